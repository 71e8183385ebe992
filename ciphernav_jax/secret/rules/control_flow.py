"""Loops and branches inside a function on secrets: `scan`, `while` and `cond`.

`lax.fori_loop` with static bounds and `lax.map` are scans. A branch, or the end of a loop, is decided by
public values alone: a secret one would show in what the parties do next.

Secrets enter a body as shares and nothing else, since a mask is for one iteration. So a secret that does not
change is opened anew in each iteration that multiplies or compares it; to open it once, compute outside the
loop. Between iterations the carry has the precision of a `Secret`: products are truncated. An entry of the
carry is public as long as all iterations leave it so (an index), otherwise secret from the start.

A body's correlated randomness is planned by itself and dealt for all iterations beforehand
(`parties.repeat`); where only the run decides how many there are, the dealer is on call.

Where a witness stands beside the program (`secret.witness`), a secret crosses with its reference, and what is
noted in a body or a branch leaves it as outputs do.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from ciphernav_jax.jax_private import ClosedJaxpr, jaxpr_as_fun, scan_parts
from ciphernav_jax.parties.dealer import Dealer, Plan, Planner, Supply
from ciphernav_jax.parties.repeat import OnCall, take_on_call, take_repeated
from ciphernav_jax.secret import bounds
from ciphernav_jax.secret.findings import Findings
from ciphernav_jax.secret.rules.operands import Operand, at_rest, frac_bits_at_rest
from ciphernav_jax.secret.rules.registry import Unsupported, rule
from ciphernav_jax.secret.value import Context, Value
from ciphernav_jax.secret.witness import Notes

Noted = tuple[Notes | None, Findings]
Part = Callable[[Dealer, Any], tuple[list[Operand], Noted]]


# --- secrets cross into a body as arrays --------------------------------------------------------------


def _arrays(operands: Sequence[Operand]) -> list[Any]:
    """Of a secret its share and its reference, if it has one."""
    return [(x.share, x.reference) if isinstance(x, Value) else x for x in operands]


class Precision(NamedTuple):
    """What is known of a secret while tracing: its fractional bits and its bound."""

    frac_bits: int
    bound: int


def _precisions(operands: Sequence[Operand]) -> list[Precision | None]:
    """The precision of each, None for what is public."""
    return [Precision(x.frac_bits, x.bound) if isinstance(x, Value) else None for x in operands]


def _operands(
    context: Context, arrays: Sequence[Any], precisions: Sequence[Precision | None]
) -> list[Operand]:
    def operand(x: Any, precision: Precision | None) -> Operand:
        if precision is None:
            return x
        share, reference = x
        return _referred(Value(context, *precision, share=share), reference)

    return [operand(x, precision) for x, precision in zip(arrays, precisions, strict=True)]


def _referred(x: Value, reference: Array | None) -> Value:
    x.reference = reference
    return x


def _settled(operands: Sequence[Operand]) -> list[Operand]:
    """Truncated before the loop, not in each of its iterations."""
    return [_referred(x.settled, x.reference) if isinstance(x, Value) else x for x in operands]


def _rest(
    context: Context, outputs: Sequence[Operand], avals: Sequence[Any], secret: Sequence[bool]
) -> list[Operand]:
    """Outputs with the precision of a `Secret`; those in `secret` made secret where they are not."""

    def rest(x: Operand, dtype: np.dtype, hidden: bool) -> Operand:
        if not isinstance(x, Value) and not hidden:
            return jnp.asarray(x)
        reference = context.witness and context.witness.reference(x, dtype)
        return _referred(at_rest(context, x, dtype), reference)

    return [rest(x, aval.dtype, hidden) for x, aval, hidden in zip(outputs, avals, secret, strict=True)]


def _resting(context: Context, dtype: np.dtype) -> Precision:
    return Precision(frac_bits_at_rest(context, dtype), bounds.at_rest(context.protocol, dtype))


def _abstract(context: Context, aval: Any, hidden: bool) -> Any:
    """The shapes with which an operand crosses."""
    if not hidden:
        return jax.ShapeDtypeStruct(aval.shape, aval.dtype)
    reference = context.witness and context.witness.abstract_reference(aval)
    return jax.ShapeDtypeStruct(aval.shape, jnp.uint64), reference


@dataclass(frozen=True)
class _Traced:
    """What is known of a part of a program before it is run.

    Attributes:
        plan: what it asks the dealer for.
        precisions: of its outputs.
        notes: the shapes of the notes that are taken of it.
    """

    plan: Plan
    precisions: list[Precision | None]
    notes: Noted

    @property
    def no_notes(self) -> Noted:
        """Those of no run at all."""
        return jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), self.notes)


def _trace(part: Part, inputs: Any) -> _Traced:
    """Traces a part of a program; nothing is run. What is known of its inputs stays known, as in the run."""
    planner, precisions = Planner(), []
    leaves, tree = jax.tree.flatten(inputs)
    known = {i: x for i, x in enumerate(leaves) if isinstance(x, np.ndarray)}

    def traced(leaves):
        inputs = jax.tree.unflatten(tree, [known.get(i, x) for i, x in enumerate(leaves)])
        outputs, notes = part(planner, inputs)
        precisions[:] = _precisions(outputs)
        return notes

    notes = jax.eval_shape(traced, leaves)
    return _Traced(planner.plan(), precisions, notes)


def _inside(context: Context, dealer: Dealer) -> Context:
    """The context of a part that is traced by itself."""
    return replace(context, dealer=dealer, witness=context.witness and context.witness.inside(), findings=[])


def _merged(noted: Noted, other: Noted) -> Noted:
    (notes, findings), (more, others) = noted, other
    return notes.merged(more) if notes and more else None, findings.merged(others)


def _include(context: Context, noted: Noted) -> None:
    notes, findings = noted
    if context.witness and notes:
        context.witness.include(notes)
    context.findings.append(findings)


# --- loops --------------------------------------------------------------------------------------------


class _Body:
    """The body of a loop: (constants, carry, inputs) -> (carry, outputs).

    Attributes:
        secret: which entries of the carry are secret.
        traced: what is known of one iteration; its outputs are the carry and the outputs of the body.
    """

    def __init__(
        self,
        context: Context,
        jaxpr: ClosedJaxpr,
        consts: Sequence[Operand],
        start: Sequence[Operand],
        xs: Sequence[Operand] = (),
    ):
        self.context, self.jaxpr = context, jaxpr
        self.consts, self.constant_precisions = _arrays(consts), _precisions(consts)
        self.input_precisions = _precisions(xs)
        self.carry_avals = jaxpr.out_avals[: len(start)]
        self.secret = [isinstance(x, Value) for x in start]
        slices = jax.tree.map(lambda x: jax.ShapeDtypeStruct(x.shape[1:], x.dtype), _arrays(xs))
        # A public start may become secret in the first iteration, and make others so in the next.
        while True:
            carry = [
                _abstract(context, aval, hidden)
                for aval, hidden in zip(self.carry_avals, self.secret, strict=True)
            ]
            self.traced = _trace(self._iterate, (carry, slices))
            secret = [bits is not None for bits in self.traced.precisions[: len(start)]]
            if secret == self.secret:
                return
            self.secret = secret

    @property
    def resting(self) -> list[Precision | None]:
        """The precisions of the carry, which may have become as large as a result may be."""
        return [
            _resting(self.context, aval.dtype) if hidden else None
            for aval, hidden in zip(self.carry_avals, self.secret, strict=True)
        ]

    def start(self, start: Sequence[Operand]) -> list[Any]:
        """The first carry, as arrays."""
        return _arrays(_rest(self.context, start, self.carry_avals, self.secret))

    def _iterate(self, dealer: Dealer, inputs: tuple[list[Any], list[Any]]) -> tuple[list[Operand], Noted]:
        carry, xs = inputs
        context = _inside(self.context, dealer)
        operands = _operands(
            context,
            [*self.consts, *carry, *xs],
            [*self.constant_precisions, *self.resting, *self.input_precisions],
        )
        outputs = context.evaluate(self.jaxpr, operands)
        secret = [*self.secret, *[False] * (len(outputs) - len(carry))]
        return _rest(context, outputs, self.jaxpr.out_avals, secret), context.notes()

    def __call__(
        self, shares: Any, state: tuple[list[Any], Noted], xs: list[Any]
    ) -> tuple[tuple[list[Any], Noted], list[Any]]:
        """One iteration, with this party's shares of its randomness. The state is the carry, and the notes of
        all iterations so far.
        """
        carry, notes = state
        operands, more = self._iterate(Supply(self.traced.plan, shares), (carry, xs))
        outputs = _arrays(operands)
        return (outputs[: len(carry)], _merged(notes, more)), outputs[len(carry) :]


@rule("scan", control_flow=True)
def scan(
    context: Context,
    *operands: Operand,
    jaxpr: ClosedJaxpr,
    length: int,
    reverse: bool,
    **params: Any,
) -> list[Operand]:
    """`lax.scan`."""
    parts = scan_parts(params, _settled(operands))
    return _counted(context, jaxpr, *parts, length=length, reverse=reverse)


def _counted(
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
    body = _Body(context, jaxpr, consts, start, xs)
    supply = take_repeated(context.dealer, body.traced.plan, length)
    (carry, notes), ys = lax.scan(
        lambda state, each: body(each[0], state, each[1]),
        (body.start(start), body.traced.no_notes),
        (supply, _arrays(xs)),
        length=length,
        reverse=reverse,
    )
    _include(context, notes)
    return _operands(context, [*carry, *ys], [*body.resting, *body.traced.precisions[len(start) :]])


@rule("while", control_flow=True)
def while_loop(
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
    call (`parties.repeat.OnCall`).
    """
    if cond_jaxpr.out_avals[0].shape:
        any_cond, each_body = _of_each_entry(cond_jaxpr, body_jaxpr, cond_nconsts, body_nconsts)
        return while_loop(
            context,
            *(*operands[:cond_nconsts], *operands),
            cond_jaxpr=any_cond,
            body_jaxpr=each_body,
            cond_nconsts=cond_nconsts,
            body_nconsts=cond_nconsts + body_nconsts,
        )
    settled = _settled(operands)
    cond_consts, consts, start = (
        settled[:cond_nconsts],
        settled[cond_nconsts : cond_nconsts + body_nconsts],
        settled[cond_nconsts + body_nconsts :],
    )
    body = _Body(context, body_jaxpr, consts, start)

    def predicate(dealer: Dealer, carry: list[Any]) -> tuple[list[Operand], Noted]:
        inner = replace(context, dealer=dealer, witness=None, findings=[])
        operands = [*cond_consts, *_operands(inner, carry, body.resting)]
        return inner.evaluate(cond_jaxpr, operands), inner.notes()

    secret = any(isinstance(x, Value) for x in cond_consts)
    if secret or _trace(predicate, body.start(start)).precisions != [None]:
        raise Unsupported("when it ends depends on a secret")
    public = [x for x, hidden in zip(start, body.secret, strict=True) if not hidden]
    public += [x for x in (*cond_consts, *consts) if not isinstance(x, Value)]
    if all(isinstance(x, np.ndarray) for x in public):
        length = _iterations(cond_jaxpr, body_jaxpr, cond_consts, consts, start)
        return _counted(context, body_jaxpr, consts, start, length=length)
    seed = context.dealer.take(OnCall(body.traced.plan))["seed"]

    def iterate(state):
        i, state = state
        shares = take_on_call(seed, body.traced.plan, i, context.protocol.generator)
        state, _ = body(shares, state, [])
        return i + 1, state

    def goes_on(state):
        _, (carry, _) = state
        (going,), _ = predicate(Planner(), carry)
        return going

    begin = (body.start(start), body.traced.no_notes)
    _, (carry, notes) = lax.while_loop(goes_on, iterate, (jnp.uint32(0), begin))
    _include(context, notes)
    return _operands(context, carry, body.resting)


