"""What a study calls after its ramp, prepared beside its mesh and ramp in a second thread.

A program is compiled on little more than one core, as a mesh is made, and holds up the study
meanwhile. The calibration in 0D is known before the ramp but for the numbers of its curve, and the
run at rest but for alpha: its programs and its prestress can be made before.
"""

import contextlib
import dataclasses
import io
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from study.case.model import Case
from study.run.pipeline import run_case
from study.run.progress import Progress
from study.run.results import PlannedRun, RunId
from study.run.run_3d import setup_of
from study.run.run_context import RunContext
from study.run.study_context import case_with_curve, with_curve
from study.store.result_names import CURVE

_T = TypeVar("_T")

MOST_TETS = 100_000
"""Tetrahedra up to which a run is prepared beside the ramp, whose memory it needs once more."""

_NOMINAL = 1e3, 1.0
"""Any curve of the surrogate will do: R0 [dyn·s/cm⁵] and K [dyn·s²/cm⁸]."""


@contextlib.contextmanager
def prepared_ahead(case: Case) -> Iterator[Callable[[RunContext], object]]:
    """Prepare the calibration in 0D, and the run at rest too, while the block is at work.

    At its end the block waits for what is at work, but not where it ends with an exception.
    Whatever fails here fails again, and is reported, where it is called.

    Yields:
        What is called for the run at rest once that of the ramp is prepared: the two share
        programs, which are compiled once where one follows the other.
    """
    pool = ThreadPoolExecutor(1, "prepare-ahead")
    pool.submit(_quietly, _calibration, case)
    ended = False
    try:
        yield lambda context: pool.submit(_quietly, _rest, context)
        ended = True
    finally:
        pool.shutdown(wait=ended, cancel_futures=not ended)


def _quietly(task: Callable[[_T], None], argument: _T) -> None:
    with contextlib.suppress(Exception):
        task(argument)


def _calibration(case: Case) -> None:
    run_case(case_with_curve(case, *_NOMINAL), progress=Progress(stream=io.StringIO()))


def _rest(context: RunContext) -> None:
    if len(context.mesh.tets) <= MOST_TETS:
        silent = dataclasses.replace(context, progress=Progress(stream=io.StringIO()))
        setup_of(with_curve(silent, *_NOMINAL), PlannedRun(RunId(CURVE, "rest"), 1.0))
