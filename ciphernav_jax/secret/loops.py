"""Loops and branches inside a function on secrets: `scan`, `while` and `cond`.

`lax.fori_loop` with static bounds and `lax.map` are scans. A branch, or the end of a loop, is decided by
public values alone: a secret one would show in what the parties do next.

Secrets enter a body as shares and nothing else, since a mask is for one iteration. So a secret that does not
change is opened anew in each iteration that multiplies or compares it; to open it once, compute outside the
loop. Between iterations the carry has the precision of a `Secret`: products are truncated. An entry of the
carry is public as long as all iterations leave it so (an index), otherwise secret from the start.

A body's correlated randomness is planned by itself and dealt for all iterations beforehand
(`protocols.repeat`); where only the run decides how many there are, the dealer is on call.

These rules are called as `rule(evaluate, context, *operands, **params)`, where `evaluate(context, jaxpr,
operands)` evaluates a closed jaxpr.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from ciphernav_jax.jax_private import ClosedJaxpr, jaxpr_as_fun, scan_parts
from ciphernav_jax.protocols.dealer import Dealer, Plan, Planner, Supply
from ciphernav_jax.protocols.party import AXIS
from ciphernav_jax.protocols.repeat import OnCall, take_on_call, take_repeated
from ciphernav_jax.secret.rules import Operand, Unsupported, at_rest, frac_bits_at_rest
from ciphernav_jax.secret.value import Context, Value

Evaluate = Callable[[Context, ClosedJaxpr, list[Operand]], list[Operand]]
Part = Callable[[Dealer, Any], list[Operand]]


# --- secrets cross into a body as arrays --------------------------------------------------------------


def _arrays(operands: Sequence[Operand]) -> list[Any]:
    return [x.share if isinstance(x, Value) else x for x in operands]


def _precisions(operands: Sequence[Operand]) -> list[int | None]:
    """The fractional bits of each, None for what is public."""
    return [x.frac_bits if isinstance(x, Value) else None for x in operands]


def _operands(context: Context, arrays: Sequence[Any], precisions: Sequence[int | None]) -> list[Operand]:
    return [
        x if bits is None else Value(context, bits, share=x)
        for x, bits in zip(arrays, precisions, strict=True)
    ]


def _settled(operands: Sequence[Operand]) -> list[Operand]:
    """Truncated before the loop, not in each of its iterations."""
    return [x.settled if isinstance(x, Value) else x for x in operands]


def _rest(
    context: Context, outputs: Sequence[Operand], avals: Sequence[Any], secret: Sequence[bool]
) -> list[Operand]:
    """Outputs with the precision of a `Secret`; those in `secret` made secret where they are not."""
    return [
        at_rest(context, x, aval.dtype) if isinstance(x, Value) or hidden else jnp.asarray(x)
        for x, aval, hidden in zip(outputs, avals, secret, strict=True)
    ]


def _trace(part: Part, inputs: Any) -> tuple[Plan, list[int | None]]:
    """What a part of a program asks the dealer for, and the precisions of its outputs; nothing is run."""
    planner, precisions = Planner(), []

    def traced(inputs):
        outputs = part(planner, inputs)
        precisions[:] = _precisions(outputs)
        return _arrays(outputs)

    jax.eval_shape(traced, inputs)
    return planner.plan(), precisions


# --- loops --------------------------------------------------------------------------------------------


class _Body:
    """The body of a loop: (constants, carry, inputs) -> (carry, outputs).

    Attributes:
        secret: which entries of the carry are secret.
        plan: what one iteration asks the dealer for.
        precisions: of the carry and the outputs.
    """

    def __init__(
        self,
        evaluate: Evaluate,
        context: Context,
        jaxpr: ClosedJaxpr,
        consts: Sequence[Operand],
        start: Sequence[Operand],
        xs: Sequence[Operand] = (),
    ):
        self.evaluate, self.context, self.jaxpr = evaluate, context, jaxpr
        self.consts, self.constant_precisions = _arrays(consts), _precisions(consts)
        self.input_precisions = _precisions(xs)
        self.carry_avals = jaxpr.out_avals[: len(start)]
        self.secret = [isinstance(x, Value) for x in start]
        slices = [jax.ShapeDtypeStruct(x.shape[1:], x.dtype) for x in _arrays(xs)]
        # A public start may become secret in the first iteration, and make others so in the next.
        while True:
            carry = [
                jax.ShapeDtypeStruct(aval.shape, jnp.uint64 if hidden else aval.dtype)
                for aval, hidden in zip(self.carry_avals, self.secret, strict=True)
            ]
            self.plan, self.precisions = _trace(self._iterate, (carry, slices))
            secret = [bits is not None for bits in self.precisions[: len(start)]]
            if secret == self.secret:
                return
            self.secret = secret

    @property
    def resting(self) -> list[int | None]:
        """The precisions of the carry."""
        return [
            frac_bits_at_rest(self.context, aval.dtype) if hidden else None
            for aval, hidden in zip(self.carry_avals, self.secret, strict=True)
        ]

    def start(self, start: Sequence[Operand]) -> list[Any]:
        """The first carry, as arrays."""
        return _arrays(_rest(self.context, start, self.carry_avals, self.secret))

    def _iterate(self, dealer: Dealer, inputs: tuple[list[Any], list[Any]]) -> list[Operand]:
        carry, xs = inputs
        context = replace(self.context, dealer=dealer)
        operands = _operands(
            context,
            [*self.consts, *carry, *xs],
            [*self.constant_precisions, *self.resting, *self.input_precisions],
        )
        outputs = self.evaluate(context, self.jaxpr, operands)
        secret = [*self.secret, *[False] * (len(outputs) - len(carry))]
        return _rest(context, outputs, self.jaxpr.out_avals, secret)

    def __call__(self, shares: Any, carry: list[Any], xs: list[Any]) -> tuple[list[Any], list[Any]]:
        """One iteration, with this party's shares of its randomness."""
        outputs = _arrays(self._iterate(Supply(self.plan, shares), (carry, xs)))
        return outputs[: len(carry)], outputs[len(carry) :]


