"""Seconds that compiling takes, and warm calls."""

import time
from collections.abc import Callable, Iterator
from typing import Any

import jax
from jax import Array

from ciphernav_jax.ring import keys

# However short they are, more calls tell no more.
MOST = 200


def compiled(function: Callable[..., Any], *args: Any) -> tuple[Callable[..., Any], dict[str, float]]:
    """The function compiled for these arguments, and the seconds that took: trace_s, compile_s."""
    start = time.perf_counter()
    lowered = jax.jit(function).lower(*args)
    traced = time.perf_counter()
    run = lowered.compile()
    return run, {"trace_s": traced - start, "compile_s": time.perf_counter() - traced}


def timed(run: Callable[..., Any], *args: Any) -> tuple[float, Any]:
    """Seconds of one call, and its result."""
    start = time.perf_counter()
    result = jax.block_until_ready(run(*args))
    return time.perf_counter() - start, result


def calls(
    run: Callable[..., Any],
    key: Array,
    args: tuple[Any, ...],
    repeat: int | None = None,
    *,
    seconds: float,
    fewest: int,
) -> Iterator[tuple[float, Any]]:
    """Seconds and result of each of several calls; a first one, which warms up, is the caller's.

    Args:
        run: called with a key of its own and the arguments.
        key, args: from which those keys are derived; what else it is called with.
        repeat: how many calls; None for as many as fill `seconds`, at least `fewest` and at most `MOST`.
        seconds, fewest: see `repeat`.
    """
    total = 0.0
    for i in range(repeat or MOST):
        took, result = timed(run, jax.block_until_ready(keys.derive(key, "again", i)), *args)
        yield took, result
        total += took
        if repeat is None and i + 1 >= fewest and total > seconds:
            break
