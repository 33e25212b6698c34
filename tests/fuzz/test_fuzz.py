"""Damaged inputs of all kinds: a few of each by default, all of them where slow tests run."""

import dataclasses
import json
import os
import pathlib
import subprocess
import sys

import pytest

from tests.fuzz import cases, classes, geometry, records
from tests.fuzz.campaign import campaign, here
from tests.fuzz.execute import Outcome
from tests.fuzz.oracle import judged
from tests.fuzz.trial import Trial

ROOT = pathlib.Path(__file__).parents[2]
FEW = {
    "case": lambda seed: cases.trials(40, seed),
    "record": lambda seed: records.trials(15, seed),
    "geometry": lambda seed: geometry.trials(12, seed, ("contours", "mesh")),
}
WATCHED = ("endless", "file: endless", "large", "bytes: endless")
"""Damage that takes a watch from outside where a promise is broken."""


@pytest.mark.parametrize("kind", FEW)
def test_a_few_damaged_inputs(kind):
    # computing is left to the slow run: an input that is accepted is not computed
    trials = (
        dataclasses.replace(trial, stop=("*",) if kind != "geometry" else trial.stop)
        for trial in FEW[kind](classes.seed())
        if trial.operator not in WATCHED
    )
    tally, findings = campaign(kind, trials, here)
    assert not findings, json.dumps(findings[0], indent=1, ensure_ascii=False)
    assert tally.refused > tally.count // 3
    assert tally.count > 5


@pytest.mark.slow
@pytest.mark.parametrize("kind", classes.NAMES)
def test_all_damaged_inputs(kind, tmp_path):
    command = [sys.executable, "-m", "tests.fuzz", "--class", kind, "--out", str(tmp_path)]
    environment = {**os.environ, "JAXFSI_FUZZ_GOOD": str(tmp_path / "good")}
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr[-10_000:]


TRIAL = Trial("case", "none", "key", "refused", {}, ("run", "--json"), blame="case.toml")
SAID = "the input was refused: 1 fault\ncase.toml: a: wrong\n    try: another"
BROKEN = {
    "silent": Outcome(0, "{}", "", 1.0, 1.0),
    "traceback": Outcome(1, "", "Traceback (most recent call last):\n  x", 1.0, 1.0),
    "cost": Outcome(2, "", SAID, 61.0, 1.0),
    "status": Outcome(3, "", SAID, 1.0, 1.0),
    "words": Outcome(2, "", SAID.replace("wrong", "index 5 is out of bounds"), 1.0, 1.0),
}


@pytest.mark.parametrize("severity", BROKEN)
def test_a_broken_promise_is_found(severity, tmp_path):
    found = judged(TRIAL, BROKEN[severity], [], None, tmp_path)
    assert severity in {breach.severity for breach in found}


def test_a_refusal_as_promised_breaks_nothing(tmp_path):
    assert judged(TRIAL, Outcome(2, "", SAID, 1.0, 1.0), [], None, tmp_path) == []
    (breach,) = judged(TRIAL, Outcome(2, "", SAID, 1.0, 1.0), ["out/x"], None, tmp_path)
    assert breach.severity == "written"


def test_impossible_and_changed_numbers_are_found(tmp_path):
    good = {"ffr": 0.9, "kind": "run"}
    trial = dataclasses.replace(TRIAL, expected="same")
    for ratio, count in (("0.9", 0), ("0.91", 1), ("NaN", 1), ("-3.0", 2)):
        text = f'{{"ffr": {ratio}, "kind": "run"}}'
        found = judged(trial, Outcome(0, text, "", 1.0, 1.0), [], good, tmp_path)
        assert [breach.severity for breach in found] == count * ["numbers"], text