def scan(
    evaluate: Evaluate,
    context: Context,
    *operands: Operand,
    jaxpr: ClosedJaxpr,
    length: int,
    reverse: bool,
    **params: Any,
) -> list[Operand]:
    """`lax.scan`."""
    parts = scan_parts(params, _settled(operands))
    return _counted(evaluate, context, jaxpr, *parts, length=length, reverse=reverse)


def _counted(
    evaluate: Evaluate,
    context: Context,
    jaxpr: ClosedJaxpr,
    consts: Sequence[Operand],
    start: Sequence[Operand],
    xs: Sequence[Operand] = (),
    *,
    length: int,
    reverse: bool = False,
) -> list[Operand]:
    """A loop of a known length. The randomness of all iterations is dealt before the program starts."""
    body = _Body(evaluate, context, jaxpr, consts, start, xs)
    supply = take_repeated(context.dealer, body.plan, length)
    carry, ys = lax.scan(
        lambda carry, each: body(each[0], carry, each[1]),
        body.start(start),
        (supply, _arrays(xs)),
        length=length,
        reverse=reverse,
    )
    return _operands(context, [*carry, *ys], body.precisions)


def while_loop(
    evaluate: Evaluate,
    context: Context,
    *operands: Operand,
    cond_jaxpr: ClosedJaxpr,
    body_jaxpr: ClosedJaxpr,
    cond_nconsts: int,
    body_nconsts: int,
    **_: Any,
) -> list[Operand]:
    """`lax.while_loop` on a public predicate.

    Where all that the predicate can depend on is known while tracing, the iterations are counted and the loop
    is a `scan`. Otherwise the number of iterations is not known before the run, and the dealer must be on
    call (`protocols.repeat.OnCall`).
    """
    settled = _settled(operands)
    cond_consts, consts, start = (
        settled[:cond_nconsts],
        settled[cond_nconsts : cond_nconsts + body_nconsts],
        settled[cond_nconsts + body_nconsts :],
    )
    body = _Body(evaluate, context, body_jaxpr, consts, start)

    def predicate(dealer: Dealer, carry: list[Any]) -> list[Operand]:
        inner = replace(context, dealer=dealer)
        return evaluate(inner, cond_jaxpr, [*cond_consts, *_operands(inner, carry, body.resting)])

    if any(isinstance(x, Value) for x in cond_consts) or _trace(predicate, body.start(start))[1] != [None]:
        raise Unsupported("when it ends depends on a secret")
    public = [x for x, hidden in zip(start, body.secret, strict=True) if not hidden]
    public += [x for x in (*cond_consts, *consts) if not isinstance(x, Value)]
    if all(isinstance(x, np.ndarray) for x in public):
        length = _iterations(cond_jaxpr, body_jaxpr, cond_consts, consts, start)
        return _counted(evaluate, context, body_jaxpr, consts, start, length=length)
    seed = context.dealer.take(OnCall(body.plan, lax.axis_size(AXIS)))["seed"]

    def iterate(state):
        i, carry = state
        shares = take_on_call(seed, body.plan, i, context.protocol.generator)
        carry, _ = body(shares, carry, [])
        return i + 1, carry

    def goes_on(state):
        (going,) = predicate(Planner(), state[1])
        return going

    _, carry = lax.while_loop(goes_on, iterate, (jnp.uint32(0), body.start(start)))
    return _operands(context, carry, body.precisions)


