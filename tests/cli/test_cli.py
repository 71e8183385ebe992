import os
import shutil
import signal
import subprocess
import sys

import pytest

from ciphernav_jax import cli
from ciphernav_jax.files import DamagedError
from ciphernav_jax.world import dataset
from tests.commands import exit_code


def run(monkeypatch, *words):
    return exit_code(monkeypatch, cli.main, "ciphernav", *words)


@pytest.mark.parametrize(
    ("command", "word"),
    [
        ("generate", "--unseen-by"),
        ("train", "--parties"),
        ("evaluate", "--model"),
        ("demo", "--workers"),
        ("sweep", "--function"),
    ],
)
def test_every_command_has_help_with_examples_and_an_output_folder(monkeypatch, capsys, command, word):
    assert run(monkeypatch, command, "--help") == 0
    shown = capsys.readouterr().out
    assert all(words in shown for words in (word, "--out", "For example:", f"ciphernav {command} "))


def test_help_imports_no_jax():
    code = "import sys; from ciphernav_jax import cli; sys.exit('jax' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["train", "--method", "secret", "--parties", "1"], "--parties must lie in 2..1024, not at 1"),
        (["train", "--method", "map-only", "--parties", "2"], "has no secrets"),
        (["train", "--method", "map-only", "--steps", "2"], "not for map-only"),
        (["train", "--method", "map-only", "--epochs", "0"], "--epochs must lie in 1.."),
        (["train", "--method", "map-only", "--seed", "-1"], "--seed must lie in 0..9223372036854775807"),
        (["train", "--method", "map-only", "--seed", str(10**24)], "--seed must lie in"),
        (["train", "--method", "secret", "--variant", "frac_bits=None"], "frac_bits is a number of bits"),
        (["train", "--method", "secret", "--variant", "frac_bits=31"], "no variant 'frac_bits=31'"),
        (["train", "--method", "secret", "--encoders", "x", "--epochs", "2"], "--encoders keeps others"),
        (["train", "--method", "map-only"], "ciphernav generate"),
        (["evaluate", "--model", "nowhere"], "ciphernav generate"),
    ],
)
def test_errors_are_one_line_with_the_way_out(monkeypatch, capsys, tmp_path, words, message):
    assert run(monkeypatch, *words, "--data", tmp_path, "--out", tmp_path / "out") == 1
    error = capsys.readouterr().err
    assert message in error
    assert error.startswith("ciphernav: ")
    assert error.count("\n") == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("words", [["--parties", "2"], ["--variant", "opened=logits"]])
def test_a_random_walk_refuses_what_it_would_ignore(monkeypatch, capsys, tmp_path, words):
    monkeypatch.setattr(dataset, "load", lambda folder: None)
    assert run(monkeypatch, "evaluate", "--model", "random", "--data", tmp_path, *words) == 1
    assert "a random walk has no secrets" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["generate", "--count", str(10**12)], "--count must lie in"),
        (["generate", "--count", str(2 * 10**7)], "20,000,000 environments need at least"),
        (["generate", "--seed", "-1"], "--seed must lie in"),
        (["demo", "--parties"], "--parties needs at least one value"),
        (["demo", "--test", "0"], "--test must lie in"),
    ],
)
def test_options_out_of_range_are_named(monkeypatch, capsys, tmp_path, words, message):
    monkeypatch.setattr(shutil, "disk_usage", lambda folder: shutil._ntuple_diskusage(0, 0, 10**12))
    assert run(monkeypatch, *words, "--out", tmp_path / "out") == 1
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def terminate():
    os.kill(os.getpid(), signal.SIGTERM)
    signal.pause()


def interrupt():
    os.kill(os.getpid(), signal.SIGINT)
    signal.pause()


def fail(error):
    raise error


@pytest.mark.parametrize(
    ("happens", "code", "message"),
    [
        (interrupt, 130, "interrupted"),
        (terminate, 143, "told to end"),
        (
            lambda: fail(PermissionError(13, "Permission denied", "/there/a")),
            1,
            "/there/a: Permission denied; ",
        ),
        (lambda: fail(OSError(28, "No space left on device", "/there/a")), 1, "make room and run the same"),
        (lambda: fail(FileNotFoundError("name another")), 1, "name another"),
        (lambda: fail(DamagedError("/a is damaged;\nremove it")), 1, "/a is damaged; remove it"),
        (lambda: fail(MemoryError("1 EB")), 1, "not enough memory: 1 EB"),
    ],
)
def test_every_end_is_one_line_and_has_its_code(monkeypatch, capsys, happens, code, message):
    before = signal.getsignal(signal.SIGTERM)
    monkeypatch.setattr(cli, "_run", lambda command: happens())
    # A shell has what it starts in the background ignore an interrupt.
    interrupts = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        assert run(monkeypatch, "demo") == code
    finally:
        signal.signal(signal.SIGINT, interrupts)
    error = capsys.readouterr().err
    assert error.startswith("ciphernav: ")
    assert message in error
    assert error.count("\n") == 1
    assert signal.getsignal(signal.SIGTERM) is before


def test_a_fault_of_the_program_keeps_its_traceback(monkeypatch):
    monkeypatch.setattr(sys, "argv", ["ciphernav", "demo"])
    monkeypatch.setattr(cli, "_run", lambda command: fail(KeyError("a")))
    with pytest.raises(KeyError):
        cli.main()
