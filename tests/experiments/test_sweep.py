import json

import jax
import numpy as np
import pytest

from ciphernav_jax import files
from ciphernav_jax.protocols import Protocol
from experiments import process, sweep
from experiments.failures import failures
from experiments.options import VARIANTS
from experiments.training import gradient_of_first_step, sgd_step, training
from experiments.trial import Effort, Trial, result_of
from experiments.work import RATE, Sizes, squared_error

TINY = Effort(Sizes(widths=(6, 4, 3), forward=4, train=10), steps=4, chunk=2, truncations=1 << 10)
DEFAULT = Protocol()
LOCAL = Protocol(truncation="local")
IDEAL = Protocol(multiplication="ideal")
UNIT = 2.0**-20


def test_the_default_variants_are_all_different_and_begin_with_the_default():
    protocols = [Protocol.parse(text) for text in VARIANTS]
    assert len(set(protocols)) == len(VARIANTS)
    assert protocols[0] == Protocol()


def test_the_training_is_gradient_descent_with_momentum():
    plain = training(TINY.sizes, 1)
    exact = jax.grad(squared_error)(plain.weights, plain.features, plain.labels)
    first = sgd_step(plain.state, plain.features, plain.labels)
    found = gradient_of_first_step(first, plain.labels.size)
    for g, e in zip(jax.tree.leaves(found), jax.tree.leaves(exact), strict=True):
        np.testing.assert_allclose(g, e / plain.labels.size, atol=1e-12)
    second = sgd_step(first, plain.features, plain.labels)
    then = jax.grad(squared_error)(first[0], plain.features, plain.labels)
    for w2, w1, w0, g in zip(*map(jax.tree.leaves, (second[0], first[0], plain.weights, then)), strict=True):
        np.testing.assert_allclose(w2 - w1, 0.9 * (w1 - w0) - RATE * g, atol=1e-12)
    assert second[2] < first[2]


def test_a_trial():
    tried = Trial(Protocol(range_bits=8), 3, TINY)
    assert Trial.from_json(json.loads(json.dumps(tried.as_json()))) == tried
    result = json.loads(json.dumps(result_of(tried)))
    for part in ("step", "forward"):
        assert 0 < result[part]["seconds"]["q1"] <= result[part]["seconds"]["median"]
        assert 0 < result[part]["cost"]["rounds"] * 20e-3 < result[part]["cost"]["wan_s"]
    assert result["step"]["cost"]["bytes_sent"] > result["forward"]["cost"]["bytes_sent"]
    # Entries below 4 in two contractions of at most 6; a gradient in the update is a multiple of 2^-20.
    assert 0 < result["outputs"]["rms"] <= result["outputs"]["largest"] < 100 * UNIT
    assert 0 < result["gradients"]["largest"] < 2 * UNIT / (RATE * 30)
    assert [point[0] for point in result["curve"]] == [2, 4]
    for _, found, expected in result["curve"]:
        assert abs(found - expected) < 1e-2
    assert result["outputs"]["far"] == result["gradients"]["far"] == result["truncations"]["failed"] == 0
    assert result["diverged"] is False
    assert result["in_range"]
    assert 0.1 < result["largest_sign_input"] < 2**8


def test_a_training_that_would_take_too_long_is_left_out():
    result = result_of(Trial(IDEAL, 2, Effort(TINY.sizes, time_limit=0, truncations=1)))
    assert result["curve"] is result["diverged"] is None
    assert result["step"]["seconds"]["repeats"] == 3
    assert result["step"]["cost"] is result["forward"]["cost"] is None


def test_failures_sees_those_of_a_truncation_that_fails_often():
    # With 30 fractional bits a product of 3 is x = 3 * 2^60: local fails with probability x / 2^64.
    failed, of = failures(Protocol(truncation="local", frac_bits=30), 2, 3, rounds=1, count=1 << 12)
    assert of == 1 << 12
    assert abs(failed / of - 3 * 2**60 / 2**64) < 0.03
    with pytest.raises(ValueError, match="within 4 in magnitude"):
        failures(Protocol(frac_bits=30), 2, 5)


@pytest.fixture
def instant(monkeypatch):
    """Trials that are not run: each answers the same, and is noted."""
    tried = []

    def run(module, order, title):
        tried.append(title)
        part = {"trace_s": 1.0, "compile_s": 2.0, "seconds": {"median": 0.01 * order["parties"]}}
        costs = {"rounds": 43, "bytes_sent": 10_000_000, "bytes_dealt": 5, "lan_s": 0.1, "wan_s": 2.5}
        costs = None if "ideal" in order["protocol"].values() else costs
        errors = {"largest": 1e-5, "rms": 1e-6, "far": 0, "of": 100}
        return {
            "forward": part | {"cost": costs},
            "step": part | {"cost": costs},
            "outputs": errors,
            "gradients": errors,
            "curve": [[2, 9.0, 8.0]],
            "diverged": False,
            "in_range": True,
            "truncations": {"failed": 7, "of": 1024, "value": 3e4},
        }

    monkeypatch.setattr(process, "run", run)
    return tried


def swept(out, parties, protocols=(DEFAULT, LOCAL, IDEAL), **given):
    return sweep.run(parties=parties, protocols=protocols, out=out, **given)


def test_the_table_names_what_is_no_protocol_and_what_cannot_be(instant, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(sweep.console, "width", 200)
    document = swept(tmp_path, [2, 5])
    assert len(instant) == 5  # local truncation is not tried with five parties
    assert files.read_json(tmp_path / "sweep.json") == json.loads(json.dumps(document))
    text = (tmp_path / "sweep.md").read_text()
    assert text == sweep.markdown(document)
    assert "| default | 2 | 20 | 20 | 43 | 10 | 2.5 | 1.0e-05 | +12 % | 7 of 1,024 |" in text
    assert "| truncation=local | 5 | two parties only |" in text
    assert "| multiplication=ideal (ideal: not a protocol) | 5 | 50 | 50 | - | - | - |" in text
    shown = capsys.readouterr().out
    assert all(word in shown for word in ("two parties only", "not a protocol", "5 parties", "sweep.png"))
    assert (tmp_path / "sweep.png").read_bytes().startswith(b"\x89PNG")


def test_a_sweep_goes_on_and_grows(instant, tmp_path):
    swept(tmp_path, [2])
    document = swept(tmp_path, [2, 3], (Protocol(), IDEAL))
    assert instant[3:] == ["default with 3 parties", "multiplication=ideal with 3 parties"]
    assert len(document["results"]) == 5
    with pytest.raises(ValueError, match="another configuration"):
        swept(tmp_path, [2], seed=1)


@pytest.mark.parametrize(
    ("given", "message"),
    [({"parties": [1]}, "two parties"), ({"effort": Effort(steps=15)}, "multiple of 10")],
)
def test_what_cannot_be_swept_is_refused(given, message, tmp_path):
    with pytest.raises(ValueError, match=message):
        swept(tmp_path, **{"parties": [2]} | given)


def test_one_trial_in_a_process_of_its_own(tmp_path):
    document = swept(tmp_path, [2], [IDEAL], effort=TINY)
    assert document["results"][0]["outputs"]["largest"] < 100 * UNIT
