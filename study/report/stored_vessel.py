"""The page of a vessel made again from stored data, alone or beside those of other results."""

import json
import pathlib
from collections.abc import Sequence

from jaxfsi.text_files import regular_text
from study.case.faults import CaseError, Fault
from study.report.study_vessel import VESSEL_FILES
from study.report.vessel_data import VESSEL_FORMAT, VesselData, joined
from study.store.json_form import from_json

_AGAIN = "give the command that made the result again: what it computed is kept"


def stored_vessel(folder: pathlib.Path, kind: str) -> VesselData | None:
    """The data of a vessel that lie beside a result; None where there are none.

    Args:
        folder: of the result.
        kind: of the result.

    Raises:
        CaseError: they are damaged.
    """
    if kind not in VESSEL_FILES:
        return None
    file = folder / VESSEL_FILES[kind][1]
    if not file.exists():
        return None
    try:
        found = from_json(VesselData, json.loads(regular_text(file)))
        if found.format != VESSEL_FORMAT:
            raise ValueError(f"its format is not {VESSEL_FORMAT}")
        if not found.views or any(view.shape >= len(found.shapes) for view in found.views):
            raise ValueError("a view or its shape is missing")
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        problem = "the data of the interactive page are damaged"
        raise CaseError([Fault(file, "", None, problem, "", _AGAIN)]) from error
    return found


def vessel_beside(
    own: VesselData | None, result: pathlib.Path, beside: Sequence[pathlib.Path]
) -> VesselData | None:
    """The data of a result and of others in one.

    Args:
        own: those of the result.
        result: its file or folder.
        beside: folders of the others.

    Raises:
        CaseError: one of them has none, or is of another patient.
    """
    if not beside:
        return own
    parts = [_found(result, own)]
    for place in beside:
        part = _found(place, _of_folder(place if place.is_dir() else place.parent))
        if part.patient != parts[0].patient:
            problem = f"a result of {part.patient}, not of {parts[0].patient}"
            cure = "put results of one patient side by side"
            raise CaseError([Fault(place, "", None, problem, "", cure)])
        parts.append(part)
    return joined(parts)


def _of_folder(folder: pathlib.Path) -> VesselData | None:
    found = (stored_vessel(folder, kind) for kind in VESSEL_FILES)
    return next((data for data in found if data is not None), None)


def _found(place: pathlib.Path, data: VesselData | None) -> VesselData:
    if data is None:
        names = " or ".join(name for _, name, _ in VESSEL_FILES.values())
        problem = f"there is no {names}, which study and simulate write"
        raise CaseError([Fault(place, "", None, problem, "", _AGAIN)])
    return data
