"""The command `sweep`: protocol variants and numbers of parties, on one table and one picture.

OUT/sweep.json   everything that was measured; the same command goes on where it was killed
OUT/sweep.md     a few columns of it, for docs/results/variants.md
OUT/sweep.png    the picture
"""

import itertools
import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from ciphernav_jax import files, provenance, tables
from ciphernav_jax.files import DamagedError, read_json, write_json, write_text
from ciphernav_jax.parties.sharing import require_parties
from ciphernav_jax.protocols import Protocol
from ciphernav_jax.protocols.truncate import VARIANTS
from ciphernav_jax.tables import Cells, ms
from experiments import pictures, process, trial
from experiments.trial import Effort, Trial

console = Console(highlight=False)

TWO_PARTIES_ONLY = "two parties only"
NO_PROTOCOL = "ideal: not a protocol"

HEADER = (
    "variant",
    "step ms",
    "forward ms",
    "compile s",
    "rounds",
    "MB sent",
    "MB dealt",
    "LAN s",
    "WAN s",
    "output error",
    "gradient error",
    "loss",
    "failures",
)
SHORT_HEADER = (
    "variant", "P", "step ms", "forward ms", "rounds", "MB sent", "WAN s", "error", "loss", "failures"
)  # fmt: skip
NOTE = (
    "Step: of training; forward: a forward pass; medians in milliseconds, all parties and the dealer on one "
    "machine. Rounds, MB and the times projected for a LAN and a WAN (without computation) are a step's; "
    "sent: by each party, dealt: to all together. Errors: the largest against float64, of the outputs and of "
    "the first gradient. Loss: after "
    "the training, by how many percent it is off float64's; - where the training was too slow to wait "
    "for. Failures: of single truncations of products of 30,000; ! where an output, a gradient or the "
    "training failed, or a value was beyond the variant's range."
)


def run(
    *,
    parties: Sequence[int],
    protocols: Sequence[Protocol],
    out: Path,
    seed: int = 0,
    effort: Effort | None = None,
) -> dict[str, Any]:
    """Try every protocol with every number of parties; print the table, and write all into OUT.

    What OUT/sweep.json holds already is kept, also of other variants; so a sweep can be killed and extended.

    Args:
        parties: numbers of parties.
        protocols: variants.
        out: folder.
        seed: of weights, data, shares and protocols.
        effort: how much to try of each.

    Returns:
        What is in OUT/sweep.json.

    Raises:
        ValueError: fewer than two parties; OUT holds a sweep of another seed or effort.
        BusyError: another process sweeps into OUT.
        RuntimeError: a trial failed.
    """
    for count in parties:
        require_parties(count)
    effort = effort or Effort()
    if effort.steps % effort.chunk or effort.steps < 1:
        raise ValueError(f"--steps must be a multiple of {effort.chunk}, not {effort.steps}")
    with files.claimed(out):
        return _run(parties, protocols, out, seed, effort)


def _run(
    parties: Sequence[int], protocols: Sequence[Protocol], out: Path, seed: int, effort: Effort
) -> dict[str, Any]:
    path = out / "sweep.json"
    document = _begun(path, {"seed": seed, "effort": asdict(effort)})
    kept = {(result["protocol"], result["parties"]) for result in document["results"]}
    trials = [
        Trial(protocol, count, effort, seed)
        for count, protocol in itertools.product(dict.fromkeys(parties), dict.fromkeys(protocols))
        if (str(protocol), count) not in kept
    ]
    with tables.progress(console) as progress:
        task = progress.add_task("", total=len(trials))
        for tried in trials:
            progress.update(task, description=f"{tried.protocol}, {tried.parties} parties")
            document["results"].append(_tried(tried))
            write_json(path, document)
            progress.advance(task)
    if kept:
        console.print(f"Kept from before: {len(kept)} results in {path}")
    for count in sorted({result["parties"] for result in document["results"]}):
        console.print(table(document, count))
    console.print(NOTE)
    write_text(out / "sweep.md", markdown(document))
    pictures.sweep(document, out / "sweep.png")
    console.print(f"Written: {path}, {out}/sweep.md, {out}/sweep.png")
    return document


def _begun(path: Path, configuration: dict[str, Any]) -> dict[str, Any]:
    fresh = {
        "configuration": configuration,
        "versions": provenance.versions(),
        "machine": provenance.machine(),
        "results": [],
    }
    if not path.exists():
        return fresh
    found = read_json(path, remedy="remove it to start anew")
    asked = json.loads(json.dumps(fresh))  # as it would be read, with lists for tuples
    for name in ("configuration", "versions", "machine"):
        if found.get(name) != asked[name]:
            raise DamagedError(
                f"{path} holds a sweep with another {name}; choose another --out, or remove it to start anew"
            )
    with files.fitting(path, "remove it to start anew"):
        for result in found["results"]:
            _row(result)
            _short_row(result)
    return found


