# ruff: noqa: E501  tables of damage read best in long rows
"""Damaged records: `diagnose` mostly, `plan-measurement` now and then."""

import dataclasses
import random
from collections.abc import Callable, Iterator

import numpy as np

from tests.fuzz.octets import BYTE_OPERATORS
from tests.fuzz.tables import TABLE_OPERATORS
from tests.fuzz.toml_text import Tables, dumps
from tests.fuzz.trial import Expected, Files, Folder, Trial

KIND = "record"
SETTINGS = (
    ("rest", "none", 0.8, 110.0, 65.0, 7.0),
    ("dobutamine", "dobutamine", 0.45, 130.0, 70.0, 14.0),
)
HEAD = "time_s,P_aorta_mmHg,P_distal_mmHg,Q_coronary_ml_per_min"
_EACH = ("period_s", "P_systolic_mmHg", "P_diastolic_mmHg")
REQUIRED = {
    "list": frozenset({"id", "condition.name", *(f"condition.{key}" for key in _EACH),
                       "prior.R0_mmHg_s_per_ml.value"}),
    "named": frozenset({"patient.id", "surrogate.R0_dyn_s_per_cm5.value",
                        *(f"condition.{name}.{key}" for name, *_ in SETTINGS for key in _EACH)}),
}  # fmt: skip
"""Keys that `diagnose` cannot do without, by how the conditions are written."""
WHOLE = 0.03
"""Share of the trials that are diagnosed to the end where they are accepted."""


def waves(period: float, high: float, low: float, drop: float, *, count: int = 80, beats: int = 4):
    """Rows time, aortic and distal pressure, flow of a plausible record with a little noise."""
    rng = np.random.default_rng(round(1000 * period))
    share = np.tile(np.arange(count) / count, beats)
    t = np.arange(count * beats) * period / count
    ejection = np.where(share < 0.4, np.sin(np.pi * share / 0.4), 0.0)
    decay = np.exp(-1.2 * np.where(share < 0.4, 0.0, share - 0.4))
    aorta = low + (high - low) * np.where(share < 0.4, 0.35 + 0.65 * ejection, 0.35 * decay)
    aorta += low - aorta.min() + (high - low) * 0.0
    flow = 70.0 * np.where(share < 0.4, 0.5, 1.35) * (1.0 + 0.1 * np.sin(2 * np.pi * share))
    distal = aorta - drop * flow / flow.mean()
    noise = 0.4 * rng.standard_normal((2, t.size))
    return np.stack([t, aorta + noise[0], distal + noise[1], flow], axis=1)


def csv(rows: np.ndarray, head: str = HEAD) -> str:
    return head + "\n" + "".join(",".join(f"{x:.9g}" for x in row) + "\n" for row in rows)


def good() -> tuple[Tables, dict[str, np.ndarray]]:
    """The tables of a good record and the rows of its files."""
    conditions, files = [], {}
    for order, (name, drug, period, high, low, drop) in enumerate(SETTINGS):
        rows = waves(period, high, low, drop)
        files[f"{name}.csv"] = rows
        aorta, distal = float(rows[:, 1].mean()), float(rows[:, 2].mean())
        conditions.append({
            "name": name, "drug": drug, "order": order, "held_out": False, "period_s": period,
            "P_systolic_mmHg": round(float(rows[:, 1].max()), 2),
            "P_diastolic_mmHg": round(float(rows[:, 1].min()), 2),
            "mean_P_aorta_mmHg": round(aorta, 3), "mean_P_distal_mmHg": round(distal, 3),
            "ffr": round(distal / aorta, 4), "mean_flow_ml_per_min": round(float(rows[:, 3].mean()), 3),
            "file": f"{name}.csv",
        })  # fmt: skip
    tables: Tables = {
        "id": "case-0001",
        "noise": {"pressure_sd_mmHg": 0.5, "flow_relative_sd": 0.05, "ffr_sd": 0.01},
        "prior": {"R0_mmHg_s_per_ml": {"value": 3.75, "sd_log": 0.15, "_inline": True}},
        "condition": conditions,
    }
    return tables, files


