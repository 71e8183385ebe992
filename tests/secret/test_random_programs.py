"""200 random programs come out as their bounds say; and the bounds find what is planted.

`python -m tests.secret.random_programs` checks thousands.
"""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import ciphernav_jax as cn
from ciphernav_jax.secret.rules import RULES

from .random_programs.checking import check, minimised
from .random_programs.drawing import CHOICES, random_program
from .random_programs.operations import Plain
from .random_programs.program import Program, Step
from .random_programs.reference import Bounded, Reference

pytestmark = pytest.mark.slow

WIDEST = 5000


def drawn(number: int, protocol=None, parties: int = 2) -> Program:
    return random_program((1, number), Reference(protocol or cn.Protocol(), parties), steps=3, widest=WIDEST)


# (protocol, parties, programs): where the rules take another way, mostly with the signs that cost least.
# Adders, layouts and generators are tested where they live, and by the command.
IDEAL = cn.Protocol(comparison="ideal")
PROTOCOLS = [
    (cn.Protocol(), 2, 40),
    (IDEAL, 3, 60),
    *(
        (replace(IDEAL, truncation=name), 2, 12)
        for name in ("nearest", "floor", "wrap-count", "local", "ideal")
    ),
    *((replace(IDEAL, frac_bits=f), 2, 12) for f in (16, 24)),
    (cn.Protocol(range_bits=10), 2, 8),
    (replace(IDEAL, multiplication="ideal"), 7, 8),
]


@pytest.mark.parametrize(("protocol", "parties", "count"), PROTOCOLS, ids=str)
def test_random_programs_come_out_within_their_bounds(protocol, parties, count):
    for number in range(count):
        program = drawn(number, protocol, parties)
        if check(program, protocol, parties):
            pytest.fail("{1.what}\n{0}".format(*minimised(program, protocol, parties)))


def test_the_programs_contain_every_operation():
    assert {step.name for number in range(2000) for step in drawn(number).steps} == set(CHOICES)


def test_the_reference_computes_what_jax_does():
    reference = Reference(cn.Protocol(), 2)
    for number in range(40):
        program = drawn(number)
        with jax.disable_jit():
            plain = program.evaluate(Plain(), [jnp.asarray(x.value, x.dtype) for x in program.inputs])
        with np.errstate(all="ignore"):
            expected = program.evaluate(reference, program.inputs)
        for got, want in zip(plain, expected, strict=True):
            assert (got.dtype, got.shape) == (want.dtype, want.shape)
            rounding = 1e-5 if program.inputs[0].dtype == np.float32 else 1e-9
            scale = np.max(np.abs(want.value), initial=0) if want.kind == "float" else 0
            off = np.abs(np.asarray(got, np.float64) - np.asarray(want.value, np.float64))
            assert np.all(off <= want.error + rounding * scale), f"{program}"


# --- planted faults -----------------------------------------------------------------------------------

X = Bounded(np.array([1.5, -2.0, 0.25]), np.zeros(3), np.dtype(np.float64))
Y = Bounded(np.array([1.5, 3.0, -0.5]), np.zeros(3), np.dtype(np.float64))


def less_precise(context, x, y, **_):
    """A product that is off by two units."""
    return RULES["add"](context, x.times(y), np.asarray(2 * 2.0**-20))


def at_least(context, x, y, **params):
    return GREATER_EQUAL(context, x, y, **params)


GREATER_EQUAL = RULES["ge"]
# The primitive, its rule, and the program to which the fault is to be reduced.
PLANTED = [
    ("mul", less_precise, Step("mul", (0, 1))),
    ("gt", at_least, Step("compare", (0, 1), ("greater",))),
]


@pytest.mark.parametrize(
    ("primitive", "rule", "step"), PLANTED, ids=lambda x: x if isinstance(x, str) else ""
)
def test_planted_faults_are_found_and_reduced_to_one_step(monkeypatch, primitive, rule, step):
    monkeypatch.setitem(RULES, primitive, rule)
    around = [Step("add", (0, 1)), step, Step("neg", (2,)), Step("add", (4, 4))]
    program, found = minimised(Program([X, Y], around), cn.Protocol(), 2)
    assert [s.name for s in program.steps] == [step.name]
    assert "got" in found.what
