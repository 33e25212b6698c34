"""Names of the files that each command writes, and which of them belong to a result that stands."""

from collections.abc import Mapping
from typing import Any, NamedTuple

RESULT_FILE, REPORT_FILE = "result.json", "report.html"
MESH_FILE, PAGE_FILE = "mesh.json", "mesh.html"
SIMULATION_FILE, SIMULATION_PAGE = "simulation.json", "simulation.html"
STUDY_FILE, STUDY_PAGE = "study.json", "study.html"
COHORT_FILE, COHORT_PAGE = "cohort.json", "cohort.html"
DIAGNOSIS_FILE, DIAGNOSIS_PAGE = "diagnosis.json", "diagnosis.html"
PLAN_FILE, CALIBRATION_FILE = "plan.json", "calibration.json"
WALL_FILE, WALL_PAGE = "wall.json", "wall.html"
WHAT_IF_FILE, WHAT_IF_PAGE = "what-if.json", "what-if.html"
BEFORE_FOLDER, AFTER_FOLDER = "before", "after"
STUDY_VESSEL_PAGE, STUDY_VESSEL_DATA = "study-vessel.html", "study-vessel.json"
SIMULATION_VESSEL_PAGE = "simulation-vessel.html"
SIMULATION_VESSEL_DATA = "simulation-vessel.json"
SWEEP_FILE, TABLE_FILE, FIGURE_FILE = "sweep.json", "sweep.csv", "sweep.svg"

HISTORY_FILE, CHECKPOINT_FILE, SHEAR_FILE = "history.csv", "checkpoint.npz", "shear.vtu"
AXIS_FILE, PULLBACK_FILE, LUMEN_FILE = "centerline.vtp", "pullback.csv", "lumen.glb"
FIELD_FOLDER, RUN_FOLDER, STAGE_FOLDER, IN_3D_FOLDER = "fields", "runs", "stages", "in-3d"
SERIES_FILE = f"{FIELD_FOLDER}/fields.pvd"
MESH_PICTURES, SIMULATION_PICTURES = "pictures", "simulation-pictures"
STUDY_PICTURES = "study-pictures"

LOCK_FILE, HOLDER_FILE, LOG_FILE = ".at-work", ".at-work-by", "run.log"
"""What any command keeps in its folder while it is at work there, and the log of all of them."""

MESH_FORMATS = ("vtu", "msh", "xdmf", "folder")
"""Kinds of files in which a mesh can be written."""


class Kind(NamedTuple):
    """Files of a result of one command.

    Attributes:
        document: the JSON file.
        shown: page and pictures, which tell with the document that a result stands.
        computed: what the command goes on with when it is given again.
    """

    document: str
    shown: tuple[str, ...] = ()
    computed: tuple[str, ...] = ()


KINDS = {
    "run": Kind(RESULT_FILE, (REPORT_FILE,)),
    "mesh": Kind(MESH_FILE, (PAGE_FILE,)),
    "simulate": Kind(
        SIMULATION_FILE,
        (SIMULATION_PAGE, SIMULATION_VESSEL_PAGE, SIMULATION_VESSEL_DATA, SIMULATION_PICTURES),
        (
            CHECKPOINT_FILE,
            HISTORY_FILE,
            SHEAR_FILE,
            AXIS_FILE,
            PULLBACK_FILE,
            LUMEN_FILE,
            FIELD_FOLDER,
        ),
    ),
    "study": Kind(
        STUDY_FILE,
        (STUDY_PAGE, STUDY_VESSEL_PAGE, STUDY_VESSEL_DATA, STUDY_PICTURES),
        (RUN_FOLDER, STAGE_FOLDER),
    ),
    "cohort": Kind(COHORT_FILE, (COHORT_PAGE,)),
    "what-if": Kind(WHAT_IF_FILE, (WHAT_IF_PAGE,), (BEFORE_FOLDER, AFTER_FOLDER)),
    "wall": Kind(WALL_FILE, (WALL_PAGE,)),
    "calibrate": Kind(CALIBRATION_FILE),
    "sweep": Kind(SWEEP_FILE, (TABLE_FILE, FIGURE_FILE)),
    "diagnose": Kind(DIAGNOSIS_FILE, (DIAGNOSIS_PAGE,), (IN_3D_FOLDER,)),
    "plan": Kind(PLAN_FILE),
}
"""By what a document says under `kind`."""


def shown_files(kind: str, document: Mapping[str, Any]) -> list[str]:
    """Names of what a result consists of but for what its command goes on with, pages first.

    Args:
        kind: of the result.
        document: its document; empty where that cannot be read.
    """
    names = [*KINDS[kind].shown, KINDS[kind].document]
    if kind == "mesh":
        names += [name for names in _part(document, "mesh_files").values() for name in names]
    meshed = document if kind == "mesh" else _part(document, "mesh")
    if kind in ("run", "mesh") and meshed.get("states"):
        names += [f"{state}.vtu" for state in meshed["states"]] if kind == "run" else []
        names.append(MESH_PICTURES)
    return names


def kept_files(kind: str, document: Mapping[str, Any]) -> list[str]:
    """Names of what the command of a result goes on with: runs, stages, cases of a cohort."""
    members = [patient["name"] for patient in document.get("patients") or ()]
    return [*KINDS[kind].computed, *(members if kind == "cohort" else ())]


def _part(document: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    part = document.get(key)
    return part if isinstance(part, Mapping) else {}
