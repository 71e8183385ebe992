"""Randomness for a part of a program that runs many times, or perhaps not at all.

The part is planned like a program of its own (`Planner`). Its masks must be fresh each time, so the program
asks once, outside, for the randomness of all times:

- `Repeated`: for a known number of times, dealt beforehand, a row for each.
- `OnCall`: for a number that only the run decides; the dealer deals whenever it is called.

Each time, the part draws on a `Supply` of its own. Both nest.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import jax
import jax.numpy as jnp
from jax import Array, lax
from jaxtyping import UInt64

from ciphernav_jax.parties.dealer import Dealer, Plan, deal
from ciphernav_jax.parties.party import AXIS
from ciphernav_jax.parties.requests import Request, Shape, Values
from ciphernav_jax.ring import keys
from ciphernav_jax.ring.random import Generator


@dataclass(frozen=True)
class Repeated(Request):
    """All that `plan` asks for, `times` times over: {"0/mask": [times, *shape], ...}, each value under the
    number of its request in the plan and its name there, and shared as there.
    """

    plan: Plan
    times: int

    def _names(self, kind: str) -> frozenset[str]:
        requests = enumerate(self.plan.requests)
        return frozenset(f"{i}/{name}" for i, request in requests for name in getattr(request, kind))

    def _shapes(self, kind: str) -> dict[str, Shape]:
        return {
            f"{i}/{name}": (self.times, *shape)
            for i, request in enumerate(self.plan.requests)
            for name, shape in getattr(request, kind).items()
        }

    @cached_property
    def uniform(self) -> dict[str, Shape]:
        return self._shapes("uniform")

    @cached_property
    def own(self) -> frozenset[str]:
        return self._names("own")

    @cached_property
    def common(self) -> dict[str, Shape]:
        return self._shapes("common")

    @cached_property
    def binary(self) -> frozenset[str]:
        return self._names("binary")

    def deal(self, uniform: Values, earlier: Sequence[Values]) -> Values:
        def once(uniform: Values) -> Values:
            dealt, found = [], {}
            for i, request in enumerate(self.plan.requests):
                drawn = {name: uniform[f"{i}/{name}"] for name in request.uniform}
                dependent = request.deal(drawn, dealt)
                dealt.append(drawn | dependent)
                found |= {f"{i}/{name}": x for name, x in dependent.items()}
            return found

        # The parties' own words have the party as leading axis, before the times.
        axes = {name: int(name in self.own) for name in uniform}
        return jax.vmap(once, in_axes=(axes,), axis_size=self.times)(uniform)


def take_repeated(dealer: Dealer, plan: Plan, times: int) -> list[Values]:
    """This party's shares for each request of the plan, with a leading axis of length `times`."""
    if not plan.requests:
        return []
    dealt = dealer.take(Repeated(plan, times))
    return [{name: dealt[f"{i}/{name}"] for name in names} for i, names in enumerate(plan.shapes)]


@dataclass(frozen=True)
class OnCall(Request):
    """The number of a session with the dealer, {"seed": [1]}, the same for all parties.

    In a deployment the dealer stays online for the session: at each call it sends every party its part of
    fresh randomness for `plan`. Here the dealer is simulated by whoever runs the program: each copy of it
    expands the seed and keeps its own party's part (`take_on_call`). A party that looked at the other parts
    would learn all masks, so this stands in for an online dealer and must not be deployed as it is.
    """

    plan: Plan

    @cached_property
    def common(self) -> dict[str, Shape]:
        return {"seed": (1,)}


def take_on_call(
    seed: UInt64[Array, "1"], plan: Plan, call: Array, generator: Generator = "threefry"
) -> list[Values]:
    """This party's shares for each request of the plan, fresh for each number `call` of an `OnCall`."""
    with jax.named_scope("dealer:on_call"):
        words = lax.bitcast_convert_type(seed, jnp.uint32).reshape(2)
        key = keys.derive(jax.random.wrap_key_data(words, impl="threefry2x32"), "call", call)
        mine = lax.axis_index(AXIS)
        return jax.tree.map(lambda x: x[mine], deal(key, plan, lax.axis_size(AXIS), generator))
