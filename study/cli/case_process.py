"""One case of a cohort in a process of its own: `python -m study.cli.case_process run CASE ...`.

It ends with the process that started it, which holds the other end of its standard input. It works
on the core that the environment names, if any.
"""

import importlib
import os
import signal
import sys
import threading

CORE = "JAXFSI_CORE"
"""Environment variable with the core to run on."""


def main() -> int:
    """Run the command of the case; gives its exit status."""
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell may have it ignored
    for name in ("SIGUSR1", "SIGUSR2"):  # a batch system tells whoever started this
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    threading.Thread(target=_leave, daemon=True).start()
    core = os.environ.get(CORE, "")
    if core and hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {int(core)})
    return importlib.import_module("study.cli.entry").main()


def _leave() -> None:
    os.read(0, 1)
    os._exit(130)


if __name__ == "__main__":
    sys.exit(main())
