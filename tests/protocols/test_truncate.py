import functools
import math
from typing import get_args

import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from ciphernav_jax.protocols import Protocol, ideal, suite, truncate
from experiments.failures import failures

from ..parties.simulated import BY_PARTIES, EDGES, elements, on_secrets, signed, words
from ..slow import slow

SHIFTS = [*range(1, 41), 61, 62]
FEW = [1, 20, 40, 62]


WIDTHS = [(bits, signed) for bits in (1, 8, 16, 32, 62) for signed in (False, True)]


def wrapped(dealer, x):
    return jnp.stack([truncate.wrapped(dealer, x, bits, signed=signed) for bits, signed in WIDTHS])


@pytest.mark.parametrize("parties", [2, *slow(3)])
def test_the_last_bits_are_exact_over_the_whole_ring(parties):
    x = words(3, 40)
    for (bits, has_sign), got in zip(WIDTHS, on_secrets(wrapped, parties)(1, x), strict=True):
        half = 2 ** (bits - 1) if has_sign else 0
        assert [int(v) for v in signed(got)] == [(int(v) + half) % 2**bits - half for v in x]


# Each variant as a program (dealer, share, shift) -> share.
VARIANTS = {
    "probabilistic": lambda dealer, x, shift: truncate.probabilistic(dealer, x, shift).share(),
    "nearest": lambda dealer, x, shift: truncate.nearest(dealer, x, shift).share(),
    "floor": lambda dealer, x, shift: truncate.floor(dealer, x, shift).share(),
    "wrap-count": truncate.wrap_count,
    "local": lambda dealer, x, shift: truncate.local(x, shift),
    "ideal": ideal.ideal_truncation,
}


def truncated(shifts, variant="probabilistic"):
    return _truncated(tuple(shifts), variant)


@functools.cache
def _truncated(shifts, variant):
    """A program that truncates a value by each of the shifts."""

    def program(dealer, x):
        return jnp.stack([VARIANTS[variant](dealer, x, shift) for shift in shifts])

    return program


def rounded_up(got, x, shift):
    """0 where the result is the floor of x / 2^shift, 1 where it is one more; anything else if it failed."""
    return signed(got) - (signed(x) >> shift)


def fair(ups, count, fraction):
    """Whether `ups` of `count` results rounded up agree with the probability `fraction`."""
    return stats.binomtest(int(ups), count, fraction).pvalue > 1e-5


@pytest.mark.parametrize(("parties", "shifts"), [(2, FEW), *slow((3, SHIFTS), (5, FEW), (8, FEW))])
def test_error_is_below_one_unit_at_every_edge_and_shift(parties, shifts):
    powers = [sign * 2**k + d for k in range(62) for sign in (1, -1) for d in (-1, 0, 1)]
    values = [v for v in [*EDGES, *powers] if -(2**62) <= v < 2**62]
    x = np.repeat(elements(values), 4)
    got = on_secrets(truncated(shifts), parties)(1, x)
    for shift, y in zip(shifts, got, strict=True):
        up = rounded_up(y, x, shift)
        assert set(np.unique(up)) <= {0, 1}
        # An error below one unit leaves multiples of 2^shift exact.
        assert not up[signed(x) % 2**shift == 0].any()


@pytest.mark.parametrize("parties", BY_PARTIES)
@pytest.mark.parametrize("base", [0, -(2**62), 2**62 - 2**20, -(5 * 2**20)])
def test_truncation_rounds_up_with_the_probability_that_makes_it_unbiased(parties, base):
    shift, count = 20, 1 << 14
    fractions = [0, 1, 2**10, 2**18, 2**19, 2**20 - 2**10, 2**20 - 1]
    x = np.repeat(elements([base + low for low in fractions])[:, None], count, axis=1)
    (got,) = on_secrets(truncated([shift]), parties)(2, x)
    ups = rounded_up(got, x, shift)
    assert set(np.unique(ups)) == {0, 1}
    for low, up in zip(fractions, ups, strict=True):
        assert fair(up.sum(), count, low / 2**shift)


