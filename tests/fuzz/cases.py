# ruff: noqa: E501  tables of damage read best in long rows
"""Damaged case files: `calibrate` mostly, `run` and `sweep` now and then."""

import dataclasses
import math
import random
from collections.abc import Iterator
from typing import Any

from tests.fuzz.octets import BYTE_OPERATORS
from tests.fuzz.shapes import contour_files, lumen_stl
from tests.fuzz.tables import TABLE_OPERATORS
from tests.fuzz.toml_text import Tables, dumps
from tests.fuzz.trial import Content, Files, Link, Trial

KIND = "case"
WHOLE = 0.06
"""Share of the trials that compute to the end where they are accepted; the others stop there."""

CONDITIONS: Tables = {
    "rest": {
        "P_systolic_mmHg": 110.0, "P_diastolic_mmHg": 65.0, "period_s": 0.8,
        "cardiac_output_l_per_min": 4.5, "stroke_volume_ml": 60.0, "ffr": 0.91, "ffr_sd": 0.01,
        "source": "cohort mean",
    },
    "dobutamine": {
        "kind": "stress", "P_systolic_mmHg": 130.0, "P_diastolic_mmHg": 70.0, "period_s": 0.45,
    },
}  # fmt: skip
BED: Tables = {
    "R_1_dyn_s_per_cm5": 3.5e4, "R_2_dyn_s_per_cm5": 6.4e4, "R_3_dyn_s_per_cm5": 2.7e5,
    "C_a_cm5_per_dyn": 4.5e-7, "C_im_cm5_per_dyn": 3.0e-6, "P_venous_mmHg": 4.0, "im_factor": 1.0,
}  # fmt: skip
TISSUE: Tables = {
    "blood": {"viscosity_poise": 0.04, "density_g_per_cm3": 1.06},
    "wall": {
        "E_dyn_per_cm2": 1.5e7, "nu": 0.49, "density_g_per_cm3": 1.0,
        "material": "saint_venant_kirchhoff", "element": "linear", "prestress": "diastole",
        "thickness_per_radius": {"factor": 0.12, "min_mm": 0.3, "max_mm": 2.0, "_inline": True},
    },
}  # fmt: skip
SOLVER: Tables = {
    "dt_s": 1e-3, "cycles": 4, "n_steps": 1000, "frames_per_cycle": 40, "checkpoint_every": 100,
    "tolerance": 1e-3, "max_halvings": 4, "change_limit": 0.03,
}  # fmt: skip
MESH: Tables = {
    "preset": "coarse", "elements_across": 6, "wall_layers": 2, "backend": "netgen", "unit": "cm",
}  # fmt: skip
REQUIRED = frozenset({
    "patient.id", "condition.rest.P_systolic_mmHg", "condition.rest.P_diastolic_mmHg",
    "condition.rest.period_s", "condition.rest.ffr", "condition.dobutamine.P_systolic_mmHg",
    "condition.dobutamine.P_diastolic_mmHg", "condition.dobutamine.period_s",
    "surrogate.R0_dyn_s_per_cm5", "anatomy.kind",
})  # fmt: skip


def beat(count: int = 40, period: float = 0.8) -> bytes:
    """One beat of aortic pressure."""
    rows = [
        f"{k * period / count:.9g},{87.5 + 22.5 * math.sin(2 * math.pi * k / count):.4f}"
        for k in range(count)
    ]
    return ("\n".join(["time_s,P_aorta_mmHg", *rows]) + "\n").encode()


