"""Case files, the pipeline of one patient, reports and the command line."""

from typing import TYPE_CHECKING

from lumped.lazy_package import import_on_first_use

if TYPE_CHECKING:
    from study.beat import Beat
    from study.case import (
        REQUIREMENTS,
        BloodParameters,
        Case,
        Condition,
        CoronaryParameters,
        MeshOptions,
        SolverOptions,
        StressParameters,
        SurrogateParameters,
        WallParameters,
        read_case,
        require,
    )
    from study.case_anatomy import (
        Anatomy,
        IvusAnatomy,
        IvusState,
        MeshAnatomy,
        SurfaceAnatomy,
        SurfaceCut,
        SyntheticAnatomy,
    )
    from study.demo import demo_case_path
    from study.faults import CaseError, Fault
    from study.findings import Note, notes, verdict
    from study.patient import Model, Patient, Vessel, load_patient
    from study.pipeline import CaseResult, Run, run_case
    from study.progress import Progress
    from study.record_template import record_template
    from study.report import html_report
    from study.results import case_document
    from study.stored_document import load_document, to_json
    from study.sweep import sweep_case
    from study.template import case_template
    from study.tuning import Calibration, Tuning, calibrate_case

import_on_first_use(__name__)
