"""svZeroDSolver case files out: a network of our elements to JSON.

A node at which one source or block meets one vessel becomes a boundary condition of that vessel;
every other node becomes a NORMAL_JUNCTION of its name. Waveforms become time series, exact for
constants and linear samples. What the format has no element for is refused.
"""

import dataclasses
import os
from typing import Any

import numpy as np

from lumped.blocks import RC, RCR, Coronary, Resistance
from lumped.network import Network
from lumped.sources import FlowSource, PressureSource
from lumped.svzerod import SAMPLES, SvZeroDCase
from lumped.svzerod_file import VESSEL_KEYS, dump_json, raise_faults
from lumped.svzerod_series import series_from_waveform
from lumped.vessels import Vessel, VesselCRL
from lumped.waveforms import AbstractWaveform

_VESSELS = {Vessel: "BloodVessel", VesselCRL: "BloodVesselCRL"}
_SOURCES = {FlowSource: ("FLOW", "Q"), PressureSource: ("PRESSURE", "P")}
_BLOCKS = (Resistance, RC, RCR, Coronary)
_CURE = (
    "Use the elements that both have: "
    + ", ".join(kind.__name__ for kind in (*_VESSELS, *_SOURCES, *_BLOCKS))
    + "."
)


def write_svzerod(
    path: str | os.PathLike[str],
    case: SvZeroDCase | Network,
    *,
    period: float | None = None,
    samples: int = SAMPLES,
) -> None:
    """Write a case that svZeroDSolver runs. The file appears whole or not at all.

    Args:
        path: the file to write.
        case: the case, or a network to be run with the settings that `SvZeroDCase` defaults to.
        period: length of the cycle [s]; needed with a network, refused with a case.
        samples: equal parts of the period into which smooth waveforms are cut.

    Raises:
        ValueError: the network has elements or waveforms that a case file cannot hold.
    """
    if isinstance(case, Network):
        if period is None:
            raise ValueError("A network has no period of its own. Give `period` in seconds.")
        case = SvZeroDCase(case, float(period))
    elif period is not None:
        raise ValueError("The case has a period. Leave `period` out, or change it in the case.")
    dump_json(path, svzerod_config(case, samples=samples))


def svzerod_config(case: SvZeroDCase, *, samples: int = SAMPLES) -> dict[str, Any]:
    """The content of a case file, as `svzerod.simulate` takes it.

    Args:
        case: the case.
        samples: equal parts of the period into which smooth waveforms are cut.

    Raises:
        ValueError: the network has elements or waveforms that a case file cannot hold.
    """
    network, faults = case.network, []
    pairs = list(zip(network.names, network.elements, strict=True))
    outlets, links, junctions = _connections(network)
    conditions, vessels = [], []
    for name, element in pairs:
        if type(element) in _VESSELS:
            entry = _vessel(name, element, len(vessels), faults)
            vessels.append(entry | {"boundary_conditions": links[name]})
        else:
            reverse = name in outlets
            conditions.append(_condition(name, element, case.period, samples, reverse, faults))
    raise_faults(f"{case.name} cannot be written as a svZeroDSolver case", faults, _CURE)
    identity = {vessel["vessel_name"]: vessel["vessel_id"] for vessel in vessels}
    return {
        "description": {"name": case.name},
        "simulation_parameters": _settings(case),
        "boundary_conditions": conditions,
        "vessels": vessels,
        "junctions": [_junction(entry, identity) for entry in junctions],
    }


@dataclasses.dataclass(frozen=True)
class _Junction:
    """A node of several elements: names of those that flow in and of those that flow out."""

    name: str
    inlets: list[str]
    outlets: list[str]


def _connections(network: Network) -> tuple[set[str], dict[str, dict[str, str]], list[_Junction]]:
    """Conditions at outlets of vessels, conditions of each vessel, and junctions."""
    meeting: dict[str, list[tuple[str, int]]] = {node: [] for node in network.nodes}
    for name, nodes in zip(network.names, network.ports, strict=True):
        for port, node in enumerate(nodes):
            meeting[node].append((name, port))
    taken = set(network.names)
    outlets: set[str] = set()
    links: dict[str, dict[str, str]] = {name: {} for name in network.names}
    junctions = []
    for node, members in meeting.items():
        ends = [(name, port) for name, port in members if type(network[name]) in _VESSELS]
        single = [name for name, _ in members if type(network[name]) not in _VESSELS]
        # a block at an inlet would count its flow backwards: only a junction turns it
        at_inlet = bool(ends) and ends[0][1] == 0
        turned = at_inlet and any(type(network[name]) not in _SOURCES for name in single)
        if len(ends) == len(single) == 1 and not turned:
            (vessel, port), (condition,) = ends[0], single
            links[vessel][("inlet", "outlet")[port]] = condition
            outlets |= {condition} if port == 1 else set()
            continue
        sources = [name for name in single if type(network[name]) in _SOURCES]
        blocks = [name for name in single if name not in sources]
        name = node
        while name in taken:
            name += "_node"
        taken.add(name)
        inlets = [vessel for vessel, port in ends if port == 1] + sources
        junctions.append(_Junction(name, inlets, [v for v, port in ends if port == 0] + blocks))
    return outlets, links, junctions


