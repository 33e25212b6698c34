"""Cases on workers of Dask: a cluster of this machine, or a scheduler that is at work elsewhere.

A case that a lost worker ran is submitted again by the cohort. Workers of this machine take one
case at a time and have a core each; those of another scheduler as it was set up. The process that a
worker begins for a case takes its later ones too, and leaves where none comes. A case whose task is
no longer wanted, since the cohort was interrupted or its process is gone, is ended in order.
"""

import contextlib
import logging
import pathlib
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future
from typing import Any

import dask.config
import distributed

from study.run.case_call import CaseCall, CaseProcess, Wish, cores
from study.run.executor_choice import ExecutorChoice
from study.run.executors import ExecutorRefused

_CONNECT_SECONDS = 15
_BARE: dict[str, Any] = {
    "memory_limit": None,  # of a worker alone, which a case is only a child of
    "dashboard_address": None,
}
_OURS = {
    "distributed.scheduler.allowed-failures": 0,  # the cohort counts itself
    "distributed.scheduler.worker-saturation": 1.0,  # no case waits at a worker that may be lost
    # a worker that was lost comes back; one that was away when this time ended never would
    "distributed.deploy.lost-worker-timeout": "365 days",
}

_FREE: list[CaseProcess] = []
"""Processes of this worker that are at no case."""


def opened(
    choice: ExecutorChoice, workers: int | None, cases: int, folder: pathlib.Path
) -> Executor:
    """Workers of Dask; see `study.run.executors.opened_executor`.

    Args:
        choice: with the address of a scheduler; empty: one is started here.
        workers: to start here; None: one a core.
        cases: number of cases.
        folder: of the cohort.

    Raises:
        ExecutorRefused: no scheduler answers at the address.
    """
    if not choice.address:
        return DaskWorkers.local(max(1, workers or len(cores())))
    try:
        client = distributed.Client(choice.address, timeout=_CONNECT_SECONDS, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        reason = " ".join(str(error).split())
        raise ExecutorRefused(
            f"no Dask scheduler answers at {choice.address}: {reason}\n"
            "    try: the address that `dask scheduler` prints, such as tcp://host:8786"
        ) from None
    return DaskWorkers(client)


class DaskWorkers(Executor):
    """Workers of a Dask cluster."""

    def __init__(
        self,
        client: distributed.Client,
        cluster: distributed.LocalCluster | None = None,
        own: Sequence[int] = (),
        settings: contextlib.ExitStack | None = None,
    ):
        """Nothing is at work yet.

        Args:
            client: of the scheduler; closed at the end.
            cluster: closed at the end as well.
            own: cores of the workers in their order, where these are numbered.
            settings: of Dask for this cluster, undone at the end.
        """
        self._client, self._cluster, self._own = client, cluster, tuple(own)
        self._settings = settings or contextlib.ExitStack()
        self._calls = client.get_executor(pure=False)

    @classmethod
    def local(cls, workers: int) -> "DaskWorkers":
        """A cluster of this machine.

        Args:
            workers: its number of workers, each a process.
        """
        own = cores()
        with contextlib.ExitStack() as settings:
            settings.enter_context(dask.config.set(_OURS))
            cluster = distributed.LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                silence_logs=logging.ERROR,
                **_BARE,
            )
            client = distributed.Client(cluster, set_as_default=False)
            kept = settings.pop_all()
        return cls(client, cluster, [own[k % len(own)] for k in range(workers)], kept)

    @property
    def cluster(self) -> distributed.LocalCluster | None:
        """The cluster that was started here."""
        return self._cluster

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Run a case; see `Executor.submit`.

        Args:
            fn: a `CaseCall`.
            args: none.
            kwargs: none.
        """
        return self._calls.submit(run_on_worker, fn, self._own)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End; see `Executor.shutdown`.

        Args:
            wait: whether to wait for what is at work.
            cancel_futures: whether what is at work is ended.
        """
        self._calls.shutdown(wait=wait and not cancel_futures)
        self._client.close()
        if self._cluster is not None:
            self._cluster.close()
        self._settings.close()


def run_on_worker(call: CaseCall, own: Sequence[int]) -> int:
    """Run a case on the worker that calls this.

    Args:
        call: the case.
        own: cores of the workers in their order; none: any core.
    """
    worker = distributed.get_worker()
    key = worker.get_current_task()
    several = len(own) > 1 and isinstance(worker.name, int)
    core = own[worker.name % len(own)] if several else None

    def wish() -> Wish:
        task = worker.state.tasks.get(key)
        return Wish.END if task is None or task.state == "cancelled" else Wish.RUN

    try:
        process = _FREE.pop()
    except IndexError:
        process = CaseProcess(core)
    try:
        return process.run(call, wish)
    finally:
        _FREE.append(process)