def named(tables: Tables) -> Tables:
    """The same record as it is written in a case: tables by the name of the condition."""
    conditions = {
        c["name"]: {k: v for k, v in c.items() if k != "name"} for c in tables["condition"]
    }
    value = {"value": 5e3, "sd_log": 0.15, "_inline": True}
    return {
        "patient": {"id": tables["id"], "source": "x"},
        "surrogate": {"R0_dyn_s_per_cm5": value},
        "noise": tables["noise"],
        "condition": conditions,
    }


Change = Callable[[np.ndarray, random.Random], np.ndarray]


def _column(k: int, change: Callable[[np.ndarray], np.ndarray]) -> Change:
    def changed(rows: np.ndarray, _: random.Random) -> np.ndarray:
        rows = rows.copy()
        rows[:, k] = change(rows[:, k])
        return rows

    return changed


def _one(k: int, *values: float) -> Change:
    def changed(rows: np.ndarray, rng: random.Random) -> np.ndarray:
        rows = rows.copy()
        rows[rng.randrange(len(rows)), k] = rng.choice(values)
        return rows

    return changed


def _less(rows: np.ndarray, rng: random.Random) -> np.ndarray:
    return rows[:: rng.choice([10, 20])]


def _uneven(rows: np.ndarray, rng: random.Random) -> np.ndarray:
    rows = rows.copy()
    rows[1:-1, 0] += 0.3 * rows[1, 0] * np.array([rng.uniform(-1, 1) for _ in rows[1:-1]])
    return rows


ROWS: dict[str, tuple[Expected, Change]] = {
    "pressure in kPa": ("refused", _column(1, lambda v: v / 7.50062)),
    "both in kPa": ("refused", lambda rows, _: rows * [1.0, 1 / 7.50062, 1 / 7.50062, 1.0]),
    "both in dyn": ("refused", lambda rows, _: rows * [1.0, 1333.22, 1333.22, 1.0]),
    "distal in kPa": ("refused", _column(2, lambda v: v / 7.50062)),
    "time in ms": ("refused", _column(0, lambda v: 1000.0 * v)),
    "time in minutes": ("refused", _column(0, lambda v: v / 60.0)),
    "flow in l/min": ("refused", _column(3, lambda v: v / 1000.0)),
    "flow in ml/s": ("refused", _column(3, lambda v: v / 60.0)),
    "flow times 1000": ("refused", _column(3, lambda v: 1000.0 * v)),
    "flow backwards": ("refused", _column(3, lambda v: -v)),
    "flow zero": ("refused", _column(3, lambda v: 0.0 * v)),
    "exchanged": ("refused", lambda rows, _: rows[:, [0, 2, 1, 3]]),
    "distal constant": ("refused", _column(2, lambda v: 0.0 * v + v.mean())),
    "aorta constant": ("refused", _column(1, lambda v: 0.0 * v + v.mean())),
    "distal zero": ("refused", _column(2, lambda v: 0.0 * v)),
    "distal negative": ("refused", _column(2, lambda v: -v)),
    "distal far above": ("refused", _column(2, lambda v: v + 60.0)),
    "one nan": ("refused", _one(1, float("nan"), float("inf"))),
    "one flow nan": ("refused", _one(3, float("nan"), float("-inf"))),
    "one time nan": ("refused", _one(0, float("nan"))),
    "one 1e300": ("refused", _one(2, 1e300, -1e300)),
    "one spike": ("refused", _one(1, 5000.0, -5000.0)),
    "clipped": ("refused", _column(1, lambda v: np.minimum(v, 0.8 * v.max()))),
    "turned": ("refused", lambda rows, _: rows[::-1]),
    "time stands": ("refused", _column(0, lambda v: 0.0 * v)),
    "time jumps back": ("refused", _column(0, lambda v: np.where(np.arange(v.size) > 50, v - 0.3, v))),
    "late start": ("either", _column(0, lambda v: v + 100.0)),
    "one sample": ("refused", lambda rows, _: rows[:1]),
    "five samples": ("refused", lambda rows, _: rows[:5]),
    "half a beat": ("refused", lambda rows, _: rows[:40]),
    "few samples": ("refused", _less),
    "uneven": ("either", _uneven),
    "no rows": ("refused", lambda rows, _: rows[:0]),
    "sample lost": ("either", lambda rows, _: np.delete(rows, 77, axis=0)),
    "40 000 samples": ("either", lambda rows, _: _long(rows, 10_000)),
    "200 000 samples": ("either", lambda rows, _: _long(rows, 50_000)),
    "1000 beats": ("either", lambda rows, _: _many(rows, 250)),
}  # fmt: skip


