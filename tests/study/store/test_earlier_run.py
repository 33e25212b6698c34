"""One result never takes the place of another unseen: the other is set aside as a whole."""

import json
import os
import subprocess
import sys

import pytest

from study.cli.arguments import parse
from study.store.earlier_run import clear_run, make_way, make_way_for_page, set_aside
from study.store.folder_lock import at_work
from study.store.identity import identity
from study.store.layouts import FORMAT


def document_of(kind="run", command=("run", "case.toml"), sha="a" * 64, **parts):
    inputs = [{"file": "case.toml", "sha256": sha, "bytes": 1}]
    words = ["jaxfsi", *command]
    origin = {"inputs": inputs, "command": words, "options": parse(command).options.stored()}
    return {"format": FORMAT, "kind": kind, "provenance": origin, **parts}


def older(document):
    """The same as version 1 wrote it: with its command line alone."""
    origin = {k: v for k, v in document["provenance"].items() if k != "options"}
    return {**document, "format": "jaxfsi 1", "provenance": origin}


def stand(folder, document, **files):
    """A result in a folder: its document, and files by name (`__` for a dot, `_in_` for /)."""
    names = {"run": "result", "simulate": "simulation", "diagnose": "diagnosis"}
    kind = document["kind"]
    texts = {f"{names.get(kind, kind)}.json": json.dumps(document)}
    texts |= {n.replace("_in_", "/").replace("__", "."): text for n, text in files.items()}
    for name, text in texts.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)


def content(folder):
    return {str(p.relative_to(folder)): p.read_text() for p in folder.rglob("*") if p.is_file()}


def test_identity_is_input_and_options_and_not_where_results_go():
    one = identity(document_of())
    assert one is not None
    assert identity(document_of(command=("run", "elsewhere/case.toml", "--out", "x"))) == one
    assert identity(document_of(command=("run", "case.toml", "--json"))) == one
    assert identity(document_of(command=("run", "case.toml", "--mesh"))) != one
    assert identity(document_of("calibrate", ("calibrate", "case.toml"))) != one
    assert identity(document_of(sha="b" * 64)) != one
    sweeps = [("sweep", "c.toml", "--alpha", f"0.1:{high}:3") for high in (2, 3)]
    assert identity(document_of("sweep", sweeps[0])) != identity(document_of("sweep", sweeps[1]))


@pytest.mark.parametrize("damage", [{}, {"provenance": []}, {"provenance": {"inputs": 3}}])
def test_document_that_does_not_say_what_it_follows_from_has_no_identity(damage):
    assert identity(damage) is None
    assert identity({**document_of(), "kind": "no such kind"}) is None
    assert identity(older(document_of())) is None


def test_identity_survives_a_document(tmp_path):
    for command in (
        ("study", "c.toml", "--rules", "all", "--quick", "--ramp-rate", "60"),
        ("sweep", "c.toml", "--alpha", "0.1:10:7"),
        ("mesh", "c.toml", "--state", "all", "rest", "--format", "vtu,msh"),
        ("diagnose", "record", "--in-3d", "rest"),
    ):
        document = document_of(command[0], command)
        assert identity(json.loads(json.dumps(document))) == identity(document)


def test_result_without_stored_options_is_set_aside_and_the_reason_told(tmp_path):
    stand(tmp_path, older(document_of()), report__html="old")
    told = []
    make_way(tmp_path, document_of(), told.append)
    assert (tmp_path / "earlier-1/report.html").read_text() == "old"
    assert told == [
        "moved the earlier result of run, by a version of jaxfsi that did not store its options,"
        f" to {tmp_path / 'earlier-1'}"
    ]


def test_own_result_may_be_replaced(tmp_path):
    stand(tmp_path, document_of(), report__html="old")
    before, told = content(tmp_path), []
    make_way(tmp_path, document_of(command=("run", "case.toml", "--json")), told.append)
    assert content(tmp_path) == before
    assert told == []


@pytest.mark.parametrize(
    "new", [document_of(sha="b" * 64), document_of(command=("run", "case.toml", "--no-mesh"))]
)
def test_result_of_other_input_or_options_is_set_aside_as_a_whole(tmp_path, new):
    standing = document_of(mesh={"states": {"rest": {}}})
    files = {"report__html": "page", "rest__vtu": "mesh", "pictures_in_rest-wall__png": "picture"}
    stand(tmp_path, standing, **files)
    before, told = content(tmp_path), []
    (tmp_path / "notes.txt").write_text("of the user")
    make_way(tmp_path, new, told.append)
    assert content(tmp_path / "earlier-1") == before
    assert {path.name for path in tmp_path.iterdir()} == {"earlier-1", "notes.txt"}
    assert str(tmp_path / "earlier-1") in told[0]


