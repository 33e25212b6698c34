"""Case files, the pipeline of one patient, reports and the command line."""

from typing import TYPE_CHECKING

from lumped.lazy_package import import_on_first_use

if TYPE_CHECKING:
    from study.case.anatomy import (
        Anatomy,
        IvusAnatomy,
        IvusState,
        MeshAnatomy,
        SurfaceAnatomy,
        SurfaceCut,
        SyntheticAnatomy,
    )
    from study.case.beat import Beat
    from study.case.blood import BloodParameters
    from study.case.condition import Condition
    from study.case.demo import demo_case_path
    from study.case.faults import CaseError, Fault
    from study.case.model import (
        REQUIREMENTS,
        Case,
        require,
    )
    from study.case.parameters import (
        CoronaryParameters,
        MeshOptions,
        SolverOptions,
        StressParameters,
        SurrogateParameters,
        TissueParameters,
        WallParameters,
        WindkesselParameters,
    )
    from study.case.read import read_case
    from study.case.template import case_template, record_template
    from study.report.documents.parts import Note
    from study.report.page import html_report
    from study.report.remarks import notes, verdict
    from study.report.results import case_document
    from study.run.patient import ContouredArtery, Patient, ReducedModel, load_patient
    from study.run.pipeline import run_case
    from study.run.progress import Progress
    from study.run.reduced_results import Calibration, CaseResult, Run, Tuning
    from study.run.sweep import sweep_case
    from study.run.tuning import calibrate_case
    from study.store.json_form import as_json
    from study.store.stored_document import load_document, to_json

__all__ = [
    "REQUIREMENTS",
    "Anatomy",
    "Beat",
    "BloodParameters",
    "Calibration",
    "Case",
    "CaseError",
    "CaseResult",
    "Condition",
    "ContouredArtery",
    "CoronaryParameters",
    "Fault",
    "IvusAnatomy",
    "IvusState",
    "MeshAnatomy",
    "MeshOptions",
    "Note",
    "Patient",
    "Progress",
    "ReducedModel",
    "Run",
    "SolverOptions",
    "StressParameters",
    "SurfaceAnatomy",
    "SurfaceCut",
    "SurrogateParameters",
    "SyntheticAnatomy",
    "TissueParameters",
    "Tuning",
    "WallParameters",
    "WindkesselParameters",
    "as_json",
    "calibrate_case",
    "case_document",
    "case_template",
    "demo_case_path",
    "html_report",
    "load_document",
    "load_patient",
    "notes",
    "read_case",
    "record_template",
    "require",
    "run_case",
    "sweep_case",
    "to_json",
    "verdict",
]

import_on_first_use(__name__)
