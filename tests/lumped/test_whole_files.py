"""Files and folders that appear complete or not at all."""

import os
import pathlib

import pytest

from lumped.whole_files import staging, write_whole


def names(folder: pathlib.Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


@pytest.mark.parametrize("shared", [False, True])
@pytest.mark.parametrize("lasting", [False, True])
def test_file_holds_what_was_given_and_nothing_lies_beside_it(tmp_path, shared, lasting):
    path = tmp_path / "x.txt"
    for content in (b"\x00\xff", "α\n"):
        write_whole(path, content, shared=shared, lasting=lasting)
        expected = content if isinstance(content, bytes) else content.encode()
        assert path.read_bytes() == expected
    assert names(tmp_path) == ["x.txt"]


@pytest.mark.parametrize("shared", [False, True])
@pytest.mark.parametrize("step", ["fsync", "replace"])
def test_failure_leaves_the_older_file_alone(tmp_path, monkeypatch, step, shared):
    path = tmp_path / "x.txt"
    path.write_text("old")

    def fail(*_):
        raise OSError("disk full")

    monkeypatch.setattr(os, step, fail)
    with pytest.raises(OSError, match="disk full"):
        write_whole(path, "new", lasting=True, shared=shared)
    assert path.read_text() == "old"
    assert names(tmp_path) == ["x.txt"]


def test_what_did_not_leave_the_staging_folder_goes_with_it(tmp_path):
    def fill(*, fail: bool) -> None:
        with staging(tmp_path) as stage:
            assert stage.parent == tmp_path
            (stage / "done").write_text("1")
            (stage / "half").write_text("1")
            if fail:
                raise RuntimeError("stop")
            os.replace(stage / "done", tmp_path / "done")

    with pytest.raises(RuntimeError, match="stop"):
        fill(fail=True)
    assert names(tmp_path) == []
    fill(fail=False)
    assert names(tmp_path) == ["done"]
