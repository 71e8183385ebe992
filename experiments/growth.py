"""How the time of one work grows with the number of parties: all numbers take turns, in one process.

`python -m experiments.growth ORDER.json RESULT.json`; `bench` starts it. The speed of a machine
wanders, within minutes, by more than the growth that is looked for; so each time is compared with that of
the fewest parties in the same round.
"""

from dataclasses import asdict, dataclass, field
from typing import Any

import jax
import numpy as np

from ciphernav_jax.comparison.timing import compiled, timed
from ciphernav_jax.protocols import Protocol
from ciphernav_jax.ring import keys
from experiments import floor, process
from experiments.measure import shared, summary
from experiments.work import Sizes, works


@dataclass(frozen=True)
class Turns:
    """What to measure.

    Attributes:
        work: see `work.works`.
        parties: numbers of parties, the fewest first.
        rounds: in each of them every number of parties has its turn.
        protocol, sizes, seed: as in `measure.Order`.
    """

    work: str
    parties: tuple[int, ...]
    rounds: int = 40
    protocol: Protocol = field(default_factory=Protocol)
    sizes: Sizes = field(default_factory=Sizes)
    seed: int = 0

    def as_json(self) -> dict[str, Any]:
        return asdict(self)

    @staticmethod
    def from_json(order: dict[str, Any]) -> "Turns":
        protocol, sizes = Protocol(**order["protocol"]), Sizes.from_json(order["sizes"])
        return Turns(**order | {"parties": tuple(order["parties"]), "protocol": protocol, "sizes": sizes})


def growth(turns: Turns) -> list[dict[str, Any]]:
    """Time all numbers of parties in turns.

    Returns:
        For each number of parties: parties; seconds of a step, and growth: the time for each party, as a
        multiple of that with the fewest parties in the same round (both as of `measure.summary`); needs, see
        `floor`.
    """
    work = works(turns.sizes, turns.seed)[turns.work]
    key = keys.derive(keys.root(turns.seed), "growth", turns.work, repr(turns.sizes), str(turns.protocol))
    call_keys = [keys.derive(key, "call", parties) for parties in turns.parties]
    runs, needs = [], []
    for parties in turns.parties:
        args = shared(work, keys.derive(key, "share", parties), parties, turns.protocol)
        runs.append((compiled(work.secured(turns.protocol), key, *args)[0], args))
        needs.append(floor.needs(work, turns.protocol, parties, args))

    # Fewer parties get more calls in a turn, so that all turns last about as long. A turn's first call finds
    # the processor's caches full of another's data, and does not count.
    often = [max(1, max(turns.parties) // parties) for parties in turns.parties]
    times = np.zeros((turns.rounds, len(runs)))
    for i in range(turns.rounds):
        for j, ((run, args), calls) in enumerate(zip(runs, often, strict=True)):
            jax.block_until_ready(run(call_keys[j], *args))
            key = jax.block_until_ready(keys.derive(call_keys[j], "round", i))
            times[i, j] = np.mean([timed(run, key, *args)[0] for _ in range(calls)]) / work.steps
    per_party = times / np.array(turns.parties)
    relative = per_party / per_party[:, :1]
    return [
        {
            "parties": parties,
            "seconds": summary(times[:, j].tolist()),
            "growth": summary(relative[:, j].tolist()),
            "needs": needs[j],
        }
        for j, parties in enumerate(turns.parties)
    ]


if __name__ == "__main__":
    process.answer(lambda order: {"results": growth(Turns.from_json(order))})
