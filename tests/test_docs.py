"""What the documentation names is there, and the README is short and true."""

import pathlib
import re
import subprocess
import sys

import jax
import pytest

ROOT = pathlib.Path(__file__).parents[1]
WRITTEN = [ROOT / "README.md", ROOT / "CONTRIBUTING.md"]
WRITTEN += [p for p in sorted((ROOT / "docs").rglob("*.md")) if "auto" not in p.parts]
FOLDERS = ("lumped", "jaxfsi", "calibration", "diagnosis", "study", "tests", "benchmarks", "docs")
_PATH = re.compile(rf"(?<![\w./-])(?:{'|'.join(FOLDERS)})/[\w./-]*\w")
_LINK = re.compile(r"\]\(([^)#\s]+)(?:#[\w-]*)?\)")
MOST_LINES = 120
"""Of the README."""


def _name(page: pathlib.Path) -> str:
    return page.relative_to(ROOT).as_posix()


@pytest.mark.parametrize("page", WRITTEN, ids=_name)
def test_paths_are_there(page):
    text = _LINK.sub("", page.read_text(encoding="utf-8"))
    named = {name for name in _PATH.findall(text) if not name.startswith("docs/auto")}
    pages = {name for name in named if (page.parent / f"{name}.md").is_file()}  # of a toctree
    assert [name for name in sorted(named - pages) if not (ROOT / name).exists()] == []


@pytest.mark.parametrize("page", WRITTEN, ids=_name)
def test_links_lead_to_files(page):
    """Pages that the build of the site makes lie in `docs/auto`."""
    dead = []
    for target in _LINK.findall(page.read_text(encoding="utf-8")):
        if re.match(r"\w+:", target) or "auto/" in target:
            continue
        if not (page.parent / target).exists():
            dead.append(target)
    assert dead == []


@pytest.mark.parametrize("page", WRITTEN, ids=_name)
def test_links_into_the_gallery_have_a_source(page):
    sources = {"tutorials": ROOT / "docs/tutorials", "examples": ROOT / "examples"}
    found = re.findall(r"auto/(tutorials|examples)/(\w+)", page.read_text(encoding="utf-8"))
    names = {(kind, name) for kind, name in found if name != "index"}
    assert [n for kind, n in names if not (sources[kind] / f"{n}.py").is_file()] == []


def test_architecture_names_every_room():
    text = (ROOT / "docs/architecture.md").read_text(encoding="utf-8")
    for package in ("study", "jaxfsi/core", "jaxfsi/anatomy", "jaxfsi/meshing"):
        for room in (ROOT / package).iterdir():
            if (room / "__init__.py").is_file() and room.name != "native":
                assert f"`{room.name}`" in text or f"/{room.name}`" in text, room


def test_readme_is_short_and_has_two_commands():
    lines = (ROOT / "README.md").read_text(encoding="utf-8").splitlines()
    assert len(lines) <= MOST_LINES
    start = lines.index("## Set up")
    block = lines[lines.index("```sh", start) + 1 : lines.index("```", start)]
    assert [line.split("#")[0].strip() for line in block] == ["make demo", "make test"]


def test_readme_example_runs(capsys):
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    (program,) = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    assert sum(bool(line.strip()) for line in program.splitlines()) <= 12
    with jax.numpy_rank_promotion("allow"):  # the core multiplies fields by numbers of elements
        exec(compile(program, "README.md", "exec"), {})
    pressures = [float(number) for number in re.findall(r"[\d.]+", capsys.readouterr().out)]
    assert len(pressures) == 2
    assert all(1.0 < P < 8.0 for P in pressures)  # Ohm's law gives a mean of 5.7 mmHg


def test_a_picture_of_no_study_is_refused(tmp_path):
    command = [sys.executable, str(ROOT / "docs/pictures.py"), str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 1
    assert "make demo" in done.stderr
