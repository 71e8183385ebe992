import functools

import numpy as np
import pytest
from scipy import stats

from ciphernav_jax.protocols import relu

from ..parties.simulated import BY_PARTIES, WHOLE_RING, elements, on_secrets, signed, words
from ..slow import slow


@functools.cache
def program(shift):
    def both(dealer, x):
        result = relu.relu(dealer, x, shift)
        return result.output, result.positive.share()

    return both


@pytest.mark.parametrize("parties", [*BY_PARTIES, *slow(16)])
def test_relu_without_a_shift_is_exact_over_the_ring(parties):
    x = np.concatenate([elements(WHOLE_RING), words(2, 300)])
    x = x[x != 2**63]
    output, positive = on_secrets(program(0), parties)(1, x)
    np.testing.assert_array_equal(signed(output), np.maximum(signed(x), 0))
    np.testing.assert_array_equal(positive, signed(x) > 0)


@pytest.mark.parametrize(
    ("parties", "shift"), [(3, 20), *slow((2, 1), (2, 20), (5, 20), (2, 40), (8, 16), (2, 62))]
)
def test_fused_truncation_errs_below_one_unit_and_the_bit_not_at_all(parties, shift):
    # Twice the range of a truncation: all of the ring but -2^63.
    powers = elements([sign * 2**k + d for k in range(63) for sign in (1, -1) for d in (-1, 0, 1)])
    x = np.concatenate([np.tile(powers, 3), elements(WHOLE_RING), words(1, 200)])
    x = x[x != 2**63]
    output, positive = map(np.asarray, on_secrets(program(shift), parties)(2, x))
    np.testing.assert_array_equal(positive, signed(x) > 0)
    assert not output[positive == 0].any()
    above = positive == 1
    up = signed(output[above]) - (signed(x[above]) >> shift)
    assert set(np.unique(up)) == {0, 1}
    assert not up[signed(x[above]) % 2**shift == 0].any()


def test_output_and_derivative_are_zero_at_zero_under_every_mask():
    output, positive = on_secrets(program(20), 3)(3, np.zeros(20_000, np.uint64))
    assert not np.any(output)
    assert not np.any(positive)


@pytest.mark.slow
@pytest.mark.parametrize("low", [1, 2**18, 2**19, 2**20 - 1])
def test_fused_truncation_is_unbiased(low):
    count = 20_000
    x = np.full(count, 5 * 2**20 + low, np.uint64)
    output, _ = on_secrets(program(20), 3)(4, x)
    ups = signed(output) - 5
    assert set(np.unique(ups)) <= {0, 1}
    assert stats.binomtest(int(ups.sum()), count, low / 2**20).pvalue > 1e-4
