"""Selection: one of several entries, by a secret bit or by what is larger."""

from functools import partial

import jax.numpy as jnp
import numpy as np
from jax import lax

from ciphernav_jax.secret.rules.comparisons import adds_nothing, beyond, comparable
from ciphernav_jax.secret.rules.operands import Operand, is_zero, to_value
from ciphernav_jax.secret.rules.products import OneOfTwo
from ciphernav_jax.secret.rules.registry import Unsupported, rule
from ciphernav_jax.secret.value import Context, Value, join, where


def _never_chosen(context: Context, x: Operand, y: Operand, above: bool) -> Operand | None:
    """The other operand where one is a constant above all secrets, or with `above` false below them."""
    for secret, public in ((x, y), (y, x)):
        if isinstance(secret, Value) and beyond(public, secret):
            shape = np.broadcast_shapes(secret.shape, np.shape(public))
            if np.all(public > 0 if above else public < 0):
                return secret.moved(partial(jnp.broadcast_to, shape=shape))
            if np.all(public < 0 if above else public > 0):
                return np.broadcast_to(public, shape)
    return None


@rule("max")
def _max(context: Context, x: Operand, y: Operand) -> Operand:
    """relu(x - y) + y, with a y that is public or waits for no truncation: the same in both places."""
    chosen = _never_chosen(context, x, y, above=False)
    if chosen is not None:
        return chosen
    larger = _larger(comparable(context, x), comparable(context, y))
    larger.choice = x, y, True
    return larger


def _larger(above: Value, base: Value) -> Value:
    if above.waits and base.waits:
        above, base = above.settled, base.settled
    if above.public is not None or base.waits:
        above, base = base, above
    if adds_nothing(base, above):
        return above.relu
    larger = above.compared(base).relu.add(base)
    bound = max(v.bound_at(larger.frac_bits) for v in (above, base))
    return Value(larger.context, larger.frac_bits, bound, share=larger.share)


@rule("min")
def _min(context: Context, x: Operand, y: Operand) -> Operand:
    chosen = _never_chosen(context, x, y, above=True)
    if chosen is not None:
        return chosen
    smaller = _larger(comparable(context, x).negated(), comparable(context, y).negated()).negated()
    smaller.choice = x, y, False
    return smaller


@rule("clamp")
def _clamp(context: Context, low: Operand, x: Operand, high: Operand) -> Operand:
    if not isinstance(x, Value):
        raise Unsupported("a bound is secret and the value public; write jnp.minimum and jnp.maximum")
    return _min(context, _max(context, x, low), high)


@rule("abs")
def _abs(context: Context, x: Value) -> Value:
    x = x.settled
    return Value(context, x.frac_bits, x.bound, share=(x.relu.share << 1) - x.share)


@rule("select_n", moves=True)
def _select(context: Context, which: Operand, *cases: Operand) -> Operand:
    if not isinstance(which, Value):
        if isinstance(which, np.ndarray) and which.size and np.all(which == which.flat[0]):
            return cases[int(which.flat[0])]
        return join(partial(lax.select_n_p.bind, which), *[to_value(context, case) for case in cases])
    if len(cases) != 2:
        raise Unsupported(f"a secret index selects among {len(cases)} cases; only two are supported")
    on_false, on_true = cases
    if isinstance(on_true, Value) and is_zero(on_false):
        return which.times(on_true)
    if not isinstance(on_true, Value) and not isinstance(on_false, Value):
        return OneOfTwo(context, which, on_false, on_true)
    return where(which, to_value(context, on_true), to_value(context, on_false))
