"""Meshes of real, drawn and foreign anatomies: time by stage, and gates on the answer.

The bundled patient in its four states, twenty anatomies drawn from the published distributions, the
virtual cohort, and lumen surfaces that other projects made. The wall stands in columns of wedges.
Nothing is taken from a cache; each anatomy is meshed once.
"""

import pathlib
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

from jaxfsi.anatomy import (
    Anatomy,
    sample_anatomies,
    surface_anatomy,
    synthetic_anatomy,
)
from jaxfsi.mesh import Region, tet_volumes
from jaxfsi.meshing.build import LEAST_DIHEDRAL_DEG, MeshResult, build_mesh
from jaxfsi.meshing.check.section_areas import section_areas
from study import demo_case_path, read_case
from study.case.demo import demo_cohort_path
from study.run.anatomy_source import case_anatomy, states_of

SHARED_DATA = pathlib.Path(__file__).parents[2] / "shared" / "data"
SEED = 2026
EACH = 5
"""Drawn anatomies of each side and age."""

STAGES = ("sampling", "sizes", "remeshing", "closing", "filling", "checking")

SEPTUM_ERROR = 0.10
AREA_ERROR = 0.03
SECONDS = {"coarse": 25.0, "medium": 60.0, "fine": 240.0}
"""Longest time on two cores; reported, and no gate, since the machine may be shared."""


class Item(NamedTuple):
    """One anatomy of the benchmark: its name, and what makes it."""

    name: str
    make: Callable[[], Anatomy]


def items() -> Iterator[Item]:
    """All anatomies that are at hand."""
    yield from _patient()
    for side in ("left", "right"):
        for k, age in enumerate(("adult", "paediatric")):
            drawn = sample_anatomies((SEED, k), EACH, side=side, age=age)
            for number, parameters in enumerate(drawn, start=1):
                name = f"{side} {age} {number}"
                yield Item(name, lambda parameters=parameters: synthetic_anatomy(parameters))
    yield from _cohort()
    yield from _surfaces()


def _cohort() -> Iterator[Item]:
    """The virtual patients that come with the package."""
    for path in sorted(demo_cohort_path().glob("virtual-*/case.toml")):
        yield Item(
            path.parent.name.replace("-", " "), lambda path=path: case_anatomy(read_case(path))
        )


def _patient() -> Iterator[Item]:
    """The bundled patient in its states."""
    for state in states_of(read_case(demo_case_path())):
        name = f"patient {state.replace('_', ' ')}"
        yield Item(name, lambda state=state: case_anatomy(read_case(demo_case_path()), state))


def _surfaces() -> Iterator[Item]:
    """Two lumen surfaces from the test cases of svFSI."""
    folder = SHARED_DATA / "svfsi-tests"
    for name, place in (
        ("surface pipe3d_rcr", "pipe3d_rcr/mesh-complete"),
        ("surface pipe_prestress", "pipe_prestress/lumen_mesh-complete"),
    ):
        file = folder / place / "mesh-complete.exterior.vtp"
        if file.is_file():
            yield Item(name, lambda file=file: surface_anatomy(file, unit="cm"))


def run(rounds: int = 1, preset: str = "medium") -> dict[str, Any]:
    """Mesh every anatomy once.

    Args:
        rounds: not used: a mesh is made once.
        preset: fineness of the meshes.

    Returns:
        {"name", "rows", "notes", "passed"}, ready for JSON.
    """
    rows = []
    for item in items():
        print(f"  {item.name} ...", end=" ", file=sys.stderr, flush=True)
        rows.append(_row(item, preset))
        print(rows[-1]["gates"], f"{rows[-1]['total_s']:.0f} s", file=sys.stderr, flush=True)
    passed = all(row["gates"] == "passed" for row in rows)
    return {"name": f"meshing, {preset}", "rows": rows, "notes": _notes(rows, preset),
            "passed": passed}  # fmt: skip


def _row(item: Item, preset: str) -> dict[str, Any]:
    start = time.perf_counter()
    row: dict[str, Any] = {"anatomy": item.name}
    try:
        anatomy = item.make()
        row["anatomy_s"] = time.perf_counter() - start
        result = build_mesh(anatomy, preset=preset, wedge_layers=1)
    except (ValueError, RuntimeError) as error:
        failed = " ".join(str(error).split())[:160]
        return row | {"total_s": time.perf_counter() - start, "gates": f"no mesh: {failed}"}
    total = time.perf_counter() - start
    row |= {f"{stage}_s": result.report.wall_time_s.get(stage, 0.0) for stage in STAGES}
    row |= {"total_s": total, "retries": len(result.report.retries), **_answer(result, anatomy)}
    return row | {"gates": ", ".join(_failed_gates(row)) or "passed"}


