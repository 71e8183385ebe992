"""What only a simulation can know: how many truncations a call carries out, and how many of them fail."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array, lax

from ciphernav_jax.protocols.party import AXIS, ideal_sum
from ciphernav_jax.secret.cost import require_step
from ciphernav_jax.secret.secure import Secure
from ciphernav_jax.secret.value import Value


class Witness:
    """Stands beside a program while it is traced, and adds up the shares before and after each truncation.

    Attributes:
        carried_out: single truncations so far.
        failed: how many of them failed, an int64 scalar of the trace.
    """

    def __init__(self):
        self.begin()

    def begin(self) -> None:
        """A program is traced more than once; each trace counts anew."""
        self.carried_out, self.failed = 0, jnp.zeros((), jnp.int64)

    def truncated(self, before: Array, shift: int, after: Value, *, clipped: bool = False) -> None:
        """Notes a truncation of the shares `before` by `shift` bits; `clipped`: what is negative became 0."""
        with jax.named_scope("audit"):
            exact = lax.bitcast_convert_type(ideal_sum(before), jnp.int64) >> shift
            found = lax.bitcast_convert_type(ideal_sum(after.share), jnp.int64)
            if clipped:
                exact = jnp.maximum(exact, 0)
            far = jnp.abs(found - exact) > lax.axis_size(AXIS)
        self.carried_out += far.size
        self.failed += jnp.sum(far, dtype=jnp.int64)


def audit(step: Secure) -> Callable[..., tuple[Any, tuple[Array, Array]]]:
    """The function with the count of its truncations. **A privilege of the simulation**: no party can count.

    Returns:
        `audited(key, *args) -> (result, (carried_out, failed))`: the result of `step(key, *args)` bit for
        bit, and two int64 scalars. A truncation has failed when it lands more than P units, farther than any
        variant rounds, from the value it truncates. Jitted; works under `jax.lax.scan` and `jax.vmap`.

    Raises:
        TypeError: `step` was not made by `secure`.
        NotImplementedError (when called): a loop or a branch in the function; audit its body.
    """
    require_step(step)

    @jax.jit
    def evaluate(key, args):
        witness = Witness()
        result = step.evaluate(key, args, witness=witness)
        return result, (jnp.int64(witness.carried_out), witness.failed)

    return lambda key, *args: evaluate(key, step.checked(key, args))