def bases() -> dict[str, tuple[Tables, Files]]:
    """Good cases, and the files that each names."""
    plain: Tables = {
        "patient": {"id": "a-01", "source": "x", "notes": "y"},
        "condition": CONDITIONS,
    }
    given: Tables = {"R0_dyn_s_per_cm5": 5e3, "C0_cm5_per_dyn": 1e-7, "law": "linear"}
    rest = {**CONDITIONS["rest"], "waveform": "beat.csv"}
    ivus = {
        "kind": "ivus", "contours": "contours.csv", "frame_table": "frames.csv",
        "reference_point": "reference.csv", "centerline": "centerline.csv",
        "aorta_radius_mm": 14.0, "septum_mm": 0.8, "take_off_angle_deg": 40.0,
        "aorta_below_mm": 20.0, "aorta_above_mm": 20.0, "distal_extension_mm": 5.0,
        "fillet_mm": 0.6, "ostium_end": "auto",
    }  # fmt: skip
    synthetic = {
        "kind": "synthetic", "side": "left", "body_surface_area_m2": 1.5,
        "ostium_major_mm": 2.9, "ostium_minor_mm": 1.2, "intramural_length_mm": 10.0,
        "septum_mm": 0.5, "hypoplasia": 0.4, "ellipticity": 2.5, "reference_radius_mm": 1.7,
        "tube_radius_mm": 13.0,
    }  # fmt: skip
    surface = {
        "kind": "surface", "surface": "lumen.stl", "unit": "mm", "smoothing_steps": 5,
        "openings": {"aorta_inlet": [0.0, 0.0, -15.0], "aorta_outlet": [0.0, 0.0, 15.0]},
        "cuts": {"side": {"centre": [5.0, 0.0, 0.0], "normal": [1.0, 0.0, 0.0], "radius": 3.0}},
    }  # fmt: skip
    contours: Files = {**contour_files()}
    return {
        "numbers": (
            {**plain, **TISSUE, "coronary": BED, "surrogate": given, "stress": {"rule": "all"},
             "windkessel": {"characteristic": "impedance"}, "mesh": MESH, "solver": SOLVER},
            {},
        ),
        "waveform": (
            {**plain, "condition": {**CONDITIONS, "rest": rest},
             "surrogate": {**given, "law": "quadratic", "K_dyn_s2_per_cm8": 800.0},
             "stress": {"factors": {"R_1": 0.9, "R_2": 0.5, "R_3": 0.6, "C_a": 1.5, "C_im": 2.0}}},
            {"beat.csv": beat()},
        ),
        "ivus": ({**plain, "anatomy": ivus, **TISSUE}, contours),
        "synthetic": ({**plain, "anatomy": synthetic, "surrogate": given, **TISSUE}, {}),
        "surface": (
            {**plain, "anatomy": surface, "surrogate": given}, {"lumen.stl": lumen_stl()},
        ),
    }  # fmt: skip


def trials(count: int, seed: int) -> Iterator[Trial]:
    """Damaged case files, operators and cases in turn."""
    good = bases()
    plan = [(base, name) for name in [*TABLE_OPERATORS, *BYTE_OPERATORS, *_OTHERS] for base in good]
    rng = random.Random(f"{KIND} {seed}")
    rng.shuffle(plan)
    done = 0
    while done < count:
        for base, name in plan:
            if done == count:
                return
            trial = one(random.Random(rng.random()), base, name, *good[base])
            if trial is not None:
                done += 1
                whole = "000 samples" in trial.key or rng.random() < (
                    0.3 if trial.expected == "same" else WHOLE
                )
                yield trial if whole else dataclasses.replace(trial, stop=("*",))


def good_trials() -> Iterator[tuple[str, Trial]]:
    """The good cases themselves, by name."""
    for base, (tables, files) in bases().items():
        content = {"case.toml": dumps(tables).encode(), **files}
        yield base, Trial(KIND, "none", base, "either", content, _argv("calibrate"))


def _argv(command: str) -> tuple[str, ...]:
    more = {"sweep": ("--alpha", "0.1:1:3"), "run": ("--no-mesh",)}.get(command, ())
    return (command, "{}/case.toml", *more, "--json", "--out", "{}/out")


