import numpy as np
import pytest

from ciphernav_jax import ring
from ciphernav_jax.parties import sharing
from ciphernav_jax.parties.requests import SharedBits
from ciphernav_jax.protocols import convert, multiply, truncate
from ciphernav_jax.protocols.masked import open_masked

from ..parties.simulated import BY_PARTIES, MODULUS, WHOLE_RING, elements, on_secrets, on_shares, words
from ..slow import slow


def python_product(x, y):
    return elements(x.astype(object) * y.astype(object))


def product(dealer, x, y):
    return multiply.bilinear(dealer, open_masked(dealer, x), open_masked(dealer, y), ring.TIMES)


@pytest.mark.parametrize("parties", [*BY_PARTIES, *slow(8, 16)])
def test_products_are_exact_for_every_pair_of_edge_values(parties):
    edges = elements(WHOLE_RING)
    x, y = edges[:, None], edges[None, :]
    np.testing.assert_array_equal(on_secrets(product, parties)(1, x, y), python_product(x, y))


@pytest.mark.parametrize("parties", BY_PARTIES)
def test_random_products_are_exact(parties):
    x, y = words(1, 13, 13), words(2, 13, 13)
    np.testing.assert_array_equal(on_secrets(product, parties)(2, x, y), python_product(x, y))


@pytest.mark.parametrize(("left", "right"), [((), (3,)), ((2, 1, 3), (4, 1)), ((0, 2), (1, 2))])
def test_products_broadcast_as_numpy_does(left, right):
    x, y = words(3, *left), words(4, *right)
    got = on_secrets(product, 3)(3, x, y)
    assert got.shape == np.broadcast_shapes(left, right)
    np.testing.assert_array_equal(got, x * y)


def square(dealer, x):
    return multiply.square(dealer, open_masked(dealer, x))


@pytest.mark.parametrize("parties", [*BY_PARTIES, *slow(8)])
def test_squares_are_exact(parties):
    x = np.concatenate([elements(WHOLE_RING), words(5, 87)])
    np.testing.assert_array_equal(on_secrets(square, parties)(4, x), python_product(x, x))


def products_of_one_opening(dealer, x, y, z):
    a, b, c = (open_masked(dealer, v) for v in (x, y, z))
    return [multiply.bilinear(dealer, p, q, ring.TIMES) for p, q in ((a, b), (b, a), (a, c), (a, a))] + [
        multiply.bilinear(dealer, a, b, ring.DotProduct((((0,), (0,)), ((), ()))))
    ]


@pytest.mark.parametrize("parties", BY_PARTIES)
def test_values_opened_once_enter_several_products(parties):
    x, y, z = (words(seed, 40) for seed in (6, 7, 8))
    got = on_secrets(products_of_one_opening, parties)(5, x, y, z)
    for result, (p, q) in zip(got, ((x, y), (y, x), (x, z), (x, x)), strict=False):
        np.testing.assert_array_equal(result, python_product(p, q))
    assert int(got[4]) == sum(int(p) * int(q) for p, q in zip(x, y, strict=True)) % MODULUS


def products_of_several_terms(dealer, x, y):
    """A truncation has two terms, a bit one: products with four, two and one pairs of terms."""
    p, q = truncate.probabilistic(dealer, x, 5), truncate.probabilistic(dealer, y, 9)
    bit = convert.to_ring_bit(dealer, dealer.take(SharedBits(x.shape))["words"], x.shape)
    pairs = ((p, q), (bit, q), (p, bit), (bit, bit), (p, p))
    products = [multiply.bilinear(dealer, a, b, ring.TIMES) for a, b in pairs]
    return [form.share() for form in (p, q, bit)], products


@pytest.mark.parametrize("parties", BY_PARTIES)
def test_products_of_values_with_several_terms_are_exact(parties):
    rng = np.random.default_rng(9)
    x, y = (elements(rng.integers(-(2**62), 2**62, 64)) for _ in range(2))
    (p, q, bit), got = on_secrets(products_of_several_terms, parties)(6, x, y)
    p, q, bit = map(np.asarray, (p, q, bit))
    assert set(np.unique(bit)) == {0, 1}
    for result, (a, b) in zip(got, ((p, q), (bit, q), (p, bit), (bit, bit), (p, p)), strict=True):
        np.testing.assert_array_equal(result, python_product(a, b))


def dot(numbers):
    def program(dealer, x, y):
        form = ring.DotProduct(numbers)
        return multiply.bilinear(dealer, open_masked(dealer, x), open_masked(dealer, y), form)

    return program


MATRICES = dot((((1,), (0,)), ((), ())))
BATCHED = dot((((2,), (1,)), ((0,), (0,))))
CROSSED = dot((((0, 2), (2, 0)), ((1,), (1,))))


@pytest.mark.parametrize("parties", BY_PARTIES)
def test_matrix_products_are_exact_beyond_one_contraction_of_the_ring(parties):
    x, y = words(10, 3, 1400), words(11, 1400, 2)
    np.testing.assert_array_equal(on_secrets(MATRICES, parties)(7, x, y), x @ y)


@pytest.mark.parametrize("parties", BY_PARTIES)
def test_tensor_products_take_any_dimension_numbers(parties):
    x, y = words(12, 4, 2, 3), words(13, 4, 3, 5)
    np.testing.assert_array_equal(on_secrets(BATCHED, parties)(8, x, y), x @ y)
    x, y = words(14, 4, 2, 3), words(15, 3, 2, 4)
    np.testing.assert_array_equal(
        on_secrets(CROSSED, parties)(8, x, y),
        elements([(x[:, b].astype(object) * y[:, b].T.astype(object)).sum() for b in range(2)]),
    )


def conjunctions(dealer):
    """All parties' words come from the dealer, so that they are shared by exclusive or."""
    left = dealer.take(SharedBits((64 * 5,)))["words"]
    right = dealer.take(SharedBits((64 * 5,), rows=(3,)))["words"]
    return left, right, multiply.conjunction(dealer, left, right)


@pytest.mark.parametrize("parties", [*BY_PARTIES, *slow(8)])
def test_conjunction_of_one_word_with_several(parties):
    left, right, both = map(sharing.join_xor, on_shares(conjunctions, parties)(9))
    np.testing.assert_array_equal(both, np.asarray(left)[None] & np.asarray(right))
    assert np.unique(right).size == 15


def test_a_product_of_matrices_is_that_of_the_ring():
    x, y = words(16, 4, 6), words(17, 6, 5)
    np.testing.assert_array_equal(on_secrets(MATRICES, 2)(10, x, y), ring.matmul(x, y))
