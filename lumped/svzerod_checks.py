"""Checks of a svZeroDSolver case file: its tables, keys and types.

Each check returns faults, one line each, naming the entry, what is wrong and why.
"""

import difflib
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

from lumped.svzerod_file import VESSEL_KEYS, is_finite


class Keys(NamedTuple):
    """Keys of the values of an element.

    Attributes:
        required: numbers that must be there.
        optional: numbers that may be there.
        series: time series, given together with "t"; empty for none.
        lists: lists of numbers, one a branch.
    """

    required: tuple[str, ...] = ()
    optional: tuple[str, ...] = ()
    series: str = ""
    lists: tuple[str, ...] = ()


CONDITIONS = {
    "FLOW": Keys(series="Q"),
    "PRESSURE": Keys(series="P"),
    "RESISTANCE": Keys(required=("R", "Pd")),
    "RCR": Keys(required=("Rp", "C", "Rd"), optional=("Pd",)),
    "CORONARY": Keys(required=("Ra1", "Ra2", "Rv1", "Ca", "Cc", "P_v"), series="Pim"),
}
"""Boundary conditions that are supported and the keys of their values."""

_VESSEL = Keys(
    required=("R_poiseuille",),
    optional=tuple(key for key in VESSEL_KEYS.values() if key != "R_poiseuille"),
)
VESSELS = {"BloodVessel": _VESSEL, "BloodVesselCRL": _VESSEL}
"""Vessels that are supported and the keys of their values."""

JUNCTIONS = {
    "NORMAL_JUNCTION": Keys(),
    "internal_junction": Keys(),
    "resistive_junction": Keys(lists=("R",)),
    "BloodVesselJunction": Keys(lists=("R_poiseuille", "L", "stenosis_coefficient")),
}
"""Junctions that are supported and the keys of their values."""

SUPPORTED = (
    f"Supported are the vessels {', '.join(VESSELS)}; the junctions {', '.join(JUNCTIONS)}; the "
    f"boundary conditions {', '.join(CONDITIONS)}."
)

_LOOP = "it closes the circulation through a model of the heart"
_REASONS = {
    "ClosedLoopRCR": _LOOP,
    "ClosedLoopCoronaryLeft": _LOOP,
    "ClosedLoopCoronaryRight": _LOOP,
    "ClosedLoopHeartAndPulmonary": _LOOP,
    "CORONARY_VAR_RES": "its resistances change in time",
}
_TABLES_REFUSED = {
    "closed_loop_blocks": ("closed_loop_type", _LOOP),
    "chambers": ("type", "a heart chamber has no counterpart here"),
    "valves": ("type", "a valve has no counterpart here"),
    "external_solver_coupling_blocks": ("type", "it waits for a 3D solver"),
}
_TABLES_KNOWN = ("description", "simulation_parameters", "boundary_conditions", "vessels")
_TABLES_KNOWN += ("junctions", "initial_condition", "initial_condition_d")
_CALIBRATION = ("y", "dy", "calibration_parameters")

_COUNTS = {"number_of_cardiac_cycles": 1, "number_of_time_pts_per_cardiac_cycle": 2}
_FLAGS = ("steady_initial", "output_all_cycles", "output_mean_only", "output_variable_based")
_FLAGS += ("output_derivative", "use_cycle_to_cycle_error", "coupled_simulation")
_NUMBERS = ("cardiac_period", "sim_cycle_to_cycle_percent_error")
_NOT_USED = ("absolute_tolerance", "maximum_nonlinear_iterations", "rho_infty")
_NOT_USED += ("density", "viscosity", "model_name")


def structure_faults(config: object) -> list[str]:
    """Faults of tables, keys and types; unsupported elements first, alone where there are any."""
    if not isinstance(config, Mapping):
        return ["it is not an object with vessels and boundary_conditions"]
    if any(key in config for key in _CALIBRATION):
        return ["it holds samples to calibrate from (y, dy): read it with `read_calibration`"]
    faults = _table_faults(config)
    if faults:
        return faults
    unsupported = _unsupported(config)
    if unsupported:
        return unsupported
    faults = _settings_faults(config)
    for where, entry, names, kinds, values in _entries(config):
        faults += _entry_faults(where, entry, names, kinds, values)
    return faults + _identity_faults(config)


def _table_faults(config: Mapping[str, Any]) -> list[str]:
    tables = {"simulation_parameters": dict, "boundary_conditions": list, "vessels": list}
    faults = [
        f"{key}: missing, or not {'a list' if kind is list else 'an object'}"
        for key, kind in tables.items()
        if not isinstance(config.get(key), kind)
    ]
    if not isinstance(config.get("junctions", []), list):
        faults.append("junctions: not a list")
    faults += _unknown(config, (*_TABLES_KNOWN, *_TABLES_REFUSED), "the file")
    for key, name, kind in _TYPED:
        for i, entry in enumerate(config.get(key, []) if not faults else []):
            if not isinstance(entry, Mapping) or not all(
                isinstance(entry.get(k), str) for k in (name, kind)
            ):
                faults.append(f"{key}[{i}]: not an object with {name} and {kind}")
    return faults


_TYPED = (
    ("boundary_conditions", "bc_name", "bc_type"),
    ("vessels", "vessel_name", "zero_d_element_type"),
    ("junctions", "junction_name", "junction_type"),
)