def one(rng: random.Random, base: str, name: str, tables: Tables, files: Files) -> Trial | None:
    """A case damaged by one operator; None where that does not fit the case."""
    text = dumps(tables)
    key, expected, argv = name, "either", _argv("calibrate")
    content: Content
    found: Any
    if name in TABLE_OPERATORS:
        required = _required(base)
        found = TABLE_OPERATORS[name](rng, tables, required)
        if found is None:
            return None
        changed, key, expected = found
        content = changed.encode("utf-8", "surrogatepass")
        if expected == "either" and rng.random() < 0.1:
            argv = _argv(rng.choice(["run", "sweep"]))
    elif name in BYTE_OPERATORS:
        content, expected = BYTE_OPERATORS[name](rng, text.encode())
    else:
        return _OTHERS[name](rng, base, tables, files)
    return Trial(
        KIND, name, f"{base}: {key}", expected, {**files, "case.toml": content}, argv,
        blame="case.toml", like=base if expected == "same" else "",
    )  # fmt: skip


def _required(base: str) -> frozenset[str]:
    """Keys that `calibrate` cannot do without."""
    if base == "ivus":
        return (REQUIRED | {"anatomy.contours"}) - {"surrogate.R0_dyn_s_per_cm5"}
    more = {"surface": {"anatomy.surface"}, "waveform": {"surrogate.K_dyn_s2_per_cm8"}}
    own = more.get(base, set())
    return (REQUIRED | own) - ({"anatomy.kind"} if base in ("numbers", "waveform") else set())


def _of_a_file(rng: random.Random, base: str, tables: Tables, files: Files) -> Trial | None:
    """A file that the case names is something else."""
    if not files:
        return None
    name = rng.choice(sorted(files))
    data = files[name]
    assert isinstance(data, bytes)
    operator = rng.choice(["empty", "no file", "endless", "binary", "all nul", "utf-16"])
    content, expected = BYTE_OPERATORS[operator](rng, data)
    read = (
        base == "waveform" or name == "contours.csv" or operator in ("empty", "no file", "endless")
    )
    odd_text = operator == "empty" and content != b""
    if not read or (odd_text and base not in ("waveform",)) or name == "lumen.stl":
        expected = "either"
    everything = {**files, name: content, "case.toml": dumps(tables).encode()}
    return Trial(
        KIND, "file: " + operator, f"{base}: {name}", expected, everything, _argv("calibrate"),
        blame=name,
    )  # fmt: skip


def _of_a_path(rng: random.Random, base: str, tables: Tables, files: Files) -> Trial | None:
    """A path of the case leads elsewhere."""
    keys = {
        "waveform": ("condition", "rest", "waveform"),
        "ivus": ("anatomy", rng.choice(["contours", "frame_table", "centerline"])),
        "surface": ("anatomy", "surface"),
    }
    if base not in keys:
        return None
    from tests.fuzz.tables import get, put

    place = keys[base]
    good = get(tables, place)
    there = ["./" + good, f"../fuzz-here/{good}", "{}/" + good]
    elsewhere = ["/", "..", ".", "", "nowhere.csv", "/dev/null", "/proc/self/mem", "~/" + good, "a" * 5000,
                 "a\x00b", "\\\\server\\x", "file:///" + good, "https://example.org/x.csv", good + "/",
                 "case.toml/x", good + "\n", "/dev/stdin", "/proc/kmsg", "*.csv", "$HOME/x"]  # fmt: skip
    value = rng.choice(elsewhere)
    return Trial(
        KIND, "path", f"{base}: {'.'.join(place)} = {value[:30]!r}", "refused",
        {**files, "case.toml": dumps(put(tables, place, value)).encode()}, _argv("calibrate"),
        blame="case.toml",
    ) if rng.random() < 0.85 or not there else Trial(
        KIND, "path there", f"{base}: {'.'.join(place)}", "same",
        {**files, "case.toml": dumps(put(tables, place, there[0])).encode()}, _argv("calibrate"),
        like=base,
    )  # fmt: skip


def _behind_a_link(rng: random.Random, base: str, tables: Tables, files: Files) -> Trial:
    """Case and files lie behind links, below a folder with an odd name."""
    folder = rng.choice(["a b", "ü", "-x", "$(x)", "%s", "'q'", "x" * 200, ".hidden"])
    everything: Files = {f"{folder}/{name}": data for name, data in files.items()}
    everything[f"{folder}/real.toml"] = dumps(tables).encode()
    everything[f"{folder}/case.toml"] = Link("real.toml")
    argv = ("calibrate", f"{{}}/{folder}/case.toml", "--json", "--out", "{}/out")
    return Trial(KIND, "odd folder", f"{base}: {folder[:20]}", "same", everything, argv, like=base)


