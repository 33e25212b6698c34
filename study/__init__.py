"""Case files, the pipeline of one patient, reports and the command line."""

from study.beat import Beat as Beat
from study.case import REQUIREMENTS as REQUIREMENTS
from study.case import Anatomy as Anatomy
from study.case import BloodParameters as BloodParameters
from study.case import Case as Case
from study.case import Condition as Condition
from study.case import CoronaryParameters as CoronaryParameters
from study.case import IvusAnatomy as IvusAnatomy
from study.case import MeshAnatomy as MeshAnatomy
from study.case import SolverOptions as SolverOptions
from study.case import StressParameters as StressParameters
from study.case import SurfaceAnatomy as SurfaceAnatomy
from study.case import SurrogateParameters as SurrogateParameters
from study.case import SyntheticAnatomy as SyntheticAnatomy
from study.case import WallParameters as WallParameters
from study.case import read_case as read_case
from study.case import require as require
from study.faults import CaseError as CaseError
from study.faults import Fault as Fault
from study.template import case_template as case_template
