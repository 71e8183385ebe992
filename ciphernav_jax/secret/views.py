"""All that parties see in one call, one of them or some together: the material of an attack."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import jax
import numpy as np
from jax import Array

from ciphernav_jax.parties import sharing
from ciphernav_jax.parties.dealer import deal
from ciphernav_jax.parties.recording import Message
from ciphernav_jax.secret.compiled import Compiled
from ciphernav_jax.secret.secured import Secure, require_step


class Seen(NamedTuple):
    """What some parties know together.

    Attributes:
        numbers: uint64 arrays that are shared, or opened, modulo 2^64.
        bits: uint64 arrays that are shared, or opened, by exclusive or.
    """

    numbers: list[Array]
    bits: list[Array]


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class View:
    """A call as all parties see it; a pytree.

    Attributes:
        inputs: uint64[P, ...], the shares of each secret argument.
        dealt: uint64[P, ...], the shares of each of the dealer's values.
        messages: all openings.
        binary: for each of `dealt`, whether it is shared by exclusive or.
    """

    inputs: tuple[Array, ...]
    dealt: tuple[Array, ...]
    messages: tuple[Message, ...]
    binary: tuple[bool, ...] = field(metadata={"static": True})

    def of(self, parties: Sequence[int]) -> Seen:
        """What `parties` know together.

        Their shares are joined, since a sum modulo 2^64 of several parts is what an attacker computes first;
        then come what is opened, and what the others send. Not among it is what they hold in the clear.
        """
        own = np.asarray(parties)
        others = np.setdiff1d(np.arange(len(self.inputs[0])), own)
        seen = Seen([sharing.join_sum(shares[own]) for shares in self.inputs], [])
        for shares, binary in zip(self.dealt, self.binary, strict=True):
            seen[binary].append((sharing.join_xor if binary else sharing.join_sum)(shares[own]))
        for message in self.messages:
            words = seen[message.opening.collective == "open_xor"]
            words += [message.opened, *message.sent[others]]
        return seen


def view(step: Secure) -> Callable[..., tuple[Any, View]]:
    """The function with all that passes, as `transcript`, and what the parties are given besides.

    Returns:
        `observed(key, *args) -> (result, View)`: the result of `step(key, *args)` bit for bit. Jitted; works
        under `jax.vmap`, over keys say.

    Raises:
        TypeError: `step` was not made by `secure`.
        NotImplementedError (when called): something is opened in a `lax.cond` or a `lax.while_loop`.
    """
    require_step(step)

    @Compiled
    def evaluate(key, given):
        call = step.call(given)
        results, messages = call.recorded(key)
        needed = call.plan()
        supply = deal(key, needed, call.parties, step.protocol.generator)
        named = [
            (shares, name in request.binary)
            for request, values in zip(needed.requests, supply, strict=True)
            for name, shares in values.items()
        ]
        dealt, binary = zip(*named, strict=True) if named else ((), ())
        return results, View(tuple(call.private), dealt, messages, binary)

    def observed(key: Array, *args: Any, **kwargs: Any) -> tuple[Any, View]:
        return evaluate(key, step.checked(key, *args, **kwargs))

    return observed
