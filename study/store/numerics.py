"""Which code decides which kept numbers, in which version: what is kept is valid under that alone.

A part of the numerics is a list of modules; a kept result names its kind, and a kind the parts that
decide it. Its key holds the versions of those parts, of the libraries that they compute with, and
the arithmetic. Versions are raised by hand, since only who changes code knows whether numbers move:

    python -m study.store.numerics                       what changed and is not decided
    python -m study.store.numerics --same WHY            no kept number changes
    python -m study.store.numerics --changed PART ...    numbers of these parts change

All are kept in ``numerics.json`` (`study.store.numerics_manifest`), and a test fails where a module
changed and nobody decided. Until then the key holds a digest of the code itself: nothing stale is
served, and nothing that is kept outlives the next edit.

Libraries: of jax, jaxlib and the meshers any release may move a number, the others count to the
second number of their version. Machine and system do not count: meshes and runs of two machines
differ by rounding. Precision and kind of device do.
"""

import argparse
import contextlib
import fnmatch
import functools
import hashlib
import importlib.metadata
import json
import pathlib
import sys
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from jaxfsi.text_files import regular_text
from lumped.whole_files import write_whole
from study.store.cache_folder import cache_folder
from study.store.numerics_manifest import (
    MANIFEST,
    ROOT,
    Manifest,
    content_digest,
    joint_digest,
    raised,
    read_manifest,
    write_manifest,
)

PACKAGES = ("lumped", "jaxfsi", "calibration", "diagnosis", "study")

PARTS: dict[str, tuple[str, ...]] = {
    "anatomy": (
        "jaxfsi/anatomy/*", "jaxfsi/contours.py", "jaxfsi/faces.py", "jaxfsi/lumen.py",
        "jaxfsi/measures.py", "jaxfsi/opening.py", "jaxfsi/polygons.py", "jaxfsi/text_files.py",
        "study/run/anatomy_source.py",
    ),
    "meshing": (
        "jaxfsi/measures.py", "jaxfsi/mesh.py", "jaxfsi/mesh_checks.py", "jaxfsi/mesh_files/*",
        "jaxfsi/mesh_parts.py", "jaxfsi/meshing/*", "jaxfsi/polygons.py", "study/run/mesh.py",
    ),
    "mesh report": (
        "study/run/limits.py", "study/run/mesh.py", "study/run/mesh_pictures.py",
        "study/run/mesh_rendering.py",
    ),
    "0D": (
        "lumped/*", "calibration/systemic.py", "calibration/reduced_law.py",
        "calibration/outlets.py",
        "study/run/patient.py", "study/report/readings.py",
    ),
    "march": (
        "jaxfsi/core/*", "jaxfsi/fields/*", "jaxfsi/nominal.py", "jaxfsi/polygons.py",
        "jaxfsi/simulation/*",
        "study/run/driven_beat.py", "study/run/case_model.py", "study/run/fitted_ramp.py",
        "study/run/run_3d.py", "study/run/ramp.py", "study/run/run_context.py",
        "study/run/setup.py", "study/run/shared_step.py", "study/run/simulation.py",
        "study/run/simulation_data.py",
        "study/run/study_choice.py", "study/run/study_parts.py",
    ),
    "reading": (
        "jaxfsi/fields/*", "jaxfsi/opening.py", "jaxfsi/polygons.py",
        "jaxfsi/simulation/cycles.py",
        "study/run/driven_beat.py", "study/run/fitted_ramp.py", "study/run/lumen_collapse.py",
        "study/run/lumen_parts.py",
        "study/run/ramp.py", "study/run/ramp_losses.py", "study/run/study_choice.py",
        "study/run/study_parts.py", "study/run/results.py", "study/run/run_3d.py",
        "study/run/run_context.py", "study/run/simulation_data.py",
        "study/report/simulation_pictures.py", "study/report/simulation_results.py",
    ),
    "derivatives": (
        "jaxfsi/adjoint/*", "study/run/sensitivity.py", "study/run/study_parts.py",
    ),
    "calibration": ("calibration/*",),
    "case": (
        "jaxfsi/nominal.py",
        "study/case/anatomy*", "study/case/assumed.py", "study/case/beat*", "study/case/body.py",
        "study/case/combinations.py", "study/case/condition.py", "study/case/from_body.py",
        "study/case/laws.py", "study/case/losses_table.py", "study/case/operation.py",
        "study/case/blood.py", "study/case/model.py", "study/case/ostium.py",
        "study/case/parameters.py",
        "study/case/read.py", "study/case/schema.py", "study/case/table*",
        "study/case/uncertainty.py", "study/run/ratio_uncertainty.py",
        "study/run/algorithm.py", "study/run/second_mesh.py", "study/run/drawn_runs.py",
        "study/run/limits.py", "study/run/mesh_error.py",
        "study/run/study_choice.py",
        "study/run/study_context.py",
        "study/run/study_options.py", "study/run/study_result.py",
        "study/run/pipeline.py", "study/run/reduced_results.py", "study/run/sweep.py",
        "study/run/tuning.py",
        "study/report/algorithm_results.py", "study/report/headline.py",
        "study/report/remarks.py", "study/report/results.py", "study/report/sensitivity_part.py",
    ),
}  # fmt: skip
"""Modules of each part, as patterns of paths; a module may belong to more than one."""

