"""A foreign record: its truth, and its folder in the project's format."""

import dataclasses
import pathlib
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from benchmarks.foreign.clock import (
    FFR_SD,
    FLOW_SHARE,
    NOISE_MMHG,
    OFFSET_MMHG,
    Acquisition,
    Seen,
    noise_like,
)
from benchmarks.foreign.form import EffectForm
from benchmarks.foreign.members import Solver
from benchmarks.foreign.patient import PRIOR_SD_LOG, STATED_SD, ForeignPatient
from benchmarks.foreign.waves import BeatPlan


class Scene(NamedTuple):
    """What a record was made of.

    Attributes:
        patient: true parameters.
        form: the effect.
        plans: beats of each condition.
        acquisition: how it was recorded.
        solver: the generator's solver.
    """

    patient: ForeignPatient
    form: EffectForm
    plans: Mapping[str, BeatPlan]
    acquisition: Acquisition
    solver: Solver


@dataclasses.dataclass(frozen=True)
class ForeignRecord:
    """A measured record whose truth is known.

    Attributes:
        id: its name.
        truth: `truth` ("none", an effect's id, "outside:KIND"), `form`, `size`, `place`,
            `generator`, `lambda` (see `visibility`), `background` (what the base model lacks even
            without the effect), and `traces`: of each condition the sample times and, with and
            without the effect, noise-free pressures [mmHg], mean flow [mL/min] and ffr.
        files: text of the files by name.
        scene: what it was made of.
    """

    id: str
    truth: dict[str, Any]
    files: dict[str, str]
    scene: Scene

    def write(self, folder: pathlib.Path) -> None:
        """Write `record.toml` and the traces into a folder, which is made."""
        folder.mkdir(parents=True, exist_ok=True)
        for name, text in self.files.items():
            (folder / name).write_text(text, encoding="utf-8")

    @property
    def label(self) -> dict[str, Any]:
        """The truth without the traces."""
        return {key: value for key, value in self.truth.items() if key != "traces"}


def written(
    name: str,
    patient: ForeignPatient,
    seen: dict[str, Seen],
    acquisition: Acquisition,
    stated_shift: float,
    rng: np.random.Generator,
) -> dict[str, str]:
    """The files of a record, with noise, as a catheter laboratory would hand them over.

    Args:
        name: id of the record.
        patient: true parameters.
        seen: noise-free data of each condition.
        acquisition: how it was recorded.
        stated_shift: what is added to the stated pressures [mmHg].
        rng: source of the noise.
    """
    prior = patient.R0 * np.exp(PRIOR_SD_LOG["R0"] * rng.normal())
    lines = ["[patient]", f'id = "{name}"', *_noise_table(acquisition, patient, rng)]
    lines += ["", "[surrogate]", f"R0_mmHg_s_per_ml = {{ value = {prior:.5g}, sd_log = 0.15 }}"]
    files: dict[str, str] = {}
    means = bool(rng.random() < 0.5)
    for c in patient.conditions:
        times, one = acquisition.times[c.name], seen[c.name]
        offset = OFFSET_MMHG * rng.normal(size=2)
        P_aorta = one.P_aorta + offset[0] + noise_like(times, acquisition.correlation, rng)
        P_distal = one.P_distal + offset[1] + noise_like(times, acquisition.correlation, rng)
        stated = stated_shift + STATED_SD * np.clip(rng.normal(size=2), -2.0, 2.0)
        # monitors show whole beats a minute where the beats are irregular
        period = c.period if acquisition.aligned else 60.0 / round(60.0 / c.period)
        flow = one.mean_flow * max(1.0 + FLOW_SHARE * rng.normal(), 0.2)
        ffr = one.ffr * (1.0 + (offset[1] - offset[0]) / P_aorta.mean()) + FFR_SD * rng.normal()
        lines += [
            "", f"[condition.{c.name}]", f'drug = "{c.drug}"', f"order = {c.order}",
            f"held_out = {str(c.held_out).lower()}", f"period_s = {period:.6f}",
            f"P_systolic_mmHg = {c.P_systolic + stated[0]:.1f}",
            f"P_diastolic_mmHg = {c.P_diastolic + stated[1]:.1f}",
        ]  # fmt: skip
        if means:
            lines.append(f"mean_P_aorta_mmHg = {P_aorta.mean():.1f}")
            lines.append(f"mean_P_distal_mmHg = {P_distal.mean():.1f}")
        lines += [f"ffr = {ffr:.3f}", f"mean_flow_ml_per_min = {flow:.2f}"]
        lines.append(f'waveform = "{c.name}.csv"')
        clock = times + acquisition.shown[c.name]
        files[f"{c.name}.csv"] = _csv(clock, P_aorta, P_distal)
    return {**files, "record.toml": "\n".join(lines) + "\n"}


def _noise_table(
    acquisition: Acquisition, patient: ForeignPatient, rng: np.random.Generator
) -> list[str]:
    """What is known of the noise; that of the mean beat only where beats are equal."""
    lines = ["", "[noise]", f"flow_relative_sd = {FLOW_SHARE}", f"ffr_sd = {FFR_SD}"]
    if rng.random() < 0.5:
        lines.append(f"pressure_offset_sd_mmHg = {OFFSET_MMHG}")
    first = patient.conditions[0]
    times = acquisition.times[first.name]
    beats = round((times[-1] - times[0]) / first.period)
    if acquisition.aligned and (beats < 3 or rng.random() < 0.5):
        lines.append(f"pressure_sd_mmHg = {NOISE_MMHG / np.sqrt(beats):.4g}")
    return lines


def _csv(times: np.ndarray, P_aorta: np.ndarray, P_distal: np.ndarray) -> str:
    rows = [f"{t:.6f},{a:.3f},{d:.3f}" for t, a, d in zip(times, P_aorta, P_distal, strict=True)]
    return "\n".join(["time_s,P_aorta_mmHg,P_distal_mmHg", *rows]) + "\n"
