"""`Secret`: a real array that exists as shares alone."""

import warnings
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import UInt64

from ciphernav_jax import ring
from ciphernav_jax.jax_private import Tracer
from ciphernav_jax.parties import sharing
from ciphernav_jax.protocols import Protocol
from ciphernav_jax.protocols.suite import chosen
from ciphernav_jax.ring import keys
from ciphernav_jax.secret import fresh, inside
from ciphernav_jax.secret.seal import INSTEAD, LOST, is_array, require_moved_along, seal

INTEGER_BOUND = 2**62
"""Shared integers lie below it in magnitude: then the difference of two has the right sign."""


@jax.tree_util.register_pytree_with_keys_class
@dataclass(frozen=True, eq=False)
class Secret:
    """A secret-shared array; a pytree, so it passes through jit, scan carries and checkpoints.

    Invariants:
    - `shares` is uint64[P, *shape]: additive shares modulo 2^64, the party as leading axis.
    - Each party's row alone, and any P - 1 rows together, are uniform whatever the value.
    - The value is the signed sum of the rows divided by 2^frac_bits.
    - `dtype` is what `reveal` returns: a float type, or bool or an integer type with frac_bits 0.
    - `rank` is the number of the value's axes. `vmap` and the outputs of `lax.scan` stack further axes in
      front of the party axis; `party_first` makes them axes of the value.
    - `parties` is P; left out, it is taken from the shares.

    Indexing works on the value's axes: `x[0]`, `x[2:5]`, `x[indices]`. Operators, comparisons, `bool`,
    `float` and `hash` raise TypeError: they belong into `secure(f)`.

    `jax.tree.map` goes over the shares, and over a seal that moves along (`secret.seal`). It may copy them,
    keep them in files, stack them in front, fill them with zeros, select among them, and index the axes
    behind the party axis. What else moves the party axis raises ValueError, and arithmetic and sorting
    TypeError. Not seen are `jnp.ones_like` and `full_like`, which fill the shares and not the value, and a
    collective over a vmapped axis, `lax.pmax`. Where a library's checkpoints do not take the seal's dtype,
    keep `x.shares`.

    Example:
        >>> import jax, numpy as np
        >>> import ciphernav_jax as cn
        >>> x = cn.share(jax.random.key(0), np.array([1.5, -2.0]), parties=3)
        >>> x, x[0].shape, x.shares.shape
        (Secret(float64[2], parties=3, frac_bits=20), (), (3, 2))
    """

    shares: UInt64[Array, "p ..."]
    frac_bits: int
    dtype: np.dtype
    rank: int
    parties: int = 0

    def __post_init__(self):
        # JAX also rebuilds trees from placeholders and from the zero derivatives of integers.
        allowed = (np.uint64, jax.dtypes.float0)
        if is_array(self.shares) and self.shares.dtype not in allowed:
            raise TypeError(
                f"a Secret got {self.shares.dtype} in place of its shares, which are uint64: jax.tree.map, "
                f"or something like it, computed on the shares of a Secret and not on its value. {INSTEAD}"
            )
        if not self.parties and is_array(self.shares) and self.stacked >= 0:
            object.__setattr__(self, "parties", self.shares.shape[self.stacked])

    def tree_flatten_with_keys(self) -> tuple[Any, Any]:
        name = jax.tree_util.GetAttrKey
        children = ((name("shares"), self.shares), (name("seal"), seal(self.shares, self.rank)))
        return children, (self.frac_bits, self.dtype, self.rank, self.parties)

    @classmethod
    def tree_unflatten(cls, aux: Any, children: Any) -> "Secret":
        shares, found = children
        secret = cls(shares, *aux)
        require_moved_along(shares, found, secret.rank, secret.parties)
        return secret

    @property
    def stacked(self) -> int:
        """How many axes stand in front of the party axis."""
        return len(self.shares.shape) - 1 - self.rank if is_array(self.shares) else 0

    def party_first(self) -> "Secret":
        """The same secret with the party as leading axis.

        Raises:
            ValueError: the party axis is gone: a loop went over a `Secret` as if over its entries.
        """
        stacked = self.stacked
        if stacked < 0:
            raise ValueError(LOST)
        shares = jnp.moveaxis(self.shares, stacked, 0) if stacked else self.shares
        return replace(self, shares=shares, rank=self.rank + stacked)

    @property
    def shape(self) -> tuple[int, ...]:
        """The shape of the value, without the party axis."""
        return self.party_first().shares.shape[1:]

    @property
    def ndim(self) -> int:
        return len(self.shape)

    @property
    def size(self) -> int:
        return int(np.prod(self.shape))

    def __len__(self) -> int:
        if not self.shape:
            raise TypeError("len() of a secret scalar")
        return self.shape[0]

    def __getitem__(self, index: Any) -> "Secret":
        index = index if isinstance(index, tuple) else (index,)
        shares = self.party_first().shares[(slice(None), *index)]
        return replace(self, shares=shares, rank=shares.ndim - 1)

    def __iter__(self):
        return (self[i] for i in range(len(self)))

    def __repr__(self) -> str:
        # Shares are noise to a reader, and a value must not slip into a log.
        if not is_array(self.shares):
            return f"Secret({self.shares!r})"  # a tree of something else: axes, shapes, shardings
        return (
            f"Secret({self.dtype.name}{list(self.shape)}, parties={self.parties}, frac_bits={self.frac_bits})"
        )

    def __array__(self, *_, **__):
        raise _refused(
            "a Secret has no public value", "Compute on it inside secure(f), or open it: reveal(x)."
        )

    @property
    def __jax_array__(self):
        # JAX asks whether there is one, and says of its own that it may not be called.
        self.__array__()

    def __format__(self, specification: str) -> str:
        if specification:
            raise _refused(
                "a Secret holds shares, which have no digits to show",
                "Open it where that is agreed: reveal(x).",
            )
        return repr(self)

    def __setitem__(self, *_: Any) -> None:
        raise _refused(
            "a Secret does not change in place",
            "Make another inside a secure function: secure(lambda x, y: x.at[i].set(y))(key, x, y).",
        )

    def __getattr__(self, name: str) -> Any:
        if name in ("item", "tolist"):
            raise AttributeError(
                f"a Secret holds shares and has no `{name}`. Open it where that is agreed: reveal(x).{name}()"
            )
        if not name.startswith("_") and hasattr(jax.Array, name):
            raise AttributeError(
                f"a Secret holds shares and has no `{name}`. Compute on its value inside a secure function: "
                f"secure(lambda x: x.{name}...)(key, x)"
            )
        raise AttributeError(f"a Secret has no attribute {name!r}")

    __array_ufunc__ = __array__


