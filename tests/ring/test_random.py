import math
import re
from typing import get_args

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.extend.random import threefry_2x32
from scipy import stats

from ciphernav_jax import ring
from ciphernav_jax.ring import chacha
from ciphernav_jax.ring.random import MAX_WORDS, Generator

draw = jax.jit(ring.draw, static_argnums=(1, 2))
MANY = 274_489
GENERATORS = get_args(Generator)
each_generator = pytest.mark.parametrize("generator", GENERATORS)


def words(seed, count, generator="threefry"):
    return np.asarray(draw(jax.random.key(seed), ((count,),), generator)[0])


def p_value(samples, bins):
    return stats.chisquare(np.bincount(samples, minlength=bins)).pvalue


@each_generator
def test_same_key_and_shapes_give_the_same_words_jitted_or_not(generator):
    shapes = ((3, 5), (7,), ())
    first = draw(jax.random.key(1), shapes, generator)
    again_eager = ring.draw(jax.random.key(1), shapes, generator)
    for again in (draw(jax.random.key(1), shapes, generator), again_eager):
        for a, b in zip(first, again, strict=True):
            np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("implementation", ["threefry2x32", "rbg", "unsafe_rbg"])
def test_keys_and_generators_that_differ_give_different_words(implementation):
    keys = [jax.random.key(seed, impl=implementation) for seed in range(8)]
    keys += list(jax.random.split(keys[0], 8))
    data = np.stack([jax.random.key_data(key) for key in keys])
    for bit in range(0, data.shape[1] * 32, 7):  # keys that differ in one bit, in whichever word
        changed = data[0].copy()
        changed[bit // 32] ^= np.uint32(1 << bit % 32)
        keys.append(jax.random.wrap_key_data(changed, impl=implementation))
    streams = [draw(key, ((1000,),), generator)[0] for key in keys for generator in GENERATORS]
    assert len(np.unique(np.concatenate(streams))) == len(streams) * 1000


def test_threefry_words_are_those_of_jaxs_own_cipher():
    key = jax.random.key(21)
    counters = np.concatenate([np.full(MANY, 1 << 31, np.uint32), np.arange(MANY, dtype=np.uint32)])
    (expected,) = joined(threefry_2x32(jax.random.key_data(key), counters).reshape(2, MANY))
    np.testing.assert_array_equal(draw(key, ((MANY,),))[0], expected)


@pytest.mark.parametrize("implementation", ["threefry2x32", "rbg"])
def test_chacha20_words_are_the_key_stream_of_the_padded_key(implementation):
    key = jax.random.key(22, impl=implementation)
    data = [*jax.random.key_data(key)]
    padded = data + [jnp.uint32(0)] * (8 - len(data))
    expected = {
        int(w)
        for n in (0, 1, 124)
        for w in joined(chacha.block(padded, [jnp.uint32(n), *[jnp.uint32(0)] * 3]))
    }
    got = {int(w) for w in draw(key, ((1000,),), "chacha20")[0]}
    assert len(expected) == 24
    assert expected <= got


def joined(halves):
    """uint64: pairs of rows, the low half first."""
    halves = np.array(halves).astype(np.uint64)
    return halves[0::2] | halves[1::2] << np.uint64(32)


@each_generator
def test_under_vmap_each_key_has_the_words_it_has_alone(generator):
    keys = jax.random.split(jax.random.key(23), 3)
    together = jax.jit(jax.vmap(lambda key: ring.draw(key, [(50,), (2, 3)], generator)))(keys)
    for i, key in enumerate(keys):
        for a, b in zip(together, draw(key, ((50,), (2, 3)), generator), strict=True):
            np.testing.assert_array_equal(a[i], b)


@each_generator
def test_the_generator_is_compiled_once_however_many_uses_there_are(generator):
    n = 81_920

    def program(key):
        a, b, c = ring.draw(key, [(n,)] * 3, generator)
        return a + b, (a ^ (b - c)) >> 3, jnp.sum(a * c), c

    compiled = jax.jit(program).lower(jax.random.key(0)).compile().as_text() or ""
    lanes, passes = (3 * n, 1) if generator == "threefry" else (3 * n // 8, 8)
    rounds = 20 if generator == "threefry" else 80 * 4
    assert passes <= len(re.findall(rf"u32\[{lanes}\]\S* xor\(", compiled)) <= passes * rounds
    # With the generator fused into its uses, they, too, would hold its exclusive ors.
    assert not re.findall(rf"u32\[{n}\]\S* xor\(", compiled)


def test_what_draw_cannot_give_raises():
    key = jax.random.key(24)
    with pytest.raises(ValueError, match="threefry, chacha20"):
        ring.draw(key, [(2,)], "aes")  # pyright: ignore[reportArgumentType]
    with pytest.raises(ValueError, match=r"vmap"):
        ring.draw(jax.random.split(key), [(2,)])
    with pytest.raises(ValueError, match=r"2\^32"):
        jax.eval_shape(lambda key: ring.draw(key, [(MAX_WORDS,), (1,)]), key)


def test_raw_and_typed_keys_agree():
    key = jax.random.key(5)
    np.testing.assert_array_equal(draw(key, ((9,),))[0], draw(jax.random.key_data(key), ((9,),))[0])


@each_generator
@pytest.mark.parametrize("sizes", [(), (0,), (1,), (2,), (3,), (0, 5, 0), (7, 1), (8,), (9,), (1 << 17, 1)])
def test_any_number_of_words_comes_in_the_shapes_asked_for(sizes, generator):
    arrays = draw(jax.random.key(6), tuple((size,) for size in sizes), generator)
    assert [array.shape for array in arrays] == [(size,) for size in sizes]
    together = np.concatenate([np.zeros(0, np.uint64), *arrays])
    assert all(array.dtype == np.uint64 for array in arrays)
    assert len(np.unique(together)) == sum(sizes)


@each_generator
def test_arrays_are_cut_one_after_the_other_from_one_stream(generator):
    shapes = ((2, 3), (), (4,), (5, 1, 2))
    arrays = draw(jax.random.key(7), shapes, generator)
    assert [array.shape for array in arrays] == list(shapes)
    whole = words(7, sum(math.prod(shape) for shape in shapes), generator)
    np.testing.assert_array_equal(np.concatenate([np.ravel(array) for array in arrays]), whole)


@each_generator
def test_no_word_repeats_within_a_long_stream_or_between_streams(generator):
    # 550,000 words of 64 bits: two agree by chance with probability 1e-8.
    streams = np.concatenate([words(8, MANY, generator), words(9, MANY, generator)])
    assert len(np.unique(streams)) == 2 * MANY


def test_words_of_a_key_are_not_the_keys_that_jax_derives_from_it():
    key = jax.random.key(10)
    derived = [*jax.random.split(key, 64), *(jax.random.fold_in(key, i) for i in range(64))]
    halves = np.stack([jax.random.key_data(k) for k in derived]).astype(np.uint64)
    stream = words(10, 1000)
    for low, high in ((0, 1), (1, 0)):
        assert not np.isin(halves[:, low] | halves[:, high] << np.uint64(32), stream).any()


@each_generator
def test_every_bit_is_fair(generator):
    stream = words(11, MANY, generator)
    ones = np.array([int(np.sum(stream >> np.uint64(j) & np.uint64(1))) for j in range(64)])
    z = (ones - MANY / 2) / math.sqrt(MANY / 4)
    assert np.max(np.abs(z)) < 5  # 64 bits: by chance once in 27,000 keys, and the key is fixed


@each_generator
def test_bytes_and_neighbouring_bytes_are_uniform(generator):
    stream = words(12, MANY, generator).view(np.uint8).reshape(-1, 8)
    for position in range(8):
        assert p_value(stream[:, position], 256) > 1e-5
        following = stream[1:, position].astype(np.int64) - stream[:-1, position]
        assert p_value(following % 256, 256) > 1e-5
    pairs = stream[:, 0].astype(np.int64) * 256 + stream[:, 4]  # both halves of the generator's block
    assert p_value(pairs, 65536) > 1e-5