WITHOUT_NUMBERS: tuple[str, ...] = (
    "diagnosis/*", "study/run/diagnosis*", "study/case/beat_folding.py", "study/case/onsets.py",
    "study/case/catheter/*", "study/case/record*",  # a diagnosis is computed anew each time
    "jaxfsi/verification/*", "lumped/lazy_package.py", "lumped/svzerod*", "lumped/verification.py",
    "lumped/whole_files.py",
    "study/case/advice.py", "study/case/demo.py", "study/case/faults.py",
    "study/case/json_schema.py", "study/case/reference.py", "study/case/sections.py",
    "study/case/patient_table.py",
    "study/case/template.py", "study/case/toml_file.py", "jaxfsi/toml_lines.py",
    "study/cli/*",
    "study/report/*_figures.py", "study/report/*_report.py", "study/report/agreement.py",
    "study/report/body_words.py",
    "study/report/chosen_laws.py", "study/report/cohort_*",
    "study/report/diagnosis_*", "study/report/figures.py", "study/report/imported_results.py",
    "study/report/sweep_figure.py", "study/report/documents/*", "study/report/mesh_results.py",
    "study/report/number_formats.py", "study/report/older_parts.py", "study/report/page.py",
    "study/report/parameter_names.py", "study/report/picture_captions.py",
    "study/report/pictures.py", "study/report/plan_results.py",
    "study/report/ratio_limits.py",
    "study/report/simulation_rendering.py", "study/report/stored_page.py",
    "study/report/style.py", "study/report/summary.py", "study/report/sweep_results.py",
    "study/report/time_spent.py",
    "study/report/packed_array.py", "study/report/stored_vessel.py",
    "study/report/study_vessel.py", "study/report/vessel_*",
    "study/run/artery_files.py", "study/run/case_call.py", "study/run/cohort.py",
    "study/run/prepare_ahead.py",
    "study/run/checked_file.py", "study/run/checking.py", "study/run/computed_parts.py",
    "study/run/dry_run.py", "study/run/*executor*.py", "study/run/job_files.py",
    "study/run/expected_times.py", "study/run/finished_study.py",
    "study/run/health*.py",
    "study/run/gap_parts.py", "study/run/members.py", "study/run/refusal.py",
    "study/run/what_if*.py", "study/report/what_if_*.py",  # 3D runs are kept as those of a study
    "study/run/opening_checks.py", "study/run/progress.py", "study/run/solver_input.py",
    "study/run/sweep_parts.py",
    "study/store/*",
    "study/report/uncertainty_part.py", "study/report/uncertainty_words.py",
    "study/report/wall_results.py", "study/run/measured_states.py",
    "study/run/wall_calibration.py",  # computed anew each time
)  # fmt: skip
"""Modules that decide no number that is kept, whatever the patterns of a part say."""

USES: dict[str, tuple[str, ...]] = {
    "mesh": ("anatomy", "meshing"),
    "mesh report": ("mesh report",),
    "prestress": ("march",),
    "ramp": ("march",),
    "run": ("march", "0D"),
    "driven run": ("march", "0D"),
    "checkpoint": ("march",),
    "reading": ("reading",),
    "derivatives": ("derivatives",),
    "member": tuple(part for part in PARTS if part != "mesh report"),
    "study": ("anatomy", "meshing", "march", "0D", "reading"),
}
"""Parts that decide each kind of kept result, beside those of the results that it starts from."""

