"""The command `bench`: every work with every number of parties, beside its floor and beside the peers.

OUT/bench.json   everything that was measured, on what machine and with what versions
OUT/bench.md     the same as tables, for docs/results/speed.md
OUT/peers        the peers' virtual environments, and their finished measurements
"""

import itertools
import tempfile
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from rich.console import Console

from ciphernav_jax import files, provenance, tables
from ciphernav_jax.files import write_json, write_text
from ciphernav_jax.parties.sharing import require_parties
from ciphernav_jax.protocols import Protocol
from ciphernav_jax.tables import Cells, Table, ms
from experiments import floor, growth, measure, peers, process
from experiments.growth import Turns
from experiments.measure import Order
from experiments.work import Sizes, Work, works

# What we want on two cores with the default protocol, in seconds.
TARGETS = {
    ("forward", 2): 0.007,
    ("forward", 5): 0.015,
    ("train", 2): 0.060,
    ("train", 5): 0.140,
    ("relu", 2): 0.009,
    ("relu", 5): 0.022,
    ("product", 2): 0.015,
    ("product", 5): 0.040,
}
# The works whose growth with the parties is measured, in turns.
GROWING = ("train", "train-loop")

console = Console(highlight=False)

HEADER = (
    "work",
    "P",
    "ms",
    "quartiles",
    "target",
    "floor",
    "x",
    "cold s",
    "warm s",
    "MB",
    "error",
)
NOTE = (
    "Milliseconds of a call after warm-up, median; all parties and the dealer on one machine. Floor: the "
    "products' multiply-adds and the dealer's random bytes at the machine's raw rates; x: ms by floor. Cold: "
    "tracing and compiling; warm: the same with a filled compilation cache. MB: peak of the whole process. "
    "Error: the largest against float64, as part of the largest value."
)
GROWTH_HEADER = ("work", "P", "ms / P", "quartiles", "growth", "quartiles", "of the floor")
GROWTH_NOTE = (
    "All numbers of parties in turns, in one process. Growth: the time for each party, as a multiple of that "
    "with the fewest parties in the same round; 1 where time grows in proportion to the parties. Of the "
    "floor: the same of the multiply-adds and random bytes that the work needs."
)
PEERS_NOTE = (
    "Milliseconds of a call, median, one framework after the other on the same machine; in brackets how many "
    "times as long as ciphernav_jax takes."
)


def benchmark(
    *,
    parties: Sequence[int],
    names: Sequence[str],
    protocols: Sequence[Protocol],
    out: Path,
    seed: int = 0,
    repeat: int | None = None,
    with_peers: Sequence[peers.Peer] = (),
    time_limit: float = 300,
    sizes: Sizes | None = None,
) -> dict[str, Any]:
    """Measure, print the tables, and write OUT/bench.json and OUT/bench.md.

    Args:
        parties: numbers of parties.
        names: of the works, see `work.works`.
        protocols: variants; the peers are compared with the first.
        out: folder.
        seed: of inputs, shares and protocols.
        repeat: timed calls of each work; by default as many as fit in three seconds (of a peer five).
        with_peers: other frameworks to run.
        time_limit: seconds after which a peer's work counts as not finished.
        sizes: of the works.

    Returns:
        What is in OUT/bench.json.

    Raises:
        ValueError: an unknown work, fewer than two parties.
        BusyError: another process measures into OUT.
        RuntimeError: a measurement of our own failed.
    """
    sizes = sizes or Sizes()
    known = works(sizes, seed)
    if unknown := [name for name in names if name not in known]:
        raise ValueError(f"unknown work {', '.join(unknown)}; the works are {', '.join(known)}")
    for count in parties:
        require_parties(count)
    if repeat is not None and repeat < 1:
        raise ValueError(f"--repeat must be at least 1, not {repeat}")
    chosen = [work for name, work in known.items() if name in names]
    with files.claimed(out):
        return _run(sorted(set(parties)), chosen, protocols, out, seed, repeat, with_peers, time_limit, sizes)


