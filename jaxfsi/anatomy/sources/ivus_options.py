"""What the measurements of an ultrasound pullback do not say: lengths, angles, wall thickness."""

import dataclasses

import numpy as np
from jaxtyping import Float

from jaxfsi.anatomy.sources.ct_course import OstiumEnd
from jaxfsi.anatomy.wall import thickness_from_radius


@dataclasses.dataclass(frozen=True)
class IvusOptions:
    """What the measurements do not say.

    Attributes:
        aorta_below: length of aorta upstream of the ostium along its axis [cm]; lengthened where a
            coronary would come too near its opening.
        aorta_above: length downstream of it [cm]; likewise.
        take_off_angle_deg: between the anomalous coronary and the aortic wall at the ostium.
        distal_extension: least length added beyond the distal frame [cm].
        fillet: blend radius of the edge of the ostium [cm].
        thickness_per_radius: wall thickness over local radius.
        thickness_minimum: least wall thickness [cm].
        thickness_maximum: greatest wall thickness [cm].
        ostium_end: which end of the centre line is the ostium.
        normal_length: of the stem of the normal coronary, from the aortic lumen to its cut [cm].
        measured_minimum: least wall thickness where it is measured [cm].
        measured_maximum: greatest wall thickness there [cm].
    """

    aorta_below: float = 2.0
    aorta_above: float = 2.0
    take_off_angle_deg: float = 40.0
    distal_extension: float = 0.5
    fillet: float = 0.06
    thickness_per_radius: float = 0.1
    thickness_minimum: float = 0.05
    thickness_maximum: float = 0.15
    ostium_end: OstiumEnd = "auto"
    normal_length: float = 1.0
    measured_minimum: float = 0.01
    measured_maximum: float = 0.5

    def thickness(self, radius: Float[np.ndarray, " points"]) -> Float[np.ndarray, " points"]:
        """Wall thickness [cm] of vessels of given radius [cm].

        Raises:
            ValueError: the wall is thicker than a radius.
        """
        thickness = thickness_from_radius(
            radius,
            factor=self.thickness_per_radius,
            minimum=self.thickness_minimum,
            maximum=self.thickness_maximum,
        )
        if np.any(thickness > radius):
            k = int(np.argmax(thickness - radius))
            raise ValueError(
                f"a wall of {thickness[k]:.2g} cm is thicker than the vessel's radius of"
                f" {radius[k]:.2g} cm. Lower thickness_minimum or thickness_per_radius (cm)."
            )
        return thickness
