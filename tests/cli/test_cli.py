import subprocess
import sys

import pytest

from ciphernav_jax import cli


def run(monkeypatch, *words):
    monkeypatch.setattr(sys, "argv", ["ciphernav", *map(str, words)])
    with pytest.raises(SystemExit) as stopped:
        cli.main()
    return stopped.value.code


@pytest.mark.parametrize(
    ("command", "word"),
    [
        ("generate", "--unseen-by"),
        ("train", "--parties"),
        ("evaluate", "--model"),
        ("demo", "--workers"),
        ("bench", "--peers"),
        ("sweep", "--variant"),
    ],
)
def test_every_command_has_help_with_a_seed_and_an_output_folder(monkeypatch, capsys, command, word):
    assert run(monkeypatch, command, "--help") == 0
    shown = capsys.readouterr().out
    assert all(option in shown for option in (word, "--seed", "--out"))


def test_help_imports_no_jax():
    code = "import sys; from ciphernav_jax import cli; sys.exit('jax' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["train", "--method", "secret", "--parties", "1"], "at least two parties"),
        (["train", "--method", "map-only", "--parties", "2"], "has no secrets"),
        (["train", "--method", "map-only", "--steps", "2"], "not for map-only"),
        (["train", "--method", "map-only", "--epochs", "0"], "--epochs must be at least 1"),
        (["train", "--method", "map-only"], "ciphernav generate"),
        (["evaluate", "--model", "nowhere"], "ciphernav generate"),
    ],
)
def test_errors_are_one_line_with_the_way_out(monkeypatch, capsys, tmp_path, words, message):
    assert run(monkeypatch, *words, "--data", tmp_path, "--out", tmp_path / "out") == 1
    error = capsys.readouterr().err
    assert message in error
    assert "Traceback" not in error
    assert not (tmp_path / "out").exists()
