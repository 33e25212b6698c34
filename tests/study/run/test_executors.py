"""Cases by each executor: the same results, and none lost with a worker."""

import multiprocessing
import os
import pathlib
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import Executor, Future, ProcessPoolExecutor

import pytest

from study.run.cohort import MOST_AGAIN, case_call, gathered, run_cohort
from study.run.executor_choice import executor_choice, slurm_minutes
from study.run.executors import LocalProcesses, opened_executor
from study.run.members import find_members
from study.store.folder_lock import at_work
from tests.study.least_case import LEAST_CASE

_STEPS = 12
_STUB = f"""
import json, os, pathlib, sys, time
from study.cli.case_process import serve

def run(words):
    case, folder = pathlib.Path(words[1]), pathlib.Path(words[-1])
    done = folder / "done.txt"
    with open(folder / "processes.txt", "a") as file:
        file.write(f"{{os.getpid()}} {{os.getppid()}}\\n")
    print("counting", case)
    try:
        for step in range(len(done.read_bytes()) if done.exists() else 0, {_STEPS}):
            time.sleep(0.1)
            with open(done, "ab") as file:
                file.write(b".")
    except KeyboardInterrupt:
        return 130
    steps = len(done.read_bytes())
    found = {{"format": "jaxfsi 2", "kind": "run", "case": case.read_text(), "steps": steps}}
    part = folder / "part"
    part.write_text(json.dumps(found))
    part.rename(folder / "result.json")
    return 0

sys.exit(serve(run))
"""
"""Stands for the command of a case: counts twelve steps, and goes on where it was ended."""


@pytest.fixture
def members(tmp_path, monkeypatch):
    """Three cases, and a program in the place of their command."""
    for name in "abc":
        (tmp_path / "patients" / name).mkdir(parents=True)
        (tmp_path / "patients" / name / "case.toml").write_text(LEAST_CASE.format(name=name))
    (tmp_path / "counting_case.py").write_text(_STUB)
    paths = [str(tmp_path), *filter(None, [os.environ.get("PYTHONPATH")])]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(paths))
    monkeypatch.setattr("study.run.case_call.CHILD", "counting_case")
    return find_members(tmp_path / "patients", tmp_path / "out")


def _documents(results):
    assert [result.status for result in results] == [0] * len(results), results
    return [result.document for result in results]


def _wanted(members):
    return [
        {"format": "jaxfsi 2", "kind": "run", "case": m.path.read_text(), "steps": _STEPS}
        for m in members
    ]


def _processes(member):
    path = member.folder / "processes.txt"
    lines = path.read_text().splitlines() if path.exists() else []
    return [tuple(map(int, line.split())) for line in lines]


def _kill_at_random(member, times, stop, *, parent=False):
    """Kill what runs a case, now and then; gives the thread."""
    killed: set[int] = set()

    def work():
        while len(killed) < times and not stop.is_set():
            time.sleep(0.25)
            for pid, above in _processes(member)[-1:]:
                if pid not in killed:
                    killed.add(pid)
                    os.kill(above if parent else pid, signal.SIGKILL)

    thread = threading.Thread(target=work)
    thread.start()
    return thread, killed


def _with_kills(members, times, **how):
    stop, parent = threading.Event(), how.pop("parent", False)
    thread, killed = _kill_at_random(members[0], times, stop, parent=parent)
    try:
        results = run_cohort(members, "curve", **how)
    finally:
        stop.set()
        thread.join()
    return results, killed


def test_local_case_killed_three_times_goes_on(members):
    results, killed = _with_kills(members, 3, executor=LocalProcesses(2))
    assert len(killed) == 3
    assert _documents(results) == _wanted(members)
    assert len(_processes(members[0])) == 4
    assert [len(_processes(member)) for member in members[1:]] == [1, 1]


def test_process_takes_case_after_case_and_gives_the_same(members):
    results = run_cohort(members, "curve", executor=LocalProcesses(1))
    assert _documents(results) == _wanted(members)
    processes = {process for member in members for process, _ in _processes(member)}
    assert len(processes) == 1
    assert not pathlib.Path(f"/proc/{processes.pop()}").exists()
    waited = _STEPS * 0.1 * (len(members) - 1)
    assert results[-1].seconds < waited, "a case's seconds begin when it does, not when submitted"
    for member in members:  # each has its own log
        assert (member.folder / "log.txt").read_text() == f"counting {member.path}\n"


