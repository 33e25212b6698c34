"""When each part of a study was computed and by which code, and which parts are older."""

from collections.abc import Iterator, Sequence
from typing import Any

from study.run.ramp import RAMP
from study.run.run_3d import Bench
from study.store.provenance import made_now

Document = dict[str, Any]


def computed_parts(bench: Bench, names: Sequence[str], differentiated: Sequence[str]) -> Document:
    """What the document holds of it: mesh, ramp, runs and derivatives, and the code at work now.

    Args:
        bench: of the study.
        names: folders of its runs.
        differentiated: those whose derivatives were asked for.
    """
    stages = bench.stages
    made = [("mesh", bench.mesh_made, None), (RAMP, stages.made(RAMP), bench.run_begun(RAMP))]
    for name in names:
        made.append((name, stages.made(f"run-{name}"), bench.run_begun(name)))
    for name in differentiated:
        made.append((f"derivatives of {name}", stages.made(f"sensitivity-{name}"), None))
    return {
        "by": _code(made_now()),
        "parts": [_part(bench, *entry) for entry in made],
    }


def _part(bench: Bench, name: str, made: Document | None, begun: Document | None) -> Document:
    """A part: when it was done, its march begun, and whether both were before this command."""
    first = begun or made
    return {
        "part": name,
        "kept": made is not None and made["date"] < bench.begun,
        "date": None if made is None else made["date"],
        "begun": None if first is None else first["date"],
        **_code(first or {}),
    }


def _code(made: Document) -> Document:
    return {name: made.get(name) for name in ("version", "commit", "libraries", "numerics")}


def older_parts(computed: Document) -> Iterator[str]:
    """Sentences on parts that other code computed than the one at work, oldest first."""
    groups: dict[tuple[Any, ...], list[Document]] = {}
    for part in sorted(computed["parts"], key=lambda p: p["begun"] or ""):
        if part["begun"] is not None and _differs(part, computed["by"]):
            groups.setdefault((part["version"], part["commit"]), []).append(part)
    for (version, commit), parts in groups.items():
        names = ", ".join(part["part"] for part in parts)
        dates = sorted({part["begun"][:10] for part in parts})
        days = dates[0] if len(dates) == 1 else f"{dates[0]} to {dates[-1]}"
        code = f"jaxfsi {version}" + (f", commit {commit}" if commit else "")
        yield (
            f"{names}: computed on {days} by {code}, and kept since what they follow from is"
            " unchanged; the rest is newer"
        )


def _differs(part: Document, by: Document) -> bool:
    """Whether a part is kept, and other code or libraries made it."""
    if not (part["kept"] or part["begun"] < (part["date"] or "")):
        return False
    local = "local changes" in (part["commit"] or "")
    return local or any(part[name] != by[name] for name in ("version", "commit", "libraries"))
