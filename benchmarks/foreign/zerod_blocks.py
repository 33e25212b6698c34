"""svZeroDSolver's blocks for the foreign records: the coronary circuit and a beating heart.

svZeroDSolver has no units: mmHg, mL and s are given. The circuit is a vessel with a stenosis
coefficient (R_0, L, C_0 at its end), a bed of the coronary boundary condition, and what an effect
adds at the junction of the distal sensor: a second layer of the bed, a collateral, a side branch, a
compliance behind a resistance.
"""

from typing import Any

import numpy as np

from benchmarks.foreign.patient import Parameters

JOINT = 1e-4
"""Resistance of a vessel that only joins blocks [mmHg·s/mL]."""

Config = dict[str, Any]


def solver_module() -> Any:
    """The module `svzerod`.

    Raises:
        ImportError: it is not installed.
    """
    try:
        import svzerod  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise ImportError(
            "The generator zerod needs svZeroDSolver: pip install 'svzerod>=3.2' "
            "(extra 'benchmark'), or use the generators other_forms and real_clock."
        ) from error
    return svzerod


class Wiring:
    """A configuration of svZeroDSolver that grows by blocks."""

    def __init__(self, period: float, points: int, cycles: int):
        self.vessels: list[Config] = []
        self.conditions: list[Config] = []
        self.junctions: list[Config] = []
        self.more: Config = {}
        self.settings = {
            "number_of_cardiac_cycles": cycles,
            "number_of_time_pts_per_cardiac_cycle": points + 1,
            "cardiac_period": period,
            "steady_initial": True,
            "output_all_cycles": False,
            "absolute_tolerance": 1e-8,
            "maximum_nonlinear_iterations": 60,
        }

    def boundary(self, name: str, kind: str, **values: Any) -> str:
        """Add a boundary condition."""
        self.conditions.append({"bc_name": name, "bc_type": kind, "bc_values": values})
        return name

    def vessel(
        self, name: str, *, inlet: str | None = None, outlet: str | None = None, **values: float
    ) -> int:
        """Add a vessel between boundary conditions or open ends."""
        ends = {"inlet": inlet, "outlet": outlet}
        self.vessels.append(
            {
                "vessel_id": len(self.vessels),
                "vessel_name": name,
                "vessel_length": 1.0,
                "zero_d_element_type": "BloodVessel",
                "zero_d_element_values": values,
                "boundary_conditions": {end: bc for end, bc in ends.items() if bc},
            }
        )
        return len(self.vessels) - 1

    def join(self, name: str, inlets: list[int], outlets: list[int]) -> None:
        """Join ends of vessels."""
        self.junctions.append(
            {
                "junction_name": name,
                "junction_type": "NORMAL_JUNCTION",
                "inlet_vessels": inlets,
                "outlet_vessels": outlets,
            }
        )

    @property
    def config(self) -> Config:
        """The whole configuration."""
        return {
            "simulation_parameters": self.settings,
            "boundary_conditions": self.conditions,
            "vessels": self.vessels,
            "junctions": self.junctions,
            **self.more,
        }


def coronary(
    p: Parameters, P_ao: np.ndarray, P_im: np.ndarray, period: float, cycles: int
) -> Config:
    """The circuit of a member; the distal sensor is at `pressure:ostium:distal`.

    Args:
        p: parameters of the base circuit, and those of an effect where it has them: `K` (stenosis
            coefficient), `K_beyond` (behind the sensor), `deep_P_v` (venous pressure of a second
            layer), `collateral_R` with `collateral_P` (0: the aorta), `late_C` with `late_R`,
            `fistula_R`, `R_2_most` with `contraction` and `relaxation`, and `at_artery` (1: what is
            added lies behind R_1, not at the sensor).
        P_ao: aortic pressure at uniform times, closing point included [mmHg].
        P_im: intramyocardial pressure at these times [mmHg].
        period: length of the beat [s].
        cycles: cycles to run.
    """
    wires = Wiring(period, P_ao.size - 1, cycles)
    t = np.linspace(0.0, period, P_ao.size).tolist()
    aorta = wires.boundary("AORTA", "PRESSURE", t=t, P=P_ao.tolist())
    ostium = wires.vessel(
        "ostium", inlet=aorta, R_poiseuille=p["R_0"], C=p["C_0"], L=p["L"],
        stenosis_coefficient=p.get("K", 0.0),
    )  # fmt: skip
    into, out_of = _sides(wires, p, P_ao, t)
    if p.get("at_artery"):
        artery = wires.vessel("artery", R_poiseuille=p["R_1"], C=p["C_a"])
        rest = {**p, "R_1": 0.5 * p["R_2"], "R_2": 0.5 * p["R_2"], "C_a": 1e-6}
        beds = _beds(wires, rest, P_im, t)
        wires.join("distal", [ostium], [artery])
        wires.join("behind", [artery, *into], [*beds, *out_of])
    else:
        beds = _beds(wires, p, P_im, t)
        wires.join("distal", [ostium, *into], [*beds, *out_of])
    return wires.config


