"""Bounds beyond which a value is impossible for any patient, from physiology and geometry alone.

They are wide on purpose: a value outside must be refused, one inside may be.
"""

import re

PRESSURE, TIME, FLOW = (25.0, 350.0), (0.15, 4.0), (0.1, 40.0)

BOUNDS: dict[str, tuple[float, float]] = {
    "P_systolic_mmHg": PRESSURE,
    "P_diastolic_mmHg": (10.0, 250.0),
    "mean_P_aorta_mmHg": (10.0, 300.0),
    "mean_P_distal_mmHg": (2.0, 300.0),
    "mean_flow_ml_per_min": (0.0, 3000.0),
    "period_s": TIME,
    "cardiac_output_l_per_min": FLOW,
    "stroke_volume_ml": (0.5, 400.0),
    "ffr": (0.0, 1.2),
    "ffr_sd": (0.0, 0.5),
    "pressure_sd_mmHg": (0.0, 50.0),
    "pressure_offset_sd_mmHg": (0.0, 50.0),
    "flow_relative_sd": (0.0, 2.0),
    "viscosity_poise": (0.002, 0.6),
    "density_g_per_cm3": (0.5, 3.0),
    "E_dyn_per_cm2": (1e4, 1e10),
    "nu": (0.0, 0.5),
    "thickness_per_radius": (0.005, 2.0),
    "factor": (0.005, 2.0),
    "min_mm": (0.0, 10.0),
    "max_mm": (0.01, 20.0),
    "R_1_dyn_s_per_cm5": (1.0, 1e9),
    "R_2_dyn_s_per_cm5": (1.0, 1e9),
    "R_3_dyn_s_per_cm5": (1.0, 1e9),
    "C_a_cm5_per_dyn": (1e-13, 1e-2),
    "C_im_cm5_per_dyn": (1e-13, 1e-2),
    "P_venous_mmHg": (-50.0, 100.0),
    "im_factor": (-1e-9, 20.0),
    "R0_dyn_s_per_cm5": (0.1, 1e8),
    "C0_cm5_per_dyn": (1e-15, 1e-2),
    "K_dyn_s2_per_cm8": (-1e-9, 1e8),
    "value": (0.001, 1e4),
    "sd_log": (0.0, 10.0),
    "order": (0.0, 1000.0),
    "dt_s": (1e-9, 0.2),
    "cycles": (0.0, 1e4),
    "n_steps": (2.0, 1e7),
    "frames_per_cycle": (0.0, 1e6),
    "checkpoint_every": (0.0, 1e8),
    "tolerance": (1e-15, 1.0),
    "max_halvings": (-1.0, 100.0),
    "change_limit": (0.0, 10.0),
    "aorta_radius_mm": (1.0, 60.0),
    "normal_length_mm": (0.0, 200.0),
    "septum_mm": (0.0, 20.0),
    "take_off_angle_deg": (-180.0, 360.0),
    "aorta_below_mm": (0.0, 500.0),
    "aorta_above_mm": (0.0, 500.0),
    "distal_extension_mm": (-1e-9, 300.0),
    "fillet_mm": (-1e-9, 30.0),
    "body_surface_area_m2": (0.1, 4.0),
    "ostium_major_mm": (0.1, 30.0),
    "ostium_minor_mm": (0.05, 30.0),
    "intramural_length_mm": (-1e-9, 200.0),
    "hypoplasia": (0.0, 2.0),
    "ellipticity": (0.5, 50.0),
    "reference_radius_mm": (0.1, 20.0),
    "tube_radius_mm": (1.0, 60.0),
    "wall_layers": (0.5, 50.0),
    "wedge_layers": (-1.0, 50.0),
    "elements_across": (0.5, 200.0),
    "smoothing_steps": (-1.0, 1e5),
    "radius": (0.0, 1e4),
}

WHOLE = frozenset({
    "cycles", "n_steps", "frames_per_cycle", "checkpoint_every", "max_halvings", "wall_layers",
    "wedge_layers", "elements_across", "smoothing_steps", "order",
})  # fmt: skip
"""Keys that count something."""

OPEN_BELOW = frozenset({
    "ffr", "ffr_sd", "cycles", "frames_per_cycle", "checkpoint_every", "aorta_radius_mm",
    "max_mm", "sd_log", "hypoplasia", "radius", "pressure_sd_mmHg", "pressure_offset_sd_mmHg",
    "flow_relative_sd",
})  # fmt: skip
"""Keys whose lower bound is refused as well."""


def is_impossible(key: str, value: float) -> bool:
    """Whether no patient can have a value of the key (its last part)."""
    name = re.sub(r".*\.", "", key)
    if name not in BOUNDS:
        return False
    low, high = BOUNDS[name]
    return not (low < value < high if name in OPEN_BELOW else low <= value <= high)
