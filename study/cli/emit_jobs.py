"""What `cohort --emit-jobs` does: an array of jobs is written, and how to use it is said."""

import shlex

from study.cli.command_output import Answer
from study.cli.request import Request
from study.run.cohort import finished_member
from study.run.executor_choice import executor_choice
from study.run.job_files import SCRIPT_FILE, job_files
from study.run.members import Member, write_cases
from study.store.options import CohortOptions
from study.store.output import OutputRefused, check_folder, write_files


def emit_jobs(request: Request[CohortOptions], members: list[Member]) -> Answer:
    """Write an array of jobs for the cases that are not finished.

    Args:
        request: the command.
        members: the cases of the cohort.

    Raises:
        OutputRefused: nothing is to be run, or the folder holds files of another origin.
    """
    options = request.options
    folder, extra, choice = (
        options.emit_jobs,
        options.options or (),
        executor_choice(options.executor),
    )
    assert folder is not None, "else cases are run"
    if choice.kind == "dask":
        raise OutputRefused("--emit-jobs writes jobs of SLURM. Leave out --executor dask.")
    rest = [m for m in members if finished_member(m, options.mode, extra) is None]
    gather = shlex.join(_gather(request.words))
    if not rest:
        raise OutputRefused(f"every case is finished. Gather them: {gather}")
    files = job_files(
        check_folder(folder), rest, options.mode, extra, choice.slurm, options.workers
    )
    write_cases(rest)
    written = write_files(folder, files)
    submit = shlex.join(["sbatch", str(folder.absolute() / SCRIPT_FILE)])
    document = {
        "kind": "jobs",
        "cases": [member.name for member in rest],
        "submit": submit,
        "gather": gather,
    }
    text = f"{len(rest)} cases; submit: {submit}\nwhen they have ended, gather: {gather}\n"
    return Answer(document, written, text=text)


def _gather(words: tuple[str, ...]) -> list[str]:
    """The command line that gathers what the jobs of another one find."""
    at = words.index("--") if "--" in words else len(words)
    kept: list[str] = []
    given = iter(words[:at])
    for word in given:
        if word in ("--emit-jobs", "--executor", "--workers"):
            next(given, None)
        elif not word.startswith(("--emit-jobs=", "--executor=", "--workers=")):
            kept.append(word)
    return [*kept, "--gather", *words[at:]]
