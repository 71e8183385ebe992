"""Secrets handed on from some parties to others."""

from typing import Any

import jax
import jax.numpy as jnp
from jax import Array

from ciphernav_jax.parties import sharing
from ciphernav_jax.protocols import Protocol
from ciphernav_jax.protocols.suite import chosen
from ciphernav_jax.ring import keys
from ciphernav_jax.secret import fresh, inside
from ciphernav_jax.secret.array import Secret, is_secret


def reshare(key: Array, x: Any, *, parties: int, protocol: Protocol | None = None) -> Any:
    """The same secrets, shared among another number of parties, or afresh among the same.

    1. each party splits its share into one fresh additive share for each of the new parties, and sends it;
    2. each new party adds up what it was sent.

    Opened: nothing. Rounds: 1. Sent: 8 bytes an entry from each old party to each new one. Correlated
    randomness: none. Error: none, bit for bit. As long as one party of each group keeps to itself, all others
    of both together learn nothing.

    Args:
        key: random key, fresh for each call; it stands for those of all old parties.
        x: pytree; each `Secret` in it is handed on, the rest stays as it is.
        parties: how many there are then, 2 or more.
        protocol: gives the generator.

    Raises:
        ValueError: fewer than two parties; a `vmap` or a loop over secrets with one key for all.
        TypeError: no key; or inside a function on secrets.

    Warns:
        KeyReuseWarning: a key hands on a second time, and other secrets.

    Example:
        >>> import jax, numpy as np
        >>> import ciphernav_jax as cn
        >>> x = cn.share(jax.random.key(0), np.array([1.5, -2.0]), parties=2)
        >>> y = cn.reshare(jax.random.key(1), x, parties=5)
        >>> y.parties, cn.reveal(y).tolist()
        (5, [1.5, -2.0])
    """
    inside.require_outside("reshare", "Return the values, and hand those on.")
    fresh.require_key(key, "reshare")
    sharing.require_parties(parties)
    fresh.of_each_iteration(key, x, "share")
    generator = chosen(protocol).generator

    def handed_on(path: Any, leaf: Any) -> Any:
        if not is_secret(leaf):
            return leaf
        name, old = jax.tree_util.keystr(path), leaf.party_first()
        fresh.of_each_call(key, leaf, "share", where=f"reshare {name}", how=parties)
        mine = fresh.of_each_entry(keys.derive(key, "reshare", name), old.shares, "share")
        total = jnp.uint64(0)
        for party in range(old.parties):
            split = keys.derive(mine, "party", party)
            total = total + sharing.share_ring(split, old.shares[party], parties, generator)
        return Secret(total, old.frac_bits, old.dtype, old.rank)

    return jax.tree_util.tree_map_with_path(handed_on, x, is_leaf=is_secret)
