"""svZeroDSolver case files in: JSON to a network of our elements.

Every end of a vessel becomes a port at a node. A node is named after the junction that makes it,
or "FROM:TO", as svZeroDSolver names it, where a boundary condition meets a vessel. What the format
allows but this package has no element for is refused, and so is every key that svZeroDSolver does
not know: a misspelt optional parameter would otherwise change a result in silence.
"""

import dataclasses
import os
import pathlib
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal

from lumped.blocks import RCR, Coronary, Resistance
from lumped.elements import AbstractElement
from lumped.network import connect
from lumped.sources import FlowSource, PressureSource
from lumped.svzerod import SvZeroDCase, SvZeroDOutput
from lumped.svzerod_checks import CONDITIONS, SUPPORTED, structure_faults
from lumped.svzerod_file import VESSEL_KEYS, load_json, raise_faults
from lumped.svzerod_series import waveform_from_series
from lumped.vessels import Vessel, VesselCRL
from lumped.waveforms import AbstractWaveform

INLET, OUTLET = 0, 1
_DEFAULT_PERIOD = 1.0  # of svZeroDSolver, for files without any time series


def read_svzerod(
    source: str | os.PathLike[str] | Mapping[str, Any],
    *,
    interpolation: Literal["linear", "cubic"] = "linear",
) -> SvZeroDCase:
    """Read a svZeroDSolver case.

    Args:
        source: path of a JSON file, or its content.
        interpolation: of the time series: "linear" as svZeroDSolver does, or "cubic" where they
            are samples of smooth functions.

    Returns:
        The network and the settings of its run. Solver tolerances of the file are not kept.

    Raises:
        ValueError: the file is no such case, or uses what is not supported; all faults are listed.
    """
    if isinstance(source, Mapping):
        config, label, name = source, "The case", "case"
    else:
        config = load_json(source, "svZeroDSolver case file")
        label, name = str(source), pathlib.Path(source).stem
    what = f"{label} cannot be read as a svZeroDSolver case"
    cure = f"Correct these entries. {SUPPORTED}"
    raise_faults(what, structure_faults(config), cure)
    faults: list[str] = []
    layout = _layout(config, faults)
    raise_faults(what, faults, cure)
    elements, period = _elements(config, layout, interpolation, faults)
    raise_faults(what, faults, cure)
    settings = config["simulation_parameters"]
    return SvZeroDCase(
        network=connect(elements),
        period=period,
        cycles=int(settings["number_of_cardiac_cycles"]),
        points_per_cycle=int(settings["number_of_time_pts_per_cardiac_cycle"]),
        steady_initial=settings.get("steady_initial", True),
        cycle_error=_cycle_error(settings),
        output=SvZeroDOutput(
            all_cycles=settings.get("output_all_cycles", False),
            interval=int(settings.get("output_interval", 1)),
            mean_only=settings.get("output_mean_only", False),
            by_variable=settings.get("output_variable_based", False),
            derivatives=settings.get("output_derivative", False),
        ),
        vessels=tuple(vessel["vessel_name"] for vessel in config["vessels"]),
        name=name,
    )


def _cycle_error(settings: Mapping[str, Any]) -> float | None:
    if not settings.get("use_cycle_to_cycle_error", False):
        return None
    return float(settings.get("sim_cycle_to_cycle_percent_error", 1.0)) / 100.0


# Who meets whom


@dataclasses.dataclass
class _Layout:
    """Nodes of a file: of each vessel end, of each boundary condition, and of junction branches.

    Attributes:
        ends: node of each end, by vessel name and INLET or OUTLET.
        conditions: node of each boundary condition and whether it stands at an INLET or OUTLET.
        branches: elements that junctions hide: name -> element and the nodes of its two ports.
    """

    ends: dict[tuple[str, int], str]
    conditions: dict[str, tuple[str, int]]
    branches: dict[str, tuple[Vessel, str, str]]


