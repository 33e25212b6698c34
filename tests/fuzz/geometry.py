"""Damaged geometry: contours, surfaces and finished meshes in all formats."""

import random
from collections.abc import Iterator

from tests.fuzz.bombs import BOMBS, bomb
from tests.fuzz.octets import BYTE_OPERATORS
from tests.fuzz.solids import FORMATS, SOLID_DAMAGE, damaged, good_files, suffix_of
from tests.fuzz.surfaces import (
    CONTOUR_DAMAGE,
    SURFACE_DAMAGE,
    WRITERS,
    damaged_contours,
    damaged_surface,
)
from tests.fuzz.toml_text import Tables, dumps
from tests.fuzz.trial import Expected, Files, Folder, Trial

KIND = "geometry"

EARLY = ("sampling", "sizes", "remeshing", "closing", "filling")
LATE = ("filling", "measuring", "drawing")
SLOWLY: tuple[str, ...] = ()
"""Damage to surfaces that only meshing brings to light."""
FINISHED = ("drawing", "preparing", "writing")

CONDITIONS: Tables = {
    "rest": {
        "P_systolic_mmHg": 110.0, "P_diastolic_mmHg": 65.0, "period_s": 0.8,
        "cardiac_output_l_per_min": 4.5, "ffr": 0.91,
    },
}  # fmt: skip


def _case(anatomy: Tables) -> bytes:
    return dumps(
        {
            "patient": {"id": "g"},
            "anatomy": anatomy,
            "condition": CONDITIONS,
            "surrogate": {"R0_dyn_s_per_cm5": 5e3},
        }
    ).encode()


IVUS: Tables = {
    "kind": "ivus", "contours": "contours.csv", "frame_table": "frames.csv",
    "reference_point": "reference.csv", "centerline": "centerline.csv", "aorta_radius_mm": 14.0,
}  # fmt: skip
OPENINGS: Tables = {
    "aorta_inlet": [0.0, 0.0, -20.0], "aorta_outlet": [0.0, 0.0, 20.0],
    "anomalous_outlet": [22.0, 0.0, 0.0],
}  # fmt: skip


def _surface(file: str) -> Tables:
    return {"kind": "surface", "surface": file, "unit": "mm", "openings": OPENINGS}


def _mesh(form: str) -> Tables:
    if form == "folder":
        return {"kind": "mesh", "fluid": "mesh/fluid", "solid": "mesh/solid", "unit": "cm"}
    return {"kind": "mesh", "path": f"mesh{suffix_of(form)}", "unit": "cm"}


def trials(count: int, seed: int, only: tuple[str, ...] = ()) -> Iterator[Trial]:
    """Damaged geometries, formats and operators in turn.

    Args:
        count: how many.
        seed: of the damage.
        only: groups out of contours, surface, mesh, octets, bomb; none named: all.
    """
    plan: list[tuple[str, str, str]] = [("contours", "contours", name) for name in CONTOUR_DAMAGE]
    plan += [("surface", form, name) for form in WRITERS for name in SURFACE_DAMAGE]
    plan += [("mesh", form, name) for form in FORMATS if form != "folder" for name in SOLID_DAMAGE]
    octets = [name for name in BYTE_OPERATORS if name not in ("latin-1", "marked", "utf-16")]
    plan += [("octets", form, name) for form in (*FORMATS, *WRITERS, "contours") for name in octets]
    plan += [("bomb", name, name) for name in BOMBS]
    plan += [("bomb", name, name) for name in BOMBS]
    rng = random.Random(f"{KIND} {seed}")
    rng.shuffle(plan)
    plan = [entry for entry in plan if not only or entry[0] in only]
    # each group in turn, so that a small sample has some of all
    groups = {group: [entry for entry in plan if entry[0] == group] for group, *_ in plan}
    order = [name for name in groups for _ in range({"bomb": 1}.get(name, 3))]
    done, at = 0, dict.fromkeys(groups, 0)
    while done < count:
        for group in order:
            if done == count:
                return
            _, form, name = groups[group][at[group] % len(groups[group])]
            at[group] += 1
            trial = one(random.Random(rng.random()), group, form, name)
            if trial is not None:
                done += 1
                yield trial


