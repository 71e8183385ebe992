import functools
import operator

import numpy as np
import pytest
from simulated import PARTIES, WHOLE_RING, elements, on_secrets, on_shares, signed, words

from ciphernav_jax import ring
from ciphernav_jax.protocols import compare, sharing
from ciphernav_jax.protocols.dealer import Mask
from ciphernav_jax.protocols.party import open_sum


def positive(dealer, x):
    return compare.positive(dealer, x).share()


def around_powers_of_two():
    values = [sign * 2**k + d for k in range(63) for sign in (1, -1) for d in (-1, 0, 1)]
    return elements([*values, *WHOLE_RING, 2**63 - 1, -(2**63) + 1])


@pytest.mark.parametrize("parties", [*PARTIES, 8, 16])
def test_the_bit_is_one_exactly_where_the_value_is_positive(parties):
    x = np.tile(around_powers_of_two(), 3)  # each under three masks
    got = on_secrets(positive, parties)(1, x)
    np.testing.assert_array_equal(got, signed(x) > 0)


@pytest.mark.parametrize("parties", PARTIES)
def test_the_bit_is_right_under_many_masks(parties):
    values = elements([0, 1, -1, 2**62, -(2**62), 2**63 - 1])
    x = np.repeat(values[:, None], 4096, axis=1)
    np.testing.assert_array_equal(on_secrets(positive, parties)(2, x), signed(x) > 0)


@pytest.mark.parametrize("shape", [(), (1,), (65,), (5, 26), (0, 3)])
def test_any_shape_is_compared(shape):
    x = words(3, *shape)
    got = on_secrets(positive, 2)(3, x)
    assert got.shape == shape
    np.testing.assert_array_equal(got, signed(x) > 0)


def borrow(dealer, public):
    """The borrow of the public, opened values against the mask's bits, beside the mask itself."""
    c = open_sum(public)
    mask = dealer.take(Mask(c.shape, bits=True))
    return mask["mask"], compare._borrow(dealer, ring.bit_slice(c), mask["bits"], mask["pairs"])


@pytest.mark.parametrize("parties", [2, 3])
def test_the_borrow_compares_the_lower_63_bits(parties):
    c = words(4, 64 * 64)
    mask_shares, borrow_shares = on_shares(borrow, parties)(4, c)
    r = np.asarray(sharing.join_sum(mask_shares))
    row = functools.reduce(operator.xor, np.asarray(borrow_shares))
    below = (c & np.uint64(2**63 - 1)) < (r & np.uint64(2**63 - 1))
    bits = row[None, :] >> np.arange(64, dtype=np.uint64)[:, None] & np.uint64(1)
    np.testing.assert_array_equal(bits.ravel(), below)
