"""A function with its arguments, its gradient, and what both give in float64."""

import functools
import hashlib
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from ciphernav_jax.jax_private import Literal
from ciphernav_jax.parties.jaxprs import jaxprs_in, opened_up
from ciphernav_jax.protocols import Protocol
from ciphernav_jax.ring import keys
from ciphernav_jax.secret import is_secret, share
from ciphernav_jax.secret.secured import Secure

ADDRESS = re.compile(r" at 0x[0-9a-f]+")
"""What a jaxpr's text says of a function that is another in every process."""


NOT_ASKED = "it was not asked for"


@dataclass(frozen=True, eq=False)
class Subject:
    """What is compared; made by `subject`.

    Attributes:
        function, args: the user's own.
        public: numbers of the arguments that are not shared.
        gradient: `(*args) ->` the gradients of the sum of all float results by all secret float arguments, as
            a list; None where there is none.
        no_gradient: why not; "" where there is one.
        expected, expected_gradient: all results, and all gradients, as float64 arrays.
        reference: the dtype in which these were evaluated: "float64", or "own" where the function takes its
            arguments in their own dtypes alone.
        digest: of the function's jaxpr and the gradient's, and of the arguments.
    """

    function: Callable[..., Any]
    args: tuple[Any, ...]
    public: tuple[int, ...]
    gradient: Callable[..., list[Array]] | None
    no_gradient: str
    expected: list[NDArray[np.float64]]
    expected_gradient: list[NDArray[np.float64]]
    reference: str
    digest: str

    def shared(self, key: Array, parties: int, protocol: Protocol) -> tuple[Any, ...]:
        """The arguments, those that are secret as shares."""
        return tuple(
            arg if i in self.public else share(keys.derive(key, i), arg, parties=parties, protocol=protocol)
            for i, arg in enumerate(self.args)
        )

    def configuration(self) -> dict[str, Any]:
        """What it is, for JSON."""
        named = jax.tree_util.tree_leaves_with_path(self.args)
        return {
            "function": _name(self.function),
            "digest": self.digest,
            "arguments": {
                f"args{jax.tree_util.keystr(path)}": f"{_dtype(x)}{list(np.shape(x))}" for path, x in named
            },
            "public": list(self.public),
            "gradients": self.no_gradient != NOT_ASKED,
            "reference": self.reference,
        }


def subject(
    function: Callable[..., Any], args: tuple[Any, ...], public: Sequence[int], gradients: bool = True
) -> Subject:
    """The function traced, and evaluated in float64 with its gradient, unless this is not asked for.

    Raises:
        TypeError: an argument is a `Secret`, or the function is secure already.
        ValueError: a number in `public` that no argument has, or none that is left to be secret.
        What the function raises on its own.
    """
    if isinstance(function, Secure):
        raise TypeError("the function is secure already: give compare the one that it was made from")
    if any(is_secret(x) for x in jax.tree.leaves(args, is_leaf=is_secret)):
        raise TypeError(
            "an argument is a Secret: give compare plain arrays, it shares them with each protocol"
        )
    if strays := [i for i in public if not 0 <= i < len(args)]:
        raise ValueError(f"public names arguments 0 to {len(args) - 1}, there is none of number {strays[0]}")
    public = tuple(sorted(set(public)))
    if len(public) == len(args):
        raise ValueError("no argument is left to be secret; take one from public, or give the function one")
    traced = [jax.make_jaxpr(function)(*args)]
    expected, reference = _exactly(function, args)
    gradient = functools.partial(_gradient, function, public)
    expected_gradient = []
    no_gradient = _without_gradient(function, args, public) if gradients else NOT_ASKED
    if not no_gradient:
        try:
            traced.append(jax.make_jaxpr(gradient)(*args))
            expected_gradient = _exactly(gradient, args)[0]
        except Exception as error:  # whatever the function does where it is differentiated
            no_gradient = f"JAX does not differentiate it: {words(error)}"
    return Subject(
        function,
        args,
        public,
        None if no_gradient else gradient,
        no_gradient,
        expected,
        expected_gradient,
        reference,
        _digest(traced, args, public),
    )


