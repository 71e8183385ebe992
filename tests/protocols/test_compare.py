import functools
import operator

import numpy as np
import pytest

from ciphernav_jax import ring
from ciphernav_jax.parties import sharing
from ciphernav_jax.parties.party import open_sum
from ciphernav_jax.parties.requests import Mask
from ciphernav_jax.protocols import compare

from ..parties.simulated import BY_PARTIES, WHOLE_RING, elements, on_secrets, on_shares, signed, words
from ..slow import slow

ADDERS = ["carry-tree", "kogge-stone", "brent-kung", "ripple"]
# Variant, layout, adder.
VARIANTS = [
    *(("masked", "sliced", adder) for adder in ADDERS),
    *(("masked", "words", adder) for adder in ADDERS),
    *(("resharing", "sliced", adder) for adder in ADDERS),
]


@functools.cache
def sign(variant="masked", layout="sliced", adder="carry-tree", sign_bit=63):
    circuit = compare.Circuit(layout, adder, sign_bit)

    def program(dealer, x):
        bit = compare.positive if variant == "masked" else compare.resharing
        return bit(dealer, x, circuit).share()

    return program


positive = sign()


def around_powers_of_two():
    values = [sign * 2**k + d for k in range(63) for sign in (1, -1) for d in (-1, 0, 1)]
    return elements([*values, *WHOLE_RING, 2**63 - 1, -(2**63) + 1])


def variants_and_parties():
    """Every variant at two parties; every number of parties with the fast adders. The ripple adder's 63
    levels are slow to compile: once here, and below with fewer.
    """
    for variant in VARIANTS:
        for parties in [2, 3, 5, 8, 16] if variant[2] == "carry-tree" else [2]:
            if variant[2] != "ripple" or variant[:2] == ("masked", "sliced"):
                yield *variant, parties
    yield "resharing", "sliced", "kogge-stone", 5
    yield "resharing", "sliced", "brent-kung", 3


@pytest.mark.parametrize(("variant", "layout", "adder", "parties"), slow(*variants_and_parties()))
def test_the_bit_is_one_exactly_where_the_value_is_positive(variant, layout, adder, parties):
    x = np.tile(around_powers_of_two(), 3)  # each under three masks
    got = on_secrets(sign(variant, layout, adder), parties)(1, x)
    np.testing.assert_array_equal(got, signed(x) > 0)


REDUCED = [(1, *v) for v in VARIANTS[::4]] + [(k, *VARIANTS[0]) for k in (2, 17, 30, 62)]
REDUCED += [(30, "masked", "words", "carry-tree"), (30, "resharing", "sliced", "brent-kung")]
REDUCED += [(12, "masked", "words", "ripple"), (12, "resharing", "sliced", "ripple")]


REDUCED = [(*reduced, 2 + n % 2) for n, reduced in enumerate(REDUCED)]


@pytest.mark.parametrize(
    ("sign_bit", "variant", "layout", "adder", "parties"),
    [*REDUCED[:3], *slow(*REDUCED[3:])],
)
def test_a_reduced_range_gives_the_sign_of_what_lies_in_it_and_not_of_what_lies_beyond(
    sign_bit, variant, layout, adder, parties
):
    limit = 2**sign_bit
    program = on_secrets(sign(variant, layout, adder, sign_bit), parties)
    x = np.array([0, 1, -limit + 1, limit, limit - 1, -1] * 100)
    np.testing.assert_array_equal(program(1, elements(x)), (x > 0) & (x != -limit))
    beyond = np.array([limit + 1, -limit, -limit - 1] * 64)
    np.testing.assert_array_equal(program(2, elements(beyond)), beyond <= 0)


@pytest.mark.parametrize("parties", BY_PARTIES)
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


@functools.cache
def borrows(width, adder, pairs):
    def program(dealer, public):
        """The borrow of opened values against the mask's bits, beside the mask itself."""
        c = open_sum(public)
        mask = dealer.take(Mask(c.shape, bits=width, pairs=width // 2 if pairs else 0))
        paired = mask["pairs"] if pairs else None
        word = compare.borrow(dealer, ring.bit_slice(c)[:width], mask["bits"], adder, paired)
        return mask["mask"], word

    return program


@pytest.mark.parametrize("width", [2, 3, *slow(20, 63)])
@pytest.mark.parametrize(
    ("adder", "pairs"), [("carry-tree", True), ("carry-tree", False), ("brent-kung", False)]
)
def test_the_borrow_compares_the_low_bits(width, adder, pairs):
    c = words(4, 64 * 64)
    mask_shares, borrow_shares = on_shares(borrows(width, adder, pairs), 3)(4, c)
    r = np.asarray(sharing.join_sum(mask_shares))
    row = functools.reduce(operator.xor, np.asarray(borrow_shares))
    low = np.uint64(2**width - 1)
    bits = row[None, :] >> np.arange(64, dtype=np.uint64)[:, None] & np.uint64(1)
    np.testing.assert_array_equal(bits.ravel(), (c & low) < (r & low))
