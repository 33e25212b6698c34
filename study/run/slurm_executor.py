"""Cases as jobs of SLURM, one job a case, by submitit.

A job pickles nothing but the command of its case and gives back its exit status, through the folder
`.slurm` of the cohort, where its log lies too. Ninety seconds before its time limit SLURM tells the
job, which ends its case in order and is lost; the cohort submits the case again, and it goes on. So
it does when a node fails. The state of jobs is read with one `squeue` for all of them.
"""

import getpass
import pathlib
import shutil
import subprocess
import threading
import time
from collections.abc import Callable
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from typing import Any

import submitit

from study.run.case_call import INTERRUPTED, CaseStopped
from study.run.executor_choice import SLURM_OPTIONS, ExecutorChoice, slurm_minutes
from study.run.executors import ExecutorRefused

_FOLDER = ".slurm"
_AT_ONCE = 200  # jobs in the queue, each of which a thread waits for
_MINUTES = 240  # of a job where nothing is said
_LOOK_SECONDS = 1.0
_ASK_SECONDS = 10.0  # between two questions to SLURM
_SETTLE_SECONDS = 15.0  # in which the result of a job that has ended reaches a shared file system
_CANCELLED = "CANCELLED"
_ENDED = (
    "", "BOOT_FAIL", "COMPLETED", "DEADLINE", "FAILED", "NODE_FAIL", "OUT_OF_MEMORY", "PREEMPTED",
    "REVOKED", "TIMEOUT", _CANCELLED,
)  # fmt: skip


def opened(
    choice: ExecutorChoice, workers: int | None, cases: int, folder: pathlib.Path
) -> Executor:
    """Jobs of SLURM; see `study.run.executors.opened_executor`.

    Args:
        choice: with options of the jobs.
        workers: jobs in the queue at a time; None: all, up to a few hundred.
        cases: number of cases.
        folder: of the cohort; nodes must reach it under the same name.

    Raises:
        ExecutorRefused: there is no SLURM here.
    """
    missing = [name for name in ("sbatch", "srun", "squeue") if shutil.which(name) is None]
    if missing:
        raise ExecutorRefused(
            f"there is no SLURM here: no {missing[0]} is found\n"
            "    try: a login node of the cluster, or --executor local"
        )
    return SlurmJobs(folder.absolute() / _FOLDER, choice, workers or min(cases, _AT_ONCE))


class SlurmJobs(Executor):
    """Jobs of SLURM."""

    def __init__(self, folder: pathlib.Path, choice: ExecutorChoice, at_once: int):
        """Nothing is submitted yet.

        Args:
            folder: what submitit keeps.
            choice: with options of the jobs.
            at_once: jobs in the queue at a time.
        """
        options = dict(choice.slurm)
        minutes = slurm_minutes(options.pop("time")) if "time" in options else _MINUTES
        self._jobs = submitit.SlurmExecutor(folder, max_num_timeout=0)
        self._jobs.update_parameters(
            job_name="jaxfsi",
            time=minutes,
            additional_parameters={SLURM_OPTIONS[name]: options[name] for name in options},
        )
        self._pool = ThreadPoolExecutor(max(1, at_once))
        self._lock, self._closed = threading.Lock(), False
        self._states: dict[str, str] | None = None
        self._asked = time.monotonic() - _ASK_SECONDS

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Run a case; see `Executor.submit`.

        Args:
            fn: a `CaseCall`.
            args: none.
            kwargs: none.
        """
        return self._pool.submit(self._run, fn)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End; see `Executor.shutdown`.

        Args:
            wait: whether to wait for the jobs.
            cancel_futures: whether jobs are cancelled.
        """
        self._closed = self._closed or cancel_futures
        self._pool.shutdown(wait=wait, cancel_futures=cancel_futures)

    def _run(self, call: Callable[..., int]) -> int:
        with self._lock:
            if self._closed:
                return INTERRUPTED
            job = self._jobs.submit(call)
        gone, submitted = 0.0, time.monotonic()
        while not job.paths.result_pickle.exists():
            if self._closed:
                job.cancel(check=False)
                return INTERRUPTED
            state = self._state(job.job_id, submitted)
            if state == _CANCELLED:
                raise CaseStopped(f"job {job.job_id} was cancelled")
            gone = gone + _LOOK_SECONDS if state in _ENDED else 0.0
            if gone > _SETTLE_SECONDS:
                raise RuntimeError(f"job {job.job_id} is gone: {state or 'unknown to SLURM'}")
            time.sleep(_LOOK_SECONDS)
        return self._status(job)

    def _status(self, job: submitit.Job[int]) -> int:
        """Exit status of the case of a job; one that was interrupted may have been cancelled."""
        status, until = job.result(), time.monotonic() + _SETTLE_SECONDS
        while status == INTERRUPTED and time.monotonic() < until and not self._closed:
            state = self._state(job.job_id, time.monotonic())
            if state == _CANCELLED:
                raise CaseStopped(f"job {job.job_id} was cancelled")
            if state in _ENDED:
                break
            time.sleep(_LOOK_SECONDS)
        return status

    def _state(self, job: str, since: float) -> str | None:
        """State of a job, empty where SLURM knows none of it; None: not known since then."""
        with self._lock:
            now = time.monotonic()
            if now - self._asked > _ASK_SECONDS:
                self._asked, self._states = now, _states()
            if self._asked <= since or self._states is None:
                return None
            return self._states.get(job, "")


def _states() -> dict[str, str] | None:
    """States of the user's jobs by their numbers; None where SLURM does not answer."""
    command = ["squeue", "-h", "-t", "all", "-u", getpass.getuser(), "-o", "%A %T"]
    try:
        said = subprocess.run(command, capture_output=True, text=True, timeout=60.0, check=True)
    except (OSError, subprocess.SubprocessError):
        return None
    return {line.split()[0]: line.split()[1] for line in said.stdout.splitlines() if " " in line}
