"""The input of svMultiPhysics for a case and its mesh: the same artery in another code.

The file names the surfaces of the mesh-complete folders beside it. What that program does not have
is left out or replaced, and a comment in the file says so:

- a coronary bed becomes an RCR of the same total resistance, R_proximal = R_1, C = C_a,
  R_distal = R_2 + R_3: without the pump of the heart muscle means agree, waveforms do not;
- the run starts from no pressure, and the wall carries none in the shape of the image: over a
  quarter of the first cycle the aortic pressure rises from nothing, and the outlets fill with it.
"""

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence

import numpy as np

from jaxfsi import INTERFACE, OUTER_WALL, Mesh, Region
from jaxfsi.mesh import RING_SUFFIX
from jaxfsi.mesh_files import UNITS_CM
from jaxfsi.opening import OUTLET, inlet_name
from lumped import RCR, AbstractElement, Coronary
from study.case.faults import CaseError
from study.case.laws import CARREAU_YASUDA
from study.case.model import Case
from study.run.opening_checks import check_openings
from study.run.patient import stress_rules
from study.run.setup import aortic_pressure, check_simulation, outlets_of, plan_steps

INPUT_FILE, PRESSURE_FILE = "solver.xml", "aortic_pressure.dat"

_SAMPLES, _HARMONICS = 400, 64
"""Of a cycle."""

_RISE = 0.25
"""Share of the first cycle over which the pressure rises."""

_FRAMES = 40
_BACKFLOW = 0.2
_LEAST_PENALTY = 1.0
"""Without effect on a wall [dyn/cm²]."""

_LAWS = {"saint_venant_kirchhoff": "stVK", "neo_hookean": "neoHookean"}


def solver_input(case: Case, condition: str, mesh: Mesh, unit: str) -> dict[str, str]:
    """Files of a run of svMultiPhysics by name, to lie beside the folders `fluid` and `solid`.

    Args:
        case: the case.
        condition: name of the condition.
        mesh: its mesh, in the folders.
        unit: length unit of the folders.

    Raises:
        CaseError: the case cannot be run in 3D.
    """
    rigid = not np.any(mesh.region == Region.SOLID)
    check_simulation(case, condition, rigid=rigid, dt=None)
    check_openings(case, mesh, rigid=rigid, segment=True)
    entry = case.conditions[condition]
    rule = None if entry.kind == "rest" else stress_rules(case)[case.stress.rule]
    outlets = outlets_of(case, condition, mesh, None, rule)
    plan = plan_steps(case, condition)
    root = ET.Element("svMultiPhysicsFile", version="0.1")
    _say(root, f"{case.id}, {condition}: units are cm, g, s. Written by jaxfsi. It differs from")
    _say(root, "a run of jaxfsi in this: the blood starts without pressure, at rest, and the")
    _say(root, f"aortic pressure rises from nothing over the first {_RISE:g} of a cycle.")
    for text in _differences(case, rigid=rigid):
        _say(root, text)
    _general(root, plan.dt, plan.n_steps, plan.per_frame)
    _meshes(root, mesh, unit, rigid=rigid)
    equation = _equation(root, "fluid" if rigid else "FSI", case, rigid=rigid)
    inlet = inlet_name(mesh.openings)
    _pressure(equation, f"fluid_{inlet}", PRESSURE_FILE)
    for name in mesh.openings:
        if name != inlet:
            _outlet(equation, name, outlets.blocks[name])
    if rigid:
        _fixed(equation, f"fluid_{INTERFACE}")
    else:
        for name in _rings(mesh):
            _fixed(equation, f"solid_{name}")
        _support(equation, case)
        moving = _mesh_equation(root)
        for name in mesh.openings:
            _fixed(moving, f"fluid_{name}")
    ET.indent(root)
    text = ET.tostring(root, encoding="unicode", xml_declaration=False)
    cycles = math.ceil(plan.n_steps / plan.per_cycle)
    head = '<?xml version="1.0" encoding="UTF-8" ?>\n'
    return {INPUT_FILE: f"{head}{text}\n", PRESSURE_FILE: _samples(case, condition, cycles)}


def input_or_reason(
    case: Case, condition: str, mesh: Mesh, unit: str
) -> tuple[dict[str, str], str]:
    """The files, or none and why in a sentence."""
    try:
        return solver_input(case, condition, mesh, unit), ""
    except CaseError as refusal:
        reason = refusal.faults[0].problem
    except RuntimeError as failure:  # no periodic state in 0D to start from
        reason = str(failure)
    return {}, f"no {INPUT_FILE} for svMultiPhysics was written: {reason}"


def _say(parent: ET.Element, text: str) -> None:
    parent.append(ET.Comment(f" {re.sub('-{2,}', '-', text)} "))


def _put(parent: ET.Element, name: str, value: object, **attributes: str) -> ET.Element:
    found = ET.SubElement(parent, name, attributes)
    if isinstance(value, bool):
        value = str(value).lower()
    found.text = f" {value:.10g} " if isinstance(value, float) else f" {value} "
    return found


