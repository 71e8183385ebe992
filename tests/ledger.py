"""A ledger of masks: every stream of uniform words that a run draws, and what its words hide.

A stream is a key's data and a generator; its counter always starts at 0, so two draws under one key overlap
in all words of the shorter one, whatever each was drawn for. Drawn again for the same values, it hides
nothing new: a training that goes on after a kill repeats its last steps to the bit. For other values it is a
fault. What a stream hides is: of `share` the encoded values; of a step its function and all arguments, public
ones too; of a dealer on call the number of the iteration besides.

The words are noted as they are drawn (`jax.debug.callback`): in jitted code, in each iteration of a loop, in
the branch that is taken, for each entry of a `vmap`.
"""

import contextlib
import functools
import hashlib
import inspect
import math
from collections import defaultdict
from collections.abc import Iterator
from typing import Any

import jax
import numpy as np
import pytest

from ciphernav_jax import ring
from ciphernav_jax.parties import sharing
from ciphernav_jax.secret import costs
from ciphernav_jax.secret.rules import control_flow
from ciphernav_jax.secret.secured import Secure

Stream = tuple[bytes, str]


class Ledger:
    """What was drawn, and for what.

    Attributes:
        hidden: of each stream (key data, generator) the digests of what it hid, each with its purposes and
            the ranges of the counter.
    """

    def __init__(self):
        self.hidden: dict[Stream, dict[bytes, set[tuple[str, int]]]] = defaultdict(lambda: defaultdict(set))

    def note(self, what: tuple[str, str, str, int], data: Any, *values: Any) -> None:
        purpose, salt, generator, count = what
        digest = hashlib.blake2b(salt.encode())
        for value in values:
            value = np.asarray(value)
            digest.update(f"{value.dtype}{value.shape}".encode() + value.tobytes())
        stream = np.asarray(data).tobytes(), generator
        self.hidden[stream][digest.digest()].add((purpose, count))

    @property
    def purposes(self) -> set[str]:
        return {
            purpose for hidden in self.hidden.values() for noted in hidden.values() for purpose, _ in noted
        }

    def reused(self) -> list[str]:
        """The streams that hid two different values, in words."""
        return [
            f"{generator} under {np.frombuffer(data, np.uint32)}: "
            + "; ".join(f"{purpose}, words 0 to {n - 1}" for noted in hidden.values() for purpose, n in noted)
            for (data, generator), hidden in self.hidden.items()
            if len(hidden) > 1
        ]


@contextlib.contextmanager
def kept() -> Iterator[Ledger]:
    """All that is drawn meanwhile, by steps that are made meanwhile. What was compiled is compiled anew,
    and again afterwards.
    """
    ledger = Ledger()
    under_way: list[tuple[str, str, list[Any]]] = []
    share_ring, draw = sharing.share_ring, ring.draw
    deal = costs.deal
    witnessed, take_on_call = Secure.witnessed, control_flow.take_on_call

    @contextlib.contextmanager
    def hiding(purpose: str, salt: str, values: Any):
        under_way.append((purpose, salt, jax.tree.leaves(values)))
        try:
            yield
        finally:
            under_way.pop()

    def noted_draw(key, shapes, generator="threefry"):
        assert under_way, "words are drawn by neither share nor a step that was made while the ledger is kept"
        purpose, salt, values = under_way[-1]
        count = sum(map(math.prod, shapes))
        what = (purpose, salt, generator, count)
        if count:
            jax.debug.callback(
                functools.partial(ledger.note, what), ring.keys.words(ring.keys.typed(key)), *values
            )
        return draw(key, shapes, generator)

    def noted_share(key, x, parties, generator="threefry"):
        with hiding("share", "", x):
            return inspect.unwrap(share_ring)(key, x, parties, generator)

    def noted_step(step, key, args, *rest, **options):
        with hiding("step", f"{id(step.function)} {step.protocol}", args):
            return witnessed(step, key, args, *rest, **options)

    def counted(*args, **options):
        with hiding("cost", "", []):  # of shapes alone: nothing is drawn
            return deal(*args, **options)

    def noted_call(seed, plan, call, generator="threefry"):
        _, salt, values = under_way[-1]
        with hiding("on call", salt, [call, *values]):
            return take_on_call(seed, plan, call, generator)

    jax.clear_caches()
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(ring, "draw", noted_draw)
        patched.setattr(sharing, "share_ring", noted_share)
        patched.setattr(Secure, "witnessed", noted_step)
        patched.setattr(costs, "deal", counted)
        patched.setattr(control_flow, "take_on_call", noted_call)
        yield ledger
        jax.effects_barrier()
    jax.clear_caches()
