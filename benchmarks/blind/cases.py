"""Draws the cases of the blind benchmark, writes their records, and seals what was wrong with them.

Mix: half one effect, a fifth none, 15 % two effects, 15 % outside the catalogue. The labels are
enciphered with a key stream of SHAKE-256 from a random key that is kept in a file of its own; the
manifest holds the SHA-256 of labels and key, so that neither can be changed later.
"""

import hashlib
import json
import pathlib
import secrets
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from benchmarks.blind.clocked import Clock, recording
from benchmarks.blind.layers import two_layers
from benchmarks.blind.sensors import noise, seen
from benchmarks.blind.truth import OUTSIDE, RANGES, SAMPLED, Lanes, one_layer

CONDITIONS = (
    ("rest", "none", (0.0, 0.0, 0.0), 0.80, 110.0, 65.0),
    ("adenosine", "adenosine", (1.0, 1.0, 0.0), 0.70, 105.0, 60.0),
    ("dobutamine", "dobutamine", (1.0, 0.0, 1.0), 0.45, 130.0, 70.0),
    ("dobutamine_high", "dobutamine", (1.0, 0.0, 1.0), 0.38, 142.0, 74.0),
)
"""Name, drug, (stress, adenosine, dobutamine), period, pressures; the last is held out."""

OFFSET_SD_MMHG = 0.3
"""Slow offset of each pressure trace."""

TIERS = {1: one_layer, 2: two_layers}
"""Truths: the diagnosis's topology with other equations, or another topology."""

SHARES = {"single": 0.50, "none": 0.20, "pair": 0.15, "outside": 0.15}


def draw_labels(rng: np.random.Generator, count: int, kind: str | None = None) -> list[dict]:
    """What is wrong with each case: kind and sizes by effect."""
    kinds = list(SHARES)
    parts = np.array([SHARES[k] for k in kinds])
    edges = np.round(np.cumsum(parts) * count).astype(int)
    drawn = [kinds[int(np.searchsorted(edges, k, side="right"))] for k in range(count)]
    names = list(RANGES)
    labels = []
    for k, drawn_kind in enumerate(drawn):
        now = kind or drawn_kind
        if now == "single":
            chosen = [names[k % len(names)]]
        elif now == "pair":
            chosen = [str(n) for n in rng.choice(names, 2, replace=False)]
        elif now == "outside":
            chosen = [list(OUTSIDE)[k % len(OUTSIDE)]]
        else:
            chosen = []
        labels.append({"kind": now, "sizes": {n: _size(rng, n) for n in chosen}})
    order = rng.permutation(count)
    return [labels[k] for k in order]


def _label(rng: np.random.Generator, name: str | None) -> dict:
    kind = "none" if name is None else "single"
    return {"kind": kind, "sizes": {} if name is None else {name: _size(rng, name)}}


def _size(rng: np.random.Generator, name: str) -> float:
    low, high, signed = RANGES[name] if name in RANGES else (*OUTSIDE[name], False)
    value = float(np.exp(rng.uniform(np.log(low), np.log(high))))
    return -value if signed and rng.random() < 0.5 else value


def draw_lanes(rng: np.random.Generator, labels: list[dict]) -> Lanes:
    """Patients and conditions as lanes of one march, conditions fastest."""
    n, C = len(labels), len(CONDITIONS)
    patient = {
        "R0_prior": 3.75 * np.exp(0.3 * rng.standard_normal(n)),
        "alpha": 0.25 * np.exp(0.4 * rng.standard_normal(n)),
        **{name: np.exp(0.3 * rng.standard_normal(n)) for name in ("C_a", "C_im", "C0")},
    }
    patient["R0"] = patient["R0_prior"] * np.exp(0.15 * rng.standard_normal(n))
    lanes: Lanes = {name: np.repeat(value, C) for name, value in patient.items()}
    table = np.array([[*c[2], c[3], c[4], c[5]] for c in CONDITIONS])
    tiled = np.tile(table, (n, 1))
    lanes["stress"], lanes["adenosine"], lanes["dobutamine"] = tiled[:, :3].T
    lanes["order"] = np.tile(np.arange(C, dtype=float), n)
    lanes["period"] = tiled[:, 3] * np.exp(0.05 * rng.standard_normal(n * C))
    shift = np.repeat(rng.standard_normal(n) * 6.0, C)
    lanes["P_systolic"] = tiled[:, 4] + shift + 3.0 * rng.standard_normal(n * C)
    lanes["P_diastolic"] = tiled[:, 5] + 0.6 * shift + 2.0 * rng.standard_normal(n * C)
    names = {name for label in labels for name in label["sizes"]}
    lanes["sizes"] = {
        name: np.repeat(np.array([label["sizes"].get(name, 0.0) for label in labels]), C)
        for name in names
    }
    return lanes


