"""A case's exported files in svMultiPhysics beside the same steps here, field by field.

`python -m benchmarks.other_code CASE --program PATH [--steps 10]` meshes the case with the coarse
preset, writes the mesh-complete folders and `solver.xml`, shortens that to so many steps and runs
it. jaxfsi takes the same mesh, boundary values, law and stabilisation, linear elements and no
prestress. The inlet has its pressure at the instant at which that program takes it, the end of a
step; jaxfsi by itself takes it at t + α_f Δt.

Source of the program: https://github.com/SimVascular/svMultiPhysics.
"""

import argparse
import dataclasses
import json
import pathlib
import re
import subprocess
import sys
import tempfile
from typing import Any

import jax.numpy as jnp
import meshio
import numpy as np
from jaxtyping import Array, Float
from scipy.spatial import KDTree

from jaxfsi import Mesh
from jaxfsi.core import BlockPort
from jaxfsi.core.ports.port import AbstractPort
from jaxfsi.core.ports.pressure import PressurePort
from jaxfsi.core.step.generalized_alpha import generalized_alpha
from jaxfsi.core.step.march import march
from jaxfsi.core.step.model import Model, build_model
from jaxfsi.core.step.state import State, initial_state
from jaxfsi.core.step.stepper import prepare
from jaxfsi.mesh_files import read_mesh_complete
from jaxfsi.opening import inlet_name
from lumped import RCR, Coronary
from lumped.parameters import Parameter
from lumped.waveforms import AbstractWaveform
from study import Case, read_case
from study.cli.entry import main as command
from study.run.case_model import blood_of, wall_of
from study.run.setup import outlets_of
from study.run.solver_input import INPUT_FILE, PRESSURE_FILE

_RESULT = "result_*.vtu"


class _Table(AbstractWaveform):
    """Samples, read so much ahead of time."""

    times: Float[Array, " samples"]
    values: Float[Array, " samples"]
    ahead: Parameter

    def __call__(self, t: Parameter) -> Array:
        return jnp.interp(jnp.asarray(t) + self.ahead, self.times, self.values)

    def repeats_after(self) -> Parameter | None:
        return float("inf")

    def breakpoints(self) -> Float[Array, " 0"]:
        return jnp.zeros(0)


def compare(path: pathlib.Path, program: str, place: pathlib.Path, steps: int) -> dict[str, Any]:
    """Export a case, run both codes, and compare their fields after the last step.

    Args:
        path: case file.
        program: path of svmultiphysics.
        place: folder for all files.
        steps: steps of both.

    Returns:
        steps, tetrahedra, and of pressure, velocity and displacement the relative differences:
        root mean square, and largest over the largest value.

    Raises:
        RuntimeError: a program failed.
    """
    words = ["mesh", str(path), "--preset", "coarse", "--format", "folder", "--quiet"]
    if command([*words, "--out", str(place)]) != 0:
        raise RuntimeError(f"{path} cannot be meshed")
    (file,) = place.rglob(INPUT_FILE)
    dt = _shortened(file, steps)
    ran = subprocess.run([program, file.name], cwd=file.parent, capture_output=True, text=True)
    results = sorted(file.parent.rglob(_RESULT))
    if ran.returncode != 0 or not results:
        raise RuntimeError(f"{program} failed: {(ran.stderr or ran.stdout)[-500:]}")
    case, folder = read_case(path), file.parent
    mesh = read_mesh_complete(folder / "fluid", folder / "solid", unit="cm")
    model = _model(case, mesh, folder / PRESSURE_FILE, dt)
    end = march(model, initial_state(model), prepare(dt, model), steps)
    differences = _differences(meshio.read(results[-1]), model, end.state)
    return {"case": case.id, "steps": steps, "tets": len(mesh.tets), **differences}


def _shortened(file: pathlib.Path, steps: int) -> float:
    """Write the number of steps into the input; gives their length [s]."""
    text = file.read_text(encoding="utf-8")
    for name in ("Number_of_time_steps", "Increment_in_saving_VTK_files"):
        text = re.sub(rf"(<{name}>)[^<]*", rf"\g<1> {steps} ", text)
    file.write_text(text, encoding="utf-8")
    found = re.search(r"<Time_step_size>([^<]*)", text)
    assert found is not None, "every input says its step"
    return float(found[1])


def _model(case: Case, mesh: Mesh, pressure: pathlib.Path, dt: float) -> Model:
    """The case with the terms of the other code."""
    times, values = np.loadtxt(pressure, skiprows=1).T
    ahead = (1.0 - generalized_alpha().alpha_f) * dt
    wave = _Table(jnp.asarray(times), jnp.asarray(values), ahead)
    ports: dict[str, AbstractPort] = {inlet_name(mesh.openings): PressurePort(wave)}
    for name, block in outlets_of(case, "rest", mesh, None, None).blocks.items():
        if isinstance(block, Coronary):
            block = RCR(block.R_1, block.C_a, block.R_2 + block.R_3, block.P_venous)
        ports[name] = BlockPort(block)
    return build_model(
        mesh,
        ports,
        blood=dataclasses.replace(blood_of(case.blood), transient_continuity=True),
        wall=wall_of(case, mesh),
        wall_element="linear",
    )


def _differences(other: meshio.Mesh, model: Model, state: State) -> dict[str, float]:
    _, there = KDTree(other.points).query(np.asarray(model.x).T)
    blood, wall = np.asarray(model.in_fluid), np.asarray(model.in_solid)
    fields = {
        "Pressure": (np.asarray(state.p)[:, None], blood),
        "Velocity": (np.asarray(state.u).T, blood),
        "Displacement": (np.asarray(state.d).T, wall),
    }
    found = {}
    for name, (ours, where) in fields.items():
        theirs = np.asarray(other.point_data[name]).reshape(len(other.points), -1)[there][where]
        off = ours[where] - theirs
        found[f"{name.lower()}_rms_%"] = 100.0 * np.linalg.norm(off) / np.linalg.norm(theirs)
        found[f"{name.lower()}_max_%"] = 100.0 * np.max(np.abs(off)) / np.max(np.abs(theirs))
    return {name: float(value) for name, value in found.items()}


def main(words: list[str]) -> int:
    """Compare the case of the command line."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.other_code", description=__doc__)
    parser.add_argument("case", type=pathlib.Path)
    parser.add_argument("--program", default="svmultiphysics")
    parser.add_argument("--steps", type=int, default=10)
    options = parser.parse_args(words)
    with tempfile.TemporaryDirectory() as place:
        row = compare(options.case, options.program, pathlib.Path(place), options.steps)
    print(json.dumps(row, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
