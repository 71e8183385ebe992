"""What a function on secrets costs: rounds, bytes and correlated randomness, from its trace alone."""

import io
import math
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

import jax
import numpy as np
from rich.console import Console, Group
from rich.table import Table

from ciphernav_jax.parties.dealer import Plan, corrected, deal, words_needed
from ciphernav_jax.parties.jaxprs import labels
from ciphernav_jax.parties.messages import Opening, depth, first_uses, openings
from ciphernav_jax.parties.repeat import OnCall, Repeated
from ciphernav_jax.parties.requests import Request
from ciphernav_jax.parties.run import one_partys_jaxpr, online
from ciphernav_jax.secret.array import is_secret
from ciphernav_jax.secret.secured import Secure, require_step

# Bytes.
WORD = 8
SEED = 16


@dataclass(frozen=True)
class Network:
    """A network between any two parties: the time of one message of no length, one way, and the rate at which
    one party sends, to all others together.

    Example:
        >>> import jax, jax.numpy as jnp
        >>> import ciphernav_jax as cn
        >>> x = cn.share(jax.random.key(0), jnp.ones(4), parties=2)
        >>> satellite = cn.Network("satellite", latency_s=0.3, bits_per_s=1e7)
        >>> round(cn.cost(cn.secure(jnp.square), x).seconds(satellite), 3)
        0.6
    """

    name: str
    latency_s: float
    bits_per_s: float


# As in Huang, Lu, Hong, Ding, *Cheetah*, USENIX Security 2022: pings of 0.3 and 40 ms.
LAN = Network("LAN", 0.15e-3, 3e9)
WAN = Network("WAN", 20e-3, 400e6)


@dataclass(frozen=True)
class Delivery:
    """What the dealer sends of one request's values: uint64 words, to each party. What is uniform, all draw
    from their seeds; of any other value one party is sent its share.

    `request` is the kind of it (`parties.requests`), `protocol` and `primitive` are those that use it first.
    A request in the body of a loop counts for all iterations at once, under its own kind. `on_call` are the
    words that each iteration of a `while` adds, which the dealer deals as the loop runs.
    """

    request: str
    protocol: str
    primitive: str
    words: tuple[int, ...]
    on_call: tuple[int, ...]

    @property
    def size(self) -> int:
        """Bytes, to all parties together."""
        return WORD * sum(self.words)


@dataclass(frozen=True)
class Row:
    """One line of a cost table. What is opened and sent, each party opens and sends.

    Attributes:
        name: of a protocol, a primitive, or a kind of request.
        openings: arrays opened, each time counted.
        rounds: rounds in which some are sent. Rows may share a round: this column does not add up.
        words: entries sent to each other party.
        bytes_sent: to all other parties together.
        bytes_dealt: of correlated randomness, sent by the dealer to all parties together, before the program
            starts; without the parties' seeds.
    """

    name: str
    openings: int
    rounds: int
    words: int
    bytes_sent: int
    bytes_dealt: int


