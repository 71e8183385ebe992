import subprocess
import sys
from fractions import Fraction

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ciphernav_jax import ring
from tests.patience import PATIENCE_S

FRAC_BITS = (0, 1, 16, 20, 30, 62)


def nearest(value: float, frac_bits: int) -> int:
    """round(value * 2^frac_bits) with ties to even, in exact rational arithmetic."""
    return round(Fraction(value) * 2**frac_bits)


@pytest.mark.parametrize("frac_bits", FRAC_BITS)
@given(data=st.data())
def test_encoding_is_the_nearest_integer_in_twos_complement(frac_bits, data):
    bound = ring.value_range(frac_bits)
    inside = st.floats(-bound, bound, exclude_max=True, allow_subnormal=False)
    value = data.draw(inside | st.integers(-8, 8).map(lambda n: n * 2.0 ** -(frac_bits + 1)))
    assert int(ring.encode(value, frac_bits)) == nearest(value, frac_bits) % 2**64


@pytest.mark.parametrize("frac_bits", FRAC_BITS)
@given(element=st.integers(0, 2**64 - 1))
def test_decoding_divides_the_signed_value(frac_bits, element):
    signed = element - 2**64 if element >> 63 else element
    got = float(ring.decode(jnp.uint64(element), frac_bits))
    assert got == float(Fraction(signed, 2**frac_bits))  # Fraction to float rounds to nearest


@pytest.mark.parametrize("frac_bits", [16, 20, 30])
@given(value=st.floats(-(2.0**22), 2.0**22))
def test_round_trip_is_within_half_a_unit(frac_bits, value):
    back = float(ring.decode(ring.encode(value, frac_bits), frac_bits))
    assert abs(Fraction(back) - Fraction(value)) <= Fraction(1, 2 ** (frac_bits + 1))


def test_negative_values_do_not_lose_a_unit():
    # CrypTen decodes -1.99998 to -2.99998.
    for value in (-1.99998, -(2.0**-16), -1.0, -1.5):
        assert abs(float(ring.decode(ring.encode(value, 16), 16)) - value) <= 2.0**-17


@pytest.mark.parametrize("frac_bits", FRAC_BITS)
def test_both_ends_of_the_range_encode_and_what_lies_beyond_raises(frac_bits):
    bound = ring.value_range(frac_bits)
    assert int(ring.encode(-bound, frac_bits)) == 2**63
    last = np.nextafter(bound, 0)
    assert int(ring.encode(last, frac_bits)) == nearest(last, frac_bits)
    for outside in (bound, np.nextafter(-bound, -np.inf), 4 * bound, 1e300):
        with pytest.raises(ValueError, match="cannot encode"):
            ring.encode(np.array([0.0, outside]), frac_bits)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_values_that_are_not_finite_raise(value, dtype):
    with pytest.raises(ValueError, match="not finite"):
        ring.encode(np.array([1.0, value], dtype), 16)


@pytest.mark.parametrize("frac_bits", [-1, 63, 64])
def test_fractional_bits_that_do_not_fit_raise(frac_bits):
    with pytest.raises(ValueError, match="frac_bits"):
        ring.encode(1.0, frac_bits)


@given(value=st.integers(-(2**63), 2**63 - 1))
def test_integers_encode_exactly_beyond_the_53_bits_of_a_float(value):
    assert int(ring.encode(np.int64(value), 0)) == value % 2**64


@pytest.mark.parametrize(("value", "frac_bits"), [(2**62, 1), (-(2**62) - 1, 1), (2**43, 20)])
def test_integers_out_of_range_raise(value, frac_bits):
    with pytest.raises(ValueError, match="cannot encode"):
        ring.encode(np.int64(value), frac_bits)


@pytest.mark.parametrize(
    "values",
    [
        np.array([-1.5, 0.25], np.float32),
        np.array([-3, 7], np.int32),
        np.array([0, 200], np.uint8),
        np.array([True, False]),
        jnp.array([-0.5, 2.0], jnp.float32),
        jnp.array([-0.5, 2.0], jnp.bfloat16),
    ],
    ids=lambda v: str(v.dtype),
)
def test_every_real_dtype_encodes_alike_inside_and_outside_jit(values):
    expected = [nearest(float(v), 20) % 2**64 for v in np.asarray(values)]
    assert ring.encode(values, 20).tolist() == expected
    assert jax.jit(lambda v: ring.encode(v, 20))(values).tolist() == expected


def test_decode_to_float32_rounds_to_nearest():
    elements = np.array([2**24 + 1, 2**24 + 3, 2**64 - 2**24 - 1], np.uint64)
    got = jax.jit(lambda e: ring.decode(e, 10, jnp.float32))(elements)
    assert got.dtype == jnp.float32
    np.testing.assert_array_equal(got, np.float32([2**24, 2**24 + 4, -(2**24)]) / 1024)


def test_differentiating_through_an_encoding_raises_and_says_the_way_out():
    def through(v):
        return ring.decode(ring.encode(v, 16), 16).sum()

    with pytest.raises(TypeError, match="secure"):
        jax.grad(through)(jnp.ones(3))
    with pytest.raises(TypeError, match="secure"):
        jax.jit(jax.grad(through))(jnp.ones(3))


def test_without_64_bit_types_encoding_and_drawing_raise():
    program = """
import jax, ciphernav_jax
from ciphernav_jax import ring
jax.config.update("jax_enable_x64", False)
for attempt in (lambda: ring.encode(1.0, 16), lambda: ring.draw(jax.random.key(0), [(2,)])):
    try:
        attempt()
    except RuntimeError as error:
        assert "jax_enable_x64" in str(error), error
    else:
        raise AssertionError("no error")
"""
    subprocess.run([sys.executable, "-c", program], check=True, timeout=PATIENCE_S)
