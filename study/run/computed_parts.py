"""When each part of a study was computed and by which code."""

from collections.abc import Mapping, Sequence
from typing import Any

from study.run.run_context import RunContext
from study.run.study_parts import Code, Computed, ComputedPart
from study.store.provenance import made_now
from study.store.result_names import RAMP


def computed_parts(
    context: RunContext, names: Sequence[str], differentiated: Sequence[str]
) -> Computed:
    """Mesh, ramp, runs and derivatives of a study, and the code at work now.

    Args:
        context: of the study.
        names: ids of its runs.
        differentiated: those whose derivatives were asked for.
    """
    stages = context.stages
    made = [("mesh", context.mesh_made, None), (RAMP, stages.made(RAMP), context.run_begun(RAMP))]
    for name in names:
        made.append((name, stages.made(f"run-{name}"), context.run_begun(name)))
    for name in differentiated:
        made.append((f"derivatives of {name}", stages.made(f"sensitivity-{name}"), None))
    by = Code(**_code(made_now()))
    return Computed(by, [_part(context, *entry) for entry in made])


def _part(
    context: RunContext, name: str, made: dict[str, Any] | None, begun: dict[str, Any] | None
) -> ComputedPart:
    first = begun or made
    return ComputedPart(
        part=name,
        kept=made is not None and made["date"] < context.begun,
        date=None if made is None else made["date"],
        begun=None if first is None else first["date"],
        **_code(first or {}),
    )


def _code(made: Mapping[str, Any]) -> dict[str, Any]:
    return {name: made.get(name) for name in ("version", "commit", "libraries", "numerics")}