@dataclass(frozen=True)
class Cost:
    """What one call costs; made by `cost`, printed as a table.

    Attributes:
        parties: P.
        openings: every opening of the program, in its order.
        deliveries: what the dealer sends of each request for correlated randomness.
        uniform_words: uint64 words that all parties draw, the dealer too, who knows all streams.
    """

    parties: int
    openings: tuple[Opening, ...]
    deliveries: tuple[Delivery, ...]
    uniform_words: int

    @property
    def rounds(self) -> int:
        """Messages that wait for one another. Openings that do not are sent together."""
        return depth(self.openings)

    @property
    def messages(self) -> int:
        """Messages that each party sends: one to each other party in each round."""
        return self.rounds * (self.parties - 1)

    @property
    def bytes_sent(self) -> int:
        """Bytes that each party sends: 8 for each entry opened, to each of the P - 1 others."""
        return sum(opening.size for opening in self.openings) * (self.parties - 1)

    @property
    def bytes_dealt_to(self) -> tuple[int, ...]:
        """Bytes that each party receives from the dealer, before the program starts: a seed of 16, from which
        it draws what is uniform, and its corrections. They take turns, so all receive about as much.
        """
        seed = SEED if self.deliveries else 0
        return tuple(
            seed + WORD * sum(delivery.words[party] for delivery in self.deliveries)
            for party in range(self.parties)
        )

    @property
    def bytes_dealt(self) -> int:
        """Bytes that the dealer sends to all parties together, before the program starts. But for the seeds,
        they are as many for any number of parties.
        """
        return sum(self.bytes_dealt_to)

    @property
    def bytes_on_call(self) -> int:
        """Bytes that the dealer sends to all parties together while the program runs, for one iteration of
        each `while`: how many there will be, nobody knows beforehand.
        """
        return WORD * sum(sum(delivery.on_call) for delivery in self.deliveries)

    @property
    def ideal(self) -> int:
        """Times that a trusted third party stands in for a protocol. Unless 0, this is no protocol's cost."""
        return sum(len(opening.rounds) for opening in self.openings if opening.ideal)

    @property
    def unbounded(self) -> bool:
        """Whether some of it is for one iteration of a `while`, of nobody knows how many."""
        return any(opening.per_iteration for opening in self.openings)

    @property
    def by_protocol(self) -> tuple[Row, ...]:
        """Each protocol's part, with what it calls upon."""
        return self._rows(lambda part: part.protocol)

    @property
    def by_primitive(self) -> tuple[Row, ...]:
        """Each primitive's part, of the function given to `secure`. A value opened for two of them counts for
        the first; "output" is what outputs need to leave with the protocol's precision.
        """
        return self._rows(lambda part: part.primitive)

    @property
    def by_request(self) -> tuple[Row, ...]:
        """The dealer's part by kind of request (`parties.requests`)."""
        return self._rows(lambda part: part.request if isinstance(part, Delivery) else None)

    def _rows(self, name: Callable[[Opening | Delivery], str | None]) -> tuple[Row, ...]:
        named = [name(part) for part in (*self.openings, *self.deliveries)]
        return tuple(
            self._row(
                row or "(none)",
                [x for x in self.openings if name(x) == row and not x.ideal],
                [x for x in self.deliveries if name(x) == row],
            )
            for row in dict.fromkeys(named)
            if row is not None
        )

    def _row(self, name: str, sent: list[Opening], dealt: list[Delivery]) -> Row:
        return Row(
            name=name,
            openings=sum(len(opening.rounds) for opening in sent),
            rounds=len({r for opening in sent for r in opening.rounds}),
            words=sum(opening.words for opening in sent),
            bytes_sent=sum(opening.size for opening in sent) * (self.parties - 1),
            bytes_dealt=sum(delivery.size for delivery in dealt),
        )

    def seconds(self, network: Network) -> float:
        """A projection: rounds x latency + bytes sent / rate. Without computation and without the dealer."""
        return self.rounds * network.latency_s + 8 * self.bytes_sent / network.bits_per_s

    def as_dict(self) -> dict[str, Any]:
        """All of it in numbers and strings, for JSON."""
        return {
            "parties": self.parties,
            "rounds": self.rounds,
            "messages": self.messages,
            "bytes_sent": self.bytes_sent,
            "bytes_dealt": self.bytes_dealt,
            "bytes_dealt_to": list(self.bytes_dealt_to),
            "bytes_on_call": self.bytes_on_call,
            "uniform_words": self.uniform_words,
            "ideal": self.ideal,
            "unbounded": self.unbounded,
            "seconds": {network.name: self.seconds(network) for network in (LAN, WAN)},
            "by_protocol": [asdict(row) for row in self.by_protocol],
            "by_primitive": [asdict(row) for row in self.by_primitive],
            "by_request": [asdict(row) for row in self.by_request],
        }

    def summary(self) -> str:
        """The totals in a few lines."""
        lines = [
            f"Each of {self.parties} parties: {self.rounds} round{'s' * (self.rounds != 1)}"
            f"{' or more' * self.unbounded}, "
            f"{_size(self.bytes_sent)} sent. Before that, the dealer sends {_size(self.bytes_dealt)} to all.",
            "Projected, without computation: "
            + ", ".join(f"{_time(self.seconds(network))} on {network.name}" for network in (LAN, WAN))
            + ".",
        ]
        if self.unbounded:
            lines.append("A while loop is counted for one iteration.")
        if self.bytes_on_call:
            lines.append(f"The dealer is on call for it, and sends {_size(self.bytes_on_call)} meanwhile.")
        if self.ideal:
            lines.append(f"ideal: {self.ideal} openings by a trusted third party, not a protocol.")
        return "\n".join(lines)

    def table(self) -> Table:
        """The parts by primitive and by protocol."""
        table = Table("", "openings", "in rounds", "entries", "sent", "dealt")
        for column in table.columns[1:]:
            column.justify = "right"
        for title, rows in (("by primitive", self.by_primitive), ("by protocol", self.by_protocol)):
            table.add_section()
            table.add_row(title, style="bold")
            for row in rows:
                numbers = (row.openings, row.rounds, row.words)
                table.add_row(
                    f"  {row.name}",
                    *(f"{n:,}" for n in numbers),
                    _size(row.bytes_sent),
                    _size(row.bytes_dealt),
                )
        return table

    def __rich__(self) -> Group:
        return Group(self.summary(), self.table())

    def __str__(self) -> str:
        text = io.StringIO()
        Console(file=text, width=100).print(self)
        return text.getvalue().rstrip()


