"""Scores the diagnoses of tier 3 one by one: `python -m benchmarks.blind.score_3d DIR`.

Wanted: the right place in all and the right cause in six of eight records, no confident wrong name,
no alarm on the matched null, and a held-out gap within twice the noise. A lumen that stress narrows
counts as found by the name of either narrowing. The last column is what the cause itself moves the
held-out distal pressure of the 3D model.
"""

import argparse
import math
import pathlib
import sys

from benchmarks.blind.cases import OFFSET_SD_MMHG
from benchmarks.blind.score import Row, load, ranked, wrongly_named
from diagnosis import CATALOGUE, find_effect

ALSO = {"stress_narrowing": ("dynamic_narrowing",)}
"""Names that count as well."""


def table(rows: list[Row], floor: float) -> str:
    """Every record in a line, and what the protocol asks of tier 3.

    Args:
        rows: diagnoses with their labels.
        floor: noise of a distal trace [mmHg].
    """
    lines = [
        "| cause, size | verdict | first, its probability | place | cause | held-out gap [mmHg] "
        "| in 3D without the cause [mmHg] |",
        "|---|---|---|---|---|---|---|",
    ]
    right, places, singles, wrong, alarms, shrunk = 0, 0, 0, 0, 0, 0
    for row in rows:
        kind, sizes = row["label"]["kind"], row["label"]["sizes"]
        cause, first = next(iter(sizes), None), ranked(row)[0]
        accepted = {*sizes, *(name for size in sizes for name in ALSO.get(size, ()))}
        wrong += wrongly_named(row) and not set(row["named"]) <= accepted
        alarms += kind == "none" and row["verdict"] != "no_gap"
        shrunk += row["held_out"]["after"] <= 2.0 * floor
        hit = place = "-"
        if kind in ("single", "pair") and cause is not None:
            singles += 1
            found = find_effect(CATALOGUE, first).place == find_effect(CATALOGUE, cause).place
            same = first in (cause, *ALSO.get(cause, ()))
            places, right = places + found, right + same
            hit, place = ("yes" if ok else "no" for ok in (same, found))
        shown = "nothing" if cause is None else f"{cause}, {sizes[cause]:.3g}"
        verdict = ": ".join([row["verdict"], ", ".join(row["named"][:3])]).removesuffix(": ")
        before, after = row["held_out"]["before"], row["held_out"]["after"]
        inclusion = row["inclusion"][first]
        lines.append(
            f"| {shown} | {verdict} | {first}, {inclusion:.2f} | {place} | {hit} "
            f"| {before:.2f} to {after:.2f} | {row['label'].get('apart', math.nan):.2f} |"
        )
    lines += [
        "",
        f"right place {places}/{singles}, right cause {right}/{singles}, named wrongly "
        f"{wrong}/{len(rows)}, alarms on the null {alarms}, held-out gap within twice the noise "
        f"({2.0 * floor:.2f} mmHg) {shrunk}/{len(rows)}",
    ]
    return "\n".join(lines)


def main() -> int:
    """Print the table of a folder whose records were diagnosed."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.blind.score_3d",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--noise", type=float, default=0.5)
    parser.add_argument("--richness", default="waveforms+flow")
    options = parser.parse_args()
    rows = load(options.folder, f"{options.richness}-{options.noise:g}")
    print(table(rows, math.hypot(options.noise, OFFSET_SD_MMHG)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