def _run(
    parties: Sequence[int],
    chosen: Sequence[Work],
    protocols: Sequence[Protocol],
    out: Path,
    seed: int,
    repeat: int | None,
    with_peers: Sequence[peers.Peer],
    time_limit: float,
    sizes: Sizes,
) -> dict[str, Any]:
    orders = [
        Order(work.name, count, protocol, sizes, seed, repeat)
        for protocol, work, count in itertools.product(protocols, chosen, parties)
    ]
    document: dict[str, Any] = {
        "configuration": {"parties": list(parties), "seed": seed, "repeat": repeat, "sizes": asdict(sizes)},
        "versions": provenance.versions(),
        "machine": provenance.machine(),
        "rates": {},
        "titles": {work.name: work.title for work in chosen},
        "results": [],
        "growth": [],
        "peers": [],
    }
    growing = [work.name for work in chosen if work.name in GROWING and len(parties) > 1]
    with tables.progress(console) as progress:
        task = progress.add_task("", total=len(orders) + len(growing))

        def keep() -> None:
            _compare(document, floor.rates())
            write_json(out / "bench.json", document)
            progress.advance(task)

        for order in orders:
            progress.update(task, description=f"{order.work}, {order.parties} parties, {order.protocol}")
            document["results"].append(_measured(order))
            keep()
            median = ms(document["results"][-1]["seconds"]["median"])
            console.print(f"  {order.work}, {order.parties} parties, {order.protocol}: {median} ms")
        for name in growing:
            progress.update(task, description=f"{name}, all numbers of parties in turns")
            turns = Turns(name, tuple(sorted(parties)), protocol=protocols[0], sizes=sizes, seed=seed)
            if repeat is not None:
                turns = replace(turns, rounds=repeat)
            document["growth"] += _grown(turns)
            keep()
    names = _names(document)  # short ones, for a terminal
    console.print(
        table(document, names), *(f"{name}: {title}" for name, title in document["titles"].items()), sep="\n"
    )
    if growing:
        console.print(growth_table(document, names))

    if with_peers:
        of_peers = [work for work in chosen if work.steps == 1]
        document["peers"] = peers.run_worker(
            with_peers, of_peers, parties, out / "peers", repeat, time_limit, console
        )
        console.print(peers_table(document, names), *_failed(document), sep="\n")
    write_json(out / "bench.json", document)
    write_text(out / "bench.md", markdown(document))
    console.print(f"Written: {out}/bench.json, {out}/bench.md")
    return document


def _compare(document: dict[str, Any], rates: dict[str, float]) -> None:
    """Sets all results beside their floors, at the best rates so far: other jobs may have slowed some."""
    best = document["rates"]
    best.update({name: max(rate, best.get(name, 0.0)) for name, rate in rates.items()})
    for result in document["results"]:
        result["floor_s"] = floor.seconds(result["needs"], best)
        result["times_floor"] = result["seconds"]["median"] / result["floor_s"]
    for result in document["growth"]:
        result["floor_s"] = floor.seconds(result["needs"], best)


def _measured(order: Order) -> dict[str, Any]:
    with tempfile.TemporaryDirectory() as cache:
        title = f"{order.work} with {order.parties} parties"
        result = process.in_process(measure, order.as_json(), title, cache)
        again = process.in_process(measure, replace(order, compile_only=True).as_json(), title, cache)
    return {
        "work": order.work,
        "parties": order.parties,
        "protocol": str(order.protocol),
        **result,
        "at": provenance.now(),
        "warm_s": again["trace_s"] + again["compile_s"],
        "target_s": TARGETS.get((order.work, order.parties)) if order.protocol == Protocol() else None,
    }


def _grown(turns: Turns) -> list[dict[str, Any]]:
    found = process.in_process(growth, turns.as_json(), f"{turns.work} with {turns.parties} parties in turns")
    return [{"work": turns.work, **result, "at": provenance.now()} for result in found["results"]]


def rows(document: dict[str, Any], titles: dict[str, str]) -> list[Cells]:
    """The cells of our own table as text, see `HEADER`; `titles` says what to call each work."""
    several = len({result["protocol"] for result in document["results"]}) > 1
    return [_row(result, titles[result["work"]], several) for result in document["results"]]


