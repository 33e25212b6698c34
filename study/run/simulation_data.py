"""What a 3D run of a case starts from, and what it leaves."""

import dataclasses
from collections.abc import Sequence
from typing import Any, NamedTuple

from jaxtyping import Array, Float

from jaxfsi import Mesh
from jaxfsi.core.ports.block import BlockPort
from jaxfsi.core.ports.port import AbstractTractionPort
from jaxfsi.core.ports.pressure import PressurePort
from jaxfsi.core.step.model import Model
from jaxfsi.core.step.state import State
from jaxfsi.simulation import ShearMeans, StepHistory
from lumped import AbstractElement
from lumped.parameters import Parameter
from lumped.waveforms import AbstractWaveform


@dataclasses.dataclass(frozen=True)
class Schedule:
    """Steps of a run.

    Attributes:
        dt: length of a whole step [s]; a cycle is a whole number of them.
        n_steps: whole steps of the run.
        per_cycle: whole steps of a cycle.
        per_frame: whole steps between two frames.
        period: length of a cycle [s].
    """

    dt: float
    n_steps: int
    per_cycle: int
    per_frame: int
    period: float


@dataclasses.dataclass(frozen=True)
class Outlets:
    """What the outlets are made of.

    Attributes:
        alpha: scale of the resistances of the anomalous outlet.
        alpha_origin: where it comes from, in words.
        blocks: the block of each port but the inlet.
        starts: states of each.
    """

    alpha: Parameter
    alpha_origin: str
    blocks: dict[str, AbstractElement]
    starts: dict[str, Float[Array, " _"]]

    def ports(
        self, inlet: AbstractWaveform, names: Sequence[str]
    ) -> dict[str, AbstractTractionPort]:
        """Condition of each opening: the aortic pressure where there is no block."""
        blocks = ((name, self.blocks.get(name)) for name in names)
        return {n: PressurePort(inlet) if b is None else BlockPort(b) for n, b in blocks}

    def starts_of(self, names: Sequence[str]) -> tuple[Float[Array, " _"] | None, ...]:
        """States in the order of the ports of a model."""
        return tuple(self.starts.get(name) for name in names)


@dataclasses.dataclass(frozen=True)
class Setup:
    """A run that can begin.

    Attributes:
        mesh: the mesh that is solved on; blood alone where the wall is rigid.
        model: the model.
        state: where it starts.
        inlet: aortic pressure.
        outlets: what lies behind the outlets.
        schedule: its steps.
    """

    mesh: Mesh
    model: Model
    state: State
    inlet: AbstractWaveform
    outlets: Outlets
    schedule: Schedule


@dataclasses.dataclass(frozen=True)
class LumenCollapse:
    """Where and when a lumen collapsed.

    Attributes:
        t_s: end of the last good step.
        point_mm: middle of the element of blood with the least part of its volume, deformed.
        from_ostium_mm: its distance from the ostium along the anomalous artery; None elsewhere.
        area_share: area of the lumen across the artery there over that of the image [-]; None
            where it is not known.
        volume_share: volume of that element over that in the image [-].
    """

    t_s: float
    point_mm: list[float]
    from_ostium_mm: float | None
    area_share: float | None
    volume_share: float

    @property
    def sentence(self) -> str:
        """What happened."""
        point = ", ".join(f"{x:.1f}" for x in self.point_mm)
        place = f"at ({point}) mm"
        if self.from_ostium_mm is not None:
            place = f"{self.from_ostium_mm:.1f} mm from the ostium, {place}"
        kept = f"an element of the blood there kept {100.0 * self.volume_share:.1f} % of its volume"
        if self.area_share is not None:
            kept = f"its area there had fallen to {100.0 * self.area_share:.0f} % of the image's"
        return f"The lumen collapsed at t = {self.t_s:.4g} s, {place}: {kept}."


class Outcome(NamedTuple):
    """What a run left.

    Attributes:
        record: of all steps.
        events: what went wrong and was mended.
        resumed_from: whole step that it went on from; None for a fresh run.
        shear: wall shear stress of the last cycle; None before two looks.
        seconds: time that the run took, compiling included [s].
        failure: why it ended early by a fault of the computation; None where it did not.
        interrupted: whether the user ended it.
        state: at its end; None where it did not get there.
        pace: time of a whole step, output included and compiling left out [s]; None where too few
            were taken to tell.
        collapse: where and when the lumen collapsed, which ended the run; None where it did not.
    """

    record: StepHistory
    events: list[dict[str, Any]]
    resumed_from: int | None
    shear: ShearMeans | None
    seconds: float
    failure: str | None = None
    interrupted: bool = False
    state: State | None = None
    pace: float | None = None
    collapse: LumenCollapse | None = None
