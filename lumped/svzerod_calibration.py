"""Calibration files of svZeroDSolver: pressures and flows at every node in, vessel parameters out.

A calibration file is a svZeroDSolver case with two more tables, `y` and `dy`, that hold the samples
of `pressure:FROM:TO` and `flow:FROM:TO` and their time derivatives at every node between two
elements. Two generations of the format are read:

- `calibration_parameters` with `calibrate_stenosis_coefficient` and `set_capacitance_to_zero`
  (up to 3.1): all parameters of all vessels and junctions are fitted but for these switches;
- a list `calibrate` in single vessels and junctions (from 3.2): what is not listed is held at
  the value in the file.

The tolerances and the number of iterations in `calibration_parameters` belong to svZeroDSolver's
own optimiser and are not used. svZeroDSolver has no units; files are taken to be CGS.
"""

import dataclasses
import os
from collections.abc import Mapping, Sequence
from typing import Any, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float

from lumped.svzerod_file import VESSEL_KEYS, dump_json, is_finite, load_json, raise_faults

_COLUMNS = {
    "P_in": ("y", "pressure", 0),
    "Q_in": ("y", "flow", 0),
    "P_out": ("y", "pressure", 1),
    "Q_out": ("y", "flow", 1),
    "dP_in": ("dy", "pressure", 0),
    "dQ_in": ("dy", "flow", 0),
    "dQ_out": ("dy", "flow", 1),
}
"""Quantity -> table, variable and end (0 inlet, 1 outlet)."""


_JUNCTION_NAMES = ("R_viscous", "L", "K_stenosis")
"""Parameters that an outlet of a branching junction has."""


@runtime_checkable
class ParameterArrays(Protocol):
    """Anything with one array for each vessel parameter [CGS]."""

    R_viscous: Any
    C: Any
    L: Any
    K_stenosis: Any


@dataclasses.dataclass(frozen=True)
class CalibrationSet:
    """What is known of a set of elements, in the order of the file.

    Attributes:
        names: names of the vessels, or "junction:vessel" for outlets of junctions.
        record: P_in, P_out [dyn/cm²], Q_in, Q_out [cm³/s] and the rates dP_in, dQ_in,
            dQ_out, each of shape (names, samples). At a junction outlet Q_in is Q_out.
        initial: R_viscous, C, L, K_stenosis [CGS], each of shape (names,).
        free: under the same keys, True where the file asks for the parameter to be fitted.
    """

    names: tuple[str, ...]
    record: Mapping[str, Float[np.ndarray, "names samples"]]
    initial: Mapping[str, Float[np.ndarray, " names"]]
    free: Mapping[str, Bool[np.ndarray, " names"]]


@dataclasses.dataclass(frozen=True)
class CalibrationCase:
    """Content of a calibration file.

    Attributes:
        vessels: all vessels.
        junction_outlets: the outlets of all junctions with more than one outlet; may be empty.
        with_stenosis: False where the file holds the quadratic loss at 0.
        with_capacitance: False where the file holds the compliance of the vessels at 0.
    """

    vessels: CalibrationSet
    junction_outlets: CalibrationSet
    with_stenosis: bool
    with_capacitance: bool