def _answer(result: MeshResult, anatomy: Anatomy) -> dict[str, Any]:
    """What the mesh is like, in numbers."""
    mesh, report = result
    wall, septum = report.fidelity.wall_ratio, report.fidelity.septum_ratio
    vessel = "anomalous" if "anomalous" in anatomy.centerlines else "aorta"
    areas = section_areas(mesh, anatomy, vessel=vessel)
    euler = report.topology.euler
    return {
        "tets": len(mesh.tets),
        "wedges": len(mesh.wedges),
        "wedge_share": report.quality.wedges.volume_share if report.quality.wedges else 0.0,
        "tets_beside": len(mesh.tets_of(Region.SOLID)) - 3 * len(mesh.wedges),
        "inverted": int(np.sum(tet_volumes(mesh.points, mesh.tets) <= 0.0)),
        "min_dihedral_deg": report.quality.min_dihedral_deg,
        "euler": " ".join(f"{name} {number}" for name, number in euler.items()),
        "faults": len(report.topology.faults),
        **_ends("wall_ratio", wall),
        **_ends("septum_ratio", septum),
        "wall_error_p98": _worst(wall),
        "septum_error_p98": _worst(septum),
        "septum_error_max": _worst(septum, every=True),
        "area_error_max": areas.largest_error,
        "open_sections": int(np.sum(~np.isfinite(areas.error))),
        "through_wall": report.quality.through_edges.wall,
        "through_septum": report.quality.through_edges.septum,
        "through_lumen": report.quality.through_edges.lumen,
    }  # fmt: skip


def _ends(name: str, ratio: Any) -> dict[str, float | None]:
    """First and 99th percentile of a ratio."""
    return {
        f"{name}_p1": None if ratio is None else ratio.p1,
        f"{name}_p99": None if ratio is None else ratio.p99,
    }


def _worst(ratio: Any, *, every: bool = False) -> float | None:
    """Largest error of a ratio in 98 % of places, or in all of them."""
    if ratio is None:
        return None
    low, high = (ratio.minimum, ratio.maximum) if every else (ratio.p1, ratio.p99)
    return max(1.0 - low, high - 1.0)


def _failed_gates(row: dict[str, Any]) -> Iterator[str]:
    """Names of the gates that a mesh does not pass."""
    if row["inverted"]:
        yield "inverted elements"
    if row["faults"]:
        yield "topology"
    if row["min_dihedral_deg"] < LEAST_DIHEDRAL_DEG:
        yield "dihedral angle"
    if row["septum_error_p98"] is not None and row["septum_error_p98"] > SEPTUM_ERROR:
        yield "septum"
    if row["anatomy"].startswith("patient"):
        # Every frame counts: a plane that finds no closed lumen is no reason to leave one out.
        if row["open_sections"] or not row["area_error_max"] <= AREA_ERROR:
            yield "lumen areas"


def _notes(rows: list[dict[str, Any]], preset: str) -> list[str]:
    made = [row for row in rows if "tets" in row]
    notes = [
        f"{sum(row['gates'] == 'passed' for row in rows)} of {len(rows)} anatomies pass all gates:"
        f" no inverted element, Euler numbers and volumes as expected, dihedral angles from"
        f" {LEAST_DIHEDRAL_DEG:g} degrees, tissue between the lumens within {SEPTUM_ERROR:.0%} in"
        f" 98 % of places, lumen areas of the patient within {AREA_ERROR:.0%} at every frame",
    ]
    if made:
        slowest = max(made, key=lambda row: row["total_s"])
        late = sum(row["total_s"] > SECONDS[preset] for row in made)
        notes.append(
            f"slowest: {slowest['anatomy']}, {slowest['total_s']:.0f} s; {late} of {len(made)} take"
            f" longer than {SECONDS[preset]:g} s"
        )
        shares = sorted(row["wedge_share"] for row in made)
        beside = max(made, key=lambda row: row["tets_beside"])
        notes.append(
            f"wedges fill {shares[0]:.0%} to {shares[-1]:.0%} of the wall, the median"
            f" {np.median(shares):.0%}; at most {beside['tets_beside']} tetrahedra stand beside"
            f" them, {beside['anatomy']}; {sum(row['wedges'] == 0 for row in made)} walls without"
        )
        smallest = min(made, key=lambda row: row["min_dihedral_deg"])
        notes.append(
            f"smallest dihedral angle: {smallest['min_dihedral_deg']:.2f} degrees,"
            f" {smallest['anatomy']}"
        )
    return notes
