"""`python -m experiments`: help with examples, and options that are refused in one line."""

import subprocess
import sys

import pytest

from experiments import __main__ as experiments
from tests.commands import exit_code


def run(monkeypatch, *words):
    return exit_code(monkeypatch, experiments.main, "experiments", *words)


@pytest.mark.parametrize(
    ("command", "word"),
    [
        ("bench", "--peers"),
        ("report", "--readme"),
        ("primitives", "docs"),
        ("pages", "docs/api.md"),
        ("programs", "--count"),
    ],
)
def test_every_command_has_help_with_examples(monkeypatch, capsys, command, word):
    assert run(monkeypatch, command, "--help") == 0
    shown = capsys.readouterr().out
    assert all(words in shown for words in (word, "For example:", f"python -m experiments {command}"))


@pytest.mark.parametrize("name", experiments.PAPER)
def test_every_script_of_the_paper_has_help_with_its_command(monkeypatch, capsys, name):
    assert run(monkeypatch, "paper", name, "--help") == 0
    shown = capsys.readouterr().out
    assert f"python -m experiments paper {name}" in shown
    assert "--results" in shown


def test_help_imports_no_jax():
    code = "import sys; import experiments.__main__; sys.exit('jax' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["bench", "--work"], "--work needs at least one value"),
        (["bench", "--parties"], "--parties needs at least one value"),
        (["bench", "--peers", "--time-limit", "nan"], "--time-limit must lie in"),
        (["bench", "--variant"], "--variant needs at least one value"),
        (["report", "--results", "nowhere"], "say with --results where"),
        (["paper"], "the names are accuracy"),
        (["paper", "tables"], "no experiment 'tables'"),
        (["paper", "accuracy", "--rows", "none"], "no row none"),
        (["paper", "accuracy", "--seeds", "-1"], "--seeds must lie in"),
    ],
)
def test_what_cannot_be_done_is_said_in_one_line(monkeypatch, capsys, tmp_path, words, message):
    monkeypatch.chdir(tmp_path)
    assert run(monkeypatch, *words) == 1
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert list(tmp_path.iterdir()) == []
