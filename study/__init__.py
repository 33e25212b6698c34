"""Case files, the pipeline of one patient, reports and the command line."""

from study.beat import Beat
from study.case import (
    REQUIREMENTS,
    Anatomy,
    BloodParameters,
    Case,
    Condition,
    CoronaryParameters,
    IvusAnatomy,
    MeshAnatomy,
    SolverOptions,
    StressParameters,
    SurfaceAnatomy,
    SurrogateParameters,
    SyntheticAnatomy,
    WallParameters,
    read_case,
    require,
)
from study.demo import demo_case_path
from study.faults import CaseError, Fault
from study.template import case_template