def read_calibration(path: str | os.PathLike[str]) -> CalibrationCase:
    """Read a svZeroDSolver calibration file.

    Args:
        path: JSON file with `vessels`, `junctions`, `y`, `dy` and `calibration_parameters`.

    Returns:
        Its records, initial values and options as plain arrays.

    Raises:
        ValueError: the file is not such a file; the faults are listed.
    """
    config = _load(path)
    faults = _structure_faults(config)
    _raise_faults(path, faults)
    vessels, junctions = config["vessels"], config["junctions"]
    nodes = _vessel_nodes(config, faults)
    _raise_faults(path, faults)
    outlets = [
        (junction, i, (nodes[inlet][1], nodes[outlet][0]))
        for junction in _branching(config)
        for inlet in junction["inlet_vessels"]
        for i, outlet in enumerate(junction["outlet_vessels"])
    ]
    listed = any("calibrate" in item for item in (*vessels, *junctions))
    vessel_set = CalibrationSet(
        names=tuple(vessel["vessel_name"] for vessel in vessels),
        record=_record(config, list(nodes.values()), faults),
        initial=_initial([vessel.get("zero_d_element_values", {}) for vessel in vessels], faults),
        free=_free(vessels, tuple(VESSEL_KEYS), listed),
    )
    record = _record(config, [pair for _, _, pair in outlets], faults)
    junction_set = CalibrationSet(
        names=tuple(outlet for _, _, (_, outlet) in outlets),
        record=record | {"Q_in": record["Q_out"], "dQ_in": record["dQ_out"]},
        initial=_initial([_outlet_values(junction, i) for junction, i, _ in outlets], faults),
        free=_free([junction for junction, _, _ in outlets], _JUNCTION_NAMES, listed),
    )
    options = config["calibration_parameters"]
    case = CalibrationCase(
        vessels=vessel_set,
        junction_outlets=junction_set,
        with_stenosis=bool(options.get("calibrate_stenosis_coefficient", True)),
        with_capacitance=not options.get("set_capacitance_to_zero", False),
    )
    faults += _contradictions(case) if listed else []
    _raise_faults(path, faults)
    return case


def write_calibrated(
    path_in: str | os.PathLike[str],
    parameters: ParameterArrays,
    path_out: str | os.PathLike[str],
    *,
    junctions: ParameterArrays | None = None,
) -> None:
    """Write the simulation case that svZeroDSolver's calibrator would write.

    The file is the input without `y`, `dy` and `calibration_parameters`, with the parameters
    put in. It appears whole or not at all. Values are written as fitted: up to version 3.1
    svZeroDSolver replaced negative C and L by 0.

    Args:
        path_in: the calibration file.
        parameters: one value for each vessel, in the order of the file [CGS].
        path_out: the file to write.
        junctions: one value for each entry of `CalibrationCase.junction_outlets` [CGS]; these
            junctions become BloodVesselJunction. Without it junctions stay as they are.

    Raises:
        ValueError: the input cannot be read, or the numbers do not fit it.
    """
    config = _load(path_in)
    faults = _structure_faults(config)
    _raise_faults(path_in, faults)
    values = _value_lists(parameters, len(config["vessels"]), "vessels", faults)
    outlet_values: dict[str, list[float]] = {}
    branching = _branching(config)
    if junctions is not None:
        count = sum(len(junction["outlet_vessels"]) for junction in branching)
        outlet_values = _value_lists(junctions, count, "outlets of junctions", faults)
    _raise_faults(path_in, faults)
    for i, vessel in enumerate(config["vessels"]):
        vessel["zero_d_element_values"] = {key: column[i] for key, column in values.items()}
    first = 0
    for junction in branching if junctions is not None else []:
        part = slice(first, first + len(junction["outlet_vessels"]))
        junction["junction_type"] = "BloodVesselJunction"
        junction["junction_values"] = {
            VESSEL_KEYS[name]: outlet_values[VESSEL_KEYS[name]][part] for name in _JUNCTION_NAMES
        }
        first = part.stop
    for key in ("y", "dy", "calibration_parameters"):
        config.pop(key)
    for element in (*config["vessels"], *config["junctions"]):
        element.pop("calibrate", None)  # which numbers were free: not a key of a case
    dump_json(path_out, config, sort_keys=True)


# Reading


def _load(path: str | os.PathLike[str]) -> dict[str, Any]:
    config = load_json(path, "svZeroDSolver calibration file")
    tables = dict.fromkeys(("y", "dy", "calibration_parameters"), dict)
    tables |= {"vessels": list, "junctions": list}
    entries = config if isinstance(config, dict) else {}
    faults = [
        f"{key}: missing, or not {'a list' if kind is list else 'an object'}"
        for key, kind in tables.items()
        if not isinstance(entries.get(key), kind)
    ]
    _raise_faults(path, faults)
    return config


