"""A small elastic tube between a pressure that pulses and a Windkessel; also a program to kill.

``python pulsed_tube.py FOLDER STEPS`` runs it with every kind of output, or goes on with it.
"""

import hashlib
import pathlib
import sys

import jax
import numpy as np

from jaxfsi import Mesh
from jaxfsi.core.laws.materials import SaintVenantKirchhoff
from jaxfsi.core.laws.solid import Wall
from jaxfsi.core.ports.block import BlockPort
from jaxfsi.core.ports.pressure import PressurePort
from jaxfsi.core.step.model import Model, WallElement, build_model
from jaxfsi.core.step.state import State, initial_state
from jaxfsi.meshing import tube
from jaxfsi.simulation import FieldSeries, ShearCycle, SolverChoice, simulate, write_csv
from lumped.blocks import RCR
from lumped.units import MMHG
from lumped.waveforms import Sinusoid

MEAN = 10.0 * MMHG
SOLVER = SolverChoice(max_iterations=60)


def pulsed_tube(
    *, rigid: bool = False, wall_element: WallElement = "linear"
) -> tuple[Mesh, Model, State]:
    """Mesh, model and start."""
    mesh = tube(
        radius=0.3,
        length=1.2,
        thickness=0.06,
        n_around=6,
        n_axial=4,
        n_layers=0 if rigid else 1,
        columns=wall_element == "bending",
    )
    ports = {
        "inlet": PressurePort(Sinusoid(MEAN, 2.0 * MMHG, 0.1, -np.pi / 2.0)),
        "outlet": BlockPort(RCR(R_proximal=400.0, C=2e-5, R_distal=4e3)),
    }
    wall = None if rigid else Wall(SaintVenantKirchhoff(4e6, 0.45), rho_s=1.1)
    model = build_model(mesh, ports, wall=wall, wall_element=wall_element)
    block = ports["outlet"].block
    assert block.state_names == ("P_wk",)
    state = initial_state(model, p=MEAN, blocks=(None, jax.numpy.asarray([MEAN])))
    return mesh, model, state


def run(folder: pathlib.Path, n_steps: int, *, rigid: bool) -> None:
    """Run with fields, shear, checkpoints and a record."""
    mesh, model, state = pulsed_tube(rigid=rigid)
    shear = ShearCycle(mesh, every=5, period=0.1)
    end = simulate(
        model,
        state,
        dt=1e-3,
        n_steps=n_steps,
        chunk=5,
        solver=SOLVER,
        observers=[FieldSeries(folder / "fields", mesh, every=15), shear],
        checkpoint=folder / "checkpoint.npz",
        checkpoint_every=10,
        progress=lambda g: print(g.step, flush=True),
    )
    shear.write(folder / "shear.vtu")
    write_csv(folder / "history.csv", end.record, model.names)


def content(folder: pathlib.Path) -> dict[str, str]:
    """Hash of every file of a run, the arrays of the checkpoint apart."""
    found = {}
    for path in sorted(folder.rglob("*")):
        if path.suffix == ".npz":
            with np.load(path) as file:
                for name in file.files:
                    found[f"{path.name}:{name}"] = hashlib.sha256(file[name].tobytes()).hexdigest()
        elif path.is_file():
            found[str(path.relative_to(folder))] = hashlib.sha256(path.read_bytes()).hexdigest()
    return found


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
    run(pathlib.Path(sys.argv[1]), int(sys.argv[2]), rigid="--rigid" in sys.argv)