def _differences(case: Case, *, rigid: bool) -> list[str]:
    """What the file cannot say, in sentences."""
    if rigid:
        return []
    wall, found = case.wall, ["Its linear tetrahedra hardly bend; jaxfsi's wall does."]
    if wall.prestress == "diastole":
        found.append("The wall has no prestress: it widens as the pressure rises from nothing.")
    if wall.material not in _LAWS:
        found.append(f"The law {wall.material} is replaced by neoHookean of the same E and nu.")
    if wall.E_coronary is not None or wall.E_septum is not None:
        found.append("The whole wall has the E of the aorta.")
    if wall.damping:
        found.append("The viscosity of the wall is left out.")
    return found


def _general(root: ET.Element, dt: float, steps: int, per_frame: int) -> None:
    part = ET.SubElement(root, "GeneralSimulationParameters")
    every = max(1, per_frame)
    for name, value in {
        "Continue_previous_simulation": 0,
        "Number_of_spatial_dimensions": 3,
        "Number_of_time_steps": steps,
        "Time_step_size": dt,
        "Spectral_radius_of_infinite_time_step": 0.5,
        "Searched_file_name_to_trigger_stop": "STOP_SIM",
        "Save_results_to_VTK_format": True,
        "Name_prefix_of_saved_VTK_files": "result",
        "Increment_in_saving_VTK_files": every,
        "Start_saving_after_time_step": 1,
        "Increment_in_saving_restart_files": 10 * every,
        "Convert_BIN_to_VTK_format": 0,
        "Verbose": 1,
        "Warning": 0,
        "Debug": 0,
    }.items():
        _put(part, name, value)


def _rings(mesh: Mesh) -> list[str]:
    return [name for name in mesh.label_names if name.endswith(RING_SUFFIX)]


def _meshes(root: ET.Element, mesh: Mesh, unit: str, *, rigid: bool) -> None:
    """Both meshes with the surfaces that lie in their folders, and how they meet."""
    surfaces: dict[str, Sequence[str]] = {"fluid": (*mesh.openings, INTERFACE)}
    if not rigid:
        surfaces["solid"] = (*_rings(mesh), INTERFACE, OUTER_WALL)
    for domain, (region, names) in enumerate(surfaces.items()):
        part = ET.SubElement(root, "Add_mesh", name=region)
        _put(part, "Mesh_file_path", f"{region}/mesh-complete.mesh.vtu")
        for name in names:
            face = ET.SubElement(part, "Add_face", name=f"{region}_{name}")
            _put(face, "Face_file_path", f"{region}/mesh-surfaces/{name}.vtp")
        _put(part, "Domain", domain)
        if unit != "cm":
            _put(part, "Mesh_scale_factor", UNITS_CM[unit])
    if not rigid:
        part = ET.SubElement(root, "Add_projection", name=f"solid_{INTERFACE}")
        _put(part, "Project_from_face", f"fluid_{INTERFACE}")


def _equation(root: ET.Element, kind: str, case: Case, *, rigid: bool) -> ET.Element:
    """The equation of blood and wall, with its materials."""
    found = ET.SubElement(root, "Add_equation", type=kind)
    _iterations(found)
    fluid = found if rigid else ET.SubElement(found, "Domain", id="0")
    if not rigid:
        _put(fluid, "Equation", "fluid")
    _put(fluid, "Density", case.blood.rho_f)
    _viscosity(fluid, case)
    _put(fluid, "Backflow_stabilization_coefficient", _BACKFLOW)
    if not rigid:
        wall = ET.SubElement(found, "Domain", id="1")
        linear = case.wall.material == "linear"
        _put(wall, "Equation", "lElas" if linear else "struct")
        if not linear:
            law = _LAWS.get(case.wall.material, "neoHookean")
            _put(wall, "Constitutive_model", "", type=law)
            _put(wall, "Dilational_penalty_model", "ST91")
            if law == "stVK":
                # by default that program adds a bulk modulus to this law too; it refuses zero
                penalty = case.wall.volumetric_penalty or _LEAST_PENALTY
                _put(wall, "Penalty_parameter", penalty)
        _put(wall, "Density", case.wall.rho_s)
        _put(wall, "Elasticity_modulus", case.wall.E)
        _put(wall, "Poisson_ratio", case.wall.nu)
    _solver(found, "GMRES")
    output = ET.SubElement(found, "Output", type="Spatial")
    for name in ("Velocity", "Pressure", *(() if rigid else ("Displacement", "VonMises_stress"))):
        _put(output, name, True)
    return found


