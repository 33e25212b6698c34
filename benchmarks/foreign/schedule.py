"""Which truth a record gets: 15 % none, 65 % an effect of the list in turn, 20 % one outside it."""

import numpy as np

EFFECTS = (
    "quadratic_loss", "dynamic_narrowing", "proximal_resistance", "stress_narrowing", "inertance",
    "vasodilation", "adenosine_vasodilation", "r1_r3_dilation", "autoregulation",
    "stress_compliance", "back_pressure", "collateral_flow", "intramyocardial_pump",
    "dobutamine_inotropy", "wall_viscoelasticity", "wire_drift", "sensor_height",
    "aortic_zero_error", "catheter_damping", "signal_delay", "aortic_waveform",
)  # fmt: skip
"""The effects of the list."""

OUTSIDE = (
    "distal_stenosis", "bridge", "venous_pulsation", "vessel_collapse", "atrial_kick",
    "damped_distal", "whipping", "moving_wire", "flow_error", "distal_gain", "pulsus_alternans",
    "thermal_trend", "arrhythmia",
)  # fmt: skip
"""Causes outside the list; a generator has eight or more of them."""

_BLOCK = ("none",) * 3 + ("effect",) * 13 + ("outside",) * 4


def truth_of(seed: int, number: int, outside: tuple[str, ...]) -> str:
    """The truth of a record: "none", an effect, or "outside:KIND".

    Args:
        seed: of the set.
        number: of the record, from 0.
        outside: causes outside the list that the generator has.
    """
    block, place = divmod(number, len(_BLOCK))
    order = np.random.default_rng([seed, block, 17]).permutation(len(_BLOCK))
    kinds = [_BLOCK[k] for k in order]
    kind = kinds[place]
    if kind == "none":
        return "none"
    names = EFFECTS if kind == "effect" else outside
    before = block * _BLOCK.count(kind) + kinds[:place].count(kind)
    turn = np.random.default_rng([seed, 5]).permutation(len(names))
    name = names[turn[before % len(names)]]
    return name if kind == "effect" else f"outside:{name}"
