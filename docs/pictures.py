"""The picture of the README, from a finished study: `python docs/pictures.py results`.

`jaxfsi study` (so `make demo`) writes cuts and views of its runs to `study-pictures`. Blood's speed
in the plane of the slit and the displacement of the wall are put above each other.
"""

import pathlib
import sys

from PIL import Image

TARGET = pathlib.Path(__file__).parent / "_static" / "result.png"
RUN, PARTS, WIDTH, COLOURS = "loop-dobutamine-printed", ("speed", "wall"), 1100, 128


def main(folder: pathlib.Path) -> None:
    """Join the pictures of one run.

    Args:
        folder: of the finished study.
    """
    files = [folder / "study-pictures" / f"{RUN}-{part}.png" for part in PARTS]
    missing = [str(file) for file in files if not file.is_file()]
    if missing:
        sys.exit(f"{', '.join(missing)}: not there. Run make demo, then give its folder, results.")
    images = [Image.open(file).convert("RGB") for file in files]
    images = [im.resize((WIDTH, round(im.height * WIDTH / im.width))) for im in images]
    joined = Image.new("RGB", (WIDTH, sum(im.height for im in images)), "white")
    top = 0
    for im in images:
        joined.paste(im, (0, top))
        top += im.height
    joined.quantize(COLOURS).save(TARGET, optimize=True)
    print(f"{TARGET}: {TARGET.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main(pathlib.Path(sys.argv[1]))