ABSURD = [
    "",
    "{",
    "[]",
    '{"kind": "run"}',
    '{"mesh": {"states": 3}}',
    '{"provenance": {"inputs": [], "command": ["jaxfsi", 1e999]}}',
    f'{{"provenance": {{"inputs": [], "command": [0, {10**4000}]}}}}',
    '{"mesh": {"states": {"a\\u0000b": {}}}}',
]


@pytest.mark.parametrize("text", ABSURD)
def test_damaged_result_is_set_aside_too(tmp_path, text):
    (tmp_path / "result.json").write_text(text)
    (tmp_path / "report.html").write_text("page")
    before = content(tmp_path)
    make_way(tmp_path, document_of(), lambda _: None)
    assert content(tmp_path / "earlier-1") == before


@pytest.mark.parametrize("way", ["up", "absolute"])
def test_names_that_lead_elsewhere_are_not_moved(tmp_path, way):
    # it leads to a folder of this test: code that follows it harms nothing else
    (tmp_path / "other").mkdir()
    (tmp_path / "other/treasure.txt").write_text("of the user")
    folder = tmp_path / "results"
    folder.mkdir()
    name = "../other" if way == "up" else str(tmp_path / "other")
    command = ("cohort", "dir")
    stand(folder, document_of("cohort", command, patients=[{"name": name}]))
    make_way(folder, document_of("cohort", command, sha="b" * 64), lambda _: None)
    assert set_aside(folder, [name]) is None
    assert (tmp_path / "other/treasure.txt").read_text() == "of the user"
    assert not (folder / "earlier-1/other").exists()


def test_results_of_two_commands_stand_side_by_side_unless_their_files_meet(tmp_path):
    stand(tmp_path, document_of(mesh={"states": {"rest": {}}}), rest__vtu="coarse")
    mesh = document_of("mesh", ("mesh", "case.toml"))
    make_way(tmp_path, mesh, lambda _: None, ["mesh.html", "mesh.json", "ivus.vtu"])
    assert (tmp_path / "result.json").exists()
    make_way(tmp_path, mesh, lambda _: None, ["mesh.html", "mesh.json", "rest.vtu"])
    assert (tmp_path / "earlier-1/rest.vtu").read_text() == "coarse"
    assert not (tmp_path / "result.json").exists()


def test_runs_of_a_study_stay_and_are_set_aside_with_its_page(tmp_path):
    old = document_of("study", ("study", "case.toml"))
    run = {"runs_in_loop1-rest_in_history__csv": "rows", "runs_in_loop1-rest_in_inputs__txt": "key"}
    stand(tmp_path, old, study__html="page", stages_in_ramp__json="ramp", **run)
    before = content(tmp_path)
    new = document_of("study", ("study", "case.toml", "--dt", "0.002"))
    make_way(tmp_path, new, lambda _: None)
    assert not (tmp_path / "study.html").exists()
    assert (tmp_path / "stages/ramp.json").exists()
    clear_run(tmp_path / "runs/loop1-rest")  # what a changed input does to a run
    assert content(tmp_path / "earlier-1") == before


def test_unfinished_study_has_nothing_to_set_aside(tmp_path):
    (tmp_path / "runs").mkdir()
    (tmp_path / "runs/checkpoint.npz").touch()
    make_way(tmp_path, document_of("study", ("study", "case.toml")), lambda _: None)
    assert [path.name for path in tmp_path.iterdir()] == ["runs"]


def test_page_of_another_result_is_not_overwritten_by_show(tmp_path):
    mine, other = document_of(), document_of(sha="b" * 64)
    stand(tmp_path, other, report__html="page of the other")
    before = content(tmp_path)
    make_way_for_page(tmp_path, mine, "page", lambda _: None)
    assert content(tmp_path / "earlier-1") == before
    stand(tmp_path, mine, report__html="page")
    make_way_for_page(tmp_path, mine, "page, drawn again", lambda _: None)
    assert not (tmp_path / "earlier-2").exists()


def test_earlier_results_are_numbered_and_not_nested(tmp_path):
    for k in (1, 2, 3):
        (tmp_path / "result.json").write_text(str(k))
        assert set_aside(tmp_path, ["result.json"]) == tmp_path / f"earlier-{k}"
    (tmp_path / "case").mkdir()
    (tmp_path / "case/earlier-1").mkdir()
    (tmp_path / "case/result.json").touch()
    place = set_aside(tmp_path, ["case"], keep=["case"])
    assert place is not None
    assert [path.name for path in (place / "case").iterdir()] == ["result.json"]


