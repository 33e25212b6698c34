"""What all runs of a patient in 3D share, and the folders where they are kept."""

import dataclasses
import json
import pathlib
from collections.abc import Callable
from typing import Any

import numpy as np

from jaxfsi import Mesh
from jaxfsi.text_files import regular_text
from lumped import MMHG
from lumped.whole_files import write_whole
from study.case.model import Case
from study.run.case_model import Stress
from study.run.progress import Progress
from study.run.study_choice import RunChoice
from study.store.earlier_run import clear_run
from study.store.provenance import made_now, now
from study.store.result_files import RUN_FOLDER, STAGE_FOLDER
from study.store.stages import Stages, stage_key

INPUTS_FILE = "inputs.txt"


@dataclasses.dataclass(frozen=True)
class RunContext:
    """What all runs of a patient in 3D share.

    Attributes:
        case: the case; its surrogate is the curve of the ramp once that is known.
        mesh: its mesh.
        mesh_key: hash of the mesh.
        folder: of the study.
        choice: how runs are made.
        progress: told of each.
        site: nodes where the aortic pressure is read, see `jaxfsi.fields.aortic_site`; None: at
            the inlet.
        mesh_made: when and by which code the mesh was made.
        begun: when the command that is at work began.
    """

    case: Case
    mesh: Mesh
    mesh_key: str
    folder: pathlib.Path
    choice: RunChoice
    progress: Progress
    site: np.ndarray | None = None
    mesh_made: dict[str, Any] | None = None
    begun: str = dataclasses.field(default_factory=now)

    @property
    def stages(self) -> Stages:
        """Where stages are kept."""
        return Stages(self.folder / STAGE_FOLDER)

    def keep(self, P_image: float, found: Callable[[], Stress]) -> Stress:
        """A prestress that was found before, see `study.run.case_model.Keep`."""
        wall = self.case.wall
        key = stage_key("prestress", self.mesh_key, wall, P_image)
        name = f"prestress-{P_image / MMHG:.6g}-mmHg"
        return self.stages.arrays(name, key, found)

    def run_folder(self, name: str) -> pathlib.Path:
        """Folder of a run."""
        return self.folder / RUN_FOLDER / name

    def prepared(self, key: str, name: str) -> pathlib.Path:
        """The folder of a run; what another input left there is forgotten."""
        folder = self.run_folder(name)
        folder.mkdir(parents=True, exist_ok=True)
        if not self.is_of(key, name):
            clear_run(folder)
            write_whole(folder / INPUTS_FILE, f"{key}\n{json.dumps(made_now())}\n")
        return folder

    def is_of(self, key: str, name: str) -> bool:
        """Whether the folder of a run holds the run of this key."""
        mark = self.run_folder(name) / INPUTS_FILE
        return mark.is_file() and mark.read_text(encoding="utf-8").split("\n")[0] == key

    def run_begun(self, name: str) -> dict[str, Any] | None:
        """When and by which code the run in a folder was begun; None where that is not known."""
        try:
            text = regular_text(self.run_folder(name) / INPUTS_FILE)
            return dict(json.loads(text.split("\n", 1)[1]))
        except (OSError, ValueError, IndexError, TypeError):
            return None