def cost(step: Secure, *args: Any, **kwargs: Any) -> Cost:
    """Rounds and bytes of `step(key, *args)` for each party, and what the dealer sends. Nothing is run.

    Everything is read from the jaxpr of one party's program, the same that is run. An opening sends 8 bytes
    an entry to each of the P - 1 other parties, in the round after the last opening that it depends on;
    independent openings travel together. A loop by `lax.scan` is multiplied out; of a `lax.cond` the
    costliest branch is counted, of a `lax.while_loop` one iteration. `reveal` is not part of it: opening a
    result of n entries takes one more round and 8 n (P - 1) bytes.

    Args:
        step: made by `secure` (or `deploy`).
        args, kwargs: its arguments without the key, or their shapes: `jax.ShapeDtypeStruct`, and
            `jax.eval_shape(partial(share, ...), ...)`.

    Returns:
        A `Cost`: `print` it, or take `as_dict()`, or `seconds(Network("mine", latency_s, bits_per_s))`.

    Raises:
        TypeError: `step` was not made by `secure`.
        What `step` would raise on these arguments.

    Example:
        >>> import jax, numpy as np
        >>> import ciphernav_jax as cn
        >>> x = cn.share(jax.random.key(0), np.ones(4), parties=3)
        >>> cost = cn.cost(cn.secure(lambda x, y: x * y), x, x[::-1])
        >>> cost.rounds, cost.bytes_sent
        (2, 192)
    """
    require_step(step)
    call = step.call(jax.eval_shape(_party_first, step.given(*args, **kwargs)))
    needed = call.plan()
    key = jax.eval_shape(jax.random.key, 0)
    supply = jax.eval_shape(partial(deal, plan=needed, parties=call.parties), key)
    jaxpr, _ = one_partys_jaxpr(
        online(call.program, needed), call.parties, (supply, call.private), call.public
    )
    handed = _deliveries(needed, call.parties, supply, first_uses(jaxpr.jaxpr))
    return Cost(call.parties, openings(jaxpr), handed, sum(words_needed(needed, call.parties)))


def _party_first(args: Any) -> Any:
    return jax.tree.map(lambda x: x.party_first() if is_secret(x) else x, args, is_leaf=is_secret)


def _deliveries(needed: Plan, parties: int, supply: Any, uses: dict[int, str]) -> tuple[Delivery, ...]:
    """One for each request, those of loops' bodies included. `uses` are the first uses of the program's
    inputs, of which `supply` is first.
    """
    sent = corrected(needed, parties)
    found: dict[tuple[int, ...], Request] = {}
    words: dict[tuple[int, ...], np.ndarray] = {}
    first: dict[tuple[int, ...], tuple[int, str]] = {}
    order = {i: n for n, i in enumerate(uses)}
    for i, (path, value) in enumerate(jax.tree_util.tree_leaves_with_path(supply)):
        number, name = path[0].idx, path[1].key
        place, request = _place(needed, number, name)
        found[place] = request
        words.setdefault(place, np.zeros(parties, np.int64))
        if name in sent[number]:
            words[place][sent[number][name]] += math.prod(value.shape[1:])
        if i in uses:
            first[place] = min(first.get(place, (order[i], uses[i])), (order[i], uses[i]))

    def delivery(place: tuple[int, ...]) -> Delivery:
        _, use = first.get(place, (0, ""))
        protocols, primitives = (labels(use, kind) for kind in ("protocol", "primitive"))
        # So often is the loop entered for which the dealer is on call.
        times = math.prod(_times(needed, place))
        return Delivery(
            request=found[place].kind,
            protocol=protocols[0] if protocols else "",
            primitive=primitives[-1] if primitives else "",
            words=tuple(words[place].tolist()),
            on_call=tuple((times * _on_call(found[place], parties)).tolist()),
        )

    return tuple(map(delivery, sorted(found)))


def _place(plan: Plan, number: int, name: str) -> tuple[tuple[int, ...], Request]:
    """The request that a value belongs to, and its number in the plan; in a body, the numbers on the way to
    it (`parties.repeat.Repeated` names its values by them).
    """
    request = plan.requests[number]
    if not isinstance(request, Repeated):
        return (number,), request
    inner, _, name = name.partition("/")
    place, request = _place(request.plan, int(inner), name)
    return (number, *place), request


def _times(plan: Plan, place: tuple[int, ...]) -> Iterator[int]:
    """How often each loop on the way to a place is run."""
    for number in place[:-1]:
        request = plan.requests[number]
        assert isinstance(request, Repeated)
        yield request.times
        plan = request.plan


def _on_call(request: Request, parties: int) -> np.ndarray:
    """int64[P]: words that a dealer on call sends to each party for one iteration of the loop that a request
    is for, with one of each such loop within.
    """
    words = np.zeros(parties, np.int64)
    if isinstance(request, Repeated):
        for inner in request.plan.requests:
            words += request.times * _on_call(inner, parties)
    elif isinstance(request, OnCall):
        plan = request.plan
        for inner, shapes, sent in zip(plan.requests, plan.shapes, corrected(plan, parties), strict=True):
            for name, party in sent.items():
                words[party] += math.prod(shapes[name])
            words += _on_call(inner, parties)
    return words


def _size(count: int) -> str:
    for unit, scale in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if count >= scale:
            return f"{count / scale:.3g} {unit}"
    return f"{count} B"


def _time(seconds: float) -> str:
    return f"{seconds:.3g} s" if seconds >= 1 else f"{1e3 * seconds:.3g} ms"