class Cases:
    """Drawn cases with their traces without noise, cases × conditions × samples."""

    def __init__(
        self,
        seed: int,
        count: int,
        kind: str | None = None,
        tier: int = 1,
        offset: float = OFFSET_SD_MMHG,
        effects: Sequence[str | None] | None = None,
    ):
        """Draw and march; the random numbers of the noise come from the same seed.

        Args:
            seed: of everything.
            count: number of cases.
            kind: the kind of all cases; by default the mix.
            tier: which truth, see `TIERS`.
            offset: slow offset of each pressure trace [mmHg].
            effects: the one effect of each case, None for none, in place of the draw.
        """
        self.offset = offset
        self.rng = np.random.default_rng(seed)
        if effects is None:
            self.labels = draw_labels(self.rng, count, kind)
        else:
            self.labels = [_label(self.rng, name) for name in effects]
        self.lanes = draw_lanes(self.rng, self.labels)
        traces = seen(TIERS[tier](self.lanes), self.lanes)
        shape = (count, len(CONDITIONS), SAMPLED)
        self.traces = {name: wave.reshape(shape) for name, wave in traces.items()}
        recorded = [self.lanes[n].reshape(shape[:2]) for n in ("P_systolic", "P_diastolic")]
        self.recorded = [p + 2.0 * self.rng.standard_normal(p.shape) for p in recorded]

    def write(
        self,
        folder: pathlib.Path,
        sd: float,
        *,
        beats: int = 1,
        state: bool = True,
        clocks: Sequence[Clock] | None = None,
    ) -> None:
        """Write one record folder a case.

        Args:
            folder: where; made if needed.
            sd: noise of the mean beat [mmHg].
            beats: beats in each file; their mean has noise of that sd.
            state: whether the record states its noise.
            clocks: how each case is recorded; sd is then the noise of a single sample. By default
                128 samples divide each beat.
        """
        for k in range(len(self.labels)):
            clock = None if clocks is None else clocks[k]
            self._write(folder / f"case-{k:04d}", k, sd, beats, state, clock)

    def _write(
        self,
        folder: pathlib.Path,
        k: int,
        sd: float,
        beats: int,
        state: bool,
        clock: Clock | None,
    ) -> None:
        C = len(CONDITIONS)
        R0 = self.lanes["R0_prior"][k * C]
        prior = [f"R0_mmHg_s_per_ml = {{ value = {R0:.6g}, sd_log = 0.15 }}"]
        settings = [
            Setting(
                name,
                drug,
                c == C - 1,
                float(self.lanes["period"][k * C + c]),
                (float(self.recorded[0][k, c]), float(self.recorded[1][k, c])),
                {n: self.traces[n][k, c] for n in ("P_aorta", "P_distal", "Q")},
            )
            for c, (name, drug, *_) in enumerate(CONDITIONS)
        ]
        write_record(
            folder, prior, settings, self.rng, sd, self.offset,
            beats=beats, state=state, clock=clock,
        )  # fmt: skip

    def clean(self, k: int) -> np.ndarray:
        """Distal pressure of the held-out condition without noise."""
        return self.traces["P_distal"][k, -1]


class Setting(NamedTuple):
    """One condition of a record to be written.

    Attributes:
        name, drug: as in the record.
        held_out: whether only its aortic pressure may be used.
        period: length of the beat [s].
        P_recorded: systolic and diastolic pressure as the record states them [mmHg].
        traces: P_aorta, P_distal [mmHg] and Q [mL/s] at `SAMPLED` instants, without noise.
    """

    name: str
    drug: str
    held_out: bool
    period: float
    P_recorded: tuple[float, float]
    traces: Mapping[str, np.ndarray]


