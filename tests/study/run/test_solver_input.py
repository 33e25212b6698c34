"""The input of another solver: the surfaces that it names exist, its numbers are the case's."""

import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest

from jaxfsi.mesh_files import write_mesh_complete
from study import CaseError, read_case
from study.run.anatomy_source import case_mesh
from study.run.setup import outlets_of
from study.run.solver_input import _say, input_or_reason, solver_input
from tests.study import tube_case

INTEGERS = ("GlobalNodeID", "GlobalElementID", "ModelFaceID", "ModelRegionID")


@pytest.fixture(scope="module")
def given(tmp_path_factory):
    case = read_case(tube_case.write_case(tmp_path_factory.mktemp("tube")))
    mesh = case_mesh(case)
    return case, mesh, solver_input(case, "rest", mesh, "cm")


def number(parent: ET.Element, place: str) -> float:
    text = parent.findtext(place)
    assert text is not None, place
    return float(text)


def test_every_surface_of_the_input_lies_in_the_folders(given, tmp_path):
    _, mesh, files = given
    write_mesh_complete(tmp_path / "fluid", tmp_path / "solid", mesh, unit="cm")
    root = ET.fromstring(files["solver.xml"])
    paths = [e.text.strip() for e in root.iter() if e.tag.endswith(("_file_path",)) and e.text]
    assert len(paths) == 2 + 4 + 5 + 1  # volumes, surfaces of both, the aortic pressure
    assert all((tmp_path / path).is_file() or path in files for path in paths)
    faces = [face.get("name") for face in root.iter("Add_face")]
    assert len(set(faces)) == len(faces)
    conditions = [bc.get("name") for bc in root.iter("Add_BC")]
    assert set(conditions) <= set(faces)
    for equation in root.iter("Add_equation"):
        names = [bc.get("name") for bc in equation.iter("Add_BC")]
        assert len(set(names)) == len(names)


def test_integers_of_the_folders_are_32_bits_for_vtk(given, tmp_path):
    vtk = pytest.importorskip("vtk", reason="VTK is not installed")
    _, mesh, _ = given
    write_mesh_complete(tmp_path / "fluid", tmp_path / "solid", mesh, unit="cm")
    seen = set()
    for path in sorted(tmp_path.rglob("*.vt[up]")):
        kind = (
            vtk.vtkXMLPolyDataReader if path.suffix == ".vtp" else vtk.vtkXMLUnstructuredGridReader
        )
        reader = kind()
        reader.SetFileName(str(path))
        reader.Update()
        data = reader.GetOutput()
        assert data.GetNumberOfCells() > 0
        needed = {"GlobalNodeID": data.GetPointData(), "GlobalElementID": data.GetCellData()}
        for name, where in needed.items():
            assert where.GetArray(name) is not None, (path, name)
        for where in (data.GetPointData(), data.GetCellData()):
            for name in INTEGERS:
                array = where.GetArray(name)
                if array is not None:
                    seen.add(name)
                    assert array.GetDataType() == vtk.VTK_INT, (path, name)
                    assert array.GetDataSize() in (
                        data.GetNumberOfPoints(),
                        data.GetNumberOfCells(),
                    )
    assert seen == set(INTEGERS)


def test_numbers_are_those_of_the_case(given):
    case, mesh, files = given
    root = ET.fromstring(files["solver.xml"])
    equation = root.find("Add_equation[@type='FSI']")
    assert equation is not None
    fluid, wall = equation.findall("Domain")
    assert number(fluid, "Density") == pytest.approx(case.blood.rho_f)
    assert number(fluid, "Viscosity/Value") == pytest.approx(case.blood.mu)
    assert number(wall, "Elasticity_modulus") == pytest.approx(case.wall.E)
    assert number(wall, "Poisson_ratio") == pytest.approx(case.wall.nu)
    law = wall.find("Constitutive_model")
    assert law is not None
    assert law.get("type") == "stVK"
    assert case.wall.volumetric_penalty == 0.0
    assert 0.0 < number(wall, "Penalty_parameter") < 1e-4 * case.wall.E
    assert wall.findtext("Dilational_penalty_model", "").strip() == "ST91"
    assert number(root, "GeneralSimulationParameters/Time_step_size") == pytest.approx(
        2e-3, rel=0.1
    )
    blocks = outlets_of(case, "rest", mesh, None, None).blocks
    aorta = equation.find("Add_BC[@name='fluid_aorta_outlet']/RCR_values")
    assert aorta is not None
    assert number(aorta, "Capacitance") == pytest.approx(float(blocks["aorta_outlet"].C), rel=1e-9)
    artery = equation.find("Add_BC[@name='fluid_anomalous_outlet']/RCR_values")
    assert artery is not None
    bed = blocks["anomalous_outlet"]
    total = number(artery, "Proximal_resistance") + number(artery, "Distal_resistance")
    assert total == pytest.approx(float(bed.R_1 + bed.R_2 + bed.R_3), rel=1e-9)
    assert "without C_im" in files["solver.xml"]
    assert "no prestress" in files["solver.xml"]


def test_aortic_pressure_rises_from_nothing_to_that_of_the_condition(given):
    case, _, files = given
    head, *rows = files["aortic_pressure.dat"].strip().split("\n")
    count, harmonics = map(int, head.split())
    values = np.array([list(map(float, row.split())) for row in rows])
    assert len(values) == count > 2 * harmonics
    rest = case.conditions["rest"]
    cycles = round(values[-1, 0] / rest.period)
    assert values[-1, 0] == pytest.approx(cycles * rest.period)
    one = (count - 1) // cycles
    beat = values[-one - 1 :, 1]
    assert beat[0] == beat[-1]
    assert beat.max() == pytest.approx(rest.P_systolic, rel=1e-3)
    assert beat.min() == pytest.approx(rest.P_diastolic, rel=1e-3)
    assert values[0, 1] == 0.0
    settled = values[values[:, 0] > 0.25 * rest.period, 1]
    assert settled[:one] == pytest.approx(np.roll(beat[:-1], -(len(values) - len(settled)) % one))
    rise = values[: one // 4, 1]
    assert np.all(np.diff(rise) > 0.0)
    assert rise[1] < 0.01 * rest.P_diastolic


def test_case_that_says_too_little_has_no_input(given):
    case, mesh, _ = given
    with pytest.raises(CaseError, match="no condition 'unknown'"):
        solver_input(case, "unknown", mesh, "cm")
    files, reason = input_or_reason(case, "unknown", mesh, "cm")
    assert files == {}
    assert re.search(r"no solver.xml .* no condition 'unknown'", reason)


def test_a_case_without_a_periodic_state_has_no_input_and_says_why(given, monkeypatch):
    case, mesh, _ = given

    def lost(*_, **__):
        raise RuntimeError("no periodic state was found")

    monkeypatch.setattr("study.run.solver_input.outlets_of", lost)
    files, reason = input_or_reason(case, "rest", mesh, "cm")
    assert files == {}
    assert reason.endswith("was written: no periodic state was found")


def test_comments_of_the_input_are_those_of_xml():
    parent = ET.Element("parent")
    _say(parent, "an opening named lad---1--x")
    assert "--" not in parent[0].text
    ET.fromstring(ET.tostring(parent))


def test_unit_of_the_folders_is_told(given):
    case, mesh, _ = given
    root = ET.fromstring(solver_input(case, "rest", mesh, "mm")["solver.xml"])
    assert [number(part, "Mesh_scale_factor") for part in root.iter("Add_mesh")] == [0.1, 0.1]