@pytest.mark.parametrize("parties", BY_PARTIES)
def test_the_mean_of_all_fractions_of_a_small_shift_is_exact(parties):
    count = 1 << 13
    x = np.repeat(elements(range(-16, 16))[:, None], count, axis=1)
    (got,) = on_secrets(truncated([4]), parties)(3, x)
    error = signed(got).mean(axis=1) - np.arange(-16, 16) / 16
    fraction = np.arange(-16, 16) % 16 / 16
    deviation = np.sqrt(fraction * (1 - fraction) / count)
    assert np.all(
        np.abs(error) <= 5 * deviation
    )  # 32 values: by chance once in 50,000 keys, and the key is fixed


def test_a_truncation_that_rounds_down_or_to_nearest_would_be_noticed():
    x = np.full(1 << 14, 2**18 + 2**20, np.uint64)
    assert not fair(rounded_up(x >> np.uint64(20), x, 20).sum(), x.size, 0.25)
    nearest = np.round(x / 2**20).astype(np.uint64)
    assert not fair(rounded_up(nearest, x, 20).sum(), x.size, 0.25)
    # A bias of a hundredth of a unit shows.
    assert not fair(round(0.24 * (1 << 17)), 1 << 17, 0.25)


@pytest.mark.parametrize("parties", [*BY_PARTIES, *slow(8, 16)])
@pytest.mark.parametrize("variant", ["nearest", "floor"])
def test_exact_truncation_is_exact_at_every_edge(variant, parties):
    shifts = [*FEW, 21] if parties == 3 else [20]
    powers = [sign * 2**k + d for k in range(62) for sign in (1, -1) for d in (-1, 0, 1)]
    half = [2**19, -(2**19), 3 * 2**19, 2**19 - 1, 2**19 + 1, -(2**19) - 1, -3 * 2**19]
    values = [v for v in [*EDGES, *powers, *half] if -(2**62) <= v < 2**62]
    for shift, y in zip(
        shifts, on_secrets(truncated(shifts, variant), parties)(1, elements(values)), strict=True
    ):
        up = 2**shift // 2 if variant == "nearest" else 0
        # Half a unit more must still be in range.
        expected = [(v + up) >> shift if v + up < 2**62 else None for v in values]
        for got, wanted in zip(signed(y), expected, strict=True):
            assert wanted is None or got == wanted


@pytest.mark.parametrize(
    ("parties", "variant"),
    [(5, "wrap-count"), (3, "ideal"), *slow((2, "wrap-count"), (16, "wrap-count"))],
)
def test_other_truncations_err_within_their_bound_and_without_bias(parties, variant):
    shift, count = 20, 1 << 13
    bound, deviation = (parties, np.sqrt(parties / 3)) if variant == "wrap-count" else (1, 0.5)
    values = [0, 1, -1, 2**19, 5 * 2**20 + 2**18, -(7 * 2**20) - 2**18, 2**34]
    x = np.repeat(elements(values)[:, None], count, axis=1)
    (got,) = on_secrets(truncated([shift], variant), parties)(5, x)
    error = signed(got) - np.array(values)[:, None] / 2**shift
    assert np.all(np.abs(error) < bound)
    assert np.all(np.abs(error.mean(axis=1)) < 5 * deviation / np.sqrt(count))


# Variant, parties, fractional bits: the probability that a truncation of a product |v| = 30,000 fails.
FAILING = {
    ("local", 2, 16): 30_000 / 2**32,
    ("local", 2, 20): 30_000 / 2**24,
    ("wrap-count", 2, 16): 30_000 / 2**32,
    ("wrap-count", 5, 16): 30_000 / 2**32,
    ("wrap-count", 3, 20): 30_000 / 2**24,
    ("probabilistic", 2, 16): 0,
    ("probabilistic", 3, 20): 0,
    ("nearest", 2, 20): 0,
    ("floor", 2, 20): 0,
}


