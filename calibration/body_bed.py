"""The bed of a coronary artery that carries a given flow.

At the mean pressure P̄ at its inlet, the total resistance R = R_1 + R_2 + R_3 and the venous
pressure P_v, a bed carries (P̄ − P_v)/R in the mean of a beat, whatever squeezes it. A bed for the
flow Q is s of it, with

    s = Q R/(P̄ − P_v),    R_i / s,    C_i · s

so that its time constants and the split of its resistance stay. The nominal bed of Puelz et al.
2024 carries 18 mL/min at 80 mmHg, a single branch's flow; per gram of myocardium its C_im then lies
at a fifth of what was measured (0.10 mL/mmHg/100 g, Chilian & Marcus 1984) whatever s is.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from calibration.outlets import share_of
from lumped import Coronary
from lumped.parameters import Parameter


def bed_flow(bed: Coronary, mean_pressure: Parameter) -> Float[Array, "..."]:
    """Mean flow of a bed [cm³/s].

    Args:
        bed: the bed.
        mean_pressure: at its inlet [dyn/cm²].
    """
    return jnp.asarray((mean_pressure - bed.P_venous) / (bed.R_1 + bed.R_2 + bed.R_3))


def bed_for_flow(bed: Coronary, flow: Parameter, mean_pressure: Parameter) -> Coronary:
    """A bed with the split and the time constants of another one that carries a given flow.

    Args:
        bed: the other one.
        flow: mean flow [cm³/s].
        mean_pressure: at its inlet [dyn/cm²], above the venous pressure.
    """
    return share_of(bed, flow / bed_flow(bed, mean_pressure))
