"""A coronary bed of three muscle layers that replaces the single compartment of the base circuit.

    aorta ── R0, L0 ── D ── R1, L1 ── A ─┬─ R2 ── M (subendocardium) ── R3 ── Pv
                       │              │  ├─ R2 ── M (midwall)        ── R3 ── Pv
                       C0             Ca └─ R2 ── M (subepicardium)  ── R3 ── Pv
                                                  C, towards the pressure in the muscle

Layers lie in parallel and have the total resistances and compliances of the base circuit, but own
shares of flow and of volume, and own splits between arterioles and venules. The pressure in the
muscle falls from the subendocardium to the subepicardium. Resistances of a layer fall as its
vessels fill. mmHg, mL, s.

Sources: layers in parallel and resistances that depend on volume: Bruinsma et al. 1988, Spaan et
al. 1981; fall of the intramyocardial pressure across the wall: Westerhof et al. 2006; loss of the
subendocardial share under dilation: Duncker and Bache 2008.
"""

from typing import NamedTuple

import numpy as np

from benchmarks.foreign.patient import ForeignCondition, ForeignPatient, base_parameters
from benchmarks.foreign.waves import assumed_aorta, ventricle

LAYERS = 3
"""Subendocardium, midwall, subepicardium."""

ROWS = 4 + LAYERS
"""Stores of volume: two branches at D, two at A, one in each layer."""

FILL_RANGE = (0.3, 3.0)
"""Least and largest volume of a layer over its usual one."""

LayerParameters = dict[str, np.ndarray]
"""Elements of one member by name, see `layer_parameters`."""

_PHASES = np.arange(2000) / 2000


class LayeredBed(NamedTuple):
    """What the layers of a record look like, relative to the single compartment.

    Attributes:
        share_rest, share_stress: of the flow of each layer, sum 1.
        volume: share of the intramyocardial compliance of each layer, sum 1.
        squeeze: pressure in the muscle of each layer over that of the ventricle.
        arterioles: arteriolar resistance of each layer over its share of R_2.
        unstressed: pressure that would fill the volume at zero transmural pressure [mmHg].
        power: by which the resistances fall with the volume, of arterioles and of venules.
        scale: factor of the layers' resistances that keeps the mean flow.
    """

    share_rest: np.ndarray
    share_stress: np.ndarray
    volume: np.ndarray
    squeeze: np.ndarray
    arterioles: np.ndarray
    unstressed: float
    power: tuple[float, float]
    scale: float = 1.0


def single_compartment() -> LayeredBed:
    """Three equal layers with constant resistances: the base circuit itself."""
    even = np.full(LAYERS, 1.0 / LAYERS)
    one = np.ones(LAYERS)
    return LayeredBed(even, even, even, one, one, 100.0, (0.0, 0.0))


def towards(bed: LayeredBed, share: float) -> LayeredBed:
    """Layers between the single compartment (share 0) and the given ones (share 1)."""
    flat = single_compartment()

    def between(name: str) -> np.ndarray:
        first, last = np.asarray(getattr(flat, name)), np.asarray(getattr(bed, name))
        return first + share * (last - first)

    return bed._replace(
        share_rest=between("share_rest"),
        share_stress=between("share_stress"),
        volume=between("volume"),
        squeeze=between("squeeze"),
        arterioles=between("arterioles"),
        power=(share * bed.power[0], share * bed.power[1]),
    )


def draw_bed(rng: np.random.Generator) -> LayeredBed:
    """Layers of one record, drawn around those of a healthy wall."""

    def shares(*about: float) -> np.ndarray:
        values = np.array(about) * np.exp(0.06 * rng.normal(size=LAYERS))
        return values / values.sum()

    volume = shares(0.38, 0.34, 0.28)
    squeeze = np.array([rng.uniform(1.25, 1.55), 1.0, rng.uniform(0.35, 0.65)])
    squeeze = squeeze / (volume @ squeeze)
    arterioles = np.array([rng.uniform(0.65, 0.85), 1.0, rng.uniform(1.15, 1.4)])
    powers = (rng.uniform(0.5, 1.2), rng.uniform(0.4, 0.9))
    return LayeredBed(
        share_rest=shares(0.37, 0.34, 0.29),
        share_stress=shares(0.31, 0.34, 0.35),
        volume=volume,
        squeeze=squeeze,
        arterioles=arterioles,
        unstressed=float(rng.uniform(90.0, 140.0)),
        power=powers,
    )


def layer_parameters(
    patient: ForeignPatient, condition: ForeignCondition, bed: LayeredBed
) -> LayerParameters:
    """Elements of a patient in a condition without an effect.

    Args:
        patient: true parameters.
        condition: rest or stress, with its pressures.
        bed: the layers.

    Returns:
        `R0`, `R1` [mmHg·s/mL]; `R2`, `R3` of each layer; `L0`, `L1` inertances [mmHg·s²/mL];
        `Y0` conductance beside L0 [mL/(mmHg·s)]; `C` and `eta`, compliance [mL/mmHg] and wall
        resistance [mmHg·s/mL] of each store; `squeeze` and `Pv` of each layer; `usual`, the
        transmural pressure at which `R2` and `R3` hold [mmHg]; `unstressed`, `power`.
    """
    base = base_parameters(patient, condition)
    share = bed.share_stress if condition.stressed else bed.share_rest
    total = (base["R_2"] + base["R_3"]) * bed.scale / share
    R2 = base["R_2"] * bed.arterioles * bed.scale / share
    R3 = total - R2
    C = np.array([base["C_0"], 0.0, base["C_a"], 0.0, *(base["C_im"] * bed.volume)])
    mean = float(
        assumed_aorta(
            _PHASES, condition.P_systolic, condition.P_diastolic, condition.P_diastolic
        ).mean()
    )
    P_A = mean / (1.0 + (base["R_0"] + base["R_1"]) * float((1.0 / total).sum()))
    pressed = condition.P_systolic * float(ventricle(_PHASES).mean())
    return {
        "R0": np.array(base["R_0"]),
        "R1": np.array(base["R_1"]),
        "R2": R2,
        "R3": R3,
        "L0": np.array(0.0),
        "Y0": np.array(0.0),
        "L1": np.array(0.0),
        "C": C,
        "eta": np.zeros(ROWS),
        "squeeze": bed.squeeze.copy(),
        "Pv": np.zeros(LAYERS),
        "usual": P_A * R3 / total - bed.squeeze * pressed,
        "unstressed": np.array(bed.unstressed),
        "power": np.array(bed.power),
    }


def filled(P_transmural: np.ndarray, p: LayerParameters) -> np.ndarray:
    """Volume of the layers over the volume at which their resistances hold.

    Args:
        P_transmural: of the layers [mmHg], shape (layers, members).
        p: elements, stacked over members.
    """
    share = (p["unstressed"] + P_transmural) / (p["unstressed"] + p["usual"])
    return np.minimum(np.maximum(share, FILL_RANGE[0]), FILL_RANGE[1])