@pytest.mark.slow
@pytest.mark.parametrize(("variant", "parties", "frac_bits"), FAILING)
def test_of_ten_million_truncations_of_large_values_as_many_fail_as_stated(variant, parties, frac_bits):
    failed, total = failures(Protocol(truncation=variant, frac_bits=frac_bits), parties, seed=frac_bits)
    assert total >= 10**7
    probability = FAILING[variant, parties, frac_bits]
    if probability == 0:
        assert failed == 0
    else:
        assert stats.binomtest(failed, total, probability).pvalue > 1e-5


@pytest.mark.slow
def test_beyond_the_stated_range_results_are_wrong_and_the_test_for_failures_sees_it():
    x = np.full(1 << 12, 2**62 + 2**61, np.uint64)
    (got,) = on_secrets(truncated([20]), 2)(4, x)
    up = rounded_up(got, x, 20)
    assert np.any((up != 0) & (up != 1))


@pytest.mark.parametrize("shift", [1, 16, 20])
def test_local_truncation_errs_below_one_unit_without_bias_while_values_are_small(shift):
    count = 1 << 14
    lows = sorted({0, 1, 2**shift // 4, 2**shift // 2, 2**shift - 1})
    values = [base + low for base in (0, -(2**22), 2**40) for low in lows]
    x = np.repeat(elements(values)[:, None], count, axis=1)
    (got,) = on_secrets(truncated([shift], "local"), 2)(5, x)
    ups = rounded_up(got, x, shift)
    assert set(np.unique(ups)) == {0, 1}  # a failure has probability 2^-24 at most, in 245,760 results
    for value, up in zip(values, ups, strict=True):
        assert fair(up.sum(), count, value % 2**shift / 2**shift)


@pytest.mark.parametrize("shift", [1, 16, 20])
@pytest.mark.parametrize("value", [2**58, 2**60, -(2**60), 2**61, 3 * 2**59 + 12345, -(2**62)])
def test_local_truncation_fails_as_often_and_by_as_much_as_it_says(value, shift):
    count = 1 << 15
    x = np.full(count, value % 2**64, np.uint64)
    (got,) = on_secrets(truncated([shift], "local"), 2)(6, x)
    error = rounded_up(got, x, shift)
    failed = (error != 0) & (error != 1)
    assert fair(failed.sum(), count, abs(value) / 2**64)
    off = -math.copysign(1, value) * 2 ** (64 - shift)
    wrapped = np.uint64(int(off) % 2**64)  # with shift 1 the error itself is half the ring
    assert set(np.unique((error[failed].view(np.uint64) - wrapped).view(np.int64))) <= {0, 1}


@pytest.mark.parametrize("parties", [3, 5])
def test_local_truncation_is_for_two_parties_only(parties):
    with pytest.raises(ValueError, match="two parties"):
        on_secrets(truncated([16], "local"), parties)(7, np.zeros(1, np.uint64))


@pytest.mark.parametrize("shift", [-1, 63, 64])
def test_a_shift_that_the_offset_does_not_allow_raises(shift):
    with pytest.raises(ValueError, match="0 to 62"):
        on_secrets(truncated([shift]), 2)(9, np.zeros(1, np.uint64))


def test_shift_zero_changes_nothing():
    x = elements([*EDGES, 2**63, 2**64 - 1])

    def program(dealer, x):
        return truncate.probabilistic(dealer, x, 0).share(), truncate.local(x, 0)

    for got in on_secrets(program, 2)(8, x):
        np.testing.assert_array_equal(got, x)


def test_every_variant_is_described():
    """What other parts of the library, the tables and the tests read of it."""
    assert set(truncate.VARIANTS) == set(get_args(suite.Truncation))
    assert [name for name, variant in truncate.VARIANTS.items() if variant.fails] == ["wrap-count", "local"]
    assert [name for name, variant in truncate.VARIANTS.items() if variant.parties] == ["local"]
