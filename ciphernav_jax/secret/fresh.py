"""A key hides one thing: the ways to give it to two, and what is done about each.

Two values under the same mask show their difference to whoever sees both hidden; two runs on the same dealt
randomness show differences of what they compute on. So, of `share` and of functions made by `secure`:

- `vmap` over what is hidden and not over the key raises (`of_each_entry`);
- a loop whose key is the same in every iteration while what it hides changes raises (`of_each_iteration`),
  and so does `shard_map` or `pmap` with one key for all devices. It is seen where the body calls with a key
  that depends on constants of the body alone. A key that passes through the carry unchanged, or as an
  argument through another jitted function or to all devices, is not. Of a function with a derivative of its
  own nobody knows whether it is called in a loop: a key that it closes over raises under a trace;
- a key given a second time, to hide something else, warns (`of_each_call`). Seen are concrete keys and values
  outside of a trace, the last ones of a process; the same key within one trace; and equal keys of a batch
  that `share` is vmapped over.
"""

import sys
import threading
import warnings
import weakref
import zlib
from collections import OrderedDict
from functools import cache
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from ciphernav_jax import jax_private
from ciphernav_jax.jax_private import Tracer
from ciphernav_jax.ring import keys

REMEMBERED = 1 << 14
"""Keys that are remembered."""
LOOKED_AT = 1 << 14
"""Entries of an array whose places count; of the others the sum does."""


class KeyReuseWarning(UserWarning):
    """A random key was given twice, to hide two different things."""


def require_key(key: Any, what: str, argument: str = "the first argument") -> None:
    """Raises TypeError where this is no random key; arguments as for `of_each_entry`."""
    if isinstance(key, jax.Array) and (
        jnp.issubdtype(key.dtype, jax.dtypes.prng_key) or (key.dtype == jnp.uint32 and key.shape[-1:] == (2,))
    ):
        return
    whose = {"share": "its owner's", "reshare": "the parties'"}.get(what, "the dealer's")
    raise TypeError(
        f"{argument} of {_called(what)} is {whose} random key, jax.random.key(seed), and not a "
        f"{type(key).__name__}"
    )


# --- vmap ---------------------------------------------------------------------------------------------


def of_each_entry(key: Array, hidden: Any, what: str) -> Array:
    """The key; raises under a `vmap` that goes over what it hides and not over the key, and warns where keys
    that it goes over are equal, as far as they are known.

    Args:
        key: one random key.
        hidden: a pytree of arrays, all that the key's randomness hides or that decides what is hidden.
        what: "share" or "step", the caller.

    Raises:
        ValueError (under such a `vmap`, or where the key is an array of several).
    """
    if shape := keys.typed(key).shape:
        raise ValueError(f"one key is needed, not an array of {shape}: take one, or vmap over them")
    return _guard(what)(key, _arrays(hidden))


def _arrays(hidden: Any) -> list[Any]:
    """All arrays but the seals of secrets, which hide nothing and are not mapped along (`secret.seal`)."""
    return [x for x in jax.tree.leaves(hidden) if not isinstance(x, jax_private.Sealed)]


@cache
def _guard(what: str) -> Any:
    @jax.custom_batching.custom_vmap
    def key_of_each(key: Array, hidden: Any) -> Array:
        return key

    @key_of_each.def_vmap
    def _(_: int, in_batched: Any, key: Array, hidden: Any) -> tuple[Array, bool]:
        if not in_batched[0]:
            raise ValueError(
                f"vmap over {_called(what)} with one key for all entries would hide them all by the same "
                f"masks. Give each entry a key: jax.vmap({what})(jax.random.split(key, n), ...)."
            )
        if any(jax.tree.leaves(in_batched[1])) and not isinstance(key, Tracer):
            words = np.asarray(keys.words(keys.typed(key)))
            words = words.reshape(-1, words.shape[-1])
            if len(np.unique(words, axis=0)) < len(words):
                warnings.warn(_leak(what), KeyReuseWarning, stacklevel=_users_level())
        # Asked again for the vmaps around this one.
        return key_of_each(key, hidden), True

    return key_of_each


def _called(what: str) -> str:
    return "a secure function" if what == "step" else what


# --- loops --------------------------------------------------------------------------------------------

BODIES = {
    "scan": "each iteration of a loop",
    "fori_loop": "each iteration of a loop",
    "while_body": "each iteration of a loop",
    "while_cond": "each iteration of a loop",
    "shard_map": "each device of a shard_map or pmap",
    "custom_jvp fun": "each call of a function with a derivative of its own, which a loop may call",
    "custom_vjp fun": "each call of a function with a derivative of its own, which a loop may call",
}
"""What is traced once and carried out several times."""