def _viscosity(parent: ET.Element, case: Case) -> None:
    blood = case.blood
    if blood.law != CARREAU_YASUDA:
        part = ET.SubElement(parent, "Viscosity", model="Constant")
        _put(part, "Value", blood.mu)
        return
    part = ET.SubElement(parent, "Viscosity", model="Carreau-Yasuda")
    for name, value in {
        "Limiting_high_shear_rate_viscosity": blood.mu_infinite,
        "Limiting_low_shear_rate_viscosity": blood.mu_zero,
        "Shear_rate_tensor_multiplier": blood.relaxation_time,
        "Shear_rate_tensor_exponent": blood.transition,
        "Power_law_index": blood.exponent,
    }.items():
        _put(part, name, value)


def _iterations(parent: ET.Element) -> None:
    values: Mapping[str, object] = {
        "Coupled": True, "Min_iterations": 1, "Max_iterations": 10, "Tolerance": 1e-6,
    }  # fmt: skip
    for name, value in values.items():
        _put(parent, name, value)


def _solver(parent: ET.Element, kind: str) -> None:
    part = ET.SubElement(parent, "LS", type=kind)
    algebra = ET.SubElement(part, "Linear_algebra", type="fsils")
    _put(algebra, "Preconditioner", "fsils")
    _put(part, "Tolerance", 1e-6)
    _put(part, "Max_iterations", 200)
    if kind == "GMRES":
        _put(part, "Krylov_space_dimension", 100)


def _pressure(parent: ET.Element, face: str, file: str) -> None:
    part = ET.SubElement(parent, "Add_BC", name=face)
    _put(part, "Type", "Neu")
    _put(part, "Time_dependence", "Unsteady")
    _put(part, "Temporal_values_file_path", file)


def _outlet(parent: ET.Element, name: str, block: AbstractElement) -> None:
    """An RCR; of a coronary bed the one of the same resistance."""
    if isinstance(block, Coronary):
        values = block.R_1, block.C_a, block.R_2 + block.R_3, block.P_venous
        _say(
            parent,
            f"{name}: the coronary bed R_1 {float(block.R_1):.6g}, R_2 {float(block.R_2):.6g}, R_3"
            f" {float(block.R_3):.6g}, C_a {float(block.C_a):.6g}, C_im {float(block.C_im):.6g} as"
            " an RCR of the same resistance, without C_im and the pressure of the heart muscle",
        )
    elif isinstance(block, RCR):
        values = block.R_proximal, block.C, block.R_distal, block.P_ref
        if name == OUTLET:
            _say(parent, f"{name}: the Windkessel of the systemic circulation, as in jaxfsi")
    else:
        raise TypeError(f"{type(block).__name__} has no RCR. Give a Windkessel or coronary bed.")
    part = ET.SubElement(parent, "Add_BC", name=f"fluid_{name}")
    _put(part, "Type", "Neu")
    _put(part, "Time_dependence", "RCR")
    rcr = ET.SubElement(part, "RCR_values")
    names = ("Proximal_resistance", "Capacitance", "Distal_resistance", "Distal_pressure")
    for key, value in zip(names, values, strict=True):
        _put(rcr, key, float(value))
    _put(rcr, "Initial_pressure", 0.0)


def _fixed(parent: ET.Element, face: str) -> None:
    part = ET.SubElement(parent, "Add_BC", name=face)
    _put(part, "Type", "Dir")
    _put(part, "Value", 0.0)


def _support(parent: ET.Element, case: Case) -> None:
    """Springs and dashpots of the tissue outside the wall, where there are any."""
    tissue = case.wall.tissue
    if not (tissue.stiffness or tissue.damping):
        return
    part = ET.SubElement(parent, "Add_BC", name=f"solid_{OUTER_WALL}")
    _put(part, "Type", "Robin")
    _put(part, "Stiffness", tissue.stiffness)
    _put(part, "Damping", tissue.damping)


def _mesh_equation(root: ET.Element) -> ET.Element:
    found = ET.SubElement(root, "Add_equation", type="mesh")
    _iterations(found)
    _put(found, "Poisson_ratio", 0.3)
    _solver(found, "CG")
    output = ET.SubElement(found, "Output", type="Spatial")
    _put(output, "Displacement", True)
    return found


def _samples(case: Case, condition: str, cycles: int) -> str:
    """The aortic pressure of all cycles: numbers of samples and harmonics, then time and value."""
    entry = case.conditions[condition]
    n = _SAMPLES * cycles + 1
    wave, t = aortic_pressure(entry), np.linspace(0.0, cycles * entry.period, n)
    share = np.minimum(t / (_RISE * entry.period), 1.0)
    one = np.array([float(wave(float(time))) for time in t[:_SAMPLES]])
    values = np.append(np.tile(one, cycles), one[0]) * np.sin(np.pi / 2.0 * share) ** 2
    assert np.all(np.isfinite(values)), "a waveform is finite"
    rows = [f"{time:.8e} {value:.8e}" for time, value in zip(t, values, strict=True)]
    return "\n".join([f"{n} {_HARMONICS * cycles}", *rows]) + "\n"