def _junction(junction: _Junction, identity: dict[str, int]) -> dict[str, Any]:
    entry: dict[str, Any] = {
        "junction_name": junction.name,
        "junction_type": "NORMAL_JUNCTION",
    }
    sides = {"inlet": junction.inlets, "outlet": junction.outlets}
    if all(name in identity for names in sides.values() for name in names):
        return entry | {f"{k}_vessels": [identity[v] for v in names] for k, names in sides.items()}
    return entry | {f"{k}_blocks": names for k, names in sides.items()}


def _vessel(name: str, vessel: Any, identity: int, faults: list[str]) -> dict[str, Any]:
    values = {
        key: _number(getattr(vessel, ours), f"{name}: {ours}", faults)
        for ours, key in VESSEL_KEYS.items()
    }
    return {
        "vessel_name": name,
        "vessel_id": identity,
        "zero_d_element_type": _VESSELS[type(vessel)],
        "zero_d_element_values": values,
    }


def _condition(
    name: str, element: Any, period: float, samples: int, reverse: bool, faults: list[str]
) -> dict[str, Any]:
    """A source or block; the flow of a source counts the other way at an outlet."""

    def series(waveform: AbstractWaveform, key: str, factor: float) -> dict[str, list[float]]:
        try:
            t, values = series_from_waveform(waveform, period, samples=samples)
        except (TypeError, ValueError) as error:
            faults.append(f"{name}: {error}")
            return {}
        return {"t": t.tolist(), key: (factor * values + 0.0).tolist()}  # + 0.0 drops minus zero

    def numbers(**keys: str) -> dict[str, float]:
        return {
            key: _number(getattr(element, ours), f"{name}: {ours}", faults)
            for ours, key in keys.items()
        }

    if type(element) in _SOURCES:
        kind, key = _SOURCES[type(element)]
        values = series(element.waveform, key, -1.0 if reverse and kind == "FLOW" else 1.0)
    elif isinstance(element, Coronary):
        kind = "CORONARY"
        values = numbers(R_1="Ra1", R_2="Ra2", R_3="Rv1", C_a="Ca", C_im="Cc", P_venous="P_v")
        scale = _number(element.im_factor, f"{name}: im_factor", faults)
        values |= series(element.P_im, "Pim", scale)
    elif isinstance(element, RCR):
        kind, values = "RCR", numbers(R_proximal="Rp", C="C", R_distal="Rd", P_ref="Pd")
    elif isinstance(element, RC):
        kind, values = "RCR", {"Rp": 0.0} | numbers(C="C", R="Rd", P_ref="Pd")
    elif isinstance(element, Resistance):
        kind, values = "RESISTANCE", numbers(R="R", P_ref="Pd")
    else:
        kind, values = "", {}
        faults.append(f"{name}: {type(element).__name__} has no counterpart in svZeroDSolver")
    return {"bc_name": name, "bc_type": kind, "bc_values": values}


def _number(value: Any, where: str, faults: list[str]) -> float:
    number = np.asarray(0.0 if value is None else value)
    if number.shape == () and np.isfinite(number):
        return float(number)
    faults.append(f"{where} = {value} is not one finite number; write one patient at a time")
    return 0.0


def _settings(case: SvZeroDCase) -> dict[str, Any]:
    settings: dict[str, Any] = {
        "number_of_cardiac_cycles": case.cycles,
        "number_of_time_pts_per_cardiac_cycle": case.points_per_cycle,
        "cardiac_period": case.period,
        "steady_initial": case.steady_initial,
        "output_all_cycles": case.output.all_cycles,
        "output_interval": case.output.interval,
        "output_mean_only": case.output.mean_only,
        "output_variable_based": case.output.by_variable,
        "output_derivative": case.output.derivatives,
    }
    if case.cycle_error is not None:
        settings["use_cycle_to_cycle_error"] = True
        settings["sim_cycle_to_cycle_percent_error"] = 100.0 * case.cycle_error
    return settings