def _long(rows: np.ndarray, count: int) -> np.ndarray:
    t = np.arange(4 * count) * (rows[1, 0] * 80 / count)
    return np.column_stack([t, *(np.interp(t, rows[:, 0], rows[:, k]) for k in (1, 2, 3))])


def _many(rows: np.ndarray, times: int) -> np.ndarray:
    found = np.tile(rows, (times, 1))
    found[:, 0] = np.arange(len(found)) * rows[1, 0]
    return found


def _texts(text: str) -> dict[str, tuple[Expected, str]]:
    """A file with its text damaged: what must become of it, and the text."""
    head, *body = text.strip().split("\n")
    return {
        "no header": ("refused", "\n".join(body)),
        "header unit": ("refused", text.replace("P_aorta_mmHg", "P_aorta_kPa", 1)),
        "header typo": ("refused", text.replace("P_distal", "P_distl", 1)),
        "header twice": ("refused", "\n".join([head, head, *body])),
        "column twice": ("refused", text.replace("P_distal", "P_aorta", 1)),
        "no aorta": ("either", "\n".join(",".join(r.split(",")[::2]) for r in (head, *body))),
        "no time": ("refused", "\n".join(",".join(r.split(",")[1:]) for r in (head, *body))),
        "semicolons": ("refused", text.replace(",", ";")),
        "decimal commas": ("refused", "\n".join([head, *(r.replace(".", ",") for r in body)])),
        "words": ("refused", "\n".join([head, *body[:9], "a,b,c,d", *body[9:]])),
        "short row": ("refused", "\n".join([head, *body[:9], "0.09,80", *body[10:]])),
        "long row": ("refused", "\n".join([head, *body[:9], body[9] + ",7", *body[10:]])),
        "empty cell": ("refused", "\n".join([head, *body[:9], body[9].rsplit(",", 1)[0] + ",", *body[10:]])),
        "columns turned": ("either", "\n".join(",".join(r.split(",")[::-1]) for r in (head, *body))),
        "crlf": ("either", text.replace("\n", "\r\n")),
        "marked": ("either", "\ufeff" + text),
        "blank lines": ("either", text + "\n\n\n"),
        "one long line": ("refused", text.replace("\n", ",")),
        "hexadecimal": ("refused", "\n".join([head, *body[:9], "0x1,0x50,0x48,0x40", *body[10:]])),
        "underscores": ("refused", "\n".join([head, *body[:9], "0_1,8_0.0,70,60", *body[10:]])),
    }  # fmt: skip


def trials(count: int, seed: int) -> Iterator[Trial]:
    """Damaged records, operators in turn."""
    plan = [("toml", name) for name in TABLE_OPERATORS] * 2
    plan += [("rows", name) for name in ROWS]
    plan += [("text", name) for name in _texts(HEAD + "\n" + "0,1,2,3\n" * 20)]
    plan += [("octets", name) for name in BYTE_OPERATORS] * 2
    plan += [("pair", "files exchanged"), ("pair", "same file twice"), ("pair", "flow in l/min")]
    plan += [("pair", "no file key"), ("pair", "record is a file"), ("pair", "many conditions")]
    rng = random.Random(f"{KIND} {seed}")
    rng.shuffle(plan)
    done = 0
    while done < count:
        for group, name in plan:
            if done == count:
                return
            trial = one(random.Random(rng.random()), group, name)
            if trial is not None:
                done += 1
                yield trial