_KILLED_AT_EACH_CALL = """
import json, os, pathlib, shutil, sys
from study.cli.arguments import parse
from study.store.earlier_run import set_aside

NAMES = ["report.html", "result.json", "rest.vtu", "pictures"]
root = pathlib.Path(sys.argv[1])

def filled(folder):
    (folder / "pictures").mkdir(parents=True)
    for name in (*NAMES[:3], "pictures/a.png", "pictures/b.png"):
        (folder / name).write_text(name)

def content(folder):
    return {str(p.relative_to(folder)): p.read_text() for p in folder.rglob("*") if p.is_file()}

def die_at(count):
    left = [count]
    def counted(call):
        def counting(*given, **named):
            left[0] -= 1
            if left[0] < 0:
                os._exit(9)
            return call(*given, **named)
        return counting
    for name in ("link", "replace", "mkdir", "unlink", "rmdir", "chmod"):
        setattr(os, name, counted(getattr(os, name)))

filled(root / "whole")
whole = content(root / "whole")
for count in range(200):
    folder = root / str(count)
    filled(folder)
    child = os.fork()
    if child == 0:
        die_at(count)
        set_aside(folder, NAMES)
        os._exit(0)
    ended = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    aside = folder / "earlier-1"
    if aside.exists():
        assert content(aside) == whole, count
    else:
        assert {n: t for n, t in content(folder).items() if not n.startswith(".earlier-")} == whole
    if (folder / "report.html").exists():  # a page stands: so do its files
        assert all((folder / name).exists() for name in whole), count
    set_aside(folder, NAMES)  # the next command
    assert not list(folder.glob(".earlier-*")), count
    assert content(folder / "earlier-1") == whole, count
    if ended == 0:
        break
print(count)
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system cannot fork")
def test_kill_at_any_instant_leaves_the_result_whole(tmp_path):
    done = subprocess.run(
        [sys.executable, "-c", _KILLED_AT_EACH_CALL, tmp_path], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) > 10


CASE = """\
[patient]
id = "small"
[condition.rest]
P_systolic_mmHg = 110.0
P_diastolic_mmHg = 65.0
period_s = 0.80
ffr = {ffr}
[surrogate]
R0_dyn_s_per_cm5 = 5.0e3
[solver]
n_steps = 64
"""


@pytest.mark.slow
def test_calibration_of_another_case_sets_the_first_aside(tmp_path, command):
    for ffr in (0.91, 0.93):
        (tmp_path / f"{ffr}.toml").write_text(CASE.format(ffr=ffr))
    out = tmp_path / "out"
    first = command("calibrate", tmp_path / "0.91.toml", "--json", folder=out)
    assert first.status == 0, first.stderr
    again = command("calibrate", tmp_path / "0.91.toml", folder=out)
    assert again.status == 0, again.stderr
    assert sorted(path.name for path in out.iterdir()) == ["calibration.json", "run.log"]
    other = command("calibrate", tmp_path / "0.93.toml", "--json", folder=out)
    assert f"moved the earlier result of calibrate, of other input or options, to {out}" in (
        other.stderr
    )
    assert other.json["alpha"] == json.loads((out / "calibration.json").read_text())["alpha"]
    earlier = json.loads((out / "earlier-1/calibration.json").read_text())
    assert earlier["alpha"] == first.json["alpha"] != other.json["alpha"]


@pytest.mark.parametrize(
    "name", ["run", "calibrate", "sweep", "mesh", "simulate", "study", "cohort", "diagnose", "plan"]
)
def test_no_command_writes_where_another_is_at_work(name, command, tmp_path):
    given = {
        "sweep": ("sweep", "--demo", "--alpha", "0.1:1:3"),
        "diagnose": ("diagnose", tmp_path / "record"),
        "plan": ("plan-measurement", tmp_path / "record"),
    }.get(name, (name, "--demo"))
    (tmp_path / "record").mkdir()
    (tmp_path / "record/record.toml").write_text(RECORD)
    with at_work(tmp_path / "out"):
        found = command(*given, folder=tmp_path / "out")
    assert found.status == 2, found.stderr
    assert "another jaxfsi is at work in this folder" in found.stderr
    assert not (tmp_path / "out").exists()


RECORD = """\
[patient]
id = "p"
[condition.rest]
drug = "none"
period_s = 0.8
P_systolic_mmHg = 110.0
P_diastolic_mmHg = 65.0
ffr = 0.91
"""
