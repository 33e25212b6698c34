"""The surrogate of a patient: aorta, anomalous coronary as one vessel, coronary bed.

    P_aorta(t) ── R0 (+ K|Q|) ──┬── five-element coronary block
                               C0
                               ⏚

R0 and C0 stand for the 3D part. Theorem (linear surrogate): over a period no capacitance has a net
flow, so that with R_total = R_1 + R_2 + R_3 after scaling by α

    mean P_distal − P_venous = (mean P_aorta − P_venous) α R_total / (R0 + α R_total),

whatever the waveform and the capacitances. With K the divider no longer holds.

Source: Puelz et al. 2024, section 2.4 and figure 4.
"""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from lumped.blocks import Coronary
from lumped.network import Network, connect
from lumped.nominal import C0_NOMINAL, NOMINAL
from lumped.parameters import (
    Parameter,
    Range,
    check_range,
    nan_unless,
    numbers_in_range,
    optional_parameter,
    parameter,
    real,
)
from lumped.sources import PressureSource
from lumped.stress import StressRule, scale_resistances
from lumped.units import MMHG
from lumped.vessels import Vessel
from lumped.waveforms import AbstractWaveform, AorticPressure, Stretched, VentricularPressure


class HaemodynamicCondition(eqx.Module):
    """A haemodynamic condition of a patient.

    Attributes:
        P_systolic: systolic aortic pressure [dyn/cm²].
        P_diastolic: diastolic aortic pressure [dyn/cm²].
        period: length of the cardiac cycle [s].
        waveform: a measured beat of aortic pressure [dyn/cm²] to use instead of `AorticPressure`;
            the ventricle then still takes its peak from P_systolic.
    """

    P_systolic: Parameter = parameter()
    P_diastolic: Parameter = parameter()
    period: Parameter = parameter()
    waveform: AbstractWaveform | None = None

    ranges: ClassVar[Range] = Range(above=("P_systolic", "P_diastolic", "period"))

    def __check_init__(self):
        check_range(self)

    def moved(
        self,
        *,
        P_systolic: Parameter | None = None,
        P_diastolic: Parameter | None = None,
        period: Parameter | None = None,
    ) -> "HaemodynamicCondition":
        """The condition with other pressures or another cycle length; a measured beat goes along.

        The beat is stretched in time, and in pressure about the diastolic one::

            P'(t) = P_d' + (P(t T/T') − P_d) (P_s' − P_d') / (P_s − P_d)

        Args:
            P_systolic: None: as it is.
            P_diastolic: likewise.
            period: likewise.
        """
        P_s = self.P_systolic if P_systolic is None else P_systolic
        P_d = self.P_diastolic if P_diastolic is None else P_diastolic
        T = self.period if period is None else period
        beat = self.waveform
        if beat is not None:
            pulse = self.P_systolic - self.P_diastolic
            steady = pulse == 0.0  # then there is nothing to stretch the beat by
            gain = jnp.where(steady, 1.0, (P_s - P_d) / jnp.where(steady, 1.0, pulse))
            beat = Stretched(beat, T / self.period, gain, P_d - gain * self.P_diastolic)
        return HaemodynamicCondition(P_s, P_d, T, waveform=beat)


def condition_from_clinic(
    P_systolic_mmHg: Parameter, P_diastolic_mmHg: Parameter, period_s: Parameter
) -> HaemodynamicCondition:
    """A condition from pressures in mmHg and the cycle length in s."""
    return HaemodynamicCondition(
        real(P_systolic_mmHg) * MMHG, real(P_diastolic_mmHg) * MMHG, period_s
    )


