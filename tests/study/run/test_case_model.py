"""Every key of blood, wall, tissue and solver arrives in the model, and acts the right way."""

import dataclasses

import jax
import numpy as np
import pytest

from jaxfsi.core import (
    CarreauYasuda,
    HolzapfelGasserOgden,
    LinearElastic,
    NeoHookean,
    Newtonian,
    SaintVenantKirchhoff,
)
from jaxfsi.core.ports.pressure import PressurePort
from jaxfsi.core.step.march import march
from jaxfsi.core.step.stepper import prepare
from jaxfsi.fields.wall_regions import WallRegion
from jaxfsi.mesh import Region
from jaxfsi.mesh_files import write_mesh
from jaxfsi.meshing import tube
from jaxfsi.simulation import SolverChoice
from jaxfsi.simulation.checkpoint import fingerprint
from lumped.waveforms import Constant
from study.case.blood import BloodParameters
from study.case.faults import CaseError
from study.case.parameters import WallParameters
from study.case.read import read_case
from study.case.schema import Word, keys_of
from study.run.anatomy_source import case_mesh
from study.run.case_model import MATERIALS, VISCOSITIES, blood_of, case_model, wall_of
from study.run.setup import check_simulation, plan_steps, prepare_simulation
from study.run.simulation import solver_choice

CASE = """\
[patient]
id = "tube"
[anatomy]
kind = "mesh"
path = "tube.vtu"
unit = "cm"
[condition.rest]
P_systolic_mmHg = 110.0
P_diastolic_mmHg = 65.0
period_s = 0.80
"""
DT = 1e-2
SHUT = PressurePort(Constant(0.0))


@pytest.fixture(scope="module")
def read(tmp_path_factory):
    """Gives the case with some tables added."""
    folder = tmp_path_factory.mktemp("case")
    mesh = tube(radius=0.2, length=1.0, thickness=0.05, n_around=6, n_axial=4, n_layers=1)
    write_mesh(folder / "tube.vtu", mesh, unit="cm")

    def case(tables: str = ""):
        path = folder / "case.toml"
        path.write_text(CASE + tables, encoding="utf-8")
        return read_case(path)

    return case


def test_defaults_are_a_newtonian_elastic_model_alone_in_space(read):
    case = read()
    viscosity, wall = blood_of(case.blood).viscosity, wall_of(case, case_mesh(case))
    assert isinstance(viscosity, Newtonian)
    assert float(viscosity.mu) == 0.04
    assert isinstance(wall.material, SaintVenantKirchhoff)
    assert float(wall.material.volumetric_penalty) == 0.0
    given = (wall.rho_s, wall.damping, wall.support_stiffness, wall.support_damping)
    assert [float(x) for x in given] == [1.0, 0.0, 0.0, 0.0]
    assert solver_choice(case.solver) == SolverChoice(rho_infinity=0.0)


def test_shear_thinning_arrives(read):
    law = 'law = "carreau_yasuda"\nmu_0_poise = 0.6\nmu_inf_poise = 0.03\n'
    case = read(f"[blood]\n{law}lambda_s = 2.0\na = 1.5\nn = 0.3\n")
    viscosity = blood_of(case.blood).viscosity
    assert isinstance(viscosity, CarreauYasuda)
    found = {name: float(value) for name, value in vars(viscosity).items()}
    assert found == {
        "mu_zero": 0.6, "mu_infinite": 0.03, "relaxation_time": 2.0, "transition": 1.5,
        "exponent": 0.3,
    }  # fmt: skip


@pytest.mark.parametrize(
    ("name", "law"),
    [
        ("linear", LinearElastic),
        ("saint_venant_kirchhoff", SaintVenantKirchhoff),
        ("neo_hookean", NeoHookean),
        ("holzapfel_gasser_ogden", HolzapfelGasserOgden),
    ],
)
def test_every_law_of_the_wall_arrives(read, name, law):
    fibres = "k1_dyn_per_cm2 = 3e5\n" if law is HolzapfelGasserOgden else ""
    case = read(f'[wall]\nmaterial = "{name}"\nE_dyn_per_cm2 = 2e6\n{fibres}')
    material = wall_of(case, case_mesh(case)).material
    assert isinstance(material, law)
    assert float(material.E) == 2e6


