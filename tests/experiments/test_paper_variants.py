"""Variants compared and trained with, small."""

import json

import jax
import numpy as np
import pytest

from ciphernav_jax import files
from ciphernav_jax.comparison import Row, running
from ciphernav_jax.navigation import classifier
from ciphernav_jax.navigation.classifier import FreshClassifier
from ciphernav_jax.protocols import Protocol
from experiments.failures import failures
from experiments.paper import variants

RECIPE = FreshClassifier(batch=6)
IDEAL = Protocol.parse(variants.VARIANTS[-1])


@pytest.fixture(autouse=True)
def few(monkeypatch):
    monkeypatch.setattr(variants, "TRUNCATIONS", (2, 1 << 10))


def test_the_variants_are_all_different_and_begin_with_the_default():
    protocols = [Protocol.parse(text) for text in variants.VARIANTS]
    assert len(set(protocols)) == len(protocols)
    assert protocols[0] == Protocol()
    for _, some in variants.PLAN:
        assert set(some) <= set(variants.VARIANTS)


def test_failures_sees_those_of_a_truncation_that_fails_often():
    # With 30 fractional bits a product of 3 is x = 3 * 2^60: local fails with probability x / 2^64.
    failed, of = failures(Protocol(truncation="local", frac_bits=30), 2, 3, rounds=1, count=1 << 12)
    assert of == 1 << 12
    assert abs(failed / of - 3 * 2**60 / 2**64) < 0.03
    with pytest.raises(ValueError, match="within 4 in magnitude"):
        failures(Protocol(frac_bits=30), 2, 5)


def test_in_float64_it_is_gradient_descent_with_momentum():
    (weights, velocity), slots, labels = variants.taught(RECIPE)
    found = variants.exactly(((weights, velocity), slots, labels), RECIPE, 3)

    def error(weights):
        return ((classifier.predict(weights, slots) - labels) ** 2).sum()

    expected = []
    for _ in range(3):
        loss, gradient = jax.value_and_grad(error)(weights)
        velocity = jax.tree.map(lambda v, g: 0.9 * v - RECIPE.scale(5) * g, velocity, gradient)
        weights = jax.tree.map(jax.numpy.add, weights, velocity)
        expected.append(float(loss))
    np.testing.assert_allclose(found, expected, rtol=1e-4)  # those of float32
    assert found[0] > found[2]


def test_a_training_with_a_variant():
    found = json.loads(json.dumps(variants.trained(IDEAL, RECIPE, steps=2)))
    assert (found["protocol"], found["ideal"], found["parties"], found["steps"]) == (str(IDEAL), True, 2, 2)
    assert 0 < abs(found["loss"] / found["exact"] - 1) < 1e-3
    assert (found["value"], found["truncations"], found["failed"]) == (30_000, 2 << 10, 0)


def test_trainings_go_on_where_they_were_killed(tmp_path, monkeypatch):
    tried = []

    def trained(protocol, recipe):
        if len(tried) == 2:
            raise KeyboardInterrupt
        tried.append(str(protocol))
        return {"protocol": str(protocol)}

    monkeypatch.setattr(variants, "trained", trained)
    path = tmp_path / "trained.json"
    with pytest.raises(KeyboardInterrupt):
        variants.trainings(path, RECIPE)
    monkeypatch.setattr(variants, "trained", lambda protocol, recipe: {"protocol": str(protocol)})
    found = variants.trainings(path, RECIPE)
    assert tried == ["default", "truncation=nearest"]
    assert [of["protocol"] for of in found] == [str(Protocol.parse(text)) for text in variants.VARIANTS]
    before = path.read_bytes()
    with pytest.raises(files.DamagedError, match="another batch"):
        variants.trainings(path, FreshClassifier(batch=7))
    assert path.read_bytes() == before


def test_all_of_the_plan_is_in_one_comparison(tmp_path, monkeypatch):
    monkeypatch.setattr(
        running, "trial", lambda subject, protocol, parties, *_: Row(str(protocol), parties, protocol.ideal)
    )
    plan = (((2,), ("default", variants.VARIANTS[-1])), ((3, 5), ("default",)))
    found = variants.compared(tmp_path, RECIPE, plan)
    assert [(row.protocol, row.parties) for row in found.rows] == [
        ("default", 2),
        (str(IDEAL), 2),
        ("default", 3),
        ("default", 5),
    ]
    assert found.configuration["public"] == [3]
