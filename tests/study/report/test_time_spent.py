"""Where the time of a command went."""

import io

import pytest

from study.report.page import rendered
from study.report.time_spent import LONGEST, time_parts
from study.run.progress import Progress


def test_longest_steps_stand_in_their_order_and_the_rest_is_summed():
    seconds = {f"step {k}": float(k % 5 + 1) for k in range(10)}
    parts = time_parts(seconds)
    assert len(parts) == LONGEST + 1
    own = [part.name for part in parts[:-1]]
    assert own == sorted(own, key=list(seconds).index)
    assert sum(part.seconds for part in parts) == pytest.approx(sum(seconds.values()))
    assert sum(part.percent for part in parts) == pytest.approx(100.0)
    assert min(part.seconds for part in parts[:-1]) >= max(
        taken for name, taken in seconds.items() if name not in own
    )


def test_few_steps_need_no_rest_and_none_make_no_bar():
    assert [part.name for part in time_parts({"a": 1.0, "b": 3.0})] == ["a", "b"]
    assert time_parts({}) == [] == time_parts({"a": 0.0})


def test_progress_adds_up_steps_of_one_name_up_to_now(tmp_path):
    now = [0.0]
    progress = Progress(stream=io.StringIO(), clock=lambda: now[0], memory=tmp_path / "m.json")
    assert progress.spent() == {}
    for name, seconds in (("mesh", 2.0), ("run", 5.0), ("mesh", 1.0)):
        progress.step(name)
        now[0] += seconds
    assert progress.spent() == {"mesh": 3.0, "run": 5.0}
    now[0] += 4.0
    assert progress.spent() == {"mesh": 7.0, "run": 5.0}


@pytest.mark.parametrize("times", [None, {"calibrating <b>": 30.0, "writing": 90.0}])
def test_page_shows_the_bar_where_times_are_known(times):
    provenance = {
        "command": ["jaxfsi", "run"],
        "date": "today",
        "platform": "here",
        "versions": {},
        "commit": None,
        "inputs": [],
    }
    if times is not None:
        provenance["seconds"] = times
    page = rendered("provenance.html", d={"provenance": provenance})
    assert ("120 s" in page) == (times is not None)
    assert ("calibrating &lt;b&gt; 30 s" in page) == (times is not None)
