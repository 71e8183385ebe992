"""Keys for purposes: what is derived, what is drawn, and what jax.random makes of a key never agree."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.extend.random import threefry_2x32

from ciphernav_jax import ring
from ciphernav_jax.ring import keys

KEY = jax.random.key(3)
LONG = jax.random.key(3, impl="rbg")
each_key = pytest.mark.parametrize("key", [KEY, LONG], ids=["64 bits", "128 bits"])


def pairs(data):
    """uint64: every 64 bits of key data, or of 32-bit words, in both orders of the halves."""
    low, high = np.asarray(data, np.uint32).reshape(-1, 2).astype(np.uint64).T
    return np.concatenate([low | high << np.uint64(32), high | low << np.uint64(32)])


def data(key):
    return np.asarray(jax.random.key_data(key))


PURPOSES = [
    *(("share", path) for path in ("", "[0]", "['a']", "0")),
    *(("party", i) for i in (0, 1, 2, 2**31, 2**32, 2**32 + 1, 2**60 - 1, -1, -(2**60))),
    ("party", "0"),
    ("party", 0, 0),
    (0, "party"),
    (0,),
    ("",),
    ("sharep", "arty"),
    ("share",),
    ("party",),
]


@each_key
def test_every_purpose_has_a_key_of_its_own_and_always_the_same(key):
    derived = [data(keys.derive(key, *purpose)) for purpose in PURPOSES]
    halves = np.concatenate([pairs(x)[: x.size // 2] for x in [*derived, data(key)]])
    # A long key made from a seed has two equal halves, and so have those derived from it.
    assert len(np.unique(halves)) == len(PURPOSES) + 1
    for purpose, expected in zip(PURPOSES, derived, strict=True):
        np.testing.assert_array_equal(data(keys.derive(key, *purpose)), expected)
        step_by_step = key
        for part in purpose:
            step_by_step = keys.derive(step_by_step, part)
        np.testing.assert_array_equal(data(step_by_step), expected)


def test_a_derived_key_is_a_number_encrypted_that_has_its_top_bits_set():
    number = (5 << 32) + 7
    counter = np.array([0xA0000005, 7], np.uint32)
    np.testing.assert_array_equal(data(keys.derive(KEY, number)), threefry_2x32(data(KEY), counter))


@each_key
def test_a_traced_integer_gives_the_key_of_its_value_and_an_array_a_key_for_each(key):
    numbers = np.array([0, 1, 2**31 + 5, 2**40 + 3])
    together = keys.derive(key, "step", numbers)
    assert together.shape == numbers.shape
    assert together.dtype == key.dtype
    jitted = jax.jit(lambda key, n: keys.derive(key, "step", n))
    for n, expected in zip(numbers, data(together), strict=True):
        np.testing.assert_array_equal(data(keys.derive(key, "step", int(n))), expected)
        np.testing.assert_array_equal(data(jitted(key, n)), expected)
        np.testing.assert_array_equal(data(jitted(key, jnp.uint64(n))), expected)
    mapped = jax.vmap(lambda n: keys.derive(key, "step", n))(numbers)
    np.testing.assert_array_equal(data(mapped), data(together))
    several = keys.derive(jnp.stack([key, keys.derive(key, "b")]), "step", numbers[:2])
    np.testing.assert_array_equal(data(several[0]), data(together[0]))
    np.testing.assert_array_equal(data(several[1]), data(keys.derive(key, "b", "step", 1)))


INTERESTING = [0, 1, 2, 3, 2**16, 2**31 - 1, 2**31, 2**31 + 1, 2**32 - 2, 2**32 - 1]
INTERESTING += [0x80000000, 0x90000000, 0xA0000000, 0xA0000001, 0xC0000000]


def by_jax(key):
    """All 64-bit values that jax.random makes of a key: keys, and neighbouring words of bits."""
    yield data(key)
    for n in INTERESTING:
        yield data(jax.random.fold_in(key, n))
    for shape in (1, 2, 3, 64, (4, 5)):
        yield data(jax.random.split(key, shape)).reshape(-1)
    for bits, count in itertools.product((32, 64), (1, 2, 3, 64, 1000)):
        drawn = np.asarray(jax.random.bits(key, (count,), dtype=f"uint{bits}")).view(np.uint32)
        yield drawn[: drawn.size // 2 * 2]
    yield np.asarray(jax.random.normal(key, (64,), np.float64)).view(np.uint32)


@pytest.mark.parametrize("partitionable", [True, False])
@pytest.mark.parametrize("key", [KEY, LONG, jax.random.wrap_key_data(jnp.uint32([0, 0]))], ids=str)
def test_no_call_of_jax_random_on_a_key_reaches_what_is_made_of_it_here(key, partitionable):
    with jax.threefry_partitionable(partitionable):
        theirs = np.concatenate([pairs(x) for x in by_jax(key)])
    derived = [data(keys.derive(key, *purpose)) for purpose in PURPOSES]
    drawn = [np.asarray(ring.draw(key, [(1000,)], generator)[0]) for generator in ("threefry", "chacha20")]
    ours = np.concatenate([*(pairs(x) for x in derived), *drawn])
    assert not np.isin(ours, theirs).any()
    assert not np.isin(np.concatenate(drawn), np.concatenate([pairs(x) for x in derived])).any()


def test_a_root_key_is_that_of_no_seed_of_jax():
    seeds = [0, 1, 2, -1, 10**24, -(10**24)]
    roots = np.concatenate([pairs(data(keys.root(seed)))[:1] for seed in seeds])
    assert len(np.unique(roots)) == len(seeds)
    assert not np.isin(roots, np.concatenate([pairs(data(jax.random.key(n))) for n in range(-3, 64)])).any()
    np.testing.assert_array_equal(data(keys.root(7)), data(keys.root(np.int64(7))))


def test_integers_of_any_type_are_the_same_purpose():
    for number in (np.uint32(7), jnp.uint32(7), jnp.int8(7), np.asarray(7)):
        np.testing.assert_array_equal(data(keys.derive(KEY, number)), data(keys.derive(KEY, 7)))


def test_what_is_no_purpose_raises():
    with pytest.raises(ValueError, match="needs a purpose"):
        keys.derive(KEY)
    for wrong in (2**60, -(2**60) - 1, np.uint64(2**63)):
        with pytest.raises(ValueError, match=r"2\^60"):
            keys.derive(KEY, wrong)
    for wrong in (1.5, True, None, b"share"):
        with pytest.raises(TypeError, match="names and integers"):
            keys.derive(KEY, wrong)  # pyright: ignore[reportArgumentType]
    np.testing.assert_array_equal(data(keys.derive(jax.random.key_data(KEY), 1)), data(keys.derive(KEY, 1)))
