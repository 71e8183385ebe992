"""`make test` leaves out no rule and no variant: it has the tests that take each of them once."""

import subprocess
import sys
from typing import get_args, get_type_hints

import pytest

from ciphernav_jax import Protocol
from ciphernav_jax.secret.rules import RULES
from tests.patience import PATIENCE_S

RULE = "tests/experiments/test_primitives.py::test_the_error_is_within_its_bound"
VARIANT = "tests/secret/test_variants.py::test_each_variant_by_itself_computes_products_signs_and_an_arg_max"


@pytest.fixture(scope="module")
def quick():
    """The parameters with which a test is among the quick ones."""
    collect = [sys.executable, "-m", "pytest", "--collect-only", "-q", "-m", "not slow", RULE, VARIANT]
    done = subprocess.run(collect, capture_output=True, text=True, check=True, timeout=PATIENCE_S)
    lines = [line.removesuffix("]").split("[", 1) for line in done.stdout.splitlines() if "[" in line]
    return lambda test: [name for name_of, name in lines if name_of == test]


def test_every_rule_is_computed(quick):
    assert {name.partition(":")[0] for name in quick(RULE)} == set(RULES)


def test_every_variant_is_computed(quick):
    variants = {
        f"{field}={choice}"
        for field, hint in get_type_hints(Protocol).items()
        for choice in get_args(hint)
        if isinstance(choice, str) and choice != getattr(Protocol(), field)
    }
    taken = {part for name in quick(VARIANT) for part in name.split(", ")}
    # What is opened of a classifier's result is navigation's, and slow.
    assert variants - taken == {"opened=logits"}