def _refused(what: str, instead: str) -> TypeError:
    """What is raised where a `Secret` is used as an array: what was wrong, and the way out."""
    return TypeError(f"{what}. {inside.CLOSED_OVER if inside.is_traced() else instead}")


def _refuse(names: str, what: str, instead: str) -> None:
    """Gives `Secret` methods that raise TypeError."""

    def refused(self: Secret, *_: Any) -> Any:
        raise _refused(f"a Secret holds shares, which do not tell {what}", instead)

    for name in names.split():
        setattr(Secret, f"__{name}__", refused)


for _symbol, _names in {
    "+": "add radd",
    "-": "sub rsub",
    "*": "mul rmul",
    "/": "truediv rtruediv",
    "//": "floordiv rfloordiv",
    "%": "mod rmod",
    "**": "pow rpow",
    "divmod": "divmod rdivmod",
    "@": "matmul rmatmul",
    "&": "and rand",
    "|": "or ror",
    "^": "xor rxor",
    "<<": "lshift rlshift",
    ">>": "rshift rrshift",
    "==": "eq",
    "!=": "ne",
    "<": "lt",
    "<=": "le",
    ">": "gt",
    ">=": "ge",
}.items():
    _refuse(
        _names,
        f"x {_symbol} y",
        f"Compute it inside a secure function: secure(lambda x, y: x {_symbol} y)(key, x, y).",
    )
for _function, _name in {
    "-x": "neg",
    "+x": "pos",
    "~x": "invert",
    "abs(x)": "abs",
    "round(x)": "round",
}.items():
    _refuse(_name, _function, "Compute it inside a secure function: secure(f)(key, x).")