def _unsupported(config: Mapping[str, Any]) -> list[str]:
    """Elements of the format that have no counterpart here."""
    faults = []
    for key, (kind, reason) in _TABLES_REFUSED.items():
        entries = config.get(key, [])
        for i, entry in enumerate(entries if isinstance(entries, list) else [entries]):
            found = entry if isinstance(entry, Mapping) else {}
            name = found.get("name", f"{key}[{i}]")
            faults.append(f"{key}: {name!r} of type {found.get(kind)!r} is not supported: {reason}")
    for (key, name, kind), kinds in zip(_TYPED, (CONDITIONS, VESSELS, JUNCTIONS), strict=True):
        for entry in config.get(key, []):
            if entry[kind] not in kinds:
                reason = _REASONS.get(entry[kind], "there is no such element here")
                faults.append(
                    f"{key}: {entry[name]!r} of type {entry[kind]!r} is not supported: {reason}"
                )
    return faults


def _settings_faults(config: Mapping[str, Any]) -> list[str]:
    settings, where = config["simulation_parameters"], "simulation_parameters"
    known = (*_COUNTS, *_FLAGS, *_NUMBERS, *_NOT_USED, "output_interval")
    faults = _unknown(settings, known, where)
    for key, least in {**_COUNTS, "output_interval": 1}.items():
        value = settings.get(key, None if key in _COUNTS else 1)
        if not is_finite(value) or int(value) != value or value < least:
            faults.append(f"{where}: {key} = {value!r} is not a whole number of {least} or more")
    faults += [
        f"{where}: {key} = {settings[key]!r} is not true or false"
        for key in _FLAGS
        if not isinstance(settings.get(key, False), bool)
    ]
    faults += [
        f"{where}: {key} = {settings[key]!r} is not a number of 0 or more"
        for key in _NUMBERS
        if key in settings and not (is_finite(settings[key]) and settings[key] >= 0)
    ]
    if settings.get("coupled_simulation") is True:
        faults.append(f"{where}: coupled_simulation: the case waits for a 3D solver")
    starts = [key for key in ("initial_condition", "initial_condition_d") if config.get(key)]
    if starts and settings.get("steady_initial") is False:
        faults.append(f"{starts[0]}: not supported; start from the steady state (steady_initial)")
    return faults


def _entries(config: Mapping[str, Any]) -> Iterable[tuple[str, Mapping, tuple, Mapping, str]]:
    """Every element: where it stands, its entry, keys, types and the key of its values."""
    layout = (
        ("boundary condition", (), CONDITIONS, "bc_values"),
        (
            "vessel",
            ("vessel_id", "vessel_length", "boundary_conditions"),
            VESSELS,
            "zero_d_element_values",
        ),
        (
            "junction",
            ("inlet_vessels", "outlet_vessels", "inlet_blocks", "outlet_blocks"),
            JUNCTIONS,
            "junction_values",
        ),
    )
    for (key, name, kind), (word, more, kinds, values) in zip(_TYPED, layout, strict=True):
        for entry in config.get(key, []):
            keys = (name, kind, values, *more)
            yield f"{word} {entry[name]}", entry, keys, {entry[kind]: kinds[entry[kind]]}, values


def _entry_faults(
    where: str, entry: Mapping[str, Any], names: tuple, kinds: Mapping[str, Keys], values: str
) -> list[str]:
    faults = _unknown(entry, names, where)
    ((_, keys),) = kinds.items()
    given = entry.get(values, {} if keys == Keys() else None)
    if not isinstance(given, Mapping):
        return [*faults, f"{where}: {values} is missing or not an object"]
    lists = (*keys.lists, *((keys.series, "t") if keys.series else ()))
    faults += _unknown(given, (*keys.required, *keys.optional, *lists), where)
    for key in (*keys.required, *lists):
        if key not in given:
            faults.append(f"{where}: {key} is missing")
    faults += [
        f"{where}: {key} = {given[key]!r} is not a finite number"
        for key in (*keys.required, *keys.optional)
        if key in given and not is_finite(given[key])
    ]
    faults += [
        f"{where}: {key} is not a list of finite numbers"
        for key in lists
        if key in given
        and not (isinstance(given[key], list) and all(is_finite(v) for v in given[key]))
    ]
    for key in ("inlet_vessels", "outlet_vessels", "inlet_blocks", "outlet_blocks"):
        kind, known = (int, "numbers") if key.endswith("vessels") else (str, "names")
        found = entry.get(key, [])
        if not isinstance(found, list) or not all(isinstance(k, kind) for k in found):
            faults.append(f"{where}: {key} is not a list of {known}")
    links = entry.get("boundary_conditions", {})
    if not isinstance(links, Mapping):
        return [*faults, f"{where}: boundary_conditions is not an object"]
    faults += [
        f"{where}: {end} of boundary_conditions is not a name"
        for end in ("inlet", "outlet")
        if not isinstance(links.get(end, ""), str)
    ]
    return faults + _unknown(links, ("inlet", "outlet"), where)


def _identity_faults(config: Mapping[str, Any]) -> list[str]:
    names = [entry[name] for key, name, _ in _TYPED for entry in config.get(key, [])]
    faults = [f"{name}: named twice" for name in dict.fromkeys(names) if names.count(name) > 1]
    identities = [vessel.get("vessel_id") for vessel in config["vessels"]]
    faults += [
        f"vessel {vessel['vessel_name']}: vessel_id = {identity!r} is not a whole number"
        for vessel, identity in zip(config["vessels"], identities, strict=True)
        if not isinstance(identity, int)
    ]
    repeated = [k for k in identities if identities.count(k) > 1]
    return faults + [f"vessel_id {k!r}: used twice" for k in repeated[:1]]


def _unknown(entry: Mapping[str, Any], known: tuple[str, ...], where: str) -> list[str]:
    """Unknown keys; those that start with '_' are remarks."""
    faults = []
    for key in entry:
        if key in known or key.startswith("_") or key == "description":
            continue
        near = difflib.get_close_matches(key, known, n=1, cutoff=0.4)
        hint = f", did you mean {near[0]!r}?" if near else ""
        faults.append(f"{where}: {key!r} is not a known key{hint}")
    return faults
