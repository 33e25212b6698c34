"""Scores diagnoses against the labels: the protocol's figures with 95 % intervals."""

import json
import pathlib
from typing import Any

import numpy as np

from benchmarks.blind.cases import unseal

Row = dict[str, Any]


def wilson(hits: int, of: int) -> str:
    """A share with its 95 % Wilson interval."""
    if of == 0:
        return "-"
    z, p = 1.96, hits / of
    centre = (p + z**2 / (2 * of)) / (1 + z**2 / of)
    half = z * np.sqrt(p * (1 - p) / of + z**2 / (4 * of**2)) / (1 + z**2 / of)
    low, high = max(centre - half, 0.0), min(centre + half, 1.0)
    return f"{p:.3f} [{low:.3f}, {high:.3f}] ({hits}/{of})"


def load(folder: pathlib.Path, level: str) -> list[Row]:
    """Diagnoses of one level of richness and noise, each with its label."""
    labels = unseal(folder)
    rows = json.loads((folder / f"diagnoses-{level}.json").read_text())
    return [{**row, "label": labels[row["case"]]} for row in rows]


def expected_calibration_error(p: np.ndarray, hit: np.ndarray, bins: int = 10) -> float:
    """Mean distance of stated and observed frequency, weighted by the cases of each bin."""
    at = np.minimum((p * bins).astype(int), bins - 1)
    gaps = [np.sum(at == b) * abs(p[at == b].mean() - hit[at == b].mean())
            for b in range(bins) if np.any(at == b)]  # fmt: skip
    return float(np.sum(gaps) / p.size)


def expected_error_if_calibrated(p: np.ndarray, draws: int = 400) -> float:
    """What `expected_calibration_error` is on average where every statement is honest."""
    rng = np.random.default_rng(0)
    hits = rng.random((draws, p.size)) < p
    return float(np.mean([expected_calibration_error(p, hit.astype(float)) for hit in hits]))


def ranked(row: Row) -> list[str]:
    """Effects by inclusion probability; "none" and "unknown" take no rank."""
    return sorted(row["inclusion"], key=lambda name: -row["inclusion"][name])


def truth(row: Row) -> list[str]:
    """Effects that act in a case."""
    return list(row["label"]["sizes"])


def detectability(row: Row) -> float:
    """λ of a case with one effect: length of its own trace in noise units."""
    (name,) = truth(row)
    return row["visibility"][name] * abs(row["label"]["sizes"][name])


def wrongly_named(row: Row) -> bool:
    """Whether an effect was named that does not act."""
    return row["verdict"] == "named" and not set(row["named"]) <= set(truth(row))