def _row(result: dict[str, Any], title: str, several: bool) -> Cells:
    times, target = result["seconds"], result["target_s"]
    return (
        f"{title} ({result['protocol']})" if several else title,
        str(result["parties"]),
        ms(times["median"]),
        f"{ms(times['q1'])}-{ms(times['q3'])}",
        "" if target is None else ms(target),
        ms(result["floor_s"]),
        f"{result['times_floor']:.1f}",
        f"{result['trace_s'] + result['compile_s']:.1f}",
        f"{result['warm_s']:.1f}",
        f"{result['peak_bytes'] / 1e6:.0f}",
        f"{result['error']:.1e}",
    )


def growth_rows(document: dict[str, Any], titles: dict[str, str]) -> list[Cells]:
    """The cells of the table of growth, see `GROWTH_HEADER`."""
    needed: dict[str, float] = {}  # by each of the fewest parties
    table = []
    for result in document["growth"]:
        work, parties, times, grown = (result[name] for name in ("work", "parties", "seconds", "growth"))
        each = result["floor_s"] / parties
        table.append(
            (
                titles[work],
                str(parties),
                ms(times["median"] / parties),
                f"{ms(times['q1'] / parties)}-{ms(times['q3'] / parties)}",
                f"{grown['median']:.2f}",
                f"{grown['q1']:.2f}-{grown['q3']:.2f}",
                f"{each / needed.setdefault(work, each):.2f}",
            )
        )
    return table


def peers_rows(document: dict[str, Any], titles: dict[str, str]) -> tuple[Cells, list[Cells]]:
    """Header and cells of the table of peers: a row for each work and number of parties."""
    names = list(dict.fromkeys(result["title"] for result in document["peers"]))
    protocol = document["results"][0]["protocol"]
    ours = {
        (result["work"], result["parties"]): result["seconds"]["median"]
        for result in document["results"]
        if result["protocol"] == protocol
    }
    theirs = {(r["title"], r["work"], r["parties"]): r for r in document["peers"]}
    table = []
    for (work, parties), seconds in ours.items():
        found = [theirs.get((name, work, parties)) for name in names]
        if any(found):
            cells = [_peer_cell(result, seconds) for result in found]
            table.append((titles[work], str(parties), ms(seconds), *cells))
    return ("work", "P", "ciphernav_jax", *names), table


def _peer_cell(result: dict[str, Any] | None, ours: float) -> str:
    if result is None:
        return ""
    if "seconds" not in result:
        return result["status"]
    median = result["seconds"]["median"]
    return f"{ms(median)} ({median / ours:.1f})"


def markdown(document: dict[str, Any]) -> str:
    """The tables in Markdown, with what they were measured on."""
    machine, versions = document["machine"], document["versions"]
    text = (
        f"{machine['cpus']} cores of {machine['processor']}, jax {versions['jax']}; "
        f"raw rates {document['rates']['multiply_adds'] / 1e9:.0f} G uint64 multiply-adds and "
        f"{document['rates']['random_bytes'] / 1e9:.1f} GB of random words a second.\n\n"
    )
    titles = document["titles"]
    shown = [table(document, titles)]
    if document["growth"]:
        shown.append(growth_table(document, titles))
    if document["peers"]:
        shown.append(peers_table(document, titles))
    return text + "\n".join(f"{each.markdown()}\n" for each in shown)


def table(document: dict[str, Any], titles: dict[str, str]) -> Table:
    """Our own works."""
    return Table("Secret-shared work", HEADER, rows(document, titles), NOTE)


def growth_table(document: dict[str, Any], titles: dict[str, str]) -> Table:
    """How steps of training grow with the parties."""
    return Table("Growth with the parties", GROWTH_HEADER, growth_rows(document, titles), GROWTH_NOTE)


def peers_table(document: dict[str, Any], titles: dict[str, str]) -> Table:
    """Ours beside the peers."""
    header, cells = peers_rows(document, titles)
    return Table("Beside other frameworks", header, cells, PEERS_NOTE)


def _failed(document: dict[str, Any]) -> list[str]:
    """What went wrong with peers."""
    return [
        f"{r['title']}, {r['work']}, {r['parties']} parties: {r['status']}. {r.get('detail', '')}".strip()
        for r in document["peers"]
        if "seconds" not in r
    ]


def _names(document: dict[str, Any]) -> dict[str, str]:
    return {name: name for name in document["titles"]}
