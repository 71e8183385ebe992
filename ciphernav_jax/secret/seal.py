"""What `jax.tree.map` and its like may do with the shares of a `Secret`: the seal beside them tells.

A `Secret` has two leaves, its shares and a seal: an array of JAX's dtype `float0`, with which neither JAX nor
numpy compute. It has the shares' shape, but for the party axis, which is 0. Whatever moves the entries of
the shares moves the seal along; so it shows where the party axis went. The seal has no bytes, and the
compiler removes it. What it costs is dispatch: JAX takes no call with `float0` by its fast path, so that
short steps belong together in one `lax.scan`.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ciphernav_jax.jax_private import Tracer

INSTEAD = (
    "Compute on the value: secure(lambda x, y: jax.tree.map(lambda a, b: a - 0.1 * b, x, y))(key, x, y)."
)
_REFUSAL = (
    "jax.tree.map, or something like it, would compute {what} of the shares of a Secret and not of its "
    f"value. {INSTEAD}"
)
LOST = (
    "a Secret has lost its party axis, the leading one: lax.scan, lax.map, vmap or jax.tree.map went over "
    "it. Close over the Secret and index it in the loop, x[i], or write secure(jax.vmap(f))."
)
_MOVED = (
    "{what} moved the party axis of a Secret: jax.tree.map sees its shares, of shape [parties, *shape]. "
    "Index the Secret itself, x[2:4]; stack and concatenate within secure(f); have vmap stack what comes "
    "out in front, out_axes=0."
)
# Of numpy, what changes entries and computes nothing that `float0` could refuse.
_CHANGES = {np.ones_like, np.full_like, np.empty_like, np.sort, np.partition, np.tril, np.triu}


class Seal(np.ndarray):
    """An array of `float0` that refuses to be computed with, and can be moved.

    Raises:
        TypeError: it meets an operator, or a function of numpy that computes. Functions of JAX raise errors
            of their own, which name `float0`.
    """

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **_: Any) -> Any:
        # Leaves are compared one by one where the bits of two results should be the same.
        if ufunc in (np.equal, np.not_equal) and method == "__call__":
            return np.full(np.broadcast_shapes(*map(np.shape, inputs)), ufunc is np.equal)
        raise TypeError(_REFUSAL.format(what=f"{ufunc.__name__}(...)"))

    def __array_function__(self, func: Any, types: Any, args: Any, kwargs: Any) -> Any:
        if func in _CHANGES:
            raise TypeError(_REFUSAL.format(what=f"{func.__name__}(...)"))
        return super().__array_function__(func, types, args, kwargs)

    def __getattr__(self, name: str) -> Any:
        # What a JAX array has and a numpy array has not, `at` for one.
        raise AttributeError(_REFUSAL.format(what=f".{name}"))

    def __getitem__(self, index: Any) -> Any:
        try:
            if any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(index)):
                return _of_shape(jax.eval_shape(lambda: jnp.zeros(self.shape, bool)[index]).shape)
            return super().__getitem__(index)
        except (IndexError, TypeError):  # the second from JAX
            raise IndexError(_MOVED.format(what=f"an index, {index},")) from None

    def _refused(self: Any, *_: Any, **__: Any) -> Any:
        raise TypeError(_REFUSAL.format(what="something"))

    sort = partition = byteswap = fill = put = _refused  # pyright: ignore[reportAssignmentType]

    def astype(self, dtype: Any, *_: Any, **__: Any) -> "Seal":
        if dtype in (np.uint64, self.dtype):
            return self
        raise TypeError(_REFUSAL.format(what=f".astype({np.dtype(dtype).name})"))

    def block_until_ready(self) -> "Seal":
        return self


def _of_shape(shape: tuple[int, ...]) -> Seal:
    return np.zeros(shape, jax.dtypes.float0).view(Seal)


def seal(shares: Any, stacked: int) -> Any:
    """The seal of shares with so many axes in front of the party axis; what stands in place of an array (an
    axis, a sharding) is its own.
    """
    return _of_shape(_shape(shares, stacked)) if is_array(shares) else shares


def _shape(shares: Any, stacked: int) -> tuple[int, ...]:
    return tuple(0 if axis == stacked else size for axis, size in enumerate(shares.shape))


def require_moved_along(shares: Any, found: Any, stacked: int, parties: int) -> None:
    """Raises ValueError where shares were moved in a way by which the party axis is not where it was, or
    does not have the same parties.

    Args:
        found: what became of the seal.
        stacked: how many axes the shares have now in front of the party axis.
    """
    if not (is_array(shares) and is_array(found)):
        return
    if stacked < 0:
        raise ValueError(LOST)
    there = shares.shape[stacked]
    if there != parties:
        raise ValueError(_MOVED.format(what=f"what made {there} rows of those of {parties} parties"))
    if found.shape != _shape(shares, stacked):
        raise ValueError(_MOVED.format(what="something"))


def is_array(x: Any) -> bool:
    """Whether it is an array of any kind, traced or abstract, and no placeholder."""
    return hasattr(x, "shape") and hasattr(x, "dtype") and not isinstance(x, type)
