"""`ciphernav sweep`: one's own function, named; and one line for what a user can do something about."""

import sys

import jax
import numpy as np
import pytest

from ciphernav_jax import cli, files
from ciphernav_jax.cli import sweep
from ciphernav_jax.comparison import Comparison, Row, running

MODULE = """
import jax.numpy as jnp, numpy as np

def product():
    return (lambda x, y: x * y), np.ones(2), np.ones(2)

def refused():
    return (lambda x: jnp.exp(x)), np.ones(2)

def mistaken():
    return (lambda x: x @ np.ones(3)), np.ones(2)

def words():
    return (lambda x: x), "a word"

def nothing():
    return None

def failing():
    return {}["a"]

number = 3
"""


@pytest.fixture
def run(monkeypatch, capsys, tmp_path):
    (tmp_path / "their_own.py").write_text(MODULE)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [path for path in sys.path if path])
    monkeypatch.delitem(sys.modules, "their_own", raising=False)

    def run(*words):
        monkeypatch.setattr(sys, "argv", ["ciphernav", "sweep", *words])
        code = 0
        try:
            cli.main()
        except SystemExit as stopped:
            code = stopped.code
        return code, *capsys.readouterr()

    return run


def test_a_function_of_ones_own_is_compared(run, tmp_path):
    code, out, err = run(
        "--function", "their_own:product", "--parties", "2", "--variant", "default", "--repeat", "1"
    )
    assert (code, err) == (0, "")
    assert "Written: out/sweep/comparison.json" in out
    found = Comparison.from_dict(files.read_json(tmp_path / "out" / "sweep" / "comparison.json"))
    assert [(row.protocol, row.parties, row.calls) for row in found.rows] == [("default", 2, 1)]
    assert (tmp_path / "out" / "sweep" / "comparison.png").exists()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--function", "their_own"], "--function is written package.module:name, not 'their_own'"),
        (["--function", "nobodys:product"], "No module named 'nobodys'"),
        (["--function", "their_own:quotient"], "has no attribute 'quotient'"),
        (["--function", "their_own:nothing"], "must return a function and its arguments"),
        (["--function", "their_own:failing"], "--function their_own:failing: KeyError: 'a'"),
        (["--function", "their_own:number"], "TypeError: 'int' object is not callable"),
        (["--function", "their_own:refused"], "their_own.py:8 (refused.<locals>.<lambda>)"),
        (["--function", "their_own:mistaken"], "dot_general requires contracting dimensions"),
        (["--function", "their_own:words"], "TypeError: Error interpreting argument"),
        (["--parties", "1"], "--parties must lie in 2..1024, not at 1"),
        (["--repeat", "0"], "--repeat must lie in"),
        (["--variant", "truncation=none"], "unknown truncation 'none'"),
    ],
)
def test_errors_are_one_line(run, tmp_path, words, message):
    code, _, err = run(*words)
    assert code == 1
    assert message in err
    assert err.startswith("ciphernav: ")
    assert err.count("\n") == 1
    assert not list(tmp_path.rglob("*.json"))


def test_without_a_function_it_is_a_training_step_of_the_papers_classifier(run, monkeypatch):
    compared = []

    def trial(subject, protocol, parties, *_):
        compared.append(subject)
        return Row(str(protocol), parties, protocol.ideal)

    monkeypatch.setattr(running, "trial", trial)
    _, args, public = sweep.training_step(0)
    (weights, velocity, loss), slots, labels, decay = args
    assert sum(x.size for x in jax.tree.leaves(weights)) == 46_373
    assert not any(np.any(x) for x in jax.tree.leaves((velocity, loss)))
    assert [x.shape for x in slots] == [(500, 32)] * 5 + [(500, 128)]
    assert np.all(np.sum(labels, axis=1) == 1)
    code, out, _ = run("--parties", "2", "3", "--variant", "default", "truncation=nearest")
    assert code == 0
    assert len(compared) == 4
    assert "sgd_step" in out
    assert compared[0].reference == "float64"
    assert compared[0].no_gradient == ""
    assert compared[0].public == public == (3,)
    assert decay == 1
