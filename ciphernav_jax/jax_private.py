"""What JAX does not promise to keep: whatever the package needs beyond JAX's public face, at this address
alone, for the oldest JAX that is supported and the newest.

A test reads the sources for strays.
"""

import weakref
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import jax
import numpy as np
from jax._src import core, dtypes, source_info_util, tree_util
from jax._src.core import trace_ctx
from jax._src.interpreters import mlir, pxla
from jax._src.interpreters.batching import BatchTracer
from jax._src.interpreters.partial_eval import DynamicJaxprTracer, dce_jaxpr
from jax._src.random import prng
from jax._src.shard_map import ShardMapTrace
from jax._src.sharding_impls import physical_sharding

# JAX keeps `Tracer` for `isinstance`: whether a value is known while tracing.
from jax.core import Tracer
from jax.experimental.compilation_cache import compilation_cache

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
    "Sealed",
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
    "sealed_by",
    "side_effects",
    "trace_of",
    "traced_for",
    "traces",
    "without_compilation_cache",
    "without_dead_code",
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


def without_dead_code(jaxpr: Jaxpr) -> Jaxpr:
    """The jaxpr without the equations, and the results of inner ones, that none of its results is made of."""
    return dce_jaxpr(jaxpr, [True] * len(jaxpr.outvars), instantiate=True)[0]


def scan_parts(params: dict[str, Any], operands: Sequence[Any]) -> tuple[list[Any], list[Any], list[Any]]:
    """A scan's operands as constants, first carry and inputs, from the parameters of its primitive."""
    if "ft_in" in params:  # jax 0.12: the three parts as a tree
        consts, carry, _ = map(len, params["ft_in"].unpack())
    else:
        consts, carry = params["num_consts"], params["num_carry"]
    operands = list(operands)
    return operands[:consts], operands[consts : consts + carry], operands[consts + carry :]


@contextmanager
def without_compilation_cache() -> Iterator[None]:
    """Within it nothing compiled is read from the persistent compilation cache, or kept there; afterwards it
    is as the user set it.
    """
    # JAX looks at the setting once, and again after a reset. No entry is lost by it: they are files.
    before = jax.config.jax_enable_compilation_cache  # pyright: ignore[reportAttributeAccessIssue]
    jax.config.update("jax_enable_compilation_cache", False)
    compilation_cache.reset_cache()
    try:
        yield
    finally:
        jax.config.update("jax_enable_compilation_cache", before)
        compilation_cache.reset_cache()


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


def _no_numbers(*_: Any) -> Any:
    raise TypeError("the seal of a Secret is no random key")


class _SealType(prng.KeyTy):
    """Of no numbers: JAX moves arrays of it, as it does with those of random keys, and computes with none."""

    class type(dtypes.extended):
        pass

    class _rules(prng.KeyTyRules):
        @staticmethod
        def full(shape: tuple[int, ...], *_: Any) -> "Sealed":
            return Sealed(shape)

        @staticmethod
        def result_handler(*_: Any) -> Any:
            return lambda _, words: Sealed.holding(words)

        @staticmethod
        def global_sharded_result_handler(aval: Any, sharding: Any, committed: bool) -> Any:
            of_words = pxla.global_result_handlers[core.ShapedArray]
            words = of_words(core.physical_aval(aval), physical_sharding(aval, sharding), committed)
            return words.wrap(Sealed.holding)

        @staticmethod
        def make_sharded_array(aval: Any, *_: Any) -> "Sealed":
            return Sealed(aval.shape)

    def __init__(self):
        super().__init__(prng.PRNGImpl((1,), *[_no_numbers] * 4, name="seal", tag="seal"))

    @property
    def name(self) -> str:
        return "seal"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _SealType)

    def __hash__(self) -> int:
        return hash(_SealType)


class Sealed(prng.PRNGKeyArray):
    """An array without bytes of a dtype of its own, `seal`, that can be moved and not computed with. JAX
    dispatches it as fast as numbers.
    """

    _dtype = _SealType()

    def __init__(self, shape: tuple[int, ...]):
        super().__init__(self._dtype._impl, np.zeros((*shape, 1), np.uint32))

    @classmethod
    def holding(cls, words: Any) -> "Sealed":
        """What JAX represents by these words."""
        sealed = cls.__new__(cls)
        sealed._impl, sealed._consumed, sealed._base_array = cls._dtype._impl, False, words
        return sealed

    @property
    def dtype(self) -> Any:
        return self._dtype

    @property
    def aval(self) -> Any:
        aval = core.ShapedArray(self.shape, self._dtype)
        return core.update_aval_with_sharding(aval, self.sharding, mat=self._base_array.aval.mat)

    def __init_subclass__(cls):
        _register(cls)


def sealed_by(x: Any) -> set[str]:
    """The primitives that a traced seal, and the seals that it was made of, came out of, in the trace and in
    functions that it calls; as far as anybody knows.
    """
    found: set[str] = set()
    seen: set[int] = set()
    left = [x]
    while left:
        x = left.pop()
        if id(x) in seen or not _is_seal(getattr(x, "aval", None)):
            continue
        seen.add(id(x))
        if isinstance(x, BatchTracer):
            left.append(x.val)
        elif isinstance(x, DynamicJaxprTracer) and x.parent is not None:
            found |= _sealing(x.parent)
            left += x.parent.in_tracers
    return found


def _is_seal(aval: Any) -> bool:
    return isinstance(getattr(aval, "dtype", None), _SealType)


def _sealing(eqn: Any) -> set[str]:
    """The primitives that make seals in an equation."""
    inner = list(core.jaxprs_in_params(eqn.params))
    return set().union(*map(_made, inner)) if inner else {eqn.primitive.name}


def _made(jaxpr: Jaxpr) -> set[str]:
    if jaxpr not in _made_in:
        sealing = [eqn for eqn in jaxpr.eqns if any(_is_seal(v.aval) for v in eqn.outvars)]
        _made_in[jaxpr] = set().union(*map(_sealing, sealing))
    return _made_in[jaxpr]


_made_in: "weakref.WeakKeyDictionary[Jaxpr, set[str]]" = weakref.WeakKeyDictionary()


def _register(cls: type[Sealed]) -> None:
    """As JAX registers the class of its keys."""
    core.pytype_aval_mappings[cls] = core.pytype_aval_mappings[prng.PRNGKeyArray]
    dtypes.register_canonicalize_value_handler(cls, None)
    pxla.shard_arg_handlers[cls] = pxla.shard_arg_handlers[prng.PRNGKeyArray]
    mlir.register_constant_handler(cls, prng.key_array_constant_handler)
    tree_util.dispatch_registry.register_node(
        cls, lambda x: ((x._base_array,), None), lambda _, words: cls.holding(*words)
    )


_register(Sealed)
