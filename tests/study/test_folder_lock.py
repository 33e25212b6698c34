import pytest

from study.faults import CaseError
from study.folder_lock import at_work

pytest.importorskip("fcntl", reason="this system has no such locks")


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
