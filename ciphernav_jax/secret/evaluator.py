"""A jaxpr on secrets: equation by equation, by the rule of each primitive (`rules`)."""

from contextlib import nullcontext
from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ciphernav_jax import jax_private
from ciphernav_jax.jax_private import ClosedJaxpr, Jaxpr, JaxprEqn, Literal, Tracer
from ciphernav_jax.parties.jaxprs import wrapped
from ciphernav_jax.secret import integers
from ciphernav_jax.secret.findings import NotUsable
from ciphernav_jax.secret.places import place
from ciphernav_jax.secret.rules import CONTROL_FLOW, MOVES, RULES, Unsupported
from ciphernav_jax.secret.value import Context, Value


def evaluate(context: Context, jaxpr: Jaxpr, consts: list[Any], args: list[Any]) -> list[Any]:
    """Evaluates a jaxpr on secret `Value`s and public arrays; public-only parts run as plain JAX."""
    env: dict[Any, Any] = {}

    def read(atom):
        return np.asarray(atom.val) if isinstance(atom, Literal) else env[atom]

    def write(variables, values):
        env.update(zip(variables, values, strict=True))

    write(jaxpr.constvars, [x if isinstance(x, Tracer) else np.asarray(x) for x in consts])
    write(jaxpr.invars, args)
    for eqn in jaxpr.eqns:
        operands = [read(atom) for atom in eqn.invars]
        if not any(isinstance(x, Value) for x in operands):
            write(eqn.outvars, _evaluate_public(eqn, operands))
            continue
        here = replace(context, place=place(eqn, context.place), eqn=eqn)
        if (inner := wrapped(eqn)) is not None:
            write(eqn.outvars, evaluate(here, *inner, operands))
        else:
            write(eqn.outvars, _evaluate_secret(here, eqn, operands))
    return [read(atom) for atom in jaxpr.outvars]


def evaluate_closed(context: Context, jaxpr: ClosedJaxpr, args: list[Any]) -> list[Any]:
    return evaluate(context, jaxpr.jaxpr, jaxpr.consts, args)


def _evaluate_public(eqn: JaxprEqn, operands: list[Any]) -> list[Any]:
    """A step on public values alone; what is known while tracing stays known, as a numpy array."""
    if all(isinstance(x, np.ndarray) for x in operands):
        with jax.ensure_compile_time_eval():
            return jax.tree.map(_known, jax_private.bind(eqn, operands))
    return jax_private.bind(eqn, operands)


def _known(x: Any) -> Any:
    """A numpy array, but for random keys, which have none."""
    return x if jnp.issubdtype(x.dtype, jax.dtypes.extended) else np.asarray(x)


def _evaluate_secret(context: Context, eqn: JaxprEqn, operands: list[Any]) -> list[Any]:
    """A step on secrets, by its rule, told to the witness where there is one."""
    name = eqn.primitive.name
    witness = None if context.composed else context.witness
    if witness:
        witness.at(name, context.place)
    result = _apply_rule(context, eqn, operands)
    of_rule = list(result) if eqn.primitive.multiple_results else [result]
    # Of arrays without axes numpy makes numbers, which would not count as known.
    results: list[Any] = [np.asarray(x) if isinstance(x, np.generic) else x for x in of_rule]
    for poisoned in [x.poisoned for x in operands if isinstance(x, Value) and x.poisoned is not None]:
        if name in MOVES:
            for x in results:
                if isinstance(x, Value):  # and not what a constant chose beside it
                    x.poisoned = poisoned if x.poisoned is None else poisoned | x.poisoned
        else:
            context.find(f"`{name}` computes with what was read at an index out of range: NaN", poisoned)
    if witness and name not in CONTROL_FLOW:  # the equations of the bodies have told it
        witness.evaluated(eqn, operands, results)
    return results


def _apply_rule(context: Context, eqn: JaxprEqn, operands: list[Any]) -> Any:
    name = eqn.primitive.name
    try:
        if name not in RULES:
            raise Unsupported("it has no rule")
        with nullcontext() if context.composed else jax.named_scope(f"primitive:{name}"):
            if name in CONTROL_FLOW:
                with jax.named_scope(f"at:{context.place.short}"):  # for who reads the program
                    return RULES[name](context, *operands, **eqn.params)
            _check_dtype(name, eqn)
            looked_at = integers.looked_at(eqn, operands)
            return integers.of_its_type(eqn, RULES[name](context, *looked_at, **eqn.params))
    except integers.BelowZero:
        raise NotImplementedError(
            f"cannot evaluate `{name}` on secret uint64s: the result may fall below 0 and wrap around, where "
            f"it could not be compared. It comes from {context.place}. Convert to int64 first."
        ) from None
    except NotUsable as problem:
        raise ValueError(f"{problem}, in `{name}`. It comes from {context.place}.") from None
    except Unsupported as problem:
        raise NotImplementedError(
            f"cannot evaluate `{name}` on secrets: {problem}. It comes from {context.place}. {_way_out(name)}"
        ) from None


# Operations that mean something else for integers.
BITS_ALONE = {"and", "or", "xor", "not", "reduce_and", "reduce_or"}
FLOATS_ALONE = {"div"}


def _check_dtype(name: str, eqn: JaxprEqn) -> None:
    dtype = eqn.invars[0].aval.dtype  # pyright: ignore[reportAttributeAccessIssue]
    if name in BITS_ALONE and dtype != np.bool_:
        raise Unsupported(f"it works on the bits of a secret {dtype}; only bools have a rule")
    if name in FLOATS_ALONE and not jnp.issubdtype(dtype, np.floating):
        raise Unsupported(f"the quotient of a secret {dtype} is rounded; only floats have a rule")


WAYS_OUT = {
    "exp": "Train with a squared loss and open the logits, or approximate it by a polynomial.",
    "log": "Train with a squared loss, or approximate it by a polynomial.",
    "logistic": "Use ReLU, or a piecewise linear sigmoid: jnp.clip(x / 4 + 0.5, 0, 1).",
    "tanh": "Use ReLU, or the piecewise linear jnp.clip(x, -1, 1).",
    "sqrt": "Keep the square, or reveal it where that is agreed.",
    "conv_general_dilated": "Write the convolution as a product of patches (stacked slices) with the kernel.",
    "while": "Loop a public number of times and keep what is done with jnp.where: the end of a loop shows.",
    "cond": "Compute all branches and select with jnp.where: a branch taken on a secret shows which it was.",
}


DEFAULT_WAY_OUT = (
    "Compute it on public values before sharing, or build it from what has a rule: sums, products, powers, "
    "ReLU, max, min, abs, sign, comparisons, jnp.where, arg max, indexing by public indices, reshaping, and "
    "loops and branches that public values decide (all of them: ciphernav_jax.secret.rules)."
)


def _way_out(name: str) -> str:
    return WAYS_OUT.get(name, DEFAULT_WAY_OUT)
