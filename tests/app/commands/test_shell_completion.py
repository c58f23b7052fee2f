"""The Tab key completes commands, options and file names of ``./headstock``, as typed."""

import os
import shutil
import sys
from pathlib import Path

import pytest

from common import Shell, run_process
from headstock.app.commands.shell_completion import SCRIPTS

PROGRAM = f'#!/bin/sh\nexec "{sys.executable}" -P -m headstock.app.command_line "$@"\n'
ASK = {
    "bash": '. ./completion; COMP_WORDS=({words}); COMP_CWORD={last}; compopt() {{ echo "compopt $*"; }}\n'
    '_headstock_completion "${{COMP_WORDS[0]}}"; printf "%s\\n" "${{COMPREPLY[@]}}"',
    "fish": "source ./completion; complete --do-complete {line}",
}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    checkout = tmp_path / "my clone"
    checkout.mkdir()
    (checkout / "headstock").write_text(PROGRAM)
    (checkout / "headstock").chmod(0o755)
    return checkout


def ask(name: str, folder: Path, *words: str) -> list[str]:
    """What a shell offers for the last word."""
    (folder / "completion").write_text(SCRIPTS[name])
    quoted = " ".join(f"'{word}'" for word in words)
    line = ASK[name].format(words=quoted, last=len(words) - 1, line=f"'{' '.join(words)}'")
    # fish keeps its settings in a home of its own
    variables = {
        **os.environ,
        "HOME": str(folder),
        "PYTHONPATH": os.pathsep.join(filter(None, sys.path)),
    }
    done = run_process([name, "-c", line], cwd=folder, env=variables)
    assert done.returncode == 0, done.stderr
    # what follows a tab describes the word
    return [word for text in done.stdout.splitlines() for word in text.split("\t")[0].split()]


@pytest.mark.parametrize("name", ASK)
def test_commands_options_names_and_files_are_completed(name: str, folder: Path) -> None:
    if shutil.which(name) is None:
        pytest.skip(f"no {name} here; the private root has one (environment/packages.txt)")
    (folder / "scene.toml").touch()
    assert ask(name, folder, "./headstock", "comp") == ["compare", "completion"]
    assert "--variant" in ask(name, folder, "./headstock", "run", "--v")
    assert set(ask(name, folder, "./headstock", "completion", "")) == set(SCRIPTS)
    files = ask(name, folder, "./headstock", "check", "sc")
    assert files[-1] == "scene.toml" if name == "fish" else files == ["compopt", "-o", "default"]


@pytest.mark.parametrize("name", SCRIPTS)
def test_a_script_is_printed_for_each_shell(name: str, shell: Shell) -> None:
    assert shell(f"completion {name}").out == SCRIPTS[name]
    assert f"_HEADSTOCK_COMPLETE=complete_{name}" in SCRIPTS[name]


def test_another_shell_is_refused_with_those_there_are(shell: Shell) -> None:
    assert "bash, zsh, fish" in shell.refuses("completion tcsh")
