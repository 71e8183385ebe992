"""Floats to floats through the protocol, differentiable in reverse mode."""

from collections.abc import Callable
from functools import cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from ciphernav_jax.protocols import Protocol
from ciphernav_jax.protocols.suite import chosen
from ciphernav_jax.ring import keys
from ciphernav_jax.secret.array import reveal, share_all
from ciphernav_jax.secret.secured import secure


def simulate(
    function: Callable[..., Any], *, parties: int, protocol: Protocol | None = None
) -> Callable[..., Any]:
    """The function as the protocol computes it: share, `secure(function)`, reveal.

    For looking at what a protocol does to values and gradients. **Nothing stays secret**: arguments, results
    and gradients are the caller's floats. To compute on secrets, use `secure`.

    Args:
        function: as for `secure`. What is to be differentiated or batched must be an argument: the function
            must not close over it.
        parties: P >= 2.
        protocol: the variants.

    Returns:
        `g(key, *args)`, `args` pytrees of float arrays (and of integers and bools), all of which are shared;
        the results are those of `function` up to the protocol's error, with the same shapes and dtypes.
        `key` decides all randomness. It works under `jax.jit`, `jax.vmap` and `jax.grad`, `jax.vjp` (not
        forward mode: `jax.jvp` raises TypeError).

        Derivative: the pullback of `function` at the same arguments, itself evaluated by the protocol, with
        the arguments and the cotangents shared. So derivatives of any order are. Integers, bools and the key
        have none (zeros).

        Keys: with `key` the arguments are shared and the step is called; the gradient at a key is
        `simulate(pullback)(ring.keys.derive(key, "pullback"), args, cotangents)`.

        Under `vmap`, each entry has masks of its own, also where one key is given for all: entry i then has
        `ring.keys.derive(key, "entry", i)`.

    Raises (when called):
        ValueError: fewer than two parties; an argument or cotangent out of the protocol's range (where it is
            concrete).
        NotImplementedError: `function` or its pullback uses an operation that has no rule.

    Example:
        >>> import jax, jax.numpy as jnp, numpy as np
        >>> import ciphernav_jax as cn
        >>> doubled = cn.simulate(lambda x: jnp.sum(2 * x), parties=2)
        >>> jax.grad(doubled, argnums=1)(jax.random.key(0), np.array([1.5, -2.0])).tolist()
        [2.0, 2.0]
    """
    protocol = chosen(protocol)
    step = secure(function, protocol=protocol)

    @jax.custom_vjp
    def simulated(key: Array, args: tuple[Any, ...]) -> Any:
        key = _own_key(key, args)
        secrets = share_all(key, args, parties, protocol)
        return reveal(step.computed(key, step.given(*secrets)))

    @cache
    def pullback() -> Callable[..., Any]:
        return simulate(_pullback(function), parties=parties, protocol=protocol)

    def forward(key: Array, args: tuple[Any, ...]) -> tuple[Any, Any]:
        return simulated(key, args), (key, args)

    def backward(residuals: Any, cotangents: Any) -> tuple[None, Any]:
        key, args = residuals
        leaves, tree = jax.tree.flatten(args)
        cotangents = [x for x in jax.tree.leaves(cotangents) if x.dtype != jax.dtypes.float0]
        key = keys.derive(_own_key(key, (args, cotangents)), "pullback")
        gradients = iter(pullback()(key, args, cotangents))
        # A None stands for the zero of any type.
        return None, jax.tree.unflatten(tree, [next(gradients) if _is_float(x) else None for x in leaves])

    simulated.defvjp(forward, backward)
    return lambda key, *args: simulated(key, jax.tree.map(jnp.asarray, args))


def _is_float(x: Any) -> bool:
    return jnp.issubdtype(x.dtype, np.floating)


def _pullback(function: Callable[..., Any]) -> Callable[..., list[Array]]:
    """(args, cotangents of the float results) -> gradients of the float arguments, both as lists."""

    def pulled_back(args: tuple[Any, ...], cotangents: list[Array]) -> list[Array]:
        leaves, tree = jax.tree.flatten(args)

        def floats_to_floats(floats: list[Array]) -> list[Array]:
            given = iter(floats)
            full = [next(given) if _is_float(x) else x for x in leaves]
            outputs = jax.tree.leaves(function(*jax.tree.unflatten(tree, full)))
            return [x for x in map(jnp.asarray, outputs) if _is_float(x)]

        _, pull = jax.vjp(floats_to_floats, [x for x in leaves if _is_float(x)])
        (gradients,) = pull(cotangents)
        return gradients

    return pulled_back


def _own_key(key: Array, args: Any) -> Array:
    """The key; under a `vmap` that goes over arguments and not over the key, a key for each entry."""
    return _key_of_each(key, jax.lax.stop_gradient(args))


@jax.custom_batching.custom_vmap
def _key_of_each(key: Array, args: Any) -> Array:
    return key


@_key_of_each.def_vmap
def _key_of_each_entry(size: int, in_batched: Any, key: Array, args: Any) -> tuple[Array, bool]:
    if not in_batched[0]:
        key = keys.derive(_key_of_each(key, args), "entry", np.arange(size))
    return _key_of_each(key, args), True
