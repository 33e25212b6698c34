"""When each part of a study was computed and by which code, and which parts are older."""

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from study.run.ramp import RAMP
from study.run.run_3d import RunContext
from study.store.provenance import made_now


@dataclasses.dataclass(frozen=True)
class Code:
    """Code that computed something; None where that is not known.

    Attributes:
        version: of the package.
        commit: of its checkout.
        libraries: versions by name.
        numerics: versions of the parts of the numerics by name.
    """

    version: str | None
    commit: str | None
    libraries: dict[str, str | None] | None
    numerics: dict[str, str] | None


@dataclasses.dataclass(frozen=True)
class ComputedPart:
    """A part of a study, and the code that began it.

    Attributes:
        part: its name.
        kept: whether it was done before the command that wrote the document.
        date: when it was done.
        begun: when its march was begun.
        version: see `Code`.
        commit: see `Code`.
        libraries: see `Code`.
        numerics: see `Code`.
    """

    part: str
    kept: bool
    date: str | None
    begun: str | None
    version: str | None
    commit: str | None
    libraries: dict[str, str | None] | None
    numerics: dict[str, str] | None


@dataclasses.dataclass(frozen=True)
class Computed:
    """The parts of a study.

    Attributes:
        by: the code that wrote the document.
        parts: mesh, ramp, runs and derivatives.
    """

    by: Code
    parts: list[ComputedPart]


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


def older_parts(computed: Computed) -> Iterator[str]:
    """Sentences on parts that other code computed than the one at work, oldest first."""
    groups: dict[tuple[Any, ...], list[tuple[str, str]]] = {}
    for part in sorted(computed.parts, key=lambda p: p.begun or ""):
        if part.begun is not None and _differs(part, part.begun, computed.by):
            known = groups.setdefault((part.version, part.commit), [])
            known.append((part.part, part.begun[:10]))
    for (version, commit), parts in groups.items():
        names = ", ".join(name for name, _ in parts)
        dates = sorted({date for _, date in parts})
        days = dates[0] if len(dates) == 1 else f"{dates[0]} to {dates[-1]}"
        code = f"jaxfsi {version}" + (f", commit {commit}" if commit else "")
        yield (
            f"{names}: computed on {days} by {code}, and kept since what they follow from is"
            " unchanged; the rest is newer"
        )


def _differs(part: ComputedPart, begun: str, by: Code) -> bool:
    """Whether a part is kept, and other code or libraries made it."""
    if not (part.kept or begun < (part.date or "")):
        return False
    local = "local changes" in (part.commit or "")
    now = (by.version, by.commit, by.libraries)
    return local or (part.version, part.commit, part.libraries) != now
