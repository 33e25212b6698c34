"""Where the power of a ramp's flow goes, read from its frames.

All flow of a ramp passes the artery, and the aorta is wide: what the whole blood dissipates is what
the artery does.
"""

import jax
import jax.numpy as jnp
import numpy as np

from jaxfsi.core.laws.fluid import Blood
from jaxfsi.fields import read_series, unresolved_loss, viscous_loss
from jaxfsi.fields.frame_arrays import frame_arrays
from jaxfsi.mesh import Region
from lumped import MMHG
from study.run.case_model import blood_of
from study.run.fitted_ramp import RampLosses
from study.run.run_context import RunContext
from study.store.result_files import FIELD_FOLDER
from study.store.result_names import RAMP
from study.store.stages import stage_key

_STAGE = f"{RAMP}-losses"
_ARRAYS = (
    *("points", "connectivity", "region"),
    *("velocity_cm_per_s", "pressure_mmHg", "displacement_cm"),
)


def ramp_losses(context: RunContext, made: str, dt: float) -> RampLosses | None:
    """Losses at the frames of the ramp, or what was kept of them.

    Args:
        context: see `RunContext`.
        made: key of the ramp.
        dt: length of its steps [s].

    Returns:
        None where its frames are not there any more.
    """
    key = stage_key("reading", made, "losses")
    kept = context.stages.known_arrays(_STAGE, key)
    if kept is not None:
        return RampLosses(**kept.value)
    folder = context.run_folder(RAMP) / FIELD_FOLDER
    entries = [entry for entry in read_series(folder / "fields.pvd") if entry.t > 0.0]
    if not entries or not context.is_of(made, RAMP):
        return None
    blood = blood_of(context.case.blood)
    found = np.array([_losses(frame_arrays(folder / e.file, _ARRAYS), dt, blood) for e in entries])
    columns = {"t": np.array([entry.t for entry in entries])}
    columns |= dict(zip(("viscous", "defect", "unresolved"), found.T, strict=True))
    context.stages.keep_arrays(_STAGE, key, columns)
    return RampLosses(**columns)


def _losses(arrays: dict[str, np.ndarray], dt: float, blood: Blood) -> tuple[float, float, float]:
    """E, η and S of a frame [erg/s], see `jaxfsi.fields.viscous_loss`."""
    tets = arrays["connectivity"].reshape(-1, 4)[arrays["region"] == Region.FLUID].T
    place = arrays["points"].reshape(-1, 3) + arrays["displacement_cm"]
    p = np.nan_to_num(arrays["pressure_mmHg"].astype(float)) * MMHG  # inside the wall it is NaN
    x, u = (jnp.asarray(v.T, float) for v in (place, arrays["velocity_cm_per_s"]))
    E, eta = viscous_loss(u, x, jnp.asarray(tets), blood.viscosity)
    S = unresolved_loss(dt, u, jnp.asarray(p), x, jnp.asarray(tets), blood)
    totals = jax.device_get([jnp.sum(part) for part in (E, eta, S)])
    return float(totals[0]), float(totals[1]), float(totals[2])
