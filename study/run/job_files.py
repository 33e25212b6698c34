"""A cohort as an array of SLURM jobs: a script for sbatch, and the list of its cases.

A task of the array runs `jaxfsi` for one case; nothing but SLURM and the installed command is
needed. Two minutes before its time limit, or where its process was killed, a task ends its case in
order and is queued again, so many times at most; SLURM itself queues it again when its node fails.
The case goes on where it was. A finished one leaves `status.json`, as `jaxfsi cohort` does.
"""

import pathlib
import shlex
import shutil
import string
import sys
from collections.abc import Mapping, Sequence

from study.case.faults import printable
from study.run.cohort import LOG_FILE, MOST_AGAIN, STATUS_FILE, case_call, member_key
from study.run.executor_choice import SLURM_OPTIONS
from study.run.members import Member
from study.store.options import Mode
from study.store.output import OutputRefused

SCRIPT_FILE, LIST_FILE = "cohort.sbatch", "cases.tsv"

_MARK = "written by jaxfsi cohort --emit-jobs"
_SCRIPT = string.Template("""\
#!/bin/bash
# $mark: one task of the array is one case
#SBATCH --job-name=jaxfsi
#SBATCH --array=$array
#SBATCH --requeue --signal=B:USR1@120
#SBATCH --open-mode=append --output=$output
$options
# Key, case file and folder of each case, below one line of comment.
cases=$cases
line=$$((SLURM_ARRAY_TASK_ID + 1))
IFS=$$'\\t' read -r key case folder < <(sed -n "$${line}p" "$$cases")
if [ -z "$${folder:-}" ]; then
  echo "$$cases has no case $$SLURM_ARRAY_TASK_ID; write it again with --emit-jobs" >&2
  exit 2
fi
grep -qsF "\\"$$key\\"" "$$folder/$status" && exit 0
mkdir -p "$$folder" || exit 1

begun=$$SECONDS limit= stop=
trap 'limit=1; kill -TERM "$$child"' USR1
trap 'stop=1; kill -TERM "$$child"' TERM INT
$command "$$case"$extra --out "$$folder" > "$$folder/$log" 2>&1 &
child=$$!
wait "$$child"; ended=$$?
while kill -0 "$$child" 2>/dev/null; do wait "$$child"; ended=$$?; done
if [ -n "$$limit$$stop" ]; then
  wait "$$child"; again=$$?
  [ "$$again" -ne 127 ] && ended=$$again
fi

if [ "$$ended" -eq 0 ]; then
  printf '{"key": "%s", "status": 0, "seconds": %d}\\n' "$$key" "$$((SECONDS - begun))" \\
    > "$$folder/.$status.task" && mv "$$folder/.$status.task" "$$folder/$status"
elif [ -z "$$stop" ] && { [ -n "$$limit" ] || [ "$$ended" -gt 128 ]; }; then
  if [ "$${SLURM_RESTART_COUNT:-0}" -lt $again ]; then
    echo "case $$case was ended ($$ended); it is queued again and goes on where it was" >&2
    scontrol requeue "$${SLURM_ARRAY_JOB_ID}_$${SLURM_ARRAY_TASK_ID}"
  else
    echo "case $$case was ended $$((SLURM_RESTART_COUNT + 1)) times; submit it again" >&2
  fi
fi
exit "$$ended"
""")


def job_files(
    folder: pathlib.Path,
    members: Sequence[Member],
    mode: Mode,
    extra: Sequence[str],
    options: Mapping[str, str],
    at_once: int | None,
) -> dict[str, str]:
    """The files of an array of jobs by their names, the script last.

    Args:
        folder: where they go.
        members: the cases to run.
        mode: `curve` in 0D, `3d` the whole algorithm.
        extra: further options of the command of each case.
        options: of a job, by their names in `SLURM_OPTIONS`.
        at_once: tasks at a time; None: as SLURM has room for.

    Raises:
        OutputRefused: a file of another origin would be overwritten, or a path cannot be listed.
    """
    for name in (SCRIPT_FILE, LIST_FILE):
        _check_ours(folder / name)
    calls = [case_call(member, mode, extra) for member in members]
    rows = [f"# {_MARK}: key, case file, folder"]
    for member, call in zip(members, calls, strict=True):
        path, where = call.arguments[1], call.arguments[-1]
        if not (path + where).isprintable():
            raise OutputRefused(
                f"{printable(path)}: a path with such characters cannot be listed. Rename it."
            )
        rows.append("\t".join((member_key(member, mode, extra), path, where)))
    place = folder.absolute()
    flags = [f"#SBATCH --{SLURM_OPTIONS[name]}={value}\n" for name, value in options.items()]
    if "cpus" not in options:
        flags.append("#SBATCH --cpus-per-task=1\n")
    script = _SCRIPT.substitute(
        mark=_MARK,
        array=f"1-{len(members)}" + ("" if at_once is None else f"%{at_once}"),
        output=_sbatch_value(str(place / "task-")) + "%a.txt",
        options="".join(flags),
        cases=shlex.quote(str(place / LIST_FILE)),
        status=STATUS_FILE,
        command=f"{shlex.quote(_installed())} {calls[0].arguments[0]}",
        extra="".join(f" {shlex.quote(word)}" for word in extra),
        log=LOG_FILE,
        again=MOST_AGAIN,
    )
    return {LIST_FILE: "".join(f"{row}\n" for row in rows), SCRIPT_FILE: script}


def _check_ours(path: pathlib.Path) -> None:
    """Refuse a file that this module has not written."""
    if not (path.exists() or path.is_symlink()):
        return
    try:
        ours = path.is_file() and _MARK in path.read_text(encoding="utf-8")[:400]
    except (OSError, ValueError):
        ours = False
    if not ours:
        raise OutputRefused(
            f"{path}: this was not written by --emit-jobs and stays. Name another folder."
        )


def _installed() -> str:
    """The command of this installation, which nodes find under the same path."""
    beside = pathlib.Path(sys.executable).with_name("jaxfsi")
    return str(beside) if beside.is_file() else shutil.which("jaxfsi") or "jaxfsi"


def _sbatch_value(text: str) -> str:
    """A path in a line of sbatch options: quoted, its percent signs no patterns."""
    return shlex.quote(text.replace("%", "%%")) if " " in text else text.replace("%", "%%")