for _function in ("bool", "int", "float", "complex", "index"):
    _refuse(
        _function,
        f"{_function}(x)",
        "Select with jnp.where inside a secure function, or open x where that is agreed: "
        f"{_function}(reveal(x)).",
    )
_refuse("hash", "hash(x)", "Use id(x), or a key of your own.")
_refuse(
    "contains", "y in x", "Compare inside a secure function: secure(lambda x, y: jnp.any(x == y))(key, x, y)."
)


def is_secret(x: Any) -> bool:
    """Whether it is a `Secret`: the `is_leaf` with which a tree of them is taken as one of values."""
    return isinstance(x, Secret)


def share(
    key: Array, values: Any, *, parties: int, protocol: Protocol | None = None, floats_only: bool = False
) -> Any:
    """Splits real arrays into fresh additive shares.

    Args:
        key: random key of the party that shares; each call needs a key of its own (`secret.fresh`). Each
            array is shared under a key derived from it by its path in the pytree; a step derives others.
        values: pytree of float arrays (float32 or float64), bools or integers. Floats lie below
            `protocol.bound` (2^(62 - 2 frac_bits); 4,194,304 by default) in magnitude, integers below 2^62.
        parties: P >= 2.
        protocol: gives the fractional bits of floats (bools and integers have none), and the generator.
        floats_only: leave integers and bools as they are, public: the count of steps in an optimizer's state.

    Returns:
        The same pytree with a `Secret` for each array. Under `jit` an entry that is out of range or not
        finite is *poisoned*, and warned of when it runs. It stands for no number, and `reveal` says so;
        poison survives being moved; a sum of several may lose it, products and comparisons do.

    Raises:
        ValueError: fewer than two parties; a value out of range or not finite (where it is concrete); a
            `vmap` or a loop over values with one key for all.
        TypeError: no key; None, or an array of another dtype; inside a function on secrets; or the call is
            being differentiated.

    Warns:
        KeyReuseWarning: a key shares a second time, and other values.
        RuntimeWarning: under `jit`, a value that cannot be shared.

    Example:
        >>> import jax, numpy as np
        >>> import ciphernav_jax as cn
        >>> cn.share(jax.random.key(0), {"w": np.ones((2, 3)), "b": np.array([True])}, parties=2)
        {'b': Secret(bool[1], parties=2, frac_bits=0), 'w': Secret(float64[2, 3], parties=2, frac_bits=20)}
    """
    inside.require_outside("share", "A plain array meets them as it is, and counts as public.")
    protocol = chosen(protocol)
    sharing.require_parties(parties)
    fresh.require_key(key, "share")
    if values is None:
        raise TypeError("there is nothing to share: the values are None")
    hidden = jax.tree.map(_floats, values, is_leaf=is_secret) if floats_only else values
    fresh.of_each_iteration(key, hidden, "share")
    shared = share_all(key, hidden, parties, protocol)
    for path, leaf in jax.tree_util.tree_leaves_with_path(hidden):
        fresh.of_each_call(key, leaf, "share", where=jax.tree_util.keystr(path), how=protocol.frac_bits)
    return jax.tree.map(lambda x, made: x if made is None else made, values, shared)


def _floats(leaf: Any) -> Any:
    """None in place of integers, bools and random keys, which a pytree passes over."""
    if is_secret(leaf):
        return leaf
    dtype = leaf.dtype if hasattr(leaf, "dtype") else np.asarray(leaf).dtype
    public = any(jnp.issubdtype(dtype, kind) for kind in (np.integer, np.bool_, jax.dtypes.prng_key))
    return None if public else leaf


def share_all(key: Array, values: Any, parties: int, protocol: Protocol) -> Any:
    """What `share` does, whatever else the key has hidden."""

    def shared(path: Any, leaf: Any) -> Secret:
        if is_secret(leaf):
            raise TypeError("a Secret is shared already: give it to secure functions as it is")
        name = jax.tree_util.keystr(path)
        return _share_array(keys.derive(key, "share", name), name, leaf, parties, protocol)

    return jax.tree_util.tree_map_with_path(shared, values, is_leaf=is_secret)


