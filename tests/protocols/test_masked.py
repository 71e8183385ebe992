import numpy as np
import pytest

from ciphernav_jax.protocols import masked

from ..parties.simulated import BY_PARTIES, EDGES, elements, on_secrets, uniformity, views, words
from ..slow import slow


def opened(dealer, x):
    return masked.open_masked(dealer, x).share()


@pytest.mark.parametrize("parties", [*BY_PARTIES, *slow(16)])
def test_a_value_open_under_a_mask_is_still_that_value(parties):
    x = np.concatenate([elements(EDGES), words(1, 91)])
    np.testing.assert_array_equal(on_secrets(opened, parties)(1, x), x)


def test_a_factor_multiplies_its_term():
    def program(dealer, x):
        form = masked.open_masked(dealer, x)
        (term,) = form.terms
        assert term.factor is None
        scaled = masked.Masked(form.public * 3, (masked.Term(form.public * 0 + 3, term.share, term.ref),))
        return scaled.share()

    x = words(2, 50)
    np.testing.assert_array_equal(on_secrets(program, 3)(2, x), 3 * x)


@pytest.mark.parametrize("secret", [0, -1, 2**62])
def test_what_is_opened_is_uniform(secret):
    (message,) = views(opened, 2)(3, np.full(8192, secret % 2**64, np.uint64))
    assert uniformity(message.opened) > 1e-6
