"""One variant with one number of parties, measured."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import jax
import numpy as np
from jax import Array
from numpy.typing import NDArray

from ciphernav_jax.comparison.rows import Row
from ciphernav_jax.comparison.subject import Subject, is_float, words
from ciphernav_jax.comparison.timing import calls, compiled
from ciphernav_jax.jax_private import without_compilation_cache
from ciphernav_jax.protocols import Protocol
from ciphernav_jax.ring import keys
from ciphernav_jax.secret import LAN, WAN, Secret, audit, cost, is_secret, reveal, secure

# Without a number of calls to time: as many as fit in so many seconds, and no fewer than these.
SECONDS = 1.0
FEWEST = 3


def trial(
    subject: Subject,
    protocol: Protocol,
    parties: int,
    key: Array,
    repeat: int | None,
    tell: Callable[[str], None],
) -> Row:
    """Count, compile, time, and compare with float64.

    Args:
        subject: what to evaluate.
        protocol, parties: how.
        key: of this trial and no other.
        repeat: timed calls; None for as many as fit in a second.
        tell: called with what is being done.

    Raises:
        What `secure` raises on the function or the variant.
    """
    tell("counting")
    args = subject.shared(keys.derive(key, "share"), parties, protocol)
    step = secure(subject.function, protocol=protocol)
    counted = cost(step, *args)  # before all else: what is refused is refused here
    tell("compiling")
    with without_compilation_cache():
        run, took = compiled(step, keys.derive(key, "lowered"), *args)
    tell("timing")
    of_calls, args = keys.derive(key, "timed"), jax.block_until_ready(args)
    jax.block_until_ready(run(keys.derive(of_calls, "first"), *args))
    times = [seconds for seconds, _ in calls(run, of_calls, args, repeat, seconds=SECONDS, fewest=FEWEST)]
    tell("looking at errors")
    result, (truncations, failed) = audit(step)(keys.derive(key, "values"), *args)
    error = largest_error(opened(result), subject.expected)
    tell("looking at the gradient")
    gradient_error, no_gradient = _gradient_error(subject, protocol, keys.derive(key, "gradient"), args)
    projected = not (counted.ideal or counted.unbounded)
    unit = 2.0**-protocol.frac_bits
    return Row(
        protocol=str(protocol),
        parties=parties,
        ideal=protocol.ideal,
        seconds=float(np.median(times)),
        calls=len(times),
        compile_seconds=sum(took.values()),
        rounds=counted.rounds,
        bytes_sent=counted.bytes_sent,
        bytes_dealt=counted.bytes_dealt,
        unbounded=counted.unbounded,
        lan_seconds=counted.seconds(LAN) if projected else None,
        wan_seconds=counted.seconds(WAN) if projected else None,
        error=error,
        error_units=error / unit,
        gradient_error=gradient_error,
        gradient_error_units=None if gradient_error is None else gradient_error / unit,
        no_gradient=no_gradient,
        truncations=int(truncations),
        failed=int(failed),
        memory_bytes=_memory(run),
    )


def opened(results: Any) -> list[NDArray[np.float64]]:
    """All results as float64. Secret floats are read as such at once: the fixed point has more digits than a
    float32.
    """

    def wide(x: Any) -> Any:
        return replace(x, dtype=np.dtype(np.float64)) if isinstance(x, Secret) and is_float(x) else x

    results = reveal(jax.tree.map(wide, results, is_leaf=is_secret))
    return [np.asarray(x, np.float64) for x in jax.tree.leaves(results)]


def largest_error(found: list[NDArray[np.float64]], expected: list[NDArray[np.float64]]) -> float:
    """The largest distance; infinite where one is NaN and the other is not. 0 where there is nothing."""
    largest = 0.0
    for x, y in zip(found, expected, strict=True):
        same = (x == y) | (np.isnan(x) & np.isnan(y))
        with np.errstate(invalid="ignore"):
            errors = np.where(same, 0.0, np.abs(x - y))
        largest = max(largest, float(np.max(np.nan_to_num(errors, nan=np.inf, posinf=np.inf), initial=0.0)))
    return largest


def _gradient_error(
    subject: Subject, protocol: Protocol, key: Array, args: tuple[Any, ...]
) -> tuple[float | None, str]:
    """The largest error of the gradient and ""; None and why there is none."""
    if subject.gradient is None:
        return None, subject.no_gradient
    try:
        found = secure(subject.gradient, protocol=protocol)(key, *args)
    except Exception as error:  # a derivative may have no rule where its function has one
        return None, words(error)
    return largest_error(opened(found), subject.expected_gradient), ""


def _memory(run: Any) -> int | None:
    told = run.memory_analysis()
    if told is None:
        return None
    return told.argument_size_in_bytes + told.output_size_in_bytes + told.temp_size_in_bytes
