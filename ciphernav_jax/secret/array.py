"""`Secret`: a real array that exists as shares alone."""

from dataclasses import dataclass, field, replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import UInt64

from ciphernav_jax import ring
from ciphernav_jax.jax_private import Tracer
from ciphernav_jax.protocols import Protocol, sharing


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Secret:
    """A secret-shared array; a pytree with one leaf, so it passes through jit, scan carries and checkpoints.

    Invariants:
    - `shares` is uint64[P, *shape]: additive shares modulo 2^64, the party as leading axis.
    - Each party's row alone, and any P - 1 rows together, are uniform whatever the value.
    - The value is the signed sum of the rows divided by 2^frac_bits.
    - `dtype` is what `reveal` returns: a float type, or bool or an integer type with frac_bits 0.
    - `rank` is the number of the value's axes. `vmap` and the outputs of `lax.scan` stack further axes in
      front of the party axis; `party_first` makes them axes of the value.

    Indexing works on the value's axes: `x[0]`, `x[2:5]`, `x[indices]`.
    """

    shares: UInt64[Array, "p ..."]
    frac_bits: int = field(metadata={"static": True})
    dtype: np.dtype = field(metadata={"static": True})
    rank: int = field(metadata={"static": True})

    def party_first(self) -> "Secret":
        """The same secret with the party as leading axis.

        Raises:
            ValueError: the party axis is gone: a loop went over a `Secret` as if over its entries.
        """
        stacked = self.shares.ndim - 1 - self.rank
        if stacked < 0:
            raise ValueError(
                "a Secret has lost its party axis, the leading one: lax.scan, lax.map or vmap went over it. "
                "Close over the Secret and index it in the loop, x[i], or write secure(jax.vmap(f))."
            )
        shares = jnp.moveaxis(self.shares, stacked, 0) if stacked else self.shares
        return replace(self, shares=shares, rank=self.rank + stacked)

    @property
    def parties(self) -> int:
        """P, the number of parties."""
        return self.party_first().shares.shape[0]

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
        return (
            f"Secret({self.dtype.name}{list(self.shape)}, parties={self.parties}, frac_bits={self.frac_bits})"
        )

    def __array__(self, *_, **__):
        raise TypeError(
            "a Secret has no public value. Compute on it inside secure(f), or open it with reveal(x)."
        )

    __jax_array__ = __array__


def _is_secret(x: Any) -> bool:
    return isinstance(x, Secret)


def share(key: Array, values: Any, *, parties: int, protocol: Protocol | None = None) -> Any:
    """Splits real arrays into fresh additive shares.

    Args:
        key: random key of the party that shares; each call needs a key of its own.
        values: pytree of float arrays (float32 or float64), bools or integers. Floats lie within
            `protocol.bound` (2^(62 - 2 frac_bits); 4,194,304 by default) in magnitude, integers within 2^62.
        parties: P >= 2.
        protocol: gives the fractional bits of floats; bools and integers have none.

    Returns:
        The same pytree with a `Secret` for each array.

    Raises:
        ValueError: fewer than two parties; a value out of range or not finite (where it is concrete).
        TypeError: an array of another dtype; or the call is being differentiated.
    """
    protocol = protocol or Protocol()
    sharing.require_parties(parties)
    leaves, tree = jax.tree.flatten(values)
    shared = [
        _share_array(jax.random.fold_in(key, i), leaf, parties, protocol) for i, leaf in enumerate(leaves)
    ]
    return jax.tree.unflatten(tree, shared)


def _share_array(key: Array, values: Any, parties: int, protocol: Protocol) -> Secret:
    values = values if isinstance(values, jax.Array) else np.asarray(values)
    dtype = np.dtype(jax.dtypes.canonicalize_dtype(values.dtype))
    if not (jnp.issubdtype(dtype, np.floating) or jnp.issubdtype(dtype, np.integer) or dtype.kind == "b"):
        raise TypeError(f"cannot share an array of dtype {dtype}; share floats, integers or bools")
    if jnp.issubdtype(dtype, np.floating):
        frac_bits = protocol.frac_bits
        if not isinstance(values, Tracer) and np.any(np.abs(values) >= protocol.bound):
            raise ValueError(
                f"cannot share {np.max(np.abs(values)):g}: with {frac_bits} fractional bits values and "
                f"products stay below {protocol.bound:g} in magnitude. "
                "Scale the values down, or use fewer fractional bits."
            )
    else:
        frac_bits = 0
    encoded = ring.encode(values, frac_bits)
    return Secret(sharing.share_ring(key, encoded, parties), frac_bits, dtype, encoded.ndim)


def reveal(x: Any) -> Any:
    """Opens secrets: every `Secret` in a pytree becomes an array of its dtype; the rest is passed through.

    **This makes values public.** All parties send their shares: 8 bytes an entry from each to each other.
    """
    return jax.tree.map(lambda leaf: _reveal_array(leaf) if _is_secret(leaf) else leaf, x, is_leaf=_is_secret)


def _reveal_array(x: Secret) -> Array:
    total = sharing.join_sum(x.party_first().shares)
    if jnp.issubdtype(x.dtype, np.floating):
        return ring.decode(total, x.frac_bits, x.dtype)
    return total.astype(jnp.int64).astype(x.dtype)