def _tried(tried: Trial) -> dict[str, Any]:
    protocol, parties = tried.protocol, tried.parties
    named = {
        "protocol": str(protocol), "ideal": protocol.ideal, "parties": parties, "at": provenance.now()
    }  # fmt: skip
    if parties > (VARIANTS[protocol.truncation].parties or parties):
        return named | {"status": TWO_PARTIES_ONLY}
    result = process.run(trial, tried.as_json(), f"{protocol} with {parties} parties")
    return named | {"status": "done"} | result


def name(result: dict[str, Any]) -> str:
    """What to call a result's variant."""
    return f"{result['protocol']} ({NO_PROTOCOL})" if result["ideal"] else result["protocol"]


def table(document: dict[str, Any], parties: int) -> Table:
    """All variants with one number of parties, for a terminal."""
    rows = [_row(result) for result in document["results"] if result["parties"] == parties]
    return tables.terminal(f"{parties} parties", HEADER, rows, "")


def _row(result: dict[str, Any]) -> Cells:
    if result["status"] != "done":
        return (name(result), result["status"], *("" for _ in HEADER[2:]))
    step, forward = result["step"], result["forward"]
    return (
        name(result),
        ms(step["seconds"]["median"]),
        ms(forward["seconds"]["median"]),
        f"{sum(part['trace_s'] + part['compile_s'] for part in (step, forward)):.0f}",
        *_costs(step["cost"], "rounds", "bytes_sent", "bytes_dealt", "lan_s", "wan_s"),
        f"{result['outputs']['largest']:.1e}",
        f"{result['gradients']['largest']:.1e}",
        _loss(result),
        _failures(result),
    )


def markdown(document: dict[str, Any]) -> str:
    """A few columns of everything, and what it was measured on."""
    machine, versions = document["machine"], document["versions"]
    effort = document["configuration"]["effort"]
    shown = tables.markdown(SHORT_HEADER, short_rows(document))
    return (
        f"{machine['cpus']} cores of {machine['processor']}, jax {versions['jax']}. A training step with "
        f"batch {effort['sizes']['train']}, a forward pass with batch {effort['sizes']['forward']}; the "
        f"loss after {effort['steps']} steps.\n\n{shown}\n\n{NOTE}\n"
    )


def short_rows(document: dict[str, Any]) -> list[Cells]:
    """The cells of a few columns as text, see `SHORT_HEADER`; by the number of parties."""
    return [_short_row(result) for result in sorted(document["results"], key=lambda r: r["parties"])]


def _short_row(result: dict[str, Any]) -> Cells:
    parties = str(result["parties"])
    if result["status"] != "done":
        return (name(result), parties, result["status"], *("" for _ in SHORT_HEADER[3:]))
    return (
        name(result),
        parties,
        ms(result["step"]["seconds"]["median"]),
        ms(result["forward"]["seconds"]["median"]),
        *_costs(result["step"]["cost"], "rounds", "bytes_sent", "wan_s"),
        f"{result['outputs']['largest']:.1e}",
        _loss(result),
        _failures(result),
    )


def _costs(cost: dict[str, Any] | None, *names: str) -> Cells:
    if cost is None:
        return ("-",) * len(names)
    return tuple(
        f"{cost[n] / 1e6:.3g}"
        if n.startswith("bytes")
        else f"{cost[n]:.3g}"
        if n.endswith("_s")
        else str(cost[n])
        for n in names
    )


def loss_off(result: dict[str, Any]) -> float | None:
    """By what part the loss after the training is above float64's; None without a training."""
    if result["status"] != "done" or not result["curve"]:
        return None
    _, found, expected = result["curve"][-1]
    return found / expected - 1


def _loss(result: dict[str, Any]) -> str:
    off = loss_off(result)
    return "-" if off is None else f"{100 * off:+.2g} %"


def _failures(result: dict[str, Any]) -> str:
    failed, of = result["truncations"]["failed"], result["truncations"]["of"]
    far = result["outputs"]["far"] or result["gradients"]["far"]
    wrong = result["diverged"] or far or not result["in_range"]
    return f"{failed} of {of:,}" + " !" * bool(wrong) if failed or wrong else "0"
