"""Arithmetic on the shares of a `Secret`, as if they were its value, is refused: `jax.tree.map` meets a seal.

A `Secret` has two leaves, its shares and a seal. The seal has their shape, no bytes, and JAX's dtype
`float0`, which moves through jit, loops, vmap, indexing, stacking and files, and with which neither JAX nor
numpy compute. It is made anew whenever a `Secret` is taken apart, so that nothing depends on what became of
the last one, and the compiler removes it.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from ciphernav_jax.jax_private import Tracer

INSTEAD = (
    "Compute on the value: secure(lambda x, y: jax.tree.map(lambda a, b: a - 0.1 * b, x, y))(key, x, y)."
)
_REFUSAL = (
    "jax.tree.map, or something like it, would compute {what} of the shares of a Secret and not of its "
    f"value. {INSTEAD}"
)


class Seal(np.ndarray):
    """An array of `float0` that refuses to be computed with, and can be moved.

    Raises:
        TypeError: it meets an operator or a ufunc. Functions of JAX raise errors of their own, which name
            `float0`.
    """

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **_: Any) -> Any:
        # Leaves are compared one by one where the bits of two results should be the same.
        if ufunc in (np.equal, np.not_equal) and method == "__call__":
            return np.full(np.broadcast_shapes(*map(np.shape, inputs)), ufunc is np.equal)
        raise TypeError(_REFUSAL.format(what=f"{ufunc.__name__}(...)"))

    def __getattr__(self, name: str) -> Any:
        # What a JAX array has and a numpy array has not, `at` for one.
        raise AttributeError(_REFUSAL.format(what=f".{name}"))

    def __getitem__(self, index: Any) -> Any:
        if any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(index)):
            return _of_shape(jax.eval_shape(lambda: jnp.zeros(self.shape, bool)[index]).shape)
        return super().__getitem__(index)

    def astype(self, dtype: Any, *_: Any, **__: Any) -> "Seal":
        if dtype == np.uint64:
            return self
        raise TypeError(_REFUSAL.format(what=f".astype({np.dtype(dtype).name})"))


def _of_shape(shape: tuple[int, ...]) -> Seal:
    return np.zeros(shape, jax.dtypes.float0).view(Seal)


def seal(shares: Any) -> Any:
    """The seal of some shares; what stands in place of an array (an axis, a sharding) is its own."""
    array = isinstance(shares, (Array, np.ndarray, np.generic, jax.ShapeDtypeStruct))
    return _of_shape(shares.shape) if array else shares
