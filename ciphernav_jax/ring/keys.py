"""Random keys, each for one purpose: a mask that hides two values shows their difference.

A run has one root key, and each use of randomness in it a key of its own, derived from the root by saying
what it is for:

>>> from ciphernav_jax.ring import keys
>>> root = keys.root(7)
>>> driving = keys.derive(root, "driving", "test set", 3)

A key is a key of the Threefry cipher, and whatever is made of it encrypts some number under it: derived keys,
drawn words (`ring.draw`), and the keys and bits of `jax.random`. Each kind has numbers of its own, told apart
by their highest bits, so that no two uses of one key agree. `jax.random` counts from 0; all numbers here have
the top bit set, which it would reach after 2^63 entries.
"""

import hashlib
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from ciphernav_jax.jax_private import Tracer
from ciphernav_jax.ring import threefry
from ciphernav_jax.ring.fixed_point import require_x64

# The highest bits of the counter's first word.
STREAM = np.uint32(0b1000 << 28)
LONG_KEY = np.uint32(0b1001 << 28)
NUMBER = np.uint32(0b101 << 29)
NAME = np.uint32(0b11 << 30)

NUMBER_BITS = 61
SHORT, LONG = 2, 4  # words of a key


def root(seed: int) -> Array:
    """The key of a whole run, from which all others are derived.

    No `jax.random.key(seed)` gives it, so that whatever draws on that (public weights, say) has other words.

    Args:
        seed: any integer. It is no secret worth the name: a deployment's keys come from its operating system.
    """
    digest = hashlib.sha256(f"ciphernav_jax root key {int(seed)}".encode()).digest()
    data = jnp.asarray(np.frombuffer(digest, "<u4", SHORT).astype(np.uint32))
    return jax.random.wrap_key_data(data, impl="threefry2x32")


def derive(key: Array, *purpose: str | int | Array | np.ndarray) -> Array:
    """The key for a purpose: the same key and purpose give the same, any other an independent one.

    In steps too: `derive(key, a, b)` is `derive(derive(key, a), b)`.

    Args:
        key: a JAX random key, of 64 or 128 bits, or an array of them.
        purpose: names, and integers in [-2^60, 2^60): a step, an entry, also as (traced) integer arrays. An
            array of integers gives an array of keys, one for each.

    Returns:
        A key of the same kind, or an array of them.

    Raises:
        ValueError: no purpose; an integer out of that range (where it is concrete); a key of another length.
        TypeError: a purpose that is neither name nor integer.
    """
    require_x64()
    if not purpose:
        raise ValueError('a derived key needs a purpose: derive(key, "share", 3)')
    key = typed(key)
    data = words(key)
    for part in purpose:
        data = _encrypted(data, *_counter(part))
    return jax.random.wrap_key_data(data, impl=jax.random.key_impl(key))


def typed(key: Array) -> Array:
    """The key as JAX's type for keys; an array of uint32 is read as data of the default kind."""
    return key if jnp.issubdtype(key.dtype, jax.dtypes.prng_key) else jax.random.wrap_key_data(key)


def words(key: Array) -> Array:
    """uint32[..., 2 or 4]: a key's data.

    Raises:
        ValueError: a key of another length.
    """
    data = jax.random.key_data(key).astype(jnp.uint32)
    if data.shape[-1] not in (SHORT, LONG):
        raise ValueError(f"keys have 64 or 128 bits, got one of {32 * data.shape[-1]} bits ({key.dtype})")
    return data


def cipher_key(data: Array) -> tuple[Array, Array]:
    """The two words of a Threefry key, from a key's data, uint32[2 or 4]: the longer one is hashed."""
    first, second = data[0], data[1]
    for word in data[SHORT:]:
        first, second = _block((first, second), (LONG_KEY, word))
    return first, second


def _counter(part: Any) -> tuple[Any, Any]:
    """What a part of a purpose encrypts: two words, uint32."""
    if isinstance(part, str):
        high, low = np.frombuffer(hashlib.sha256(part.encode()).digest(), "<u4", 2).astype(np.uint32)
        return NAME | high >> np.uint32(2), low
    whole = isinstance(part, int) and not isinstance(part, bool)
    if not whole and not jnp.issubdtype(getattr(part, "dtype", np.bool_), np.integer):
        raise TypeError(f"a key's purpose is made of names and integers, got {part!r}")
    bound = 1 << NUMBER_BITS - 1
    # As numpy: in JAX, -2^60 would be of the array's own type, and wrap around in a narrow one.
    known = None if isinstance(part, Tracer) else np.asarray(part)
    if known is not None and not np.all((-bound <= known) & (known < bound)):
        raise ValueError(f"integers in a key's purpose lie in [-2^60, 2^60), got {part}")
    number = jnp.asarray(part).astype(jnp.uint64)
    high, low = (number >> 32).astype(jnp.uint32), number.astype(jnp.uint32)
    return NUMBER | high & np.uint32((1 << NUMBER_BITS - 32) - 1), low


@jax.jit
def _encrypted(data: Array, high: Array, low: Array) -> Array:
    """uint32[..., words]: the counters under each 64 bits of the keys, broadcast."""
    halves = data.reshape(*data.shape[:-1], -1, 2)
    made = _block((halves[..., 0], halves[..., 1]), (high[..., None], low[..., None]))
    made = jnp.stack(made, axis=-1)
    return made.reshape(*made.shape[:-2], data.shape[-1])


# Compiled, so that it is traced once.
_block = jax.jit(threefry.block)
