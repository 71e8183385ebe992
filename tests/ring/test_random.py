import math

import jax
import numpy as np
import pytest
from scipy import stats

from ciphernav_jax import ring
from ciphernav_jax.ring.random import PIECE

draw = jax.jit(ring.draw, static_argnums=1)
MANY = 2 * PIECE + 12_345  # three pieces, the last not used up


def words(seed, count):
    return np.asarray(draw(jax.random.key(seed), ((count,),))[0])


def p_value(samples, bins):
    return stats.chisquare(np.bincount(samples, minlength=bins)).pvalue


def test_same_key_and_shapes_give_the_same_words_jitted_or_not():
    shapes = ((3, 5), (7,), ())
    first = draw(jax.random.key(1), shapes)
    for again in (draw(jax.random.key(1), shapes), ring.draw(jax.random.key(1), shapes)):
        for a, b in zip(first, again, strict=True):
            np.testing.assert_array_equal(a, b)


def test_different_keys_give_different_words():
    streams = [words(seed, 1000) for seed in range(8)]
    streams += [np.asarray(draw(key, ((1000,),))[0]) for key in jax.random.split(jax.random.key(0), 8)]
    assert len(np.unique(np.concatenate(streams))) == 16 * 1000


def test_raw_and_typed_keys_agree():
    key = jax.random.key(5)
    np.testing.assert_array_equal(draw(key, ((9,),))[0], draw(jax.random.key_data(key), ((9,),))[0])


@pytest.mark.parametrize(
    "sizes", [(0,), (1,), (2,), (3,), (0, 5, 0), (PIECE, 1), (2 * PIECE,), (2 * PIECE + 1,)]
)
def test_any_number_of_words_comes_in_the_shapes_asked_for(sizes):
    arrays = draw(jax.random.key(6), tuple((size,) for size in sizes))
    assert [array.shape for array in arrays] == [(size,) for size in sizes]
    together = np.concatenate(arrays)
    assert together.dtype == np.uint64
    assert len(np.unique(together)) == sum(sizes)


def test_arrays_are_cut_one_after_the_other_from_one_stream():
    shapes = ((2, 3), (), (4,), (5, 1, 2))
    arrays = draw(jax.random.key(7), shapes)
    assert [array.shape for array in arrays] == list(shapes)
    whole = words(7, sum(math.prod(shape) for shape in shapes))
    np.testing.assert_array_equal(np.concatenate([np.ravel(array) for array in arrays]), whole)


def test_no_word_repeats_within_a_stream_of_several_pieces_or_between_streams():
    # 550,000 words of 64 bits: two agree by chance with probability 1e-8.
    streams = np.concatenate([words(8, MANY), words(9, MANY)])
    assert len(np.unique(streams)) == 2 * MANY


def test_words_of_a_key_are_not_the_keys_that_jax_derives_from_it():
    key = jax.random.key(10)
    derived = [*jax.random.split(key, 64), *(jax.random.fold_in(key, i) for i in range(64))]
    halves = np.stack([jax.random.key_data(k) for k in derived]).astype(np.uint64)
    stream = words(10, 1000)
    for low, high in ((0, 1), (1, 0)):
        assert not np.isin(halves[:, low] | halves[:, high] << np.uint64(32), stream).any()


def test_every_bit_is_fair():
    stream = words(11, MANY)
    ones = np.array([int(np.sum(stream >> np.uint64(j) & np.uint64(1))) for j in range(64)])
    z = (ones - MANY / 2) / math.sqrt(MANY / 4)
    assert np.max(np.abs(z)) < 5  # 64 bits: by chance once in 27,000 keys, and the key is fixed


def test_bytes_and_neighbouring_bytes_are_uniform():
    stream = words(12, MANY).view(np.uint8).reshape(-1, 8)
    for position in range(8):
        assert p_value(stream[:, position], 256) > 1e-5
        following = stream[1:, position].astype(np.int64) - stream[:-1, position]
        assert p_value(following % 256, 256) > 1e-5
    pairs = stream[:, 0].astype(np.int64) * 256 + stream[:, 4]  # both halves of the generator's block
    assert p_value(pairs, 65536) > 1e-5
