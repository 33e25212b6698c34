"""One process at a time in a folder: locks of the system, and the file that stands for one."""

import errno
import os
import pathlib
import platform
import subprocess
import sys

import pytest

from study.case.faults import CaseError
from study.store.folder_lock import HOLDER_FILE, LOCK_FILE, at_work

fcntl = pytest.importorskip("fcntl", reason="this system has no such locks")


def test_one_at_a_time_in_a_folder(tmp_path):
    with at_work(tmp_path / "out"):
        with pytest.raises(CaseError, match="another jaxfsi"), at_work(tmp_path / "out"):
            pass
        with at_work(tmp_path / "other"):
            pass
    with at_work(tmp_path / "out"):
        pass


def test_lock_goes_with_an_error(tmp_path):
    with pytest.raises(RuntimeError, match="stop"), at_work(tmp_path):
        raise RuntimeError("stop")
    with at_work(tmp_path):
        pass


def test_folder_made_for_nothing_is_removed_and_a_filled_one_stays(tmp_path):
    with at_work(tmp_path / "a/b"):
        pass
    assert not (tmp_path / "a").exists()
    with at_work(tmp_path / "a/b"):
        (tmp_path / "a/b/result.json").write_text("{}")
    assert (tmp_path / "a/b/result.json").exists()


@pytest.mark.parametrize("kind", ["link", "dangling", "folder", "fifo"])
def test_what_is_no_file_of_ours_is_refused_and_left_as_it_is(tmp_path, kind):
    place, precious = tmp_path / "out", tmp_path / "precious"
    place.mkdir()
    precious.write_text("years of work")
    match kind:
        case "link":
            (place / LOCK_FILE).symlink_to(precious)
        case "dangling":
            (place / LOCK_FILE).symlink_to(tmp_path / "elsewhere")
        case "folder":
            (place / LOCK_FILE).mkdir()
        case "fifo":
            os.mkfifo(place / LOCK_FILE)
    with pytest.raises(CaseError, match="where jaxfsi keeps the lock") as refusal, at_work(place):
        pass
    assert str(refusal.value).count("\n") == 2  # head, problem, cure
    assert precious.read_text() == "years of work"
    assert not (tmp_path / "elsewhere").exists()


def test_file_of_the_locks_name_keeps_its_content(tmp_path):
    (tmp_path / LOCK_FILE).write_text("a note")
    with at_work(tmp_path):
        pass
    assert (tmp_path / LOCK_FILE).read_text() == "a note"


def _failing(monkeypatch, *errors):
    """Let `flock` fail so many times before it is the system's again."""
    waiting, flock = list(errors), fcntl.flock

    def fail(handle, how):
        if waiting:
            raise OSError(waiting[0], os.strerror(waiting.pop(0)))
        return flock(handle, how)

    monkeypatch.setattr(fcntl, "flock", fail)


def test_failing_disk_is_no_other_process(tmp_path, monkeypatch):
    _failing(monkeypatch, errno.EIO)
    with pytest.raises(CaseError, match="Input/output error") as refusal, at_work(tmp_path):
        pass
    assert "another jaxfsi" not in str(refusal.value)


def test_interrupted_call_is_made_again(tmp_path, monkeypatch):
    _failing(monkeypatch, errno.EINTR, errno.EINTR)
    with at_work(tmp_path):
        monkeypatch.undo()
        with pytest.raises(CaseError, match="another jaxfsi"), at_work(tmp_path):
            pass


@pytest.mark.parametrize("error", [errno.ENOLCK, errno.ENOTSUP, errno.ENOSYS])
def test_file_stands_for_a_lock_where_there_are_none(tmp_path, monkeypatch, error):
    _failing(monkeypatch, error, error, error)
    told: list[str] = []
    with at_work(tmp_path / "out", told.append):
        assert os.strerror(error) in told[0]
        assert HOLDER_FILE in told[0]
        busy = rf"another jaxfsi is at work .*process {os.getpid()} on "
        with pytest.raises(CaseError, match=busy), at_work(tmp_path / "out"):
            pass
        assert (tmp_path / "out" / HOLDER_FILE).exists()
    assert not (tmp_path / "out").exists()
    with at_work(tmp_path / "out"):
        (tmp_path / "out/result.json").touch()
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["result.json"]


def _holder(process=None, host=None, begun=1) -> str:
    """As the library puts it down: process, host and when the process began."""
    return f"{process or os.getpid()}\n{host or platform.node()}\n{begun}\n"


def _ended_process() -> int:
    child = subprocess.Popen([sys.executable, "-c", ""])
    child.wait()
    return child.pid


@pytest.mark.parametrize("stale", ["ended", "number given again"])
def test_file_that_a_killed_process_left_is_replaced(tmp_path, monkeypatch, stale):
    if stale != "ended" and not pathlib.Path("/proc/self/stat").exists():
        pytest.skip("this system does not tell when a process began")
    left = _holder(process=_ended_process()) if stale == "ended" else _holder()
    (tmp_path / HOLDER_FILE).write_text(left)
    _failing(monkeypatch, errno.ENOLCK)
    with at_work(tmp_path):
        assert (tmp_path / HOLDER_FILE).read_text().split()[0] == str(os.getpid())
    assert not (tmp_path / HOLDER_FILE).exists()


@pytest.mark.parametrize(
    "left", [_holder(host="elsewhere"), "", "[1]", "{"], ids=["elsewhere", "empty", "list", "cut"]
)
def test_file_that_cannot_be_judged_from_here_is_respected(tmp_path, monkeypatch, left):
    (tmp_path / HOLDER_FILE).write_text(left)
    _failing(monkeypatch, errno.ENOLCK)
    with (
        pytest.raises(CaseError, match=f"if it has ended, remove .*{HOLDER_FILE}"),
        at_work(tmp_path),
    ):
        pass
    assert (tmp_path / HOLDER_FILE).read_text() == left


_LOCK_AND_REPORT = """
import pathlib, sys, time
from study.case.faults import CaseError
from study.store.folder_lock import at_work
try:
    with at_work(pathlib.Path(sys.argv[1])):
        print("in", flush=True)
        sys.stdin.read()
except CaseError:
    print("refused", flush=True)
"""


def test_killed_process_leaves_no_lock(tmp_path):
    def begun():
        return subprocess.Popen(
            [sys.executable, "-c", _LOCK_AND_REPORT, tmp_path],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip

    with begun() as first, begun() as second:
        assert first.stdout is not None
        assert second.stdout is not None
        said = {first.stdout.readline(), second.stdout.readline()}
        assert said == {"in\n", "refused\n"}
        first.kill()
        second.kill()
    with at_work(tmp_path):
        pass