def test_fibres_arrive_with_directions_round_and_along_the_lumen(read):
    numbers = "k1_dyn_per_cm2 = 3e5\nk2 = 2.5\nfibre_angle_deg = 40\ndispersion = 0.1\n"
    case = read(f'[wall]\nmaterial = "holzapfel_gasser_ogden"\n{numbers}')
    mesh = case_mesh(case)
    law = wall_of(case, mesh).material
    assert isinstance(law, HolzapfelGasserOgden)
    given = [float(v) for v in (law.k1, law.k2, law.angle, law.dispersion)]
    assert given == pytest.approx([3e5, 2.5, np.radians(40.0), 0.1])
    middle = mesh.points[mesh.tets_of(Region.SOLID)].mean(axis=1)
    radial = middle[:, :2] / np.hypot(*middle[:, :2].T)[:, None]
    # a hexagon: its sides are 30 degrees off a circle at most
    assert np.max(np.abs(np.sum(radial.T * np.asarray(law.circumference)[:2], axis=0))) < 0.51
    np.testing.assert_allclose(np.abs(np.asarray(law.axis)[2]), 1.0, atol=1e-6)


def test_a_checkpoint_of_other_fibres_is_another_run(read):
    ports = {"inlet": SHUT, "outlet": SHUT}

    def run_hash(line):
        fibres = f'material = "holzapfel_gasser_ogden"\nk1_dyn_per_cm2 = 3e5\n{line}'
        case = read(f'[wall]\nprestress = "none"\n{fibres}')
        return fingerprint(case_model(case, case_mesh(case), ports, 0.0)).everything

    hashes = {run_hash(line) for line in ("", "fibre_angle_deg = 41\n", "dispersion = 0.1\n")}
    assert len(hashes) == 3
    assert run_hash("") in hashes


def test_damping_penalty_and_tissue_arrive(read):
    tables = "[wall]\ndamping_poise = 300\nvolumetric_penalty_dyn_per_cm2 = 1e6\n"
    tables += "[tissue]\nstiffness_dyn_per_cm3 = 2e5\ndamping_dyn_s_per_cm3 = 40\n"
    case = read(tables)
    wall = wall_of(case, case_mesh(case))
    assert isinstance(wall.material, SaintVenantKirchhoff)
    assert float(wall.material.volumetric_penalty) == 1e6
    given = (wall.damping, wall.support_stiffness, wall.support_damping)
    assert [float(x) for x in given] == [300.0, 2e5, 40.0]


def test_parts_of_the_wall_have_moduli_of_their_own(read, monkeypatch):
    """With parts of a tube called as those of an anatomy are."""
    linear = '[wall]\nelement = "linear"\n'  # its programs are the smallest
    tables = f"{linear}E_dyn_per_cm2 = 1e7\nE_coronary_dyn_per_cm2 = 2e7\n"
    case = read(tables)
    mesh = case_mesh(case)
    region = np.arange(np.sum(mesh.region == Region.SOLID)) % 3
    monkeypatch.setattr("study.run.case_model.wall_regions", lambda mesh, anatomy: region)
    monkeypatch.setattr("study.run.case_model.case_anatomy", lambda case: None)
    found = np.asarray(wall_of(case, mesh).material.E)
    assert np.array_equal(found, np.where(region == WallRegion.CORONARY, 2e7, 1e7))
    septum = wall_of(read("[wall]\nE_septum_dyn_per_cm2 = 2e7\n"), mesh).material.E
    assert np.array_equal(septum, np.where(region == WallRegion.SEPTUM, 2e7, 1.5e7))
    # prestress and equilibrium of a wall with one modulus a tetrahedron: twice as stiff everywhere
    alike = read(f"{linear}E_dyn_per_cm2 = 2e7\n")
    ports = {"inlet": SHUT, "outlet": SHUT}
    monkeypatch.setattr("study.run.case_model.wall_regions", lambda mesh, anatomy: 0 * region + 1)
    with jax.numpy_rank_promotion("allow"):
        one, other = (case_model(c, mesh, ports, 1e5).prestress for c in (case, alike))
    assert np.allclose(one, other, rtol=1e-6, atol=1e-3)


