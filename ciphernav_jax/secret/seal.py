"""What `jax.tree.map` and its like may do with the shares of a `Secret`: the seal beside them tells.

A `Secret` has two leaves, its shares and a seal: an array of a dtype of its own, `seal`, with which
neither JAX nor numpy compute. It has the shares' shape, but for the party axis, which is 0. Whatever moves
the entries of the shares moves the seal along; so it shows where the party axis went. The seal has no bytes,
and the compiler removes it.
"""

from functools import lru_cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ciphernav_jax import jax_private
from ciphernav_jax.jax_private import Sealed, Tracer

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
# The primitives of JAX that move entries, between devices as well. Others may be refused only as they are
# compiled, which nothing is that leaves no trace in a result.
_NAMED = """
    all_gather all_gather_invariant all_to_all broadcast_in_dim concatenate copy copy_p device_put
    dynamic_slice dynamic_update_slice gather mesh_cast optimization_barrier pad pbroadcast ppermute pvary
    reshape reshard rev scatter select_n sharding_constraint slice split squeeze stack stop_gradient tile
    transpose unstack
"""
_MOVES = frozenset(_NAMED.split())
# Of numpy, what changes entries and computes nothing that could be refused.
_CHANGES = {np.ones_like, np.full_like, np.empty_like, np.sort, np.partition, np.tril, np.triu}
_COMPUTES = """
    __add__ __radd__ __sub__ __rsub__ __mul__ __rmul__ __truediv__ __rtruediv__ __floordiv__ __rfloordiv__
    __mod__ __rmod__ __divmod__ __rdivmod__ __pow__ __rpow__ __matmul__ __rmatmul__ __and__ __rand__ __or__
    __ror__ __xor__ __rxor__ __lshift__ __rlshift__ __rshift__ __rrshift__ __lt__ __le__ __gt__ __ge__
    __neg__ __pos__ __abs__ __invert__ __round__
    all any argmax argmin argpartition argsort clip conj cumprod cumsum dot max mean min prod ptp round
    searchsorted sort std sum trace var view byteswap fill partition put
"""


class Seal(Sealed):
    """An array that refuses to be computed with, and can be moved.

    Raises:
        TypeError: it meets an operator, or a function of numpy that computes. Functions of JAX raise errors
            of their own, which name `seal`.
    """

    def __array__(self, *_: Any, **__: Any) -> np.ndarray:
        return np.zeros(self.shape, jax.dtypes.float0)  # which numpy can move as well, and nothing else

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **_: Any) -> Any:
        # Leaves are compared one by one where the bits of two results should be the same.
        if ufunc in (np.equal, np.not_equal) and method == "__call__":
            return np.full(np.broadcast_shapes(*map(np.shape, inputs)), ufunc is np.equal)
        raise TypeError(_REFUSAL.format(what=f"{ufunc.__name__}(...)"))

    def __array_function__(self, func: Any, _: Any, args: Any, kwargs: Any) -> Any:
        if func in _CHANGES:
            raise TypeError(_REFUSAL.format(what=f"{func.__name__}(...)"))
        args, kwargs = jax.tree.map(lambda x: np.asarray(x) if isinstance(x, Seal) else x, (args, kwargs))
        return func(*args, **kwargs)

    def __getitem__(self, index: Any) -> Any:
        try:
            if any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(index)):
                return _of_shape(jax.eval_shape(lambda: jnp.zeros(self.shape, bool)[index]).shape)
            return _of_shape(np.zeros(self.shape, bool)[index].shape)
        except (IndexError, TypeError):  # the second from JAX
            raise IndexError(_MOVED.format(what=f"an index, {index},")) from None

    @property
    def at(self) -> Any:
        raise AttributeError(_REFUSAL.format(what=".at"))

    def astype(self, dtype: Any, *_: Any, **__: Any) -> "Seal":
        if dtype in (np.uint64, self.dtype):
            return self
        raise TypeError(_REFUSAL.format(what=f".astype({np.dtype(dtype).name})"))

    def copy(self, *_: Any) -> "Seal":
        return self

    def __reduce__(self) -> Any:
        return Seal, (self.shape,)


def _refuses(name: str) -> None:
    def refused(self: Seal, *_: Any, **__: Any) -> Any:
        raise TypeError(_REFUSAL.format(what=f".{name}(...)"))

    setattr(Seal, name, refused)


for _name in _COMPUTES.split():
    _refuses(_name)

_kept = lru_cache(1024)(Seal)


def _of_shape(shape: tuple[int, ...]) -> Seal:
    if _kept(shape).is_deleted():  # it was donated to a call
        _kept.cache_clear()
    return _kept(shape)


def seal(shares: Any, rank: int) -> Any:
    """The seal of shares whose value has so many axes: the party axis is the one before them. What stands
    in place of an array (an axis, a sharding) is its own.
    """
    if not is_array(shares):
        return shares
    shape = shares.shape
    return _of_shape(_without_parties(shape, len(shape) - 1 - rank))


def _without_parties(shape: tuple[int, ...], axis: int) -> tuple[int, ...]:
    return (*shape[:axis], 0, *shape[axis + 1 :]) if axis >= 0 else shape


def require_moved_along(shares: Any, found: Any, rank: int, parties: int) -> None:
    """Raises ValueError where shares were moved in a way by which the party axis is not where it was, or
    does not have the same parties; TypeError where they were not only moved.

    Args:
        found: what became of the seal.
        rank: how many axes the value has, behind the party axis.
    """
    if not (is_array(shares) and is_array(found)):
        return
    shape = shares.shape
    axis = len(shape) - 1 - rank
    if axis < 0:
        raise ValueError(LOST)
    if shape[axis] != parties:
        raise ValueError(_MOVED.format(what=f"what made {shape[axis]} rows of those of {parties} parties"))
    if found.shape != _without_parties(shape, axis):
        raise ValueError(_MOVED.format(what="something"))
    if isinstance(found, Tracer) and (others := jax_private.sealed_by(found) - _MOVES):
        raise TypeError(_REFUSAL.format(what=f"`{min(others)}`"))


def is_array(x: Any) -> bool:
    """Whether it is an array of any kind, traced or abstract, and no placeholder."""
    return isinstance(x, jax.Array) or (
        hasattr(x, "shape") and hasattr(x, "dtype") and not isinstance(x, type)
    )
