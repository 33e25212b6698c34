"""How a command starts and is ended: what it imports, and what signals do to it."""

import os
import re
import signal
import subprocess
import sys

import pytest

HEAVY = ("jax", "matplotlib", "scipy", "trimesh", "pyvista", "jinja2")


def _python(program: str, *arguments: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", program, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=300)


_IMPORTED = f"""
import sys
from study.cli.entry import main
status = main(sys.argv[1:])
print(status, [name for name in {HEAVY} if name in sys.modules], file=sys.stderr)
"""


@pytest.mark.parametrize(
    ("arguments", "status"),
    [
        (("template",), 0),
        (("--help",), 0),
        (("--version",), 0),
        (("check", "bad.toml"), 2),
        (("check", "missing.toml"), 2),
        (("cache", "info"), 0),
        (("run", "bad.toml"), 2),
        (("simulate", "bad.toml"), 2),
        (("study", "missing.toml"), 2),
        (("cohort", "."), 2),
        (("diagnose", "bad.toml"), 2),
        (("import-record", "missing_rest.csv"), 2),
        (("show", "plan.json"), 0),
        (("show", "missing"), 2),
        (("show", "--schema", "study"), 0),
    ],
)
def test_no_word_of_refusal_waits_for_jax(arguments, status, tmp_path, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(path or os.getcwd() for path in sys.path))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bad.toml").write_text('[patient]\nid = "p"\n[condition.rest]\nffr = 7.0\n')
    plan = '{"format": "jaxfsi 1", "kind": "plan", "patient": "p", "next": [], "conditions": []}'
    (tmp_path / "plan.json").write_text(plan)
    found = _python(_IMPORTED, *arguments)
    assert found.stderr.splitlines()[-1].split(" ", 1)[1] == "[]", found.stderr
    if arguments != ("show", "plan.json"):
        assert found.stderr.splitlines()[-1].startswith(str(status)), found.stderr


@pytest.mark.parametrize("arguments", [("--help",), ("--version",)])
def test_help_and_version_import_nothing_slow_and_take_half_a_second(arguments):
    """Time of the processor, which the load of the machine does not stretch."""
    program = f"""
import sys, time
from study.cli.entry import main
main({list(arguments)})
slow = [n for n in {(*HEAVY, "numpy", "pydantic", "rich")} if n in sys.modules]
print(slow, time.process_time(), file=sys.stderr)
"""
    names, seconds = _python(program).stderr.rsplit(None, 1)
    assert names == "[]"
    assert float(seconds) < 0.7


def test_version_says_the_commit_of_a_checkout():
    said = _python("import study.cli.entry as e; e.main(['--version'])").stdout
    assert re.fullmatch(r"jaxfsi [0-9.]+\w*(, commit [0-9a-f]{40}( \(.*\))?)?\n", said), said


_STRUCK = """
import importlib, os, signal, sys, time
signal.signal(signal.SIGINT, signal.default_int_handler)  # a job in the background ignores some
for name in ("SIGTERM", "SIGHUP"):
    signal.signal(getattr(signal, name), signal.SIG_DFL)
import study.cli.entry as cli

number, times, early = int(sys.argv[1]), int(sys.argv[2]), sys.argv[3] == "early"

class Commands:
    def run(argv, signals):
        if not early:
            signals.working()
        try:
            for _ in range(times):
                os.kill(os.getpid(), number)
            time.sleep(20.0)
        except KeyboardInterrupt:
            os.kill(os.getpid(), number)  # a second one while the first is told
            signals.deaf()
            os.kill(os.getpid(), number)
            print("ended in order", file=sys.stderr)
            return cli.INTERRUPTED

sys.modules["study.cli.commands"] = Commands
sys.exit(cli.main())
"""


@pytest.mark.skipif(os.name != "posix", reason="these signals are those of POSIX")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
@pytest.mark.parametrize(("when", "said"), [("early", "interrupted"), ("late", "ended in order")])
def test_signals_once_or_more_end_with_130_and_one_sentence(number, when, said):
    for times in (1, 3):
        found = _python(_STRUCK, int(number), times, when)
        assert found.returncode == 130
        assert found.stderr.startswith(said)
        assert found.stderr.count("\n") == 1


_DROPPED = """
import os, signal, sys, time, weakref
signal.signal(signal.SIGINT, signal.default_int_handler)  # a job in the background ignores some
for name in ("SIGTERM", "SIGHUP"):
    signal.signal(getattr(signal, name), signal.SIG_DFL)
import study.cli.entry as cli

class Thing:
    pass

class Commands:
    def run(argv, signals):
        signals.working()
        thing = Thing()
        weakref.finalize(thing, lambda: None)
        ref = weakref.ref(thing, lambda _: os.kill(os.getpid(), signal.SIGINT))
        try:
            del thing  # the interrupt is raised in a callback, where Python drops it
            time.sleep(20.0)
        except KeyboardInterrupt:
            return cli.INTERRUPTED
        return 0

sys.modules["study.cli.commands"] = Commands
sys.exit(cli.main())
"""


@pytest.mark.skipif(os.name != "posix", reason="these signals are those of POSIX")
def test_interrupt_that_python_drops_in_a_callback_is_raised_again():
    found = _python(_DROPPED)
    assert (found.returncode, found.stderr) == (130, "")


_AT_WORK = """
import sys, threading, time
import study.cli.entry as cli

class Commands:
    def run(argv, signals):
        threading.Thread(target=time.sleep, args=(600.0,)).start()
        print("told")
        return cli.INTERRUPTED

sys.modules["study.cli.commands"] = Commands
sys.exit(cli.main())
"""


def test_interrupted_command_does_not_wait_for_a_thread_that_compiles():
    found = _python(_AT_WORK)  # would run into the time limit of the call
    assert (found.returncode, found.stdout) == (130, "told\n")


def test_command_lets_xla_log_nothing_but_what_ends_it(monkeypatch):
    monkeypatch.delenv("TF_CPP_MIN_LOG_LEVEL", raising=False)
    program = "import os, study.cli.entry; study.cli.entry.main(['template']); print(os.environ)"
    assert "'TF_CPP_MIN_LOG_LEVEL': '3'" in _python(program).stdout
    monkeypatch.setenv("TF_CPP_MIN_LOG_LEVEL", "0")
    assert "'TF_CPP_MIN_LOG_LEVEL': '0'" in _python(program).stdout


_ALARMING = """
import study.cli.entry
study.cli.entry.main(["template"])
import jax, numpy as np
values = np.arange(1500.0)
n = len(values)
window = lambda: jax.lax.reduce_window(
    jax.numpy.asarray(values), 0.0, jax.lax.add, (n,), (1,), "SAME"
)
jax.jit(window).lower().compile()
"""


@pytest.mark.slow
@pytest.mark.parametrize("level", [None, "2"])
def test_alarm_of_a_slow_compilation_reaches_no_terminal(level, monkeypatch):
    """A constant that takes seconds to fold makes XLA log the alarm that slow compilations do."""
    monkeypatch.delenv("TF_CPP_MIN_LOG_LEVEL", raising=False)
    if level:
        monkeypatch.setenv("TF_CPP_MIN_LOG_LEVEL", level)
    ended = _python(_ALARMING)
    assert ended.returncode == 0, ended.stderr
    assert ("slow_operation_alarm" in ended.stderr) == (level is not None)
