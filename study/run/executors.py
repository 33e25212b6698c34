"""Where the cases of a cohort run: each place is a `concurrent.futures.Executor` of case calls.

An executor here runs `study.run.case_call.CaseCall` on a machine that shares the folders of the
cohort. `shutdown(cancel_futures=True)` ends what is at work, in order; it can be resumed. Any other
executor whose workers share the folders will do as well.
"""

import contextlib
import importlib
import pathlib
import queue
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from typing import Any, cast

from study.run.case_call import INTERRUPTED, CaseCall, CaseProcess, Wish, cores
from study.run.executor_choice import ExecutorChoice


class ExecutorRefused(ValueError):
    """There is nothing at the place where cases were to run; nothing was computed."""


@contextlib.contextmanager
def at_work_on(executor: Executor) -> Iterator[Executor]:
    """Use an executor; whatever ends the block early ends what is at work.

    Args:
        executor: shut down at the end.
    """
    try:
        yield executor
    except BaseException:
        executor.shutdown(cancel_futures=True)
        raise
    executor.shutdown()


def load_engine(choice: ExecutorChoice) -> None:
    """Import what an executor needs, before any log is open: submitit closes those that are.

    Args:
        choice: kind of the executor.
    """
    if choice.kind != "local":
        importlib.import_module(f"study.run.{choice.kind}_executor")


def opened_executor(
    choice: ExecutorChoice, workers: int | None, cases: int, folder: pathlib.Path
) -> Executor:
    """The executor that was chosen.

    Args:
        choice: its kind and options.
        workers: cases at a time; None: one a core, on SLURM all of them.
        cases: number of cases.
        folder: of the cohort, for what an engine keeps.

    Raises:
        ExecutorRefused: an engine is not installed, or cannot be reached.
    """
    if choice.kind == "local":
        return LocalProcesses(workers)
    module = importlib.import_module(f"study.run.{choice.kind}_executor")
    return module.opened(choice, workers, cases, folder)


class LocalProcesses(Executor):
    """Child processes of this one, each for case after case; if several, each has a core."""

    def __init__(self, workers: int | None = None):
        """Nothing is at work yet.

        Args:
            workers: cases at a time; None: one a core.
        """
        own = cores()
        count = max(1, workers or len(own))
        self._processes = [
            CaseProcess(own[k % len(own)] if count > 1 else None) for k in range(count)
        ]
        self._free: queue.LifoQueue[CaseProcess] = queue.LifoQueue()
        for process in reversed(self._processes):
            self._free.put(process)
        self._pool = ThreadPoolExecutor(count)
        self._wish = Wish.RUN

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Run a case; see `Executor.submit`.

        Args:
            fn: a `CaseCall`.
            args: none.
            kwargs: none.
        """
        return self._pool.submit(self._run, cast(CaseCall, fn))

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End; a second interrupt ends at once what is at work.

        Args:
            wait: whether to wait for what is at work.
            cancel_futures: whether what is at work is ended.
        """
        if cancel_futures:
            self._wish = Wish.END
        try:
            self._pool.shutdown(wait=wait, cancel_futures=cancel_futures)
        except BaseException:
            self._wish = Wish.KILL
            raise
        if wait:
            for process in self._processes:
                process.end()

    def _run(self, call: CaseCall) -> int:
        if self._wish is not Wish.RUN:
            return INTERRUPTED
        process = self._free.get()
        try:
            return process.run(call, lambda: self._wish)
        finally:
            self._free.put(process)
