"""What JAX does not promise to keep: whatever the package needs beyond JAX's public face, at this address
alone, for the oldest JAX that is supported and the newest.

A test reads the sources for strays.
"""

from collections.abc import Iterator, Sequence
from typing import Any

import jax
from jax._src import source_info_util
from jax._src.core import trace_ctx
from jax._src.interpreters.batching import BatchTracer
from jax._src.interpreters.partial_eval import DynamicJaxprTracer
from jax._src.shard_map import ShardMapTrace

# JAX keeps `Tracer` for `isinstance`: whether a value is known while tracing.
from jax.core import Tracer

# The language that programs are read in. Since jax 0.11 `Jaxpr` and `ClosedJaxpr` are one class.
# `get_opaque_trace_state` differs from one trace to another: what one body was dealt is not taken in another.
from jax.extend.core import (
    ClosedJaxpr,
    Jaxpr,
    JaxprEqn,
    Literal,
    Primitive,
    get_opaque_trace_state,
    jaxpr_as_fun,
)

__all__ = [
    "ClosedJaxpr",
    "Jaxpr",
    "JaxprEqn",
    "Literal",
    "Primitive",
    "Tracer",
    "bind",
    "frames",
    "get_opaque_trace_state",
    "is_tracing",
    "jaxpr_as_fun",
    "name_stack",
    "origins",
    "place",
    "scan_parts",
    "side_effects",
    "trace_of",
    "traced_for",
    "traces",
]

# Under `shard_map` that checks what varies, a collective has a primitive of another name.
SUM = frozenset({"psum", "psum_invariant"})
GATHER = frozenset({"all_gather", "all_gather_invariant"})

# Primitives that only wrap a jaxpr, and the parameter that holds it.
INLINED = {
    "jit": "jaxpr",
    "closed_call": "call_jaxpr",
    "custom_jvp_call": "call_jaxpr",
    "custom_vjp_call": "call_jaxpr",
    "remat2": "jaxpr",
}


# The effects of equations that stay within the program: collectives, and references to arrays of its own.
_INNER = {"NamedAxisEffect", "InternalMutableArrayEffect", "ReadEffect", "WriteEffect", "AccumEffect"}

with jax.ensure_compile_time_eval():
    _NO_TRACE = get_opaque_trace_state()


def is_tracing() -> bool:
    """Whether what is called now becomes part of a jaxpr, or of a vmap or a derivative."""
    return get_opaque_trace_state() != _NO_TRACE


def side_effects(x: JaxprEqn | Jaxpr) -> set[str]:
    """What it does beside computing its results, as JAX names it: prints, calls Python."""
    return {type(effect).__name__ for effect in x.effects} - _INNER


def place(eqn: JaxprEqn) -> str:
    """Where the user wrote it: file, line, function."""
    return source_info_util.summarize(eqn.source_info)


def frames(eqn: JaxprEqn) -> list[tuple[str, int, str]]:
    """The lines that led to it outside of JAX, from the innermost out: file, line, function."""
    user_frames = source_info_util.user_frames(eqn.source_info.traceback)
    return [(frame.file_name, frame.start_line, frame.function_name) for frame in user_frames]


def name_stack(eqn: JaxprEqn) -> str:
    """The `jax.named_scope`s around it within its jaxpr, with the transformations that wrap them."""
    return str(eqn.source_info.name_stack)


def bind(eqn: JaxprEqn, operands: Sequence[Any]) -> list[Any]:
    """Applies the equation to other operands; its results, also where it has one."""
    # Some primitives are bound with functions, and hold jaxprs of them.
    results = eqn.primitive.bind(*operands, **eqn.primitive.get_bind_params(eqn.params))
    return list(results) if eqn.primitive.multiple_results else [results]


def scan_parts(params: dict[str, Any], operands: Sequence[Any]) -> tuple[list[Any], list[Any], list[Any]]:
    """A scan's operands as constants, first carry and inputs, from the parameters of its primitive."""
    if "ft_in" in params:  # jax 0.12: the three parts as a tree
        consts, carry, _ = map(len, params["ft_in"].unpack())
    else:
        consts, carry = params["num_consts"], params["num_carry"]
    operands = list(operands)
    return operands[:consts], operands[consts : consts + carry], operands[consts + carry :]


def traces() -> Iterator[Any]:
    """The traces that are under way, from the innermost out."""
    trace = trace_ctx.trace
    while trace is not None:
        yield trace
        trace = getattr(trace, "parent_trace", None)


def traced_for(trace: Any) -> str | None:
    """What a trace makes a jaxpr for: "jit", "scan", "fori_loop", "while_body", "cond", "shard_map" (also
    where none is made), "custom_jvp fun", "custom_vjp fun"; else None.
    """
    if isinstance(trace, ShardMapTrace):
        return "shard_map"
    frame = getattr(trace, "frame", None)
    return None if frame is None or frame.debug_info is None else frame.debug_info.traced_for


def trace_of(x: Tracer) -> Any:
    """The trace that a value belongs to."""
    return x._trace


def origins(x: Tracer) -> list[Any] | None:
    """The values that a traced one was computed from, among them constants and those of other traces; None
    for an input of its trace, and where nobody knows.
    """
    if isinstance(x, BatchTracer):
        return [x.val]
    if not isinstance(x, DynamicJaxprTracer):
        return None
    if x.parent is not None:
        return list(x.parent.in_tracers)
    if isinstance(x.val, Literal):
        return []
    constants = x._trace.frame.constvar_to_val
    return [constants[x.val]] if x.val in constants else None