def _iterations(
    cond_jaxpr: ClosedJaxpr,
    body_jaxpr: ClosedJaxpr,
    cond_consts: Sequence[Operand],
    consts: Sequence[Operand],
    start: Sequence[Operand],
) -> int:
    """How often a loop runs whose predicate depends on nothing secret: run in the clear, on zeros in place of
    the secrets.
    """

    def clear(operands, avals):
        return [
            np.zeros(aval.shape, aval.dtype) if isinstance(x, Value) else x
            for x, aval in zip(operands, avals, strict=True)
        ]

    avals = body_jaxpr.in_avals
    consts, start = clear(consts, avals[: len(consts)]), clear(start, avals[len(consts) :])
    goes_on = jaxpr_as_fun(cond_jaxpr)
    body = jaxpr_as_fun(body_jaxpr)
    with jax.ensure_compile_time_eval():
        count, _ = lax.while_loop(
            lambda state: goes_on(*cond_consts, *state[1])[0],
            lambda state: (state[0] + 1, body(*consts, *state[1])),
            (0, start),
        )
    return int(count)


# --- branches -----------------------------------------------------------------------------------------


def cond(
    evaluate: Evaluate,
    context: Context,
    index: Operand,
    *operands: Operand,
    branches: Sequence[ClosedJaxpr],
    **_: Any,
) -> list[Operand]:
    """`lax.cond` and `lax.switch` on a public index.

    Only the branch taken is run, but the dealer deals for each. An output is secret if any branch makes it
    so. An index that is known while tracing leaves only its branch.
    """
    if isinstance(index, Value):
        raise Unsupported("which branch is taken is secret")
    if isinstance(index, np.ndarray):
        return evaluate(context, branches[int(index)], list(operands))
    settled = _settled(operands)
    arrays, precisions = _arrays(settled), _precisions(settled)

    def branch(jaxpr: ClosedJaxpr, secret: list[bool], dealer: Dealer, arrays: list[Any]) -> list[Operand]:
        inner = replace(context, dealer=dealer)
        outputs = evaluate(inner, jaxpr, _operands(inner, arrays, precisions))
        return _rest(inner, outputs, jaxpr.out_avals, secret)

    secret = [False] * len(branches[0].out_avals)
    while True:
        parts = [partial(branch, jaxpr, secret) for jaxpr in branches]
        traced = [_trace(part, arrays) for part in parts]
        found = [any(of_branch[i] is not None for _, of_branch in traced) for i in range(len(secret))]
        if found == secret:
            break
        secret = found

    def taken(part: Part, plan: Plan, supply: list[dict[str, Array]]) -> Callable[[], list[Any]]:
        def run():
            shares = jax.tree.map(lambda x: x[0], supply)
            return _arrays(part(Supply(plan, shares), arrays))

        return run

    runs = [
        taken(part, plan, take_repeated(context.dealer, plan, 1))
        for part, (plan, _) in zip(parts, traced, strict=True)
    ]
    return _operands(context, lax.switch(index, runs), traced[0][1])


LOOPS = {"scan": scan, "while": while_loop, "cond": cond}