def test_process_that_was_killed_between_cases_is_followed_by_another(members):
    with LocalProcesses(1) as place:
        for member in members[:2]:
            assert place.submit(case_call(member, "curve", ())).result() == 0
            ((process, _),) = _processes(member)
            os.kill(process, signal.SIGKILL)
            while not _is_dead(process):
                time.sleep(0.05)
    assert len({_processes(member)[-1] for member in members[:2]}) == 2


def _is_dead(process):
    """Whether all threads of a killed process have gone, so that its parent can be told."""
    state = pathlib.Path(f"/proc/{process}/stat").read_text().split()[2]
    return state == "Z" and len(os.listdir(f"/proc/{process}/task")) == 1


def test_memory_of_a_process_is_not_that_of_the_one_that_began_it():
    large = bytearray(os.urandom(1_000_000)) * 400
    program = "import study.cli.case_process as p; print(p._memory())"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert 1e6 < int(done.stdout) < len(large)


@pytest.mark.parametrize("limit", ["MOST_CASES = 1", "MOST_MEMORY = 1"])
def test_process_that_has_grown_or_grown_old_is_followed_by_another(members, tmp_path, limit):
    stub = tmp_path / "counting_case.py"
    stub.write_text(f"import study.cli.case_process as p\np.{limit}\n{stub.read_text()}")
    results = run_cohort(members[:2], "curve", executor=LocalProcesses(1))
    assert _documents(results) == _wanted(members[:2])
    assert len({_processes(member)[-1] for member in members[:2]}) == 2


def test_process_that_ends_without_an_answer_has_not_finished_its_case(members, tmp_path):
    (tmp_path / "counting_case.py").write_text("import sys; sys.exit('no such thing')")
    (result,) = run_cohort(members[:1], "curve", executor=LocalProcesses(1))
    assert result.status == 1
    assert result.reason == "no such thing"


def test_case_that_is_killed_each_time_ends_with_a_sentence(members):
    results, killed = _with_kills(members[:1], 10, executor=LocalProcesses(1))
    assert len(killed) == MOST_AGAIN + 1
    assert results[0].status == -signal.SIGKILL
    lost = "submitted 4 times and lost each time: ended by signal 9."
    assert results[0].reason == f"{lost} counting {members[0].path}"
    again = run_cohort(members[:1], "curve")
    assert _documents(again) == _wanted(members[:1])


def test_any_executor_of_the_standard_library_will_do(members):
    pool = ProcessPoolExecutor(1, multiprocessing.get_context("spawn"))
    results = run_cohort(members[:2], "curve", executor=pool)
    assert _documents(results) == _wanted(members[:2])


class _Refusing(Executor):
    """Loses each case a number of times before it runs."""

    def __init__(self, times):
        self.left = times
        self.local = LocalProcesses(1)

    def submit(self, fn, /, *args, **kwargs):
        if not self.left:
            return self.local.submit(fn)
        self.left -= 1
        lost: Future[int] = Future()
        lost.set_exception(ConnectionError("the node\nis gone"))
        return lost

    def shutdown(self, wait=True, *, cancel_futures=False):
        self.local.shutdown(wait, cancel_futures=cancel_futures)


@pytest.mark.parametrize("times", [3, 4])
def test_lost_submission_is_made_again_three_times(members, times):
    (result,) = run_cohort(members[:1], "curve", executor=_Refusing(times))
    if times <= MOST_AGAIN:
        assert _documents([result]) == _wanted(members[:1])
    else:
        assert result.document is None
        assert result.reason.endswith("lost each time: ConnectionError: the node is gone.")


def test_gathering_runs_nothing(members):
    run_cohort(members[:1], "curve")
    found = gathered(members, "curve", ())
    assert found[0].document == _wanted(members)[0]
    assert [r.reason for r in found[1:]] == ["not finished."] * 2
    assert not members[1].folder.exists()


def _dask(tmp_path, workers):
    pytest.importorskip("distributed", reason="Dask is not installed")
    return opened_executor(executor_choice("dask"), workers, 3, tmp_path)


@pytest.mark.filterwarnings("default")
def test_dask_gives_the_same(members, tmp_path):
    results = run_cohort(members, "curve", executor=_dask(tmp_path, 2))
    assert _documents(results) == _wanted(members)
    # two workers, each with one process for all its cases
    assert len({process for member in members for process, _ in _processes(member)}) <= 2


