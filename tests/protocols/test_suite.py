import dataclasses
import subprocess
import sys

import pytest

from ciphernav_jax.protocols import Protocol
from tests.patience import PATIENCE_S


def test_a_protocol_is_a_value():
    assert Protocol() == Protocol(frac_bits=20, truncation="probabilistic")
    assert hash(Protocol()) == hash(Protocol())
    assert Protocol() != Protocol(frac_bits=16)
    with pytest.raises(dataclasses.FrozenInstanceError):
        Protocol().frac_bits = 3  # pyright: ignore[reportAttributeAccessIssue]


@pytest.mark.parametrize("frac_bits", [-1, 0, 31, 64])
def test_fractional_bits_without_room_for_products_raise(frac_bits):
    with pytest.raises(ValueError, match=r"1\.\.30"):
        Protocol(frac_bits=frac_bits)


def test_an_unknown_variant_raises_and_names_the_known_ones():
    with pytest.raises(ValueError, match="probabilistic, local"):
        Protocol(truncation="exact")  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize("name", ["frac_bits", "range_bits"])
@pytest.mark.parametrize("bits", [16.0, 16.5, True, "16"])
def test_bits_are_integers(name, bits):
    with pytest.raises(ValueError, match=f"{name} is a number of bits, an int, and not {bits!r}"):
        Protocol(**{name: bits})


@pytest.mark.parametrize("frac_bits", [1, 16, 20, 30])
def test_products_within_the_bound_are_within_the_range_of_truncation(frac_bits):
    assert Protocol(frac_bits=frac_bits).bound * 4**frac_bits == 2**62


def test_protocols_import_nothing_of_what_is_built_on_them():
    program = """
import sys
import ciphernav_jax.protocols.relu, ciphernav_jax.parties.run
above = ("ciphernav_jax.secret", "ciphernav_jax.models", "ciphernav_jax.navigation", "flax", "optax")
assert not [n for n in sys.modules if n.startswith(above)]
"""
    subprocess.run([sys.executable, "-c", program], check=True, timeout=PATIENCE_S)


def test_a_protocol_is_parsed_from_words():
    assert Protocol.parse("default") == Protocol()
    chosen = Protocol(truncation="nearest", frac_bits=16)
    assert Protocol.parse("truncation=nearest, frac_bits=16") == Protocol.parse(str(chosen)) == chosen
    for wrong, message in (
        ("nearest", "NAME=VALUE"),
        ("rounding=up", "the names are"),
        ("truncation=up", "the variants are"),
        ("frac_bits=many", "number of bits"),
    ):
        with pytest.raises(ValueError, match=message):
            Protocol.parse(wrong)
