"""How one coronary bed divides among the outlets of an artery: by a power of their radii.

A case has one coronary bed. Where an artery ends in several outlets, outlet i has the share

    s_i = r_i^2.6 / Σ_j r_j^2.6

of it, its resistances over s_i and its compliances times s_i, so that the outlets together are the
bed of the case. The exponent is that of coronary arteries.

Source: Changizi and Cherniak 2000 (Can J Physiol Pharmacol 78:603).
"""

from collections.abc import Iterable

import numpy as np

from jaxfsi import Mesh
from lumped import Coronary
from lumped.stress import scale_resistances, scaled

_EXPONENT = 2.6


def opening_area(mesh: Mesh, name: str) -> float:
    """Area of an opening [cm²]."""
    # on the host: it is asked for while models are traced
    corner = mesh.points[mesh.labelled(name)]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    return float(np.linalg.norm(normal, axis=1).sum() / 2.0)


def outlet_shares(mesh: Mesh, names: Iterable[str]) -> dict[str, float]:
    """Share of each outlet of one artery in its flow; they add up to 1."""
    weight = {name: opening_area(mesh, name) ** (_EXPONENT / 2.0) for name in names}
    total = sum(weight.values())
    return {name: own / total for name, own in weight.items()}


def share_of(bed: Coronary, share: float) -> Coronary:
    """The part of a bed that carries a share of its flow at the same pressures."""
    if share == 1.0:
        return bed
    return scaled(scale_resistances(bed, 1.0 / share), C_a=share, C_im=share)
