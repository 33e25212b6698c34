"""What is made from the declarations of the keys: JSON Schema, reference page, defaults."""

import dataclasses
import json
import pathlib

import pytest
from pydantic import ValidationError

from jaxfsi.core import Blood, CarreauYasuda, Newtonian
from jaxfsi.meshing.presets import PRESETS
from jaxfsi.simulation import SolverChoice, StepControl
from lumped import nominal_coronary
from study import BloodParameters, CoronaryParameters, MeshOptions, SolverOptions, WallParameters
from study.case.condition import Condition
from study.case.json_schema import json_schema, schema_path, schema_text
from study.case.laws import CARREAU_YASUDA
from study.case.reference import reference
from study.case.schema import keys_of, spellings
from study.case.sections import CASE, CONDITION_SLOT, RECORD, FileTable
from study.store.stages import plain

ROOT = pathlib.Path(__file__).parents[3]


def test_reference_page_is_up_to_date():
    again = "run python -m study.case.reference"
    assert (ROOT / "docs/case-file.md").read_text(encoding="utf-8") == reference(), again


@pytest.mark.parametrize("kind", ["case", "record"])
def test_published_schema_is_up_to_date_and_printed(kind, command):
    again = "run python -m study.case.json_schema"
    assert schema_path(kind).read_text(encoding="utf-8") == schema_text(kind), again
    printed = command("template", "--schema", *(["--record"] if kind == "record" else []))
    assert printed.status == 0
    assert json.loads(printed.stdout) == json_schema(kind)


@pytest.mark.parametrize("kind", ["case", "record"])
def test_schema_lies_beside_a_template_and_is_named_in_its_first_line(kind, command, tmp_path):
    record = ["--record"] if kind == "record" else []
    assert command("template", *record, folder=tmp_path).status == 0
    first, rest = (tmp_path / f"{kind}.toml").read_text(encoding="utf-8").split("\n", 1)
    assert first == f"#:schema ./{kind}.schema.json"
    assert rest == command("template", *record).stdout
    assert json.loads((tmp_path / f"{kind}.schema.json").read_text()) == json_schema(kind)
    assert command("show", "--schema", kind, "--json").json == json_schema(kind)


def properties_of(section: FileTable, schema: dict) -> dict[str, dict]:
    """What the schema says of the keys of a table."""
    tables = schema["properties"]
    if section.kind:
        kinds = tables["anatomy"]["oneOf"]
        (table,) = (k for k in kinds if k["properties"]["kind"]["const"] == section.kind)
    elif section.heading == CONDITION_SLOT:
        table = tables["condition"]["additionalProperties"]
    else:
        table = tables[section.heading]
    return table["properties"]


@pytest.mark.parametrize(("kind", "sections"), [("case", CASE), ("record", RECORD)])
def test_schema_and_page_know_every_key_with_its_range(kind, sections):
    schema, page = json_schema(kind), reference()
    for section in sections:
        found = properties_of(section, schema)
        for key in (spelled for one in section.keys for spelled in spellings(one)):
            entry = found[key.key]
            entry = entry["anyOf"][0] if "anyOf" in entry else entry
            if hasattr(key, "low"):
                limits = {v for k, v in entry.items() if k.lower().endswith("imum")}
                assert limits == {key.low, key.high}, key.key
            assert f"`{key.key}`" in page


def test_defaults_are_those_of_the_models_that_they_go_to():
    bed, blood = nominal_coronary(), BloodParameters()
    for name, value in dataclasses.asdict(CoronaryParameters()).items():
        assert value == getattr(bed, name), name
    assert (blood.mu, blood.rho_f) == (Newtonian().mu, Blood().rho_f)
    thinning = ("mu_zero", "mu_infinite", "relaxation_time", "transition", "exponent")
    for name in thinning:
        assert getattr(blood, name) == getattr(CarreauYasuda(), name), name
    solver = SolverOptions()
    assert solver.max_halvings == StepControl().max_halvings
    assert solver.max_iterations == SolverChoice().max_iterations
    assert solver.max_systems == SolverChoice().max_systems
    # this one a case declares otherwise; the text of its table says why
    assert (solver.rho_infinity, SolverChoice().rho_infinity) == (0.0, 0.5)
    assert "rho_infinity = 0.5" in (SolverOptions.__doc__ or "")
    (preset,) = (key for key in keys_of(MeshOptions) if key.name == "preset")
    assert preset.options == tuple(PRESETS)


def test_text_names_what_the_law_is_called():
    (law,) = (key for key in keys_of(BloodParameters) if key.name == "law")
    assert CARREAU_YASUDA in law.options


@pytest.mark.parametrize(
    ("model", "values"),
    [
        (WallParameters, {"E": "stiff"}),
        (WallParameters, {"E": None}),
        (WallParameters, {"material": "rubber"}),
        (SolverOptions, {"dt": "short"}),
        (BloodParameters, {"law": "casson"}),
    ],
)
def test_python_cannot_put_a_word_where_a_number_belongs(model, values):
    with pytest.raises(ValidationError, match=next(iter(values))):
        model(**values)
    with pytest.raises(ValidationError, match=next(iter(values))):
        dataclasses.replace(model(), **values)


def test_an_array_stays_what_it_is():
    E = Newtonian().mu * 2
    assert WallParameters(E=E).E is E


def test_keys_that_came_later_leave_kept_results_valid():
    """A stage is kept under what its parameters hold; a new key counts where it is set."""
    assert set(dict(plain(WallParameters())[1][1:])) == {
        "E", "nu", "rho_s", "material", "element", "prestress", "thickness_per_radius",
    }  # fmt: skip
    assert plain(SolverOptions())[1] == ["mapping"]
    assert ["damping", 5.0] in plain(WallParameters(damping=5.0))[1]


def test_what_was_measured_of_the_flow_leaves_kept_runs_valid():
    """No run in 3D depends on the measured ratio, reserve or the drug's name."""
    driven = Condition("dobutamine", "stress", 1.3e5, 9e4, 0.5)
    known = dataclasses.replace(driven, ffr=0.8, ifr=0.9, flow_reserve=2.2, drug="other")
    assert plain(known.without_outcome()) == plain(driven)
    assert plain(dataclasses.replace(known, period=0.6).without_outcome()) != plain(driven)