def of_each_iteration(key: Array, hidden: Any, what: str) -> None:
    """Raises ValueError in a body that iterations, or devices, carry out with one key for different things.

    Arguments as for `of_each_entry`.
    """
    inside: list[Any] = []
    for trace in jax_private.traces():
        inside.append(trace)
        each = BODIES.get(jax_private.traced_for(trace) or "")
        if each is None or _varies(inside, key):
            continue
        if any(_varies(inside, x) for x in jax.tree.leaves(hidden)):
            raise ValueError(
                f"{_called(what)} has one key for {each}: it would hide what changes by the same masks. Give "
                "each a key: let a loop go over jax.random.split(key, n), or write ring.keys.derive(key, i), "
                "i being the iteration or the device; give a function its key as an argument."
            )


def _varies(inside: list[Any], x: Any) -> bool:
    """Whether x may differ from one iteration to the next. The last of the traces `inside` is the loop's
    body, the others are within it: what depends on none of their inputs is the same each time.
    """
    seen: set[int] = set()
    left = [x]
    while left:
        x = left.pop()
        if not isinstance(x, Tracer) or id(x) in seen:
            continue
        seen.add(id(x))
        if any(jax_private.trace_of(x) is trace for trace in inside):
            origins = jax_private.origins(x)
            if origins is None:
                return True
            left += origins
    return False


# --- calls --------------------------------------------------------------------------------------------

Uses = OrderedDict[tuple[str, bytes | int], tuple[int, weakref.ref[Tracer] | None]]
_hidden_by: Uses = OrderedDict()
_hidden_in: weakref.WeakKeyDictionary[Any, Uses] = weakref.WeakKeyDictionary()  # by trace
_lock = threading.Lock()


def of_each_call(key: Array, hidden: Any, what: str, *, where: str = "", how: Any = None) -> None:
    """Warns (`KeyReuseWarning`) where a key is given a second time and hides something else.

    The same call repeated with the same values leaks nothing, and is passed over. Arrays are compared by the
    sum of their words and a checksum of up to 16,384 of them; those on other devices than the CPU by
    identity.

    Args:
        key, hidden, what: as for `of_each_entry`.
        where: for which of its uses the key is, where it has several.
        how: hashable; what else decides what is hidden.
    """
    leaves = _arrays(hidden)
    traced = any(isinstance(x, Tracer) for x in (key, *leaves))
    with jax.ensure_compile_time_eval():
        name = id(key) if isinstance(key, Tracer) else np.asarray(keys.words(keys.typed(key))).tobytes()
        now = hash((how, *(id(x) if isinstance(x, Tracer) else _checksum(x) for x in leaves)))
    used = (what + where, name)
    with _lock:
        # Traced values are known by which they are, within their trace.
        trace = next(jax_private.traces())
        hidden_by = _hidden_in.setdefault(trace, OrderedDict()) if traced else _hidden_by
        before, of = hidden_by.get(used, (now, None))
        if of is not None and of() is not key:  # another traced key, which came into its place
            before = now
        hidden_by[used] = (before, weakref.ref(key) if isinstance(key, Tracer) else None)
        hidden_by.move_to_end(used)
        if len(hidden_by) > REMEMBERED:
            hidden_by.popitem(last=False)
    if before != now:
        warnings.warn(_leak(what), KeyReuseWarning, stacklevel=_users_level())


def forget() -> None:
    """Forgets all keys: what comes is another run."""
    with _lock:
        _hidden_by.clear()
        _hidden_in.clear()


def _leak(what: str) -> str:
    seen = {
        "share": "whoever holds shares of both sees the difference of the values",
        "step": "what is opened in both calls shows differences of the secrets",
        "fit": "what is opened in both trainings shows differences of the secrets",
    }
    return (
        f"the same key is given to {_called(what)} a second time, with something else to hide: {seen[what]}. "
        "Give each call a key of its own: jax.random.split(key, n), or ring.keys.derive(key, purpose)."
    )


def _checksum(x: Any) -> tuple[Any, ...]:
    if isinstance(x, Array):
        if any(device.platform != "cpu" for device in x.devices()) or not x.is_fully_addressable:
            return (id(x),)
        if jnp.issubdtype(x.dtype, jax.dtypes.prng_key):
            x = jax.random.key_data(x)
    flat = np.ascontiguousarray(x).reshape(-1)
    some = np.ascontiguousarray(flat[:: -(-flat.size // LOOKED_AT) or 1])
    words = flat.view(np.uint8)
    whole = len(words) // 8 * 8
    total = int(np.sum(words[:whole].view(np.uint64), dtype=np.uint64)), int(np.sum(words[whole:]))
    return np.shape(x), str(flat.dtype), zlib.crc32(some.tobytes()), total


def _users_level() -> int:
    """How many calls up the first frame outside of this package and of JAX is."""
    ours = tuple(str(Path(module.__file__ or "").parent) for module in (sys.modules["ciphernav_jax"], jax))
    level, frame = 1, sys._getframe(1)
    while frame.f_back is not None and frame.f_code.co_filename.startswith(ours):
        level, frame = level + 1, frame.f_back
    return level
