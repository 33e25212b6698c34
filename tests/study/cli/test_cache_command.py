"""The command `cache`: what is ours is counted and removed, and nothing else."""

import json
import os

import pytest

from study.cli.entry import main
from study.store.cache_contents import cache_problem, size_words
from study.store.cache_folder import VARIABLE

COMPILED = f"jit_f-{'0' * 64}-cache"
KEY = "0123456789abcdef" * 2


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A cache folder that a foreign file, folder and link lie in too."""
    folder = tmp_path / "cache"
    (folder / "meshes" / KEY).mkdir(parents=True)
    (folder / "meshes" / KEY / "mesh.npz").write_bytes(b"1234")
    (folder / "meshes" / "mine").mkdir()
    (folder / COMPILED).write_bytes(b"12")
    (folder / "durations.json").write_text("{}")
    (folder / "thesis.tex").write_text("mine")
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere/mesh.npz").write_text("mine")
    (folder / "meshes" / KEY[::-1]).symlink_to(tmp_path / "elsewhere")
    monkeypatch.setenv(VARIABLE, str(folder))
    return folder


def test_info_counts_what_is_ours(folder, capsys):
    assert main(["cache", "info", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["contents"]["meshes"] == {"files": 1, "bytes": 4}
    assert found["contents"]["compiled code"] == {"files": 1, "bytes": 2}
    assert found["contents"]["durations and digests"]["files"] == 1
    assert found["problem"] is None
    assert main(["cache", "info"]) == 0
    assert str(folder) in capsys.readouterr().out


def test_clear_asks_and_without_a_terminal_refuses(folder, capsys, monkeypatch):
    assert main(["cache", "clear"]) == 2
    assert "Give --yes" in capsys.readouterr().err
    assert (folder / COMPILED).exists()
    for answer, left in (("n\n", True), ("", True), ("y\n", False)):
        monkeypatch.setattr("sys.stdin", _Terminal(answer))
        assert main(["cache", "clear"]) == 0
        assert (folder / COMPILED).exists() == left


class _Terminal:
    def __init__(self, answer):
        self._answer = answer

    def isatty(self):
        return True

    def readline(self):
        return self._answer


def test_clear_leaves_what_is_not_ours_and_follows_no_link(folder, tmp_path, capsys):
    assert main(["cache", "clear", "--yes"]) == 0
    assert "removed 3 files" in capsys.readouterr().out
    left = sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))
    assert left == ["meshes", f"meshes/{KEY[::-1]}", "meshes/mine", "thesis.tex"]
    assert (tmp_path / "elsewhere/mesh.npz").exists()
    assert main(["cache", "clear", "--yes"]) == 0
    assert "nothing to remove" in capsys.readouterr().out


@pytest.mark.parametrize("value", ["off", "absent"])
def test_cache_that_is_off_or_not_there_is_said_and_not_made(value, tmp_path, monkeypatch, capsys):
    monkeypatch.setenv(VARIABLE, "off" if value == "off" else str(tmp_path / "absent"))
    for action in ("info", "clear"):
        assert main(["cache", action]) == 0
    assert not (tmp_path / "absent").exists()
    assert "no cache is kept" in capsys.readouterr().out or value == "absent"


def test_problem_of_a_cache_that_cannot_be_written_has_a_cure(tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    monkeypatch.setenv(VARIABLE, str(tmp_path / "file/cache"))
    problem, cure = cache_problem() or ("", "")
    assert os.strerror(20) in problem
    assert VARIABLE in cure


def test_sizes_in_words():
    assert [size_words(size) for size in (0, 2048, 3 * 2**20, 2**31)] == [
        "0 bytes", "2 KiB", "3 MiB", "2 GiB",
    ]  # fmt: skip