def _beds(wires: Wiring, p: Parameters, P_im: np.ndarray, t: list[float]) -> list[int]:
    """The bed, or two layers of it side by side."""
    layers = 2 if "deep_P_v" in p else 1
    found = []
    for layer in range(layers):
        values = {
            "Ra1": layers * p["R_1"],
            "Rv1": layers * p["R_3"],
            "Ca": p["C_a"] / layers,
            "Cc": p["C_im"] / layers,
            "P_v": p["deep_P_v"] if layer else p["P_v"],
            "Pim": P_im.tolist(),
            "t": t,
        }
        R_2 = layers * p["R_2"]
        if "R_2_most" in p:
            kind = "CORONARY_VAR_RES"
            values |= {"Ra2_min": R_2, "Ra2_max": R_2 * p["R_2_most"]}
            values |= {"T_vc": p["contraction"] * t[-1], "T_vr": p["relaxation"] * t[-1]}
        else:
            kind, values["Ra2"] = "CORONARY", R_2
        bed = wires.boundary(f"BED{layer}", kind, **values)
        found.append(
            wires.vessel(
                f"to_bed{layer}",
                outlet=bed,
                R_poiseuille=JOINT,
                stenosis_coefficient=p.get("K_beyond", 0.0),
            )
        )
    return found


def _sides(
    wires: Wiring, p: Parameters, P_ao: np.ndarray, t: list[float]
) -> tuple[list[int], list[int]]:
    """Vessels of an effect that flow into the joint, and out of it."""
    into, out_of = [], []
    if "collateral_R" in p:
        steady = p.get("collateral_P", 0.0)
        P = P_ao.tolist() if steady == 0.0 else [steady] * len(t)
        source = wires.boundary("ELSEWHERE", "PRESSURE", t=t, P=P)
        into.append(wires.vessel("collateral", inlet=source, R_poiseuille=p["collateral_R"]))
    if p.get("late_C"):
        wall = wires.boundary("WALL", "RCR", Rp=p["late_R"], C=p["late_C"], Rd=1e7, Pd=0.0)
        out_of.append(wires.vessel("to_wall", outlet=wall, R_poiseuille=JOINT))
    if "fistula_R" in p:
        drain = wires.boundary("DRAIN", "RESISTANCE", R=p["fistula_R"], Pd=6.0)
        out_of.append(wires.vessel("fistula", outlet=drain, R_poiseuille=JOINT))
    return into, out_of


def heart_beat(rng: np.random.Generator) -> np.ndarray:
    """One beat of aortic pressure [mmHg] of a beating heart; it starts anywhere.

    A ventricle of varying elastance, two valves and a Windkessel.
    """
    period = float(rng.uniform(0.6, 0.9))
    wires = Wiring(period, 400, 14)
    wires.settings |= {"steady_initial": False, "absolute_tolerance": 1e-8}
    preload = wires.boundary("PRELOAD", "PRESSURE", t=[0.0, period], P=[8.0, 8.0])
    system = wires.boundary(
        "SYSTEM", "RCR", Rp=float(rng.uniform(0.03, 0.09)), C=float(rng.uniform(0.8, 1.8)),
        Rd=float(rng.uniform(0.9, 1.3)), Pd=4.0,
    )  # fmt: skip
    wires.vessel(
        "aorta", outlet=system, R_poiseuille=0.02, C=float(rng.uniform(0.1, 0.3)),
        L=float(rng.uniform(0.0005, 0.0015)),
    )  # fmt: skip
    values = {"Emax": 2.5, "Emin": 0.08, "Vrd": 10.0, "Vrs": 10.0, "Impedance": 1e-4}
    course = {"type": "half_cosine", "t_active": 0.0, "t_twitch": float(rng.uniform(0.45, 0.6))}
    course["t_twitch"] *= period
    chamber = {"type": "ChamberElastanceInductor", "name": "ventricle", "values": values}
    closed = {"Rmax": 200.0, "Steepness": 2.0}
    ends = [(preload, "ventricle", 0.005), ("ventricle", "aorta", 0.02)]
    valves = [
        {
            "type": "ValveTanh",
            "name": f"valve_{k}",
            "params": {**closed, "Rmin": R, "upstream_block": a, "downstream_block": b},
        }
        for k, (a, b, R) in enumerate(ends)
    ]
    wires.more = {
        "chambers": [{**chamber, "activation_function": course}],
        "valves": valves,
        "initial_condition": {"pressure_all": 70.0, "volume:ventricle": 100.0},
    }
    solver = solver_module().Solver(wires.config)
    solver.run()
    return np.asarray(solver.get_single_result("pressure:valve_1:aorta")).ravel()[:-1]
