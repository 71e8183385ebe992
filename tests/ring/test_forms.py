"""Forms are bilinear, exactly, and say how many products an entry adds up."""

import numpy as np
import pytest

from ciphernav_jax import ring

ROWS_BY_COLUMNS = (((1,), (0,)), ((), ()))
FORMS = [
    (ring.TIMES, (3, 4), (3, 4), 1),
    (ring.TIMES, (3, 1), (4,), 1),
    (ring.DotProduct(ROWS_BY_COLUMNS), (3, 20), (20, 4), 20),
    (ring.DotProduct((((0, 2), (2, 0)), ((1,), (1,)))), (5, 3, 2), (2, 3, 5), 10),
]


def words(seed, shape):
    return np.random.default_rng(seed).integers(2**64, size=shape, dtype=np.uint64)


@pytest.mark.parametrize(("form", "left", "right", "count"), FORMS)
def test_products_distribute_over_sums_of_either_factor(form, left, right, count):
    a, b, c, d = words(0, left), words(1, left), words(2, right), words(3, right)
    expected = form(a, c) + form(a, d) + form(b, c) + form(b, d)
    np.testing.assert_array_equal(form(a + b, c + d), expected)
    plus = words(4, expected.shape)
    np.testing.assert_array_equal(form(a, c, plus=plus), form(a, c) + plus)
    # As many products are added up in an entry as ones give.
    np.testing.assert_array_equal(form(np.ones_like(a), np.ones_like(c)), np.uint64(count))
    assert form.count(left) == count


def test_forms_are_values():
    assert ring.DotProduct(ROWS_BY_COLUMNS) == ring.DotProduct(ROWS_BY_COLUMNS)
    assert len({ring.TIMES, ring.DotProduct(ROWS_BY_COLUMNS), ring.DotProduct(ROWS_BY_COLUMNS)}) == 2