_EXACT = ("jax", "jaxlib", "mmgpy", "netgen-mesher")
_JAX = ("jax", "jaxlib", "numpy", "equinox")
_LIBRARIES: dict[str, tuple[str, ...]] = {
    "anatomy": ("numpy", "scipy", "trimesh"),
    "meshing": ("numpy", "scipy", "meshio", "mmgpy", "netgen-mesher"),
    "mesh report": ("numpy", "matplotlib", "pyvista", "vtk"),
    "march": (*_JAX, "scipy"),
    "reading": ("numpy", "scipy"),
    "derivatives": (*_JAX, "scipy"),
    "0D": (*_JAX, "diffrax", "optimistix"),
    "calibration": (*_JAX, "scipy", "lineax", "optimistix"),
    "case": ("numpy",),
}
_COUNTED = ("march", "0D", "derivatives", "calibration")


def decided_by(kind: str) -> dict[str, Any]:
    """What decides the numbers of a kind of kept result, one of `USES`, for its key."""
    parts = USES[kind]
    libraries = sorted({name for part in parts for name in _LIBRARIES[part]})
    found: dict[str, Any] = {
        "numerics": {part: version(part) for part in parts},
        "libraries": {name: library(name) for name in libraries},
    }
    if any(part in _COUNTED for part in parts):
        found["arithmetic"] = arithmetic()
    return found


def arithmetic() -> str:
    """Precision and kind of device of what jax computes."""
    import jax  # slow to import, and a command that refuses its input does without

    bits = 64 if jax.config.read("jax_enable_x64") else 32
    return f"{bits} bits, {jax.default_backend()}"


def version(part: str) -> str:
    """Version of a part; a digest of its code where that is not what was decided on."""
    now, manifest = part_digests(part), _decided()
    same = now == {name: manifest.modules.get(name) for name in now}
    known = manifest.versions.get(part) if same else None
    return known or f"undecided {joint_digest(now)}"


def library(name: str) -> str | None:
    """Version of a library as far as it counts; None: not installed."""
    full = installed(name)
    return full if full is None or name in _EXACT else ".".join(full.split(".")[:2])


@functools.cache
def installed(name: str) -> str | None:
    """Version of a package; None: not installed."""
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return None


@functools.cache
def _decided() -> Manifest:
    return read_manifest()


@functools.cache
def modules(root: pathlib.Path = ROOT) -> tuple[str, ...]:
    """Paths of all modules of the packages but those that only export names."""
    found = (path for package in PACKAGES for path in (root / package).rglob("*.py"))
    names = (path.relative_to(root).as_posix() for path in found if path.name != "__init__.py")
    return tuple(sorted(names))


def modules_of(part: str) -> list[str]:
    """Modules of a part."""
    chosen = (name for name in modules() if _fits(name, PARTS[part]))
    return [name for name in chosen if not _fits(name, WITHOUT_NUMBERS)]


def unsorted() -> list[str]:
    """Modules that belong to no part, and of which it is not said that they have no numbers."""
    known = [*WITHOUT_NUMBERS, *(p for patterns in PARTS.values() for p in patterns)]
    return [name for name in modules() if not _fits(name, known)]


def _fits(name: str, patterns: Iterable[str]) -> bool:
    return any(fnmatch.fnmatchcase(name, pattern) for pattern in patterns)


@functools.cache
def part_digests(part: str) -> dict[str, str]:
    """Digest of the content of each module of a part, as the code was when first asked."""
    return _digests(modules_of(part))


def _digests(names: Sequence[str]) -> dict[str, str]:
    """Digests by path; those known by their bytes come from the user's cache: parsing is slow."""
    folder = cache_folder()
    path = None if folder is None else folder / "numerics.json"
    kept: dict[str, str] = {}
    if path is not None:
        with contextlib.suppress(OSError, ValueError, TypeError):
            kept = dict(json.loads(regular_text(path)))
    way = (ROOT / "study/store/numerics_manifest.py").read_bytes()  # read another way
    found, fresh = {}, {}
    for name in names:
        source = (ROOT / name).read_bytes()
        raw = hashlib.sha256(way + source).hexdigest()[:32]
        if raw not in kept:
            fresh[raw] = content_digest(source)
        found[name] = str(kept.get(raw) or fresh[raw])
    if path is not None and fresh:
        with contextlib.suppress(OSError):
            path.parent.mkdir(parents=True, exist_ok=True)
            write_whole(path, json.dumps({**kept, **fresh}), shared=True)
    return found


