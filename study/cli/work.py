"""A command at work in its folder: alone there, with its log, telling how far it is."""

import contextlib
import io
import pathlib
from collections.abc import Iterator
from typing import Any

from study.cli.command_output import note
from study.cli.request import Request
from study.cli.run_log import run_log
from study.run.progress import Progress
from study.store.folder_lock import at_work


@contextlib.contextmanager
def work(request: Request[Any], folder: pathlib.Path) -> Iterator[Progress]:
    """Be at work in a folder.

    Args:
        request: the command.
        folder: where results go; made if needed.

    Raises:
        CaseError: another process is at work there.
    """
    with (
        at_work(folder, note),
        run_log(folder, request.words, request.options),
        Progress(stream=io.StringIO() if request.quiet else None) as progress,
    ):
        yield progress