def write_record(
    folder: pathlib.Path,
    prior: Sequence[str],
    settings: Sequence[Setting],
    rng: np.random.Generator,
    sd: float,
    offset: float,
    *,
    beats: int = 1,
    state: bool = True,
    clock: Clock | None = None,
) -> None:
    """Add noise to traces and write them as a record.

    Args:
        folder: of the record, named as its id; made if needed.
        prior: lines of the table [surrogate].
        settings: the conditions in order of acquisition.
        rng: gives the noise.
        sd: noise of the mean beat [mmHg].
        offset: slow offset of each pressure trace [mmHg].
        beats: beats in each file; their mean has noise of that sd.
        state: whether the record states its noise.
        clock: how it is recorded, see `Cases.write`.
    """
    folder.mkdir(parents=True, exist_ok=True)
    lines = ["[patient]", f'id = "{folder.name}"']
    if state:
        lines += ["[noise]", f"pressure_sd_mmHg = {sd}",
                  f"pressure_offset_sd_mmHg = {max(offset, 0.01)}",
                  "flow_relative_sd = 0.05", "ffr_sd = 0.01"]  # fmt: skip
    lines += ["[surrogate]", *prior]
    for c, (name, drug, held_out, T, (high, low), traces) in enumerate(settings):
        pressures = {n: traces[n] for n in ("P_aorta", "P_distal")}
        if clock is not None:
            t, noisy = recording(rng, pressures, T, sd, clock)
            noisy = {n: wave + offset * rng.standard_normal() for n, wave in noisy.items()}
        else:
            t = np.arange(beats * SAMPLED) / SAMPLED * T
            noisy = {
                n: np.tile(wave, beats)
                + noise(rng, (beats, SAMPLED), sd * np.sqrt(beats)).reshape(-1)
                + offset * rng.standard_normal()
                for n, wave in pressures.items()
            }
        means = {n: wave.mean() for n, wave in noisy.items()}
        ffr = means["P_distal"] / means["P_aorta"] + 0.01 * rng.standard_normal()
        flow = traces["Q"].mean() * 60.0 * (1.0 + 0.05 * rng.standard_normal())
        lines += [
            f"[condition.{name}]", f'drug = "{drug}"', f"order = {c}",
            f"held_out = {'true' if held_out else 'false'}", f"period_s = {T:.6g}",
            f"P_systolic_mmHg = {high:.5g}", f"P_diastolic_mmHg = {low:.5g}",
            f"mean_P_aorta_mmHg = {means['P_aorta']:.6g}",
            f"mean_P_distal_mmHg = {means['P_distal']:.6g}", f"ffr = {ffr:.5g}",
            f"mean_flow_ml_per_min = {flow:.6g}", f'waveform = "{name}.csv"',
        ]  # fmt: skip
        columns = np.stack([t, noisy["P_aorta"], noisy["P_distal"]], axis=1)
        rows = "\n".join(",".join(f"{v:.7g}" for v in row) for row in columns)
        head = "time_s,P_aorta_mmHg,P_distal_mmHg"
        (folder / f"{name}.csv").write_text(f"{head}\n{rows}\n", encoding="utf-8")
    (folder / "record.toml").write_text("\n".join(lines) + "\n", encoding="utf-8")


def seal(folder: pathlib.Path, labels: list[dict]) -> None:
    """Write the labels enciphered, their key apart, and the hash of both into the manifest."""
    key = secrets.token_bytes(32)
    text = json.dumps(labels).encode()
    stream = hashlib.shake_256(key).digest(len(text))
    (folder / "labels.sealed").write_bytes(bytes(a ^ b for a, b in zip(text, stream, strict=True)))
    (folder / "labels.key").write_bytes(key)
    digest = hashlib.sha256(text + key).hexdigest()
    (folder / "manifest.json").write_text(
        json.dumps({"labels_sha256": digest, "count": len(labels)})
    )


def unseal(folder: pathlib.Path) -> list[dict]:
    """Open the labels; refuses where labels or key were changed.

    Raises:
        ValueError: the hash in the manifest differs.
    """
    key = (folder / "labels.key").read_bytes()
    sealed = (folder / "labels.sealed").read_bytes()
    stream = hashlib.shake_256(key).digest(len(sealed))
    text = bytes(a ^ b for a, b in zip(sealed, stream, strict=True))
    digest = json.loads((folder / "manifest.json").read_text())["labels_sha256"]
    if hashlib.sha256(text + key).hexdigest() != digest:
        raise ValueError(
            f"{folder}: labels or key were changed after sealing. Make the cases anew."
        )
    return json.loads(text)