def _large(rng: random.Random, base: str, tables: Tables, files: Files) -> Trial:
    """A file far larger, deeper or longer than any case."""
    text = dumps(tables)
    odd = {
        "comment": text + "#" * 30_000_000,
        "key": text + "\n" + "k" * 500_000 + " = 1\n",
        "nested": text + "\na = " + "[" * 100_000,
        "tables": text + "".join(f"[x{k}]\n" for k in range(50_000)),
        "conditions": text
        + "".join(
            f"[condition.c{k}]\nP_systolic_mmHg = 130.0\nP_diastolic_mmHg = 70.0\nperiod_s = 0.5\n"
            for k in range(8_000)
        ),
        "dots": text + "\n" + ".".join("a" * 20_000) + " = 1\n",
        "braces": text + "\na = " + "{a=" * 20_000,
    }
    name = rng.choice(sorted(odd))
    return Trial(
        KIND, "large", f"{base}: {name}", "refused",
        {**files, "case.toml": odd[name].encode()}, _argv("calibrate"), blame="case.toml",
    )  # fmt: skip


def _beat(rng: random.Random, base: str, tables: Tables, files: Files) -> Trial | None:
    """A waveform that is damaged, or has very many samples."""
    if base != "waveform":
        return None
    rows = beat().decode().splitlines()
    head, body = rows[0], rows[1:]
    k = rng.randrange(len(body))
    t, p = body[k].split(",")
    ways: dict[str, tuple[str, str]] = {
        "40 000 samples": (beat(40_000).decode(), "either"),
        "200 000 samples": (beat(200_000).decode(), "either"),
        "kPa": ("\n".join([head, *(f"{r.split(',')[0]},{float(r.split(',')[1]) / 7.5}" for r in body)]), "refused"),
        "nan": ("\n".join([head, *body[:k], f"{t},nan", *body[k + 1 :]]), "refused"),
        "1e300": ("\n".join([head, *body[:k], f"{t},1e300", *body[k + 1 :]]), "refused"),
        "negative": ("\n".join([head, *body[:k], f"{t},-{p}", *body[k + 1 :]]), "refused"),
        "no header": ("\n".join(body), "refused"),
        "semicolons": ("\n".join(rows).replace(",", ";"), "refused"),
        "decimal commas": ("\n".join(rows).replace(".", ","), "refused"),
        "turned": ("\n".join([head, *body[::-1]]), "refused"),
        "ms": ("\n".join([head, *(f"{1000 * float(r.split(',')[0])},{r.split(',')[1]}" for r in body)]), "refused"),
        "two beats": (beat(80, 1.6).decode(), "refused"),
        "half a beat": ("\n".join([head, *body[:20]]), "refused"),
        "crlf": ("\r\n".join(rows) + "\r\n", "same"),
        "marked": ("\ufeff" + "\n".join(rows), "same"),
        "columns turned": ("\n".join(",".join(r.split(",")[::-1]) for r in rows), "same"),
        "column twice": ("\n".join(f"{r},{r.split(',')[1]}" for r in rows), "refused"),
    }  # fmt: skip
    name = rng.choice(sorted(ways))
    text, expected = ways[name]
    everything = {**files, "case.toml": dumps(tables).encode(), "beat.csv": text.encode()}
    return Trial(
        KIND, "waveform", f"{base}: {name}", expected, everything, _argv("calibrate"),  # pyright: ignore
        blame="beat.csv", like=base if expected == "same" else "",
    )  # fmt: skip


_OTHERS = {
    "file": _of_a_file,
    "file again": _of_a_file,
    "path": _of_a_path,
    "path again": _of_a_path,
    "odd folder": _behind_a_link,
    "large": _large,
    "waveform": _beat,
    "waveform again": _beat,
    "waveform more": _beat,
}
