"""Which parts of a study other code computed than the one that wrote it, in sentences."""

from collections.abc import Iterator
from typing import Any

from study.run.study_parts import Code, Computed, ComputedPart


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
