"""α of one patient: what is compiled for it serves the next."""

import logging
import pathlib

import jax

from study.case.read import read_case
from study.run.patient import load_patient
from study.run.tuning import calibrate_model

CASE = """
[patient]
id = "p"
[condition.rest]
P_systolic_mmHg = {systolic}
P_diastolic_mmHg = 65.0
period_s = {period}
ffr = {ratio}
[surrogate]
R0_dyn_s_per_cm5 = {R0}
[solver]
n_steps = 64
"""


def _calibrated(folder: pathlib.Path, **numbers: float):
    path = folder / "case.toml"
    path.write_text(CASE.format(**numbers))
    patient = load_patient(read_case(path))
    return calibrate_model(patient, patient.model)


def test_second_patient_compiles_nothing(tmp_path, caplog):
    first = _calibrated(tmp_path, systolic=110.0, period=0.8, ratio=0.91, R0=5e3)
    with jax.log_compiles(), caplog.at_level(logging.WARNING, "jax"):
        second = _calibrated(tmp_path, systolic=118.0, period=0.9, ratio=0.94, R0=4e3)
    assert first.bisection != second.bisection
    assert [r.getMessage() for r in caplog.records if "Compiling" in r.getMessage()] == []