def _of_each_entry(
    cond_jaxpr: ClosedJaxpr, body_jaxpr: ClosedJaxpr, cond_nconsts: int, body_nconsts: int
) -> tuple[ClosedJaxpr, ClosedJaxpr]:
    """A vmapped loop whose entries end at different times: it goes on while any does, and entries that have
    ended stay as they are. The body has the predicate's constants in front of its own.
    """
    goes_on, step = jaxpr_as_fun(cond_jaxpr), jaxpr_as_fun(body_jaxpr)

    def any_goes_on(*operands: Array) -> Array:
        return jnp.any(goes_on(*operands)[0])

    def body(*operands: Array) -> list[Array]:
        cond_consts, consts = operands[:cond_nconsts], operands[cond_nconsts:][:body_nconsts]
        carry = operands[cond_nconsts + body_nconsts :]
        (going,) = goes_on(*cond_consts, *carry)
        return [
            lax.select_n(lax.broadcast_in_dim(going, old.shape, range(going.ndim)), old, new)
            for old, new in zip(carry, step(*consts, *carry), strict=True)
        ]

    cond_avals, carry_avals = cond_jaxpr.in_avals, body_jaxpr.in_avals
    return (
        jax.make_jaxpr(any_goes_on)(*cond_avals),
        jax.make_jaxpr(body)(*cond_avals[:cond_nconsts], *carry_avals),
    )


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


