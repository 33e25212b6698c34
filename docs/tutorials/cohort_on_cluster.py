"""
A cohort on a cluster
=====================

Cases share nothing, so a cluster runs them as an array of jobs; each keeps what it has computed
and goes on there when it is started again. On one machine ``jaxfsi cohort patients/`` does it all.
"""

# %%
# An array of jobs
# ----------------
# ``--emit-jobs`` writes a script for sbatch and the list of its cases. A task needs SLURM and the
# installed command, nothing else. Before its time limit it ends its case in order and is queued
# again, three times at most: the case goes on from its last stage or checkpoint, bit for bit.
COMMANDS = """\
jaxfsi cohort patients/ --mode 3d --out results --emit-jobs jobs \\
    --executor slurm:partition=long,time=4:00:00,mem=8G -- --preset coarse
sbatch jobs/cohort.sbatch       # --array=1-200
jaxfsi cohort patients/ --mode 3d --out results --gather -- --preset coarse
"""
print(COMMANDS)

# %%
# ``--executor slurm`` submits a job for each case itself and waits, ``--executor dask:ADDRESS``
# hands the cases to a Dask scheduler, and without either ``--workers 16`` starts processes on one
# node. All draw the same parity and Bland-Altman plots; :doc:`/howto/cohort` compares them.

# %%
# One task of the array
# ---------------------
# Two of the virtual children that come with the package, in 0D so that it takes seconds.
import importlib.resources
import pathlib

import matplotlib.pyplot as plt

import study

patients = pathlib.Path(str(importlib.resources.files("study"))) / "data/virtual_cohort"
names = ["virtual-l-01", "virtual-r-04"]


def task(name):
    """Measured and predicted ratios of one patient, α = 1 and calibrated."""
    case = study.read_case(patients / name / "case.toml")
    law = case.surrogate.law or "linear"
    return [
        (run.condition, run.boundary, run.ratio, case.conditions[run.condition].ffr)
        for run in study.run_case(case).runs
        if run.law == law and run.rule in (None, "printed")
    ]


found = {name: task(name) for name in names}
for name, rows in found.items():
    for condition, boundary, ratio, measured in rows:
        print(f"{name} {condition:11s} {boundary:10s} {ratio:.3f}, measured {measured:.3f}")

# %%
# Gathering
# ---------
# Documents of finished studies are read with `study.load_document`, or ``jaxfsi show``.
fig, axis = plt.subplots(figsize=(4.2, 4.0))
for boundary, marker in (("fixed", "x"), ("calibrated", "o")):
    pairs = [(m, r) for rows in found.values() for _, kind, r, m in rows if kind == boundary]
    axis.plot(*zip(*pairs, strict=True), marker, label=boundary)
axis.plot([0.6, 1.0], [0.6, 1.0], "k:")
axis.set(xlabel="measured ratio", ylabel="predicted ratio")
axis.legend()
fig.tight_layout()