@pytest.mark.filterwarnings("default")
def test_killed_dask_worker_loses_nothing(members, tmp_path):
    dask = pytest.importorskip("dask", reason="Dask is not installed")
    # as where the next worker takes longer to start than Dask waits for one by default
    with dask.config.set({"distributed.deploy.lost-worker-timeout": "1s"}):
        executor = _dask(tmp_path, 1)
        results, killed = _with_kills(members, 3, executor=executor, parent=True)
    assert len(killed) == 3
    assert _documents(results) == _wanted(members)
    workers = {parent for _, parent in _processes(members[0])}
    assert len(workers) == 4  # Dask started another one each time


@pytest.mark.filterwarnings("default")
def test_interrupted_dask_cohort_leaves_no_case_at_work(members, tmp_path):
    def stop(text, share, left):
        if _processes(members[0]):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_cohort(members[:1], "curve", executor=_dask(tmp_path, 1), tell=stop)
    ((process, _),) = _processes(members[0])
    end = time.monotonic() + 10.0
    while pathlib.Path(f"/proc/{process}").exists():
        assert time.monotonic() < end, "the case is still at work"
        time.sleep(0.1)
    assert not (members[0].folder / "result.json").exists()


def test_dask_scheduler_that_does_not_answer_is_refused(members, tmp_path, command, monkeypatch):
    pytest.importorskip("distributed", reason="Dask is not installed")
    monkeypatch.setattr("study.run.dask_executor._CONNECT_SECONDS", 0.5)
    options = ("--executor", "dask:tcp://127.0.0.1:9")
    found = command("cohort", tmp_path / "patients", *options, folder=tmp_path / "out")
    assert found.status == 2
    assert "no Dask scheduler answers at tcp://127.0.0.1:9" in found.stderr
    assert not (tmp_path / "out").exists()


_FAILING = """
import study.run.case_call
study.run.case_call.CHILD = "jaxfsi_of_nothing"
"""
_FAKES = {
    "sbatch": """
import os, pathlib, re, subprocess, sys
place = pathlib.Path(os.environ["FAKE_SLURM"])
number = str(len(list(place.glob("*.job"))) + 1)
(place / f"{number}.job").write_text(" ".join(sys.argv[1:]))
script = pathlib.Path(sys.argv[-1])
job = {"SLURM_JOB_ID": number, "SLURM_NTASKS": "1", "SLURM_JOB_NUM_NODES": "1",
    "SLURM_NODEID": "0", "SLURM_PROCID": "0", "SLURM_LOCALID": "0"}
with open(place / f"{number}.log", "wb") as log:
    process = subprocess.Popen(["bash", script], env={**os.environ, **job}, stdout=log,
        stderr=log, start_new_session=True)
(place / f"{number}.pid").write_text(str(process.pid))
print(f"Submitted batch job {number}")
""",
    "srun": """
import os, sys
at = next(k for k, word in enumerate(sys.argv) if k and not word.startswith("-")
    and sys.argv[k - 1] not in ("--output", "--error"))
os.execvp(sys.argv[at], sys.argv[at:])
""",
    "squeue": """
import os, pathlib
for path in pathlib.Path(os.environ["FAKE_SLURM"]).glob("*.pid"):
    stat = pathlib.Path(f"/proc/{path.read_text()}/stat")
    gone = not stat.exists() or stat.read_text().split()[2] == "Z"
    print(path.stem, "NODE_FAIL" if gone else "RUNNING")
""",
    "scancel": """
import os, pathlib, signal, sys
pid = (pathlib.Path(os.environ["FAKE_SLURM"]) / f"{sys.argv[-1]}.pid").read_text()
os.killpg(int(pid), signal.SIGKILL)
""",
}


@pytest.fixture
def slurm(tmp_path, monkeypatch):
    """Programs of the names of SLURM's, which run jobs at once on this machine."""
    pytest.importorskip("submitit", reason="submitit is not installed")
    place = tmp_path / "fake-slurm"
    place.mkdir()
    for name, text in _FAKES.items():
        (place / name).write_text(f"#!{sys.executable}\n{text}")
        (place / name).chmod(0o755)
    monkeypatch.setenv("FAKE_SLURM", str(place))
    monkeypatch.setenv("PATH", str(place), prepend=os.pathsep)
    for name, seconds in (("_LOOK_SECONDS", 0.1), ("_ASK_SECONDS", 0.2), ("_SETTLE_SECONDS", 0.5)):
        monkeypatch.setattr(f"study.run.slurm_executor.{name}", seconds)
    return place


def _slurm(tmp_path, text="slurm"):
    return opened_executor(executor_choice(text), None, 3, tmp_path / "out")


