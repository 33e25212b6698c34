"""Fields of a state for people to look at: wall shear, wall stress, files that ParaView opens."""

from typing import TYPE_CHECKING

from lumped.lazy_package import import_on_first_use

if TYPE_CHECKING:
    from jaxfsi.fields.frame import Grid
    from jaxfsi.fields.series import Entry, frame_name, read_series, write_series
    from jaxfsi.fields.viscous_loss import (
        ViscousLoss,
        drop_added_by_mesh,
        flow_lost_to_mesh,
        unresolved_loss,
        viscous_loss,
    )
    from jaxfsi.fields.wall_frame import WallFrame, wall_frame
    from jaxfsi.fields.wall_shear import (
        WallPatches,
        wall_gradient,
        wall_normals,
        wall_patches,
        wall_shear,
    )
    from jaxfsi.fields.wall_stress import WallStress, wall_stress

__all__ = [
    "Entry",
    "Grid",
    "ViscousLoss",
    "WallFrame",
    "WallPatches",
    "WallStress",
    "drop_added_by_mesh",
    "flow_lost_to_mesh",
    "frame_name",
    "read_series",
    "unresolved_loss",
    "viscous_loss",
    "wall_frame",
    "wall_gradient",
    "wall_normals",
    "wall_patches",
    "wall_shear",
    "wall_stress",
    "write_series",
]

import_on_first_use(__name__)
