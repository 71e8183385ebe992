import numpy as np
import pytest

from ciphernav_jax import ring
from ciphernav_jax.parties import sharing
from ciphernav_jax.parties.requests import SharedBits
from ciphernav_jax.protocols import convert
from ciphernav_jax.ring import bits

from ..parties.simulated import BY_PARTIES, PARTIES, WHOLE_RING, elements, on_secrets, on_shares, words
from ..slow import slow

SHAPE = (9, 22)


def values():
    return np.concatenate([elements(WHOLE_RING), words(1, 198 - len(WHOLE_RING))]).reshape(SHAPE)


@pytest.mark.parametrize("parties", [*BY_PARTIES, *slow(8)])
def test_to_bits_shares_each_bit_of_the_value(parties):
    x = values()
    shares = on_shares(convert.to_bits, parties)(1, x)
    got = bits.unpack(sharing.join_xor(shares), SHAPE)
    np.testing.assert_array_equal(got, [x >> np.uint64(j) & np.uint64(1) for j in range(64)])


def there_and_back(dealer, x):
    return convert.to_ring(dealer, convert.to_bits(dealer, x), x.shape)


@pytest.mark.parametrize("parties", [*BY_PARTIES, *slow(8)])
def test_a_value_comes_back_from_its_bits(parties):
    x = values()
    np.testing.assert_array_equal(on_secrets(there_and_back, parties)(2, x), x)


@pytest.mark.parametrize("shape", [(), (1,), (64,), (3, 43)])
def test_a_row_of_bits_becomes_values_in_the_ring(shape):
    def program(dealer):
        word = dealer.take(SharedBits(shape))["words"]
        return word, convert.to_ring_bit(dealer, word, shape).share()

    for parties in PARTIES:
        word, value = on_shares(program, parties)(3)
        expected = bits.unpack(sharing.join_xor(word), shape)
        np.testing.assert_array_equal(sharing.join_sum(value), expected)


def test_bits_of_any_source_convert_not_only_values_of_the_ring():
    def program(dealer):
        word = dealer.take(SharedBits((70,), rows=(64,)))["words"]
        return word, convert.to_ring(dealer, word, (70,))

    word, value = on_shares(program, 3)(4)
    expected = ring.bit_unslice(sharing.join_xor(word), (70,))
    np.testing.assert_array_equal(sharing.join_sum(value), expected)