def good_trials() -> Iterator[tuple[str, Trial]]:
    """The good record itself."""
    tables, rows = good()
    argv = ("diagnose", "{}/rec", "--json", "--out", "{}/out")
    for spelling, written in (("list", tables), ("named", named(tables))):
        files: Files = {f"rec/{file}": csv(values).encode() for file, values in rows.items()}
        files["rec/record.toml"] = dumps(written).encode()
        yield spelling, Trial(KIND, "none", spelling, "either", files, argv, ("*",))


def one(rng: random.Random, group: str, name: str) -> Trial | None:
    """One damaged record; None where the operator does not fit."""
    tables, rows = good()
    spelling = rng.choice(sorted(REQUIRED)) if group != "pair" else "list"
    written = named(tables) if spelling == "named" else tables
    files: Files = {file: csv(values).encode() for file, values in rows.items()}
    files["record.toml"] = dumps(written).encode()
    target = rng.choice(sorted(rows))
    key, expected, blame = target, "either", target
    if group == "toml":
        found = TABLE_OPERATORS[name](rng, written, REQUIRED[spelling])
        if found is None:
            return None
        text, key, expected = found
        files["record.toml"], blame = text.encode("utf-8", "surrogatepass"), "record.toml"
    elif group == "rows":
        expected, change = ROWS[name]
        blame = f"{target}|record.toml"
        with np.errstate(all="ignore"):
            files[target] = csv(change(rows[target], rng)).encode()
    elif group == "text":
        expected, text = _texts(csv(rows[target]))[name]
        files[target] = text.encode()
    elif group == "octets":
        target = blame = key = rng.choice([*sorted(rows), "record.toml"])
        data = files[target]
        assert isinstance(data, bytes)
        files[target], expected = BYTE_OPERATORS[name](rng, data)
        if name in ("flipped", "truncated", "spliced"):
            blame = ""
    else:
        expected, blame = _pair(name, tables, files)
    kept: Expected = "either" if expected == "same" else expected  # pyright: ignore
    command = (
        "plan-measurement" if rng.random() < 0.1 and group in ("toml", "octets") else "diagnose"
    )
    everything: Files = {f"rec/{file}": content for file, content in files.items()}
    argv = (command, "{}/rec", "--json", "--out", "{}/out")
    trial = Trial(
        KIND, name, f"{key} by {command}", kept, everything, argv, ("*",), blame, limit=400.0
    )
    costly = name.startswith(("40 000", "200 000", "1000"))
    return dataclasses.replace(trial, stop=()) if costly or rng.random() < WHOLE else trial


def _pair(name: str, tables: Tables, files: Files) -> tuple[Expected, str]:
    """Damage that lies in how table and files belong together."""
    first, second = tables["condition"]
    expected: Expected = "refused"
    blame = "record.toml"
    if name == "files exchanged":
        first["file"], second["file"] = second["file"], first["file"]
        blame = ""
    elif name == "same file twice":
        second["file"] = first["file"]
        blame = ""
    elif name == "flow in l/min":
        first["mean_flow_ml_per_min"] /= 1000.0
        del first["file"]
    elif name == "no file key":
        del first["file"], second["file"]
        expected = "either"
    elif name == "many conditions":
        more = [{**second, "name": f"c{k}", "order": 2} for k in range(5000)]
        tables["condition"] = [first, second, *more]
    files["record.toml"] = dumps(tables).encode()
    if name == "record is a file":
        files["record.toml"] = Folder()
    return expected, blame
