"""The table of primitives: it is the page in docs, it leaves out no rule, and its errors are bounds."""

from functools import cache
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import ciphernav_jax as cn
from ciphernav_jax.secret.rules import CONTROL_FLOW, RULES
from experiments import primitives
from tests.secret.digests import arguments

pytestmark = pytest.mark.newest_jax

PAGE = Path(__file__).parents[2] / "docs" / "primitives.md"
UNIT = 2.0**-20
EXAMPLES = {f"{example.primitive}: {example.expression}": example for example in primitives.examples()}

ARGUMENTS = arguments()


def test_the_page_is_what_is_generated():
    assert PAGE.read_text() == primitives.markdown(), "run: python -m experiments primitives"


def test_every_rule_has_a_row():
    assert {example.primitive for example in EXAMPLES.values()} == set(RULES)


@pytest.mark.parametrize("name", EXAMPLES)
def test_an_example_applies_its_primitive_and_pays_for_nothing_else(name, monkeypatch):
    example = EXAMPLES[name]
    rule, applied = RULES[example.primitive], []

    def noted(*args, **params):
        applied.append(example.primitive)
        return rule(*args, **params)

    monkeypatch.setitem(RULES, example.primitive, noted)
    found = primitives.example_cost(example)
    assert applied
    if example.primitive not in CONTROL_FLOW:
        assert {row.name for row in found.by_primitive} <= {example.primitive, "output"}


@pytest.mark.parametrize("name", EXAMPLES)
def test_rounds_and_bytes_are_the_same_for_any_number_of_parties(name):
    two, five = (primitives.example_cost(EXAMPLES[name], parties) for parties in (2, 5))
    assert (two.rounds, two.bytes_sent) == (five.rounds, five.bytes_sent // 4)
    assert [row.bytes_dealt for row in two.by_request] == [row.bytes_dealt for row in five.by_request]
    assert two.bytes_on_call == five.bytes_on_call


@cache
def results():
    """All examples in one compilation."""
    step = cn.secure(lambda *args: {name: example.function(*args) for name, example in EXAMPLES.items()})
    shared = cn.share(jax.random.key(0), ARGUMENTS[2:], parties=3)
    return step(jax.random.key(1), *ARGUMENTS[:2], *shared)


@pytest.mark.parametrize("name", EXAMPLES)
def test_the_error_is_within_its_bound(name):
    example, secret = EXAMPLES[name], results()[name]
    assert isinstance(secret, cn.Secret)
    expected = example.function(*[x if isinstance(x, int) else jnp.asarray(x) for x in ARGUMENTS])
    error = np.abs(np.asarray(cn.reveal(secret), np.float64) - np.asarray(expected, np.float64))
    assert error.shape == expected.shape
    # Float64 itself rounds in the last of 53 bits.
    assert np.all(error <= example.bound(*ARGUMENTS) * UNIT + 1e-12)