def score(rows: list[Row]) -> dict[str, str]:
    """All figures of one level.

    Top-1 and top-2 rank the effects among themselves, by inclusion probability.
    """

    def of_kind(kind: str) -> list[Row]:
        return [row for row in rows if row["label"]["kind"] == kind]

    single, null, pair, outside = (of_kind(k) for k in ("single", "none", "pair", "outside"))
    named = [r for r in single if r["verdict"] == "named"]
    visible = [r for r in single if r["probabilities"].get("none", 0.0) < 0.05]
    p, hit = stated_and_seen(rows)
    shrink = [
        (1 - r["held_out"]["after"] / r["held_out"]["before"],
         1 - r["held_out"]["oracle"] / r["held_out"]["before"])
        for r in single
    ]  # fmt: skip
    ratio = [a / b for a, b in shrink if b > 0.05]
    worse = [r for r in rows if r["held_out"]["after"] > 1.1 * r["held_out"]["before"] + 0.05]
    found = {
        "top-1": wilson(sum(ranked(r)[0] == truth(r)[0] for r in single), len(single)),
        "top-1 of visible": wilson(sum(ranked(r)[0] == truth(r)[0] for r in visible), len(visible)),
        "top-2": wilson(sum(truth(r)[0] in ranked(r)[:2] for r in single), len(single)),
        "named": wilson(len(named), len(single)),
        "right if named": wilson(sum(r["named"] == truth(r) for r in named), len(named)),
        "wrongly named of all": wilson(sum(wrongly_named(r) for r in rows), len(rows)),
        "90 % set covers": wilson(
            sum(any(truth(r)[0] in h.split("+") for h in r["cover"]) for r in single), len(single)
        ),
        "mean size of set": f"{np.mean([len(r['cover']) for r in single]):.1f}" if single else "-",
        "false alarms": wilson(sum(r["verdict"] != "no_gap" for r in null), len(null)),
        "nulls named": wilson(sum(r["verdict"] == "named" for r in null), len(null)),
        "outside: flagged": wilson(
            sum(r["verdict"] in ("unknown", "ambiguous") for r in outside), len(outside)
        ),
        "outside: unknown": wilson(sum(r["verdict"] == "unknown" for r in outside), len(outside)),
        "outside: named": wilson(sum(r["verdict"] == "named" for r in outside), len(outside)),
        "pair: first": wilson(sum(ranked(r)[0] in truth(r) for r in pair), len(pair)),
        "pair: both": wilson(sum(set(ranked(r)[:2]) == set(truth(r)) for r in pair), len(pair)),
        **_by_detectability(single),
        "ECE": f"{expected_calibration_error(p, hit):.3f}",
        "ECE of honest statements": f"{expected_error_if_calibrated(p):.3f}",
        "held-out shrink": f"{np.median([a for a, _ in shrink]):.2f}" if shrink else "-",
        "of oracle": f"{np.median([b for _, b in shrink]):.2f}" if shrink else "-",
        "shrink / oracle": f"{np.median(ratio):.2f}" if ratio else "-",
        "made worse": wilson(len(worse), len(rows)),
        "chi-square alone: gap seen": wilson(sum(r["chi2_p"] < 0.01 for r in single), len(single)),
        "chi-square alone: false": wilson(sum(r["chi2_p"] < 0.01 for r in null), len(null)),
        "BIC single: top-1": wilson(sum(r["bic"] == truth(r)[0] for r in single), len(single)),
        "BIC single: false": wilson(sum(r["bic"] != "none" for r in null), len(null)),
        "score scan: top-1": wilson(sum(r["scan"] == truth(r)[0] for r in single), len(single)),
        "BIC single: outside named": wilson(sum(r["bic"] != "none" for r in outside), len(outside)),
        "sparse regression: top-1": wilson(
            sum(r["sparse"] == truth(r)[0] for r in single), len(single)
        ),
        "sparse regression: false": wilson(sum(r["sparse"] != "none" for r in null), len(null)),
        "free forcing only: gap seen": wilson(
            sum(r["forcing_log_B"] > 3.0 for r in single), len(single)
        ),
        "free forcing only: false": wilson(sum(r["forcing_log_B"] > 3.0 for r in null), len(null)),
    }
    return found


def _by_detectability(single: list[Row]) -> dict[str, str]:
    found = {}
    for low, high in ((0.0, 3.0), (3.0, 10.0), (10.0, np.inf)):
        some = [r for r in single if low <= detectability(r) < high]
        label = f"top-1, λ {low:g} to {high:g}" if np.isfinite(high) else f"top-1, λ above {low:g}"
        found[label] = wilson(sum(ranked(r)[0] == truth(r)[0] for r in some), len(some))
    return found


def stated_and_seen(rows: list[Row]) -> tuple[np.ndarray, np.ndarray]:
    """Stated probability of the likeliest hypothesis, and whether it is true."""
    p, hit = [], []
    for row in rows:
        name = max(row["probabilities"], key=lambda n: row["probabilities"][n])
        sizes, kind = row["label"]["sizes"], row["label"]["kind"]
        true = {"none": "none", "outside": "unknown"}.get(kind, "+".join(sorted(sizes)))
        p.append(row["probabilities"][name])
        hit.append("+".join(sorted(name.split("+"))) == true)
    return np.array(p), np.array(hit, float)


def misses(rows: list[Row]) -> list[str]:
    """Every case that was ranked or named wrongly, in a line."""
    lines = []
    for row in rows:
        kind, sizes = row["label"]["kind"], row["label"]["sizes"]
        wrong = (
            (kind == "single" and (ranked(row)[0] not in sizes or row["verdict"] == "unknown"))
            or wrongly_named(row)
            or (kind == "none" and row["verdict"] != "no_gap")
        )
        if wrong:
            given = ", ".join(f"{name} {size:.3g}" for name, size in sizes.items()) or "nothing"
            visible = f" (λ {detectability(row):.1f})" if kind == "single" else ""
            names = ", ".join(row["named"][:3]) or "-"
            lines.append(
                f"case {row['case']}: {given}{visible} -> {row['verdict']}: {names}; "
                f"first {ranked(row)[0]}"
            )
    return lines