_NOT_READ = ("walls_combined.vtp", "mesh-complete.exterior.vtp")
"""Files of a folder that repeat what others say, for other programs."""


def good_trials() -> Iterator[tuple[str, Trial]]:
    """The good geometries themselves, by format."""
    for form in (*FORMATS, *WRITERS, "contours"):
        rng = random.Random(form)
        yield form, _trial(rng, "none", form, "either", *_good(rng, form), "")


def one(rng: random.Random, group: str, form: str, name: str) -> Trial | None:
    """One damaged geometry; None where the format cannot hold the damage."""
    expected: Expected
    if group == "contours":
        files, expected, blame = damaged_contours(rng, name)
        return _trial(rng, name, form, expected, files, IVUS, blame)
    if group == "surface":
        found = damaged_surface(rng, form, name)
        if found is None:
            return None
        file = WRITERS[form][0]
        return _trial(rng, name, form, found[1], found[0], _surface(file), file)
    if group == "mesh":
        found = damaged(rng, form, name)
        if found is None:
            return None
        return _trial(rng, name, form, found[1], found[0], _mesh(form), f"mesh{suffix_of(form)}")
    if group == "bomb":
        files, anatomy, blame = bomb(rng, name)
        return _trial(rng, "bomb", name, "refused", files, anatomy, blame)
    return _octets(rng, form, name)


def _octets(rng: random.Random, form: str, name: str) -> Trial | None:
    files, anatomy = _good(rng, form)
    target = rng.choice(sorted(file for file in files if not file.endswith(".json")))
    data = files[target]
    assert isinstance(data, bytes)
    content, expected = BYTE_OPERATORS[name](rng, data)
    if name == "nul bytes":
        expected = "either"
    optional = (form == "contours" and target == "frames.csv") or form == "folder"
    if name in ("empty",) and isinstance(content, bytes) and (optional or content):
        expected = "either"
    if target.endswith(_NOT_READ):
        expected = "either"
    if isinstance(content, Folder) and form == "folder":
        return None
    blame = target.rsplit("/", 1)[-1] if name in ("empty", "no file", "binary") else ""
    if target.endswith(".h5") or form == "folder":
        blame = ""
    return _trial(
        rng,
        f"bytes: {name}",
        f"{form}: {target}",
        expected,
        {**files, target: content},
        anatomy,
        blame,
    )


def _good(rng: random.Random, form: str) -> tuple[Files, Tables]:
    """Files of a good geometry and the table that names them."""
    if form == "contours":
        from tests.fuzz.shapes import contour_files

        return contour_files(), IVUS
    if form in WRITERS:
        found = damaged_surface(rng, form, "nothing")
        assert found is not None
        return found[0], _surface(WRITERS[form][0])
    if form == "folder":
        return {**good_files("folder")}, _mesh(form)
    found = damaged(rng, form, "nothing")
    assert found is not None, form
    return found[0], _mesh(form)


def _trial(
    rng: random.Random,
    operator: str,
    key: str,
    expected: Expected,
    files: Files,
    anatomy: Tables,
    blame: str,
) -> Trial:
    finished = anatomy["kind"] == "mesh"
    command = rng.choice(["mesh", "simulate"]) if finished else "mesh"
    more = ("--preset", "coarse") if command == "mesh" else ("--rigid", "--cycles", "0.02")
    if command == "simulate" and expected != "refused":
        more = more[:1] if rng.random() < 0.5 else more
    stop = FINISHED if finished else LATE if operator in SLOWLY else EARLY
    argv = (command, "{}/case.toml", *more, "--json", "--out", "{}/out")
    everything: Files = {**files, "case.toml": _case(anatomy)}
    wanted: Expected = "either" if expected == "same" else expected
    return Trial(KIND, operator, f"{key} by {command}", wanted, everything, argv, stop, blame=blame)