def _share_array(key: Array, name: str, values: Any, parties: int, protocol: Protocol) -> Secret:
    values = values if isinstance(values, jax.Array) else np.asarray(values)
    refusal = f"cannot share an array of dtype {values.dtype}{name and f', values{name}'}"
    refusal += "; share floats, integers or bools"
    if jnp.issubdtype(values.dtype, jax.dtypes.extended):
        raise TypeError(refusal)
    dtype = np.dtype(jax.dtypes.canonicalize_dtype(values.dtype))
    # Floats of JAX's own (bfloat16) have a kind of their own, as have integers of 4 bits.
    if not (jnp.issubdtype(dtype, np.floating) or dtype.kind in "iub"):
        raise TypeError(refusal)
    real = jnp.issubdtype(dtype, np.floating)
    frac_bits = protocol.frac_bits if real else 0
    bound = protocol.bound if real else INTEGER_BOUND
    encoded = _encoded(values, frac_bits, bound)
    key = fresh.of_each_entry(key, encoded, "share")
    shares = sharing.share_ring(key, encoded, parties, protocol.generator)
    return Secret(shares, frac_bits, dtype, encoded.ndim)


def _encoded(values: Any, frac_bits: int, bound: float) -> Any:
    """The ring integers of values that must lie below the bound in magnitude. Under a trace no one can raise:
    what does not is poisoned, and warned of when it runs.
    """

    def refusal(values: Any) -> str:
        values = np.asarray(values)
        worst = values[~np.asarray(ring.fits(values, bound))].flat[0]
        if values.dtype.kind in "iu":
            return (
                f"cannot share {worst}: integers stay below 2^62 in magnitude, so that they can be compared."
            )
        return (
            f"cannot share {worst:g}: with {frac_bits} fractional bits values and products stay below "
            f"{bound:g} in magnitude. Scale the values down, or use fewer fractional bits."
        )

    def warn(values: Any) -> None:
        warnings.warn(
            f"{refusal(values)} What is computed from it is no number.", RuntimeWarning, stacklevel=2
        )

    @jax.custom_batching.custom_vmap
    def looked_at(values: Array) -> Array:
        fit = jnp.all(ring.fits(values, bound))
        jax.lax.cond(fit, lambda _: None, partial(jax.debug.callback, warn), values)
        return values

    # A vmapped cond would ask the host about every entry.
    looked_at.def_vmap(lambda _, batched, values: (looked_at(values), batched[0]))

    fits = ring.fits(values, bound)
    if isinstance(fits, Tracer):
        return ring.encode_or_poison(looked_at(values), frac_bits, bound)
    if not np.all(fits):
        raise ValueError(refusal(values))
    return ring.encode(values, frac_bits)


def reveal(x: Any) -> Any:
    """Opens secrets: every `Secret` in a pytree becomes an array of its dtype; the rest is passed through.

    **This makes values public.** All parties send their shares: 8 bytes an entry from each to each other.

    Returns:
        Arrays. A float is NaN where the opened number is beyond 2^(62 - frac_bits) in magnitude, where no
        result in range is: a computation left the range, or had a number of which there is none, shared
        (`share`) or public (`secure`), under a trace; int64 is then -2^63.

    Raises:
        TypeError: inside a function on secrets, which opens nothing.

    Example:
        >>> import jax, numpy as np
        >>> import ciphernav_jax as cn
        >>> x = cn.share(jax.random.key(0), np.array([1.5, -2.0]), parties=2)
        >>> cn.reveal({"x": x, "count": 3})
        {'count': 3, 'x': Array([ 1.5, -2. ], dtype=float64)}
    """
    inside.require_outside("reveal", "Nothing is opened there. Return the values, and reveal those.")
    return jax.tree.map(lambda leaf: _reveal_array(leaf) if is_secret(leaf) else leaf, x, is_leaf=is_secret)


def _reveal_array(x: Secret) -> Array:
    total = sharing.join_sum(x.party_first().shares)
    if jnp.issubdtype(x.dtype, np.floating):
        in_range = total + np.uint64(2**62) <= np.uint64(2**63)
        return jnp.where(in_range, ring.decode(total, x.frac_bits, x.dtype), np.asarray(np.nan, x.dtype))
    return total.astype(jnp.int64).astype(x.dtype)
