"""The command `completion`: scripts that a shell takes, with what it completes."""

import shutil
import subprocess
import sys

import pytest

from study.cli.command_arguments import SHELLS


@pytest.mark.parametrize("shell", SHELLS)
def test_script_of_each_shell_knows_commands_options_and_choices(shell, command):
    outcome = command("completion", shell)
    assert outcome.status == 0, outcome.stderr
    for word in ("simulate", "dry-run", "import-record", "coarse"):
        assert word in outcome.stdout
    if shutil.which(shell):
        subprocess.run([shell, "-n"], input=outcome.stdout, text=True, check=True)


@pytest.mark.skipif(shutil.which("bash") is None, reason="bash is not installed")
@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("jaxfsi simu", "simulate"),
        ("jaxfsi simulate --pre", "--preset"),
        ("jaxfsi mesh --preset m", "medium"),
        ("jaxfsi cache cl", "clear"),
        ("jaxfsi completion z", "zsh"),
    ],
)
def test_bash_completes(line, expected, command, tmp_path):
    script = tmp_path / "jaxfsi.bash"
    script.write_text(command("completion", "bash").stdout)
    words = line.split()
    asked = (
        f"source {script}; COMP_WORDS=({line}); COMP_CWORD={len(words) - 1}; "
        '_shtab_jaxfsi; echo "${COMPREPLY[@]}"'
    )
    done = subprocess.run(["bash", "-c", asked], capture_output=True, text=True)
    assert done.stdout.split() == [expected], done.stderr


def test_package_that_is_missing_is_named(command, monkeypatch):
    monkeypatch.setitem(sys.modules, "shtab", None)
    outcome = command("completion", "bash")
    assert outcome.status == 1
    assert "pip install shtab" in outcome.stderr
