"""What the documentation names is there."""

import pathlib
import re

import pytest

ROOT = pathlib.Path(__file__).parents[1]
PAGES = (
    "README.md",
    "CONTRIBUTING.md",
    "docs/architecture.md",
    "docs/extending.md",
    "docs/files.md",
    "docs/glossary.md",
    "docs/results.md",
    "docs/wall.md",
)
FOLDERS = ("lumped", "jaxfsi", "calibration", "diagnosis", "study", "tests", "benchmarks", "docs")
_PATH = re.compile(rf"(?<![\w./-])(?:{'|'.join(FOLDERS)})/[\w./-]*\w")


@pytest.mark.parametrize("page", PAGES)
def test_paths_are_there(page):
    named = set(_PATH.findall((ROOT / page).read_text(encoding="utf-8")))
    assert [name for name in sorted(named) if not (ROOT / name).exists()] == []


def test_architecture_names_every_room():
    text = (ROOT / "docs/architecture.md").read_text(encoding="utf-8")
    for package in ("study", "jaxfsi/core", "jaxfsi/anatomy", "jaxfsi/meshing"):
        for room in (ROOT / package).iterdir():
            if (room / "__init__.py").is_file() and room.name != "native":
                assert f"`{room.name}`" in text or f"/{room.name}`" in text, room
