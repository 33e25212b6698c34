"""Cohorts under a real SLURM: the same results in every way, jobs lost on purpose among them.

`python -m benchmarks.slurm FOLDER [--cases N]` works on this machine as a cluster of one node, from
the packages of the distribution (Debian: `apt-get install slurm-wlm munge`), as root, with munge at
work. It starts `slurmctld` and `slurmd` with files in FOLDER alone, and ends both.
"""

import argparse
import json
import os
import pathlib
import shlex
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

from study.case.demo import demo_cohort_path

_CONFIGURATION = """\
ClusterName=one
SlurmctldHost={host}
SlurmUser=root
SlurmctldPort=16817
SlurmdPort=16818
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
ReturnToService=2
MpiDefault=none
NodeName={host} CPUs={cores} State=UNKNOWN
PartitionName=debug Nodes=ALL Default=YES MaxTime=INFINITE State=UP
"""
_EXTRA = ("--", "--no-mesh")
_KILLS = 3
_LONGEST_ARRAY = 1800.0
_SLURM = "slurm:partition=debug,time=60,cpus=1"


@contextmanager
def one_node(folder: pathlib.Path) -> Iterator[None]:
    """A SLURM of this machine alone, whose files lie in a folder."""
    for name in ("state", "spool"):
        (folder / name).mkdir(parents=True)
    host = socket.gethostname().split(".")[0]
    text = _CONFIGURATION.format(host=host, folder=folder, cores=os.cpu_count())
    (folder / "slurm.conf").write_text(text)
    os.environ["SLURM_CONF"] = str(folder / "slurm.conf")
    with _daemon("slurmctld", "-i"), _daemon("slurmd"):
        said = None
        for _ in range(60):
            said = subprocess.run(["sinfo", "-h", "-o", "%T"], capture_output=True, text=True)
            if said.stdout.strip() == "idle":
                break
            time.sleep(1.0)
        else:
            raise RuntimeError(f"no idle node after a minute: sinfo says {said and said.stdout!r}.")
        yield


@contextmanager
def _daemon(name: str, *options: str) -> Iterator[None]:
    process = subprocess.Popen([name, "-D", *options], stderr=subprocess.DEVNULL)
    try:
        yield
    finally:
        process.terminate()
        process.wait()


def cohort(patients: pathlib.Path, out: pathlib.Path, *options: str) -> dict[str, Any]:
    """What `jaxfsi cohort` prints as JSON."""
    words = [str(patients), "--out", str(out), "--json", "--quiet", *options, *_EXTRA]
    command = [sys.executable, "-c", _COMMAND, "cohort", *words]
    return json.loads(subprocess.run(command, stdout=subprocess.PIPE, check=True).stdout)


_COMMAND = "import sys; from study.cli.entry import main; sys.exit(main())"


def array(patients: pathlib.Path, out: pathlib.Path, jobs: pathlib.Path) -> dict[str, Any]:
    """A cohort as an array of jobs; the first task gets the signal of its time limit once."""
    emitted = cohort(patients, out, "--emit-jobs", str(jobs), "--executor", _SLURM)
    script = shlex.split(emitted["submit"])[1]
    submit = ["sbatch", "--parsable", script]
    number = subprocess.run(submit, stdout=subprocess.PIPE, text=True, check=True).stdout.strip()
    time.sleep(6.0)
    limit = ["scancel", "--batch", "--signal=USR1", f"{number}_1"]
    subprocess.run(limit, timeout=30.0, check=True)
    end = time.monotonic() + _LONGEST_ARRAY
    while subprocess.run(["squeue", "-h"], stdout=subprocess.PIPE, check=True).stdout.strip():
        if time.monotonic() > end:
            raise RuntimeError(f"the array is not done after {_LONGEST_ARRAY:g} s.")
        time.sleep(1.0)
    return cohort(patients, out, "--gather")


def kill_jobs(times: int, stop: threading.Event, killed: set[int]) -> None:
    """Kill what runs a job of submitit, so many times, each a different process, and note which."""
    while len(killed) < times and not stop.is_set():
        time.sleep(4.0)
        found = subprocess.run(["pgrep", "-f", "submitit.core._submit"], stdout=subprocess.PIPE)
        for process in {int(word) for word in found.stdout.split()} - killed:
            with suppress(ProcessLookupError):
                os.kill(process, signal.SIGKILL)
                killed.add(process)
            break


def main() -> int:
    """Run the same cohort in every way and compare; gives the exit status."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.slurm", description=__doc__)
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--cases", type=int, default=3)
    given = parser.parse_args()
    folder = given.folder.absolute()
    patients = folder / "patients"
    for path in sorted(demo_cohort_path().glob("*/case.toml"))[: given.cases]:
        shutil.copytree(path.parent, patients / path.parent.name)
    found = {"local": cohort(patients, folder / "local")}
    found["dask"] = cohort(patients, folder / "dask", "--executor", "dask")
    with one_node(folder / "cluster"):
        stop, killed = threading.Event(), set()
        killer = threading.Thread(target=kill_jobs, args=(_KILLS, stop, killed))
        killer.start()
        found["slurm, processes killed"] = cohort(patients, folder / "slurm", "--executor", _SLURM)
        stop.set()
        killer.join()
        found["array, one queued again"] = array(patients, folder / "array", folder / "jobs")
    print(f"killed {len(killed)} processes of jobs, {_KILLS} asked for")
    same = len(killed) == _KILLS
    for name, document in found.items():
        equal = all(document[key] == found["local"][key] for key in ("pairs", "groups", "changes"))
        finished = sum(patient["status"] == 0 for patient in document["patients"])
        print(f"{name}: {finished} of {len(document['patients'])} cases, the same: {equal}")
        same = same and equal and finished == len(document["patients"])
    return 0 if same else 1


if __name__ == "__main__":
    sys.exit(main())