def _raise_faults(path: str | os.PathLike[str], faults: Sequence[str]) -> None:
    raise_faults(
        f"{path} cannot be used for calibration",
        faults,
        "Correct these entries; a calibration file names samples of pressure and flow, in y, and "
        "their rates, in dy, at every node (pressure:FROM:TO, flow:FROM:TO).",
    )


def _structure_faults(config: Mapping[str, Any]) -> list[str]:
    """Faults of the network itself: elements, names and links."""
    faults = []
    identities = []
    for i, vessel in enumerate(config["vessels"]):
        if not isinstance(vessel, dict) or not {"vessel_name", "vessel_id"} <= vessel.keys():
            faults.append(f"vessels[{i}]: not an object with vessel_name and vessel_id")
            continue
        identities.append(vessel["vessel_id"])
        name, kind = vessel["vessel_name"], vessel.get("zero_d_element_type")
        if kind != "BloodVessel":
            faults.append(f"vessel {name}: type {kind!r} is not supported, only 'BloodVessel'")
        for key in ("boundary_conditions", "zero_d_element_values"):
            if not isinstance(vessel.get(key, {}), dict):
                faults.append(f"vessel {name}: {key} is not an object")
        if not isinstance(vessel.get("calibrate", []), list):
            faults.append(f"vessel {name}: calibrate is not a list")
    if not config["vessels"]:
        faults.append("vessels: empty")
    faults += [f"vessel_id {k!r}: used twice" for k in identities if identities.count(k) > 1][:1]
    for i, junction in enumerate(config["junctions"]):
        ends = ("inlet_vessels", "outlet_vessels")
        if (
            not isinstance(junction, dict)
            or "junction_name" not in junction
            or not all(isinstance(junction.get(end), list) for end in ends)
        ):
            faults.append(
                f"junctions[{i}]: not an object with junction_name, inlet_vessels, outlet_vessels"
            )
            continue
        name = junction["junction_name"]
        if not isinstance(junction.get("junction_values", {}), dict):
            faults.append(f"junction {name}: junction_values is not an object")
        if not isinstance(junction.get("calibrate", []), list):
            faults.append(f"junction {name}: calibrate is not a list")
        unknown = [k for end in ends for k in junction[end] if k not in identities]
        if unknown:
            faults.append(f"junction {name}: no vessel has the vessel_id {unknown}")
        if len(junction["outlet_vessels"]) > 1 and len(junction["inlet_vessels"]) != 1:
            faults.append(f"junction {name}: several outlets need exactly one inlet")
    return faults