def _layout(config: Mapping[str, Any], faults: list[str]) -> _Layout:
    """Nodes and connections; every end must be connected once."""
    vessels = [vessel["vessel_name"] for vessel in config["vessels"]]
    conditions = [condition["bc_name"] for condition in config["boundary_conditions"]]
    layout = _Layout({}, {}, {})
    seen: dict[tuple[str, int], list[str]] = {(v, e): [] for v in vessels for e in (INLET, OUTLET)}
    users: dict[str, list[str]] = {name: [] for name in conditions}

    def attach(member: str, side: int, node: str, by: str) -> None:
        if member in users:
            users[member].append(by)
            layout.conditions[member] = (node, side)
        elif member in vessels:
            # what flows into a junction leaves a vessel
            end = OUTLET if side == INLET else INLET
            seen[member, end].append(by)
            layout.ends[member, end] = node
        else:
            faults.append(f"{by}: no vessel or boundary condition is named {member!r}")

    for vessel in config["vessels"]:
        name, links = vessel["vessel_name"], vessel.get("boundary_conditions", {})
        for key, side in (("inlet", INLET), ("outlet", OUTLET)):
            if key not in links:
                continue
            node = f"{links[key]}:{name}" if side == INLET else f"{name}:{links[key]}"
            if links[key] not in users:
                faults.append(f"vessel {name}: no boundary condition is named {links[key]!r}")
                continue
            attach(links[key], side, node, f"vessel {name}")
            seen[name, side].append(links[key])
            layout.ends[name, side] = node
    for junction in config.get("junctions", []):
        _attach_junction(config, junction, set(users), attach, layout, faults)
    faults += [
        f"vessel {name}: its {('inlet', 'outlet')[end]} is connected to "
        f"{', '.join(by) or 'nothing'}, must be to one junction or boundary condition"
        for (name, end), by in seen.items()
        if len(by) != 1
    ]
    faults += [
        f"boundary condition {name}: used by {', '.join(by) or 'nothing'}, must be used once"
        for name, by in users.items()
        if len(by) != 1
    ]
    return layout


def _attach_junction(
    config: Mapping[str, Any],
    junction: Mapping[str, Any],
    conditions: set[str],
    attach: Callable[[str, int, str, str], None],
    layout: _Layout,
    faults: list[str],
) -> None:
    """Attach the members of a junction to its node, each through its branch where it has one."""
    name = junction["junction_name"]
    by_id = {vessel["vessel_id"]: vessel["vessel_name"] for vessel in config["vessels"]}
    members = []
    for key, side in (("inlet", INLET), ("outlet", OUTLET)):
        for identity in junction.get(f"{key}_vessels", []):
            if identity in by_id:
                members.append((by_id[identity], side))
            else:
                faults.append(f"junction {name}: no vessel has the vessel_id {identity!r}")
        members += [(block, side) for block in junction.get(f"{key}_blocks", [])]
    branches = _branches(junction, members, faults)
    if len(members) < 2:
        faults.append(f"junction {name}: joins {len(members)} element(s), must be two or more")
    centre = name
    if [side for _, side in members] == [INLET, OUTLET] and not any(branches):
        (first, _), (second, _) = members
        if (first in conditions) != (second in conditions):
            centre = f"{first}:{second}"  # as a boundary condition that is set on a vessel
    for (member, side), values in zip(members, branches, strict=True):
        node = centre
        if values:
            node = f"{member}:{name}" if side == INLET else f"{name}:{member}"
            start, end = (node, centre) if side == INLET else (centre, node)
            element = _built(Vessel, values, f"junction {name}, branch to {member}", faults)
            layout.branches[f"{name}_{member}"] = (element, start, end)
        attach(member, side, node, f"junction {name}")


def _branches(
    junction: Mapping[str, Any], members: Sequence[tuple[str, int]], faults: list[str]
) -> list[dict[str, float]]:
    """Parameters of the vessel that each member is joined through; empty where there are none."""
    name, kind = junction["junction_name"], junction["junction_type"]
    if kind == "resistive_junction":
        columns, carriers = {"R_viscous": "R"}, members
    elif kind == "BloodVesselJunction":
        columns = {ours: key for ours, key in VESSEL_KEYS.items() if ours != "C"}
        carriers = [member for member in members if member[1] == OUTLET]
        if len(members) - len(carriers) != 1:
            faults.append(f"junction {name}: a BloodVesselJunction has exactly one inlet")
    else:
        return [{} for _ in members]
    values = junction["junction_values"]
    faults += [
        f"junction {name}: {key} has {len(values[key])} values for {len(carriers)} branches"
        for key in columns.values()
        if len(values[key]) != len(carriers)
    ]
    if faults:
        return [{} for _ in members]
    rows = iter(range(len(carriers)))
    branches = []
    for member in members:
        row = next(rows) if member in carriers else None
        found = {} if row is None else {ours: values[key][row] for ours, key in columns.items()}
        branches.append({"R_viscous": 0.0} | _without_zeros(found) if any(found.values()) else {})
    return branches


# Elements


