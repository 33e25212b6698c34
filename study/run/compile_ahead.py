"""What a study calls after its ramp, compiled beside its mesh and ramp in a second thread.

A program is compiled on little more than one core, as a mesh is made, and holds up the study
meanwhile. The calibration in 0D is known before the ramp but for the numbers of its curve.
"""

import contextlib
import io
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

from study.case.model import Case
from study.run.pipeline import run_case
from study.run.progress import Progress
from study.run.study_context import case_with_curve

_NOMINAL = 1e3, 1.0
"""Any curve of the surrogate will do: R0 [dyn·s/cm⁵] and K [dyn·s²/cm⁸]."""


@contextlib.contextmanager
def compiled_ahead(case: Case) -> Iterator[None]:
    """Compile the calibration in 0D while the block is at work.

    At its end the block waits for what is being compiled. Whatever fails here fails again, and is
    reported, where it is called.
    """
    with ThreadPoolExecutor(1, "compile-ahead") as pool:
        pool.submit(_calibration, case)
        try:
            yield
        except BaseException:
            pool.shutdown(wait=True, cancel_futures=True)
            raise


def _calibration(case: Case) -> None:
    with contextlib.suppress(Exception):
        run_case(case_with_curve(case, *_NOMINAL), progress=Progress(stream=io.StringIO()))
