"""What a study calls after its ramp, compiled beside it in a second thread.

A program is compiled on little more than one core, and holds up the study meanwhile. What follows
the ramp is known before it but for numbers, so that the programs can be made before.
"""

import contextlib
import dataclasses
import io
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor

from jaxfsi.core.step.stepper import prepare
from jaxfsi.simulation.chunk import compile_chunk
from study.run.pipeline import run_case
from study.run.progress import Progress
from study.run.results import PlannedRun, RunId
from study.run.run_3d import setup_of
from study.run.run_context import RunContext
from study.run.simulation import CHUNK, solver_choice
from study.run.study_context import with_curve
from study.store.result_names import CURVE

MOST_TETS = 100_000
"""Tetrahedra up to which a run is prepared beside the ramp, whose memory it needs once more."""

_NOMINAL = 1e3, 1.0
"""Any curve of the surrogate will do: R0 [dyn·s/cm⁵] and K [dyn·s²/cm⁸]."""


@contextlib.contextmanager
def compiled_ahead(context: RunContext) -> Iterator[None]:
    """Compile calibration in 0D and a step at rest while the block is at work.

    At its end the block waits for what is being compiled. Whatever fails here fails again, and is
    reported, where it is called.
    """
    known = dataclasses.replace(
        with_curve(context, *_NOMINAL), progress=Progress(stream=io.StringIO())
    )
    with ThreadPoolExecutor(1, "compile-ahead") as pool:
        for task in (_calibration, _rest):
            pool.submit(_quietly, task, known)
        try:
            yield
        except BaseException:
            pool.shutdown(wait=True, cancel_futures=True)
            raise


def _quietly(task: Callable[[RunContext], None], context: RunContext) -> None:
    with contextlib.suppress(Exception):
        task(context)


def _calibration(context: RunContext) -> None:
    run_case(context.case, progress=context.progress)


def _rest(context: RunContext) -> None:
    if len(context.mesh.tets) > MOST_TETS:
        return
    setup = setup_of(context, PlannedRun(RunId(CURVE, "rest"), 1.0))
    solver = dataclasses.asdict(solver_choice(context.case.solver))
    stepper = prepare(setup.schedule.dt, setup.model, **solver)
    compile_chunk(setup.model, setup.state, stepper, CHUNK)