def _branching(config: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Junctions whose outlets have parameters of their own."""
    return [junction for junction in config["junctions"] if len(junction["outlet_vessels"]) > 1]


def _vessel_nodes(config: Mapping[str, Any], faults: list[str]) -> dict[Any, tuple[str, str]]:
    """Names "FROM:TO" of the nodes at the inlet and the outlet of every vessel, by vessel_id."""
    nodes = {}
    for vessel in config["vessels"]:
        name, identity = vessel["vessel_name"], vessel["vessel_id"]
        conditions = vessel.get("boundary_conditions", {})
        before = [
            j["junction_name"] for j in config["junctions"] if identity in j["outlet_vessels"]
        ]
        after = [j["junction_name"] for j in config["junctions"] if identity in j["inlet_vessels"]]
        before += [conditions["inlet"]] if "inlet" in conditions else []
        after += [conditions["outlet"]] if "outlet" in conditions else []
        for end, found in (("inlet", before), ("outlet", after)):
            if len(found) != 1:
                faults.append(
                    f"vessel {name}: {end} connected to {found or 'nothing'}, must be to one "
                    "junction or boundary condition"
                )
        if len(before) == len(after) == 1:
            nodes[identity] = (f"{before[0]}:{name}", f"{name}:{after[0]}")
    return nodes


def _record(
    config: Mapping[str, Any], nodes: Sequence[tuple[str, str]], faults: list[str]
) -> dict[str, Float[np.ndarray, "names samples"]]:
    """The seven quantities at the given pairs of inlet and outlet nodes."""
    expected = max((len(v) for v in config["y"].values() if isinstance(v, list)), default=0)
    record = {}
    for quantity, (table, variable, end) in _COLUMNS.items():
        rows = np.zeros((len(nodes), expected))
        for row, pair in zip(rows, nodes, strict=True):
            key = f"{variable}:{pair[end]}"
            fault = _sample_fault(config[table], key, expected)
            if fault is None:
                row[:] = config[table][key]
            elif f"{table}: {fault}" not in faults:
                faults.append(f"{table}: {fault}")
        record[quantity] = rows
    return record


def _sample_fault(table: Mapping[str, Any], key: str, expected: int) -> str | None:
    if key not in table:
        return f"{key!r} is missing"
    values = table[key]
    if not isinstance(values, list) or not all(is_finite(value) for value in values):
        return f"{key!r} is not a list of finite numbers"
    if len(values) != expected or expected == 0:
        return f"{key!r} has {len(values)} samples, the longest entry of y has {expected}"
    return None


def _outlet_values(junction: Mapping[str, Any], i: int) -> dict[str, Any]:
    """Values of outlet i, as a vessel would have them; empty for a plain junction."""
    values = junction.get("junction_values", {})
    if junction.get("junction_type") != "BloodVesselJunction":
        return {}
    columns = {key: column if isinstance(column, list) else [] for key, column in values.items()}
    return {key: column[i] if i < len(column) else None for key, column in columns.items()}


def _initial(
    values: Sequence[Mapping[str, Any]], faults: list[str]
) -> dict[str, Float[np.ndarray, " names"]]:
    """Values in the file, 0 where there are none, as svZeroDSolver takes them."""
    initial = {}
    for name, key in VESSEL_KEYS.items():
        column = [entry.get(key, 0.0) for entry in values]
        if not all(is_finite(value) for value in column):
            faults.append(f"{key}: an initial value is not a finite number")
            column = [0.0] * len(column)
        initial[name] = np.array(column, dtype=float)
    return initial


def _free(
    elements: Sequence[Mapping[str, Any]], names: Sequence[str], listed: bool
) -> dict[str, Bool[np.ndarray, " names"]]:
    return {
        name: np.array(
            [
                name in names and (not listed or key in element.get("calibrate", []))
                for element in elements
            ],
            dtype=bool,
        )
        for name, key in VESSEL_KEYS.items()
    }


def _contradictions(case: CalibrationCase) -> list[str]:
    faults = []
    free = [case.vessels.free, case.junction_outlets.free]
    if not case.with_stenosis and any(f["K_stenosis"].any() for f in free):
        faults.append("calibrate_stenosis_coefficient is false, yet a 'calibrate' list names it")
    if not case.with_capacitance and any(f["C"].any() for f in free):
        faults.append("set_capacitance_to_zero is true, yet a 'calibrate' list names C")
    return faults


# Writing


def _value_lists(
    parameters: ParameterArrays, count: int, what: str, faults: list[str]
) -> dict[str, list[float]]:
    lists = {}
    for name, key in VESSEL_KEYS.items():
        values = np.asarray(getattr(parameters, name), dtype=float)
        if values.shape != (count,):
            faults.append(f"{name}: shape {values.shape} given, the file has {count} {what}")
        elif not np.all(np.isfinite(values)):
            faults.append(f"{name}: not finite for {what} {np.flatnonzero(~np.isfinite(values))}")
        lists[key] = [float(value) + 0.0 for value in values.ravel()]  # + 0.0 drops minus zero
    return lists
