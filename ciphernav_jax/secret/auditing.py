"""How many truncations a call carries out, and how many of them fail."""

from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
from jax import Array

from ciphernav_jax.secret.compiled import Compiled
from ciphernav_jax.secret.secured import Secure, require_step
from ciphernav_jax.secret.witness import Witness


def audit(step: Secure) -> Callable[..., tuple[Any, tuple[Array, Array]]]:
    """The function with the count of its truncations, loops and branches included: of what `validate` reports
    that alone, at a fraction of the cost. **A privilege of the simulation**: no party can count.

    Returns:
        `audited(key, *args) -> (result, (carried_out, failed))`: the result of `step(key, *args)` bit for
        bit, and two int64 scalars. A truncation has failed when it lands more than P units, farther than any
        variant rounds, from the value it truncates. Jitted; works under `jax.lax.scan` and `jax.vmap`.

    Raises:
        TypeError: `step` was not made by `secure`.
        What `step` would raise (when called).

    Example:
        >>> import jax, jax.numpy as jnp, numpy as np
        >>> import ciphernav_jax as cn
        >>> x = cn.share(jax.random.key(0), np.array([1.5, -2.0]), parties=2)
        >>> result, counts = cn.audit(cn.secure(jnp.square))(jax.random.key(1), x)
        >>> [int(count) for count in counts]
        [2, 0]
    """
    require_step(step)

    @Compiled
    def evaluate(key, given):
        result, (notes, findings) = step.witnessed(key, given, Witness(step.protocol, beside=False))
        assert notes is not None
        counts = jnp.sum(notes.total["truncations"]), jnp.sum(notes.total["failed"])
        return (result, counts), findings

    def audited(key: Array, *args: Any, **kwargs: Any) -> tuple[Any, tuple[Array, Array]]:
        counted, findings = evaluate(key, step.checked(key, *args, **kwargs))
        step.require_sound(key, findings)
        return counted

    return audited