def _elements(
    config: Mapping[str, Any],
    layout: _Layout,
    interpolation: Literal["linear", "cubic"],
    faults: list[str],
) -> tuple[dict[str, tuple[Any, ...]], float]:
    """All elements with their nodes, and the period of the sources."""
    elements: dict[str, tuple[Any, ...]] = {}
    periods: dict[str, float] = {}
    stated = config["simulation_parameters"].get("cardiac_period", 0.0)
    if stated > 0.0:
        periods["cardiac_period"] = float(stated)
    for condition in config["boundary_conditions"]:
        name = condition["bc_name"]
        node, side = layout.conditions[name]
        element = _condition(condition, side, interpolation, periods, faults)
        elements[name] = (element, node)
    for vessel in config["vessels"]:
        name = vessel["vessel_name"]
        kind = Vessel if vessel["zero_d_element_type"] == "BloodVessel" else VesselCRL
        given = vessel["zero_d_element_values"]
        values = {ours: given[key] for ours, key in VESSEL_KEYS.items() if key in given}
        element = _built(kind, _without_zeros(values), f"vessel {name}", faults)
        elements[name] = (element, layout.ends[name, INLET], layout.ends[name, OUTLET])
    faults += [f"{name}: named twice" for name in layout.branches if name in elements]
    elements |= layout.branches
    period = next(iter(periods.values()), _DEFAULT_PERIOD)
    if any(abs(other - period) > 1e-9 * period for other in periods.values()):
        listing = ", ".join(f"{name} {value:.10g} s" for name, value in periods.items())
        faults.append(f"the periods differ: {listing}")
    return elements, period


def _without_zeros(values: Mapping[str, float]) -> dict[str, float]:
    """Vessel parameters, those of absent elements left out."""
    return {name: v for name, v in values.items() if v != 0.0 or name == "R_viscous"}


def _condition(
    condition: Mapping[str, Any],
    side: int,
    interpolation: Literal["linear", "cubic"],
    periods: dict[str, float],
    faults: list[str],
) -> AbstractElement | None:
    """The source or block of a boundary condition; its period is entered into `periods`."""
    name, kind = condition["bc_name"], condition["bc_type"]
    where = f"boundary condition {name}"
    values = {k: v for k, v in condition["bc_values"].items() if not k.startswith("_")}
    series_key = CONDITIONS[kind].series
    waveform = None
    if series_key:
        times, series = ([float(v) for v in values[key]] for key in ("t", series_key))
        if kind == "FLOW" and side == OUTLET:
            series = [-value for value in series]  # ours enters the node, theirs leaves the vessel
        try:
            waveform, period = waveform_from_series(times, series, interpolation=interpolation)
        except ValueError as error:
            faults.append(f"{where}: {series_key}: {error}")
            return None
        if period is not None:
            periods[name] = period
    if kind in ("FLOW", "PRESSURE"):
        return {"FLOW": FlowSource, "PRESSURE": PressureSource}[kind](waveform)
    if side == INLET:
        faults.append(
            f"{where}: a {kind} at an inlet would be a negative resistance (flow counts from the "
            "inlet into the vessel); set it at an outlet"
        )
        return None
    kind, parameters = _block(kind, values, waveform)
    return _built(kind, parameters, where, faults)


def _block(
    kind: str, values: Mapping[str, Any], waveform: AbstractWaveform | None
) -> tuple[Any, dict[str, Any]]:
    """Type and parameters of the block that represents a boundary condition of svZeroDSolver."""
    if kind == "CORONARY":
        names = {"R_1": "Ra1", "R_2": "Ra2", "R_3": "Rv1", "C_a": "Ca", "C_im": "Cc"}
        names |= {"P_venous": "P_v"}
        return Coronary, {"P_im": waveform} | {ours: values[key] for ours, key in names.items()}
    if kind == "RESISTANCE":
        return Resistance, {"R": values["R"], "P_ref": values["Pd"]}
    P_ref = values.get("Pd", 0.0)
    if values["C"] == 0.0 or values["Rd"] == 0.0:  # no charge, or none that changes
        return Resistance, {"R": values["Rp"] + values["Rd"], "P_ref": P_ref}
    names = {"R_proximal": "Rp", "C": "C", "R_distal": "Rd"}
    return RCR, {"P_ref": P_ref} | {ours: values[key] for ours, key in names.items()}


def _built(kind: Any, parameters: Mapping[str, Any], where: str, faults: list[str]) -> Any:
    """An element, or None and a fault where it refuses its parameters."""
    try:
        return kind(**parameters)
    except ValueError as error:
        faults.append(f"{where}: {error}")
        return None
