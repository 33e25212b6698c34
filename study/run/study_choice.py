"""How a study, its ramp and its runs in 3D are made."""

import dataclasses

from lumped import MMHG


@dataclasses.dataclass(frozen=True)
class RunChoice:
    """How runs are made.

    Attributes:
        dt: longest step [s]; None: as the case says.
        cycles: of a run.
        continued: whether stress goes on from the end of rest, as in the paper, instead of
            starting from its own periodic state in 0D.
    """

    dt: float | None = None
    cycles: int = 1
    continued: bool = False


@dataclasses.dataclass(frozen=True)
class RampChoice:
    """How the ramp is made; the paper's numbers.

    Attributes:
        P_image: pressure at which the wall is prestressed and the ramp starts [dyn/cm²].
        rate: of the drop [dyn/(cm²·s)].
        drop: largest drop [dyn/cm²].
    """

    P_image: float = 60.0 * MMHG
    rate: float = 37.5 * MMHG
    drop: float = 42.0 * MMHG


@dataclasses.dataclass(frozen=True)
class StudyChoice:
    """How a study is made.

    Attributes:
        run: how its 3D runs are made.
        ramp: how the ramp is made.
        rules: stress rules to run; None: that of the case.
        nominal: also run every condition with α = 1.
        paper: also run rest with the α of the linear surrogate.
        sensitivities: conditions whose calibrated run is differentiated.
        drawn: runs of each condition under stress with drawn numbers, for the interval of FFR;
            None: no interval.
        mesh_error: whether the ramp is also made on a second mesh.
    """

    run: RunChoice = dataclasses.field(default_factory=RunChoice)
    ramp: RampChoice = dataclasses.field(default_factory=RampChoice)
    rules: tuple[str, ...] | None = None
    nominal: bool = False
    paper: bool = True
    sensitivities: tuple[str, ...] = ()
    drawn: int | None = None
    mesh_error: bool = False