def undecided(manifest: Manifest, now: Mapping[str, Mapping[str, str]]) -> dict[str, list[str]]:
    """Parts with modules that changed, came or went since they were decided on.

    Args:
        manifest: what was decided.
        now: digests of the modules of each part.
    """
    found = {}
    for part, digests in now.items():
        changed = [name for name, digest in digests.items() if manifest.modules.get(name) != digest]
        if manifest.versions.get(part) is None:
            changed.append("(a version is missing, or a merge left two)")
        if changed:
            found[part] = changed
    known = {name for digests in now.values() for name in digests}
    gone = sorted(manifest.modules.keys() - known)
    return {**found, **({"no part any more": gone} if gone else {})}


def advice(changed: Mapping[str, Sequence[str]]) -> str:
    """What is not decided, and how it is."""
    lines = [f"{part}: {', '.join(names)}" for part, names in changed.items()]
    return (
        "Code that decides kept numbers changed, and nobody said whether numbers do:\n  "
        + "\n  ".join(lines)
        + "\nIf no kept number changes (beyond rounding):\n"
        "  python -m study.store.numerics --same 'why'\n"
        "If numbers of some parts change, so that what users kept must be computed again:\n"
        "  python -m study.store.numerics --changed PART [PART ...] [--same WHY]\n"
        "and commit study/store/numerics.json. After a merge with conflicts in it, run this again."
    )


def decide(
    raise_parts: Sequence[str],
    same: str | None,
    *,
    path: pathlib.Path = MANIFEST,
    now: Mapping[str, Mapping[str, str]] | None = None,
) -> dict[str, list[str]]:
    """Write down that numbers of some parts change, and that those of the others do not.

    Args:
        raise_parts: parts whose numbers change.
        same: why the others do not; None: not said.
        path: the manifest.
        now: digests of the modules of each part; as the code is, where not given.

    Returns:
        Parts left undecided with their modules; nothing is written then.
    """
    now = now or {part: part_digests(part) for part in PARTS}
    manifest = read_manifest(path)
    changed = undecided(manifest, now)
    left = {part: names for part, names in changed.items() if part not in raise_parts}
    if left.keys() - {"no part any more"} and not same:
        return left
    versions: dict[str, str | None] = {}
    for part, digests in now.items():
        old = manifest.versions.get(part)
        versions[part] = raised(path, part, digests) if part in raise_parts or not old else old
    modules_now: dict[str, str | None] = {
        n: d for of_part in now.values() for n, d in of_part.items()
    }
    write_manifest(Manifest(versions, modules_now), path)
    return {}


def main(arguments: Sequence[str] | None = None) -> int:
    """The command; exit status 1 where something is not decided."""
    parser = argparse.ArgumentParser("python -m study.store.numerics", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("--same", metavar="WHY", help="why (other) kept numbers do not change")
    parser.add_argument(
        "--changed", nargs="+", default=[], choices=list(PARTS), metavar="PART",
        help=f"parts whose numbers change: {', '.join(PARTS)}",
    )  # fmt: skip
    options = parser.parse_args(arguments)
    if unsorted():
        names = ", ".join(unsorted())
        sys.stdout.write(
            f"In study/store/numerics.py, put into a part or WITHOUT_NUMBERS: {names}\n"
        )
        return 1
    if options.same or options.changed:
        left = decide(options.changed, options.same)
        if left:
            sys.stdout.write(f"Nothing was written. {advice(left)}\n")
            return 1
        raised_parts = ", ".join(options.changed) or "none"
        why = f"; others unchanged: {options.same}" if options.same else ""
        sys.stdout.write(f"Numerics: raised {raised_parts}{why}\n")
        return 0
    left = undecided(read_manifest(), {part: part_digests(part) for part in PARTS})
    sys.stdout.write(f"{advice(left)}\n" if left else "Every change is decided.\n")
    return 1 if left else 0


if __name__ == "__main__":
    sys.exit(main())