class Surrogate(eqx.Module):
    """Parameters of the surrogate at rest; networks are made from it for any condition.

    Attributes:
        R0: resistance of the anomalous coronary [dyn·s/cm⁵], zero or positive.
        alpha: scale of the resistances of the coronary bed [-].
        coronary: the coronary bed at α = 1 and at rest; its P_im is replaced by the ventricular
            pressure of the condition.
        C0: compliance of the anomalous coronary [cm⁵/dyn].
        K: quadratic loss of the anomalous coronary [dyn·s²/cm⁸], or None for the linear surrogate.
    """

    R0: Parameter = parameter()
    alpha: Parameter = parameter(default=1.0)
    coronary: Coronary = eqx.field(default_factory=lambda: nominal_coronary())
    C0: Parameter = parameter(default=C0_NOMINAL)
    K: Parameter | None = optional_parameter()

    ranges: ClassVar[Range] = Range(above=("alpha", "C0"), least=("R0", "K"))

    def __check_init__(self):
        check_range(self)

    def network(
        self,
        condition: HaemodynamicCondition,
        *,
        rule: StressRule | None = None,
        inlet: AbstractWaveform | None = None,
    ) -> Network:
        """The network in a condition.

        Elements: "inlet", "ostium" (vessel), "coronary"; nodes: "aorta", "distal".

        Args:
            condition: pressures and cycle length.
            rule: stress rule applied to the coronary bed, None at rest.
            inlet: aortic pressure; by default the waveform of the condition, else `AorticPressure`.
        """
        bed = scale_resistances(self.coronary, self.alpha)
        if rule is not None:
            bed = rule(bed)
        ventricle = VentricularPressure(condition.P_systolic, condition.period)
        bed = eqx.tree_at(lambda b: b.P_im, bed, ventricle)
        inlet = condition.waveform if inlet is None else inlet
        if inlet is None:
            inlet = AorticPressure(condition.P_systolic, condition.P_diastolic, condition.period)
        ostium = Vessel(R_viscous=self.R0, C=self.C0, K_stenosis=self.K)
        return connect(
            {
                "inlet": (PressureSource(inlet), "aorta"),
                "ostium": (ostium, "aorta", "distal"),
                "coronary": (bed, "distal"),
            }
        )


def nominal_coronary(
    *, P_venous: Parameter = 0.0, im_factor: Parameter = 1.0, **changes: Parameter
) -> Coronary:
    """The coronary bed of the paper, with any of its five parameters changed.

    Args:
        P_venous: pressure behind R_3 [dyn/cm²].
        im_factor: share of the ventricular pressure that squeezes C_im [-].
        **changes: values for R_1, R_2, R_3, C_a or C_im.
    """
    unknown = set(changes) - set(NOMINAL)
    if unknown:
        raise ValueError(f"No parameter {sorted(unknown)}; a coronary bed has {list(NOMINAL)}.")
    beating = VentricularPressure(100.0 * MMHG, 1.0)
    values = {**NOMINAL, **changes}
    return Coronary(**values, P_im=beating, P_venous=P_venous, im_factor=im_factor)


def ffr_divider(
    R0: Parameter, R_total: Parameter, mean_P_aorta: Parameter = 1.0, P_venous: Parameter = 0.0
) -> Float[Array, "..."]:
    """FFR of the linear surrogate in closed form; R_total includes α and the stress rule.

    Args:
        R0: resistance of the anomalous coronary [dyn·s/cm⁵].
        R_total: total resistance of the coronary bed [dyn·s/cm⁵].
        mean_P_aorta: mean aortic pressure [dyn/cm²]; matters only with a venous pressure.
        P_venous: venous pressure [dyn/cm²].

    Returns:
        The ratio; NaN where a traced argument lies outside its range.

    Raises:
        ValueError: R0 is negative, R_total or the aortic pressure not positive.
    """
    usable = numbers_in_range(
        above={"R_total [dyn·s/cm⁵]": R_total, "mean_P_aorta [dyn/cm²]": mean_P_aorta},
        least={"R0 [dyn·s/cm⁵]": R0},
        finite={"P_venous [dyn/cm²]": P_venous},
    )
    share = R_total / (R0 + R_total)
    return (P_venous + (mean_P_aorta - P_venous) * share) / mean_P_aorta * nan_unless(usable)