def test_slurm_gives_the_same_and_has_its_options(members, tmp_path, slurm):
    executor = _slurm(tmp_path, "slurm:partition=long,time=2:00:00,mem=4G,cpus=2")
    results = run_cohort(members, "curve", executor=executor)
    assert _documents(results) == _wanted(members)
    script = next((tmp_path / "out" / ".slurm").glob("*submission*.sh")).read_text()
    for line in ("partition=long", "time=120", "mem=4G", "cpus-per-task=2"):
        assert f"#SBATCH --{line}\n" in script


def test_log_of_a_cohort_on_slurm_is_kept_to_its_end(members, tmp_path, slurm):
    # in a process of its own: submitit changes logging when it is first imported
    program = "import sys; from study.cli.entry import main; sys.exit(main())"
    words = ["cohort", tmp_path / "patients", "--executor", "slurm", "--out", tmp_path / "out"]
    (tmp_path / "jaxfsi_of_nothing.py").touch()
    found = subprocess.run([sys.executable, "-c", _FAILING + program, *words], check=False)
    assert found.returncode == 1
    assert "every case failed" in (tmp_path / "out" / "run.log").read_text()


def test_killed_slurm_job_loses_nothing(members, tmp_path, slurm):
    how = {"executor": _slurm(tmp_path), "parent": True}
    results, killed = _with_kills(members[:1], 3, **how)
    assert len(killed) == 3
    assert _documents(results) == _wanted(members[:1])
    assert len(list(slurm.glob("*.job"))) == 4


def test_without_slurm_the_command_is_refused(members, tmp_path, command, monkeypatch):
    pytest.importorskip("submitit", reason="submitit is not installed")
    monkeypatch.setenv("PATH", str(tmp_path))
    found = command("cohort", tmp_path / "patients", "--executor", "slurm", folder=tmp_path / "out")
    assert found.status == 2
    assert "there is no SLURM here: no sbatch is found" in found.stderr
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(("kind", "package"), [("dask", "distributed"), ("slurm", "submitit")])
def test_missing_package_is_named(members, tmp_path, command, monkeypatch, kind, package):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    found = command("cohort", tmp_path / "patients", "--executor", kind, folder=tmp_path / "out")
    assert found.status == 2
    assert f"{kind} needs {package}; try pip install 'jaxfsi[cluster]'" in found.stderr
    assert not (tmp_path / "out").exists()


def test_folder_where_another_process_is_at_work_is_told_of(members, monkeypatch):
    monkeypatch.setattr("study.run.case_call.CHILD", "study.cli.case_process")
    with at_work(members[0].folder):
        (result,) = run_cohort(members[:1], "curve", extra=["--no-mesh"])
    assert result.status == 2
    assert "another jaxfsi is at work in this folder" in result.reason


@pytest.mark.slow
@pytest.mark.filterwarnings("default")
def test_real_cases_have_the_same_results_by_each_executor(members, tmp_path, slurm, monkeypatch):
    monkeypatch.setattr("study.run.case_call.CHILD", "study.cli.case_process")
    found = {}
    for kind in ("local", "dask", "slurm"):
        place = tmp_path / kind
        own = find_members(tmp_path / "patients", place)[:2]
        executor = opened_executor(executor_choice(kind), 2, 2, place)
        documents = _documents(run_cohort(own, "curve", extra=["--no-mesh"], executor=executor))
        found[kind] = [
            {key: part for key, part in document.items() if key != "provenance"}
            for document in documents
        ]
    assert found["dask"] == found["local"]
    assert found["slurm"] == found["local"]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("ray", "is none of local, dask"),
        ("local:2", "is none of local, dask"),
        ("slurm:", "is none of local, dask"),
        ("slurm:walltime=3", "slurm has no option 'walltime'; choose from partition, time"),
        ("slurm:partition=a b", "is not NAME=VALUE"),
        ("slurm:time=soon", "'soon' is no time"),
        ("slurm:time=0", "'0' leaves no time"),
    ],
)
def test_place_that_makes_no_sense_is_refused(text, said):
    with pytest.raises(ValueError, match=said):
        executor_choice(text)


@pytest.mark.parametrize(
    ("text", "minutes"),
    [("90", 90), ("30:30", 31), ("2:00:00", 120), ("1-12", 2160), ("1-0:30", 1470), ("0:59", 1)],
)
def test_times_are_read_as_sbatch_reads_them(text, minutes):
    assert slurm_minutes(text) == minutes