def repeated(
    context: Context, body: Callable[[Context, list[Value]], list[Value]], values: list[Value], times: int
) -> list[Value]:
    """`body` applied `times` times over, in one loop; it keeps shapes, precisions and bounds, and truncates
    nothing.
    """
    precisions = _precisions(values)

    def part(dealer: Dealer, arrays: list[Any]) -> tuple[list[Operand], Noted]:
        inner = replace(context, dealer=dealer, witness=None, findings=[])
        outputs = body(inner, _operands(inner, arrays, precisions))  # pyright: ignore[reportArgumentType]
        return list(outputs), inner.notes()

    plan = _trace(part, _arrays(values)).plan

    def once(arrays: list[Any], shares: Any) -> tuple[list[Any], None]:
        return _arrays(part(Supply(plan, shares), arrays)[0]), None

    arrays, _ = lax.scan(once, _arrays(values), take_repeated(context.dealer, plan, times), length=times)
    return _operands(context, arrays, precisions)  # pyright: ignore[reportReturnType]


# --- branches -----------------------------------------------------------------------------------------


@rule("cond", control_flow=True)
def cond(
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
        return context.evaluate(branches[int(index)], list(operands))
    settled = _settled(operands)
    arrays, precisions = _arrays(settled), _precisions(settled)

    def branch(
        jaxpr: ClosedJaxpr, secret: list[bool], dealer: Dealer, arrays: list[Any]
    ) -> tuple[list[Operand], Noted]:
        inner = _inside(context, dealer)
        outputs = inner.evaluate(jaxpr, _operands(inner, arrays, precisions))
        return _rest(inner, outputs, jaxpr.out_avals, secret), inner.notes()

    secret = [False] * len(branches[0].out_avals)
    while True:
        parts = [partial(branch, jaxpr, secret) for jaxpr in branches]
        traced = [_trace(part, arrays) for part in parts]
        of_all = zip(*(part.precisions for part in traced), strict=True)
        found = [any(bits is not None for bits in of_branches) for of_branches in of_all]
        if found == secret:
            break
        secret = found

    def taken(number: int, supply: list[dict[str, Array]]) -> Callable[[], tuple[list[Any], list[Any]]]:
        def run():
            shares = jax.tree.map(lambda x: x[0], supply)
            operands, notes = parts[number](Supply(traced[number].plan, shares), arrays)
            others = [x.no_notes for x in traced]
            return _arrays(operands), [*others[:number], notes, *others[number + 1 :]]

        return run

    runs = [taken(i, take_repeated(context.dealer, x.plan, 1)) for i, x in enumerate(traced)]
    outputs, noted = lax.switch(index, runs)
    for notes in noted:
        _include(context, notes)
    of_all = zip(*(part.precisions for part in traced), strict=True)
    largest = [of[0] and max(of, key=lambda x: x.bound) for of in of_all]
    return _operands(context, outputs, largest)