def test_moduli_of_parts_need_an_axis(read):
    case = read("[wall]\nE_septum_dyn_per_cm2 = 2e7\n")
    with pytest.raises(CaseError, match="axis of the anomalous artery") as error:
        check_simulation(case, "rest", rigid=False, dt=None)
    assert any("wall.E_septum_dyn_per_cm2" in str(fault) for fault in error.value.faults)


def test_least_gap_arrives(read):
    ports = {"inlet": SHUT, "outlet": SHUT}
    for line, gap in (("", None), ("minimum_gap_mm = 0.12\n", 0.012)):
        case = read(f'[wall]\nprestress = "none"\n{line}')
        model = case_model(case, case_mesh(case), ports, 0.0)
        assert (model.contact is None) == (gap is None)
        if model.contact is not None:
            assert float(model.contact.law.gap) == pytest.approx(gap)
            assert float(model.contact.law.stiffness) == 1e6


def test_options_of_the_solver_arrive(read):
    options = "rho_infinity = 0.5\nmax_systems = 5\nmax_iterations = 60\ntolerance = 1e-5\n"
    choice = solver_choice(read(f"[solver]\n{options}").solver)
    assert choice == SolverChoice(0.5, 1e-5, 60, 5)


@pytest.fixture(scope="module")
def ended(read):
    """The state after ten steps of the pulse, and the mesh, of a case with some tables."""

    def run(tables: str = "", *, rigid: bool = False):
        case = read(f"[surrogate]\nR0_dyn_s_per_cm5 = 5e3\n{tables}")
        mesh = case_mesh(case)
        plan = plan_steps(case, "rest", dt=DT)
        with jax.numpy_rank_promotion("allow"):
            setup = prepare_simulation(case, mesh, "rest", plan, rigid=rigid, alpha=0.2)
            options = dataclasses.asdict(solver_choice(case.solver))
            stepper = prepare(plan.dt, setup.model, **options)
            return march(setup.model, setup.state, stepper, 10), mesh

    return run


def widening(found) -> float:
    """Largest displacement of the wall [cm]."""
    end, _ = found
    return float(np.linalg.norm(np.asarray(end.state.d), axis=0).max())


def test_damping_and_tissue_hold_the_wall(ended):
    soft = '[wall]\nelement = "linear"\nprestress = "none"\nE_dyn_per_cm2 = 3e6\n'
    free = widening(ended(soft))
    damped = widening(ended(f"{soft}damping_poise = 1e5\n"))
    held = widening(ended(f"{soft}[tissue]\nstiffness_dyn_per_cm3 = 3e6\n"))
    slowed = widening(ended(f"{soft}[tissue]\ndamping_dyn_s_per_cm3 = 1e5\n"))
    assert free > 1e-3
    for name, less in (("damped", damped), ("held", held), ("slowed", slowed)):
        assert less < 0.9 * free, name


def test_thicker_blood_loses_more_pressure(ended):
    """With n = 1 Carreau-Yasuda blood has mu_0 at every shear rate: Poiseuille's loss is known."""
    drops = []
    for law in ("newtonian", "carreau_yasuda"):
        end, _ = ended(f'[blood]\nlaw = "{law}"\nmu_0_poise = 9.0\nn = 1.0\n', rigid=True)
        P = np.asarray(end.state.P_port)
        drops.append((P[0] - P[1]) / float(end.state.Q_port[1]))
    # the lumen is a hexagon of four elements along the axis
    assert drops[1] == pytest.approx(8.0 * 9.0 * 1.0 / (np.pi * 0.2**4), rel=0.15)
    assert drops[1] > 5.0 * abs(drops[0])  # the blood of 0.04 poise is led by its inertia


@pytest.mark.parametrize(
    ("of", "name", "laws"),
    [(WallParameters, "material", MATERIALS), (BloodParameters, "law", VISCOSITIES)],
    ids=["wall", "blood"],
)
def test_every_law_that_a_case_may_name_is_known(of, name, laws):
    (key,) = (key for key in keys_of(of) if key.name == name)
    assert isinstance(key, Word)
    assert set(key.options) == laws.keys()