def words(error: Exception) -> str:
    """An error in one line; one that is none of ours with its type."""
    said = " ".join(str(error).split())
    ours = isinstance(error, NotImplementedError | ValueError)
    return said if ours and said else f"{type(error).__name__}: {said}"


def _gradient(function: Callable[..., Any], public: tuple[int, ...], *args: Any) -> list[Array]:
    leaves, tree = jax.tree.flatten(args)
    chosen = _differentiated(args, public)

    def total(floats: list[Array]) -> Array:
        given = iter(floats)
        full = [next(given) if floats_too else x for x, floats_too in zip(leaves, chosen, strict=True)]
        results = jax.tree.leaves(function(*jax.tree.unflatten(tree, full)))
        # In one dtype, whatever the results have.
        return sum(
            (jnp.sum(x.astype(jnp.float64)) for x in map(jnp.asarray, results) if is_float(x)), jnp.zeros(())
        )

    return jax.grad(total)([x for x, wanted in zip(leaves, chosen, strict=True) if wanted])


def _differentiated(args: tuple[Any, ...], public: tuple[int, ...]) -> list[bool]:
    """Of each leaf of the arguments, whether it is a secret float."""
    return [i not in public and is_float(x) for i, arg in enumerate(args) for x in jax.tree.leaves(arg)]


def _without_gradient(function: Callable[..., Any], args: tuple[Any, ...], public: tuple[int, ...]) -> str:
    """Why there is nothing to differentiate; "" where there is."""
    if not any(_differentiated(args, public)):
        return "no secret argument is a float"
    if not any(is_float(x) for x in jax.tree.leaves(jax.eval_shape(function, *args))):
        return "no result is a float"
    return ""


def _exactly(function: Callable[..., Any], args: tuple[Any, ...]) -> tuple[list[NDArray[np.float64]], str]:
    """All results with floats widened to float64, and "float64"; with their own dtypes, and "own", where the
    function does not take others, as one with a float32 carry in a loop does not.
    """
    try:
        wide = jax.tree.map(lambda x: np.asarray(x, np.float64) if is_float(x) else x, args)
        with jax.numpy_dtype_promotion("standard"):  # what the function holds itself may be float32
            results, reference = jax.jit(function)(*wide), "float64"
    except (TypeError, ValueError):
        results, reference = jax.jit(function)(*args), "own"
    return [np.asarray(x, np.float64) for x in jax.tree.leaves(results)], reference


def is_float(x: Any) -> bool:
    """Whether it is a float, or an array of floats."""
    return jnp.issubdtype(_dtype(x), np.floating)


def _dtype(x: Any) -> Any:
    return x.dtype if hasattr(x, "dtype") else np.asarray(x).dtype


def _digest(traced: list[Any], args: tuple[Any, ...], public: tuple[int, ...]) -> str:
    found = hashlib.sha256(repr(public).encode())
    for jaxpr in traced:
        found.update(ADDRESS.sub("", str(jaxpr)).encode())
        for x in _constants(jaxpr):
            found.update(_bytes(x))
    for path, x in jax.tree_util.tree_leaves_with_path(args):
        found.update(jax.tree_util.keystr(path).encode() + _bytes(x))
    return found.hexdigest()


def _constants(jaxpr: Any) -> Iterator[Any]:
    """What a program closes over, itself or in a function that it calls."""
    opened, constants = opened_up(jaxpr)
    yield from constants
    for eqn in opened.eqns:
        yield from (x.val for x in eqn.invars if isinstance(x, Literal))
        for inner in jaxprs_in(eqn):
            yield from _constants(inner)


def _bytes(x: Any) -> bytes:
    if jnp.issubdtype(_dtype(x), jax.dtypes.prng_key):
        x = jax.random.key_data(x)
    array = np.asarray(x)
    return f"{array.dtype}{array.shape}".encode() + array.tobytes()


def _name(function: Callable[..., Any]) -> str:
    while isinstance(function, functools.partial):
        function = function.func
    return getattr(function, "__name__", type(function).__name__)
