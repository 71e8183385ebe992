"""Seconds of a forward pass of the action classifier, batch 100 (paper: the table of forward-pass times).

The paper, on a CPU: plaintext 0.00032 s, 2 parties 0.23, 5 parties 1.3; on a GPU 0.00028, 0.15 and 0.42.

    python -m experiments paper forward            # a minute on two cores

Medians after warm-up, all parties and the dealer on one machine; weights public, as the paper has them, and
secret. The device is JAX's default one. One file, RESULTS/forward-DEVICE.json.
"""

from typing import Any

import jax

from ciphernav_jax import provenance
from ciphernav_jax.command_line import read
from ciphernav_jax.comparison.timing import calls, compiled
from ciphernav_jax.files import write_json
from ciphernav_jax.protocols import Protocol
from ciphernav_jax.ring import keys
from ciphernav_jax.secret import share
from experiments.measure import FEWEST, SECONDS, summary
from experiments.paper.runs import Options, console
from experiments.work import Sizes, Work, works

PARTIES = (2, 5)


def measured(work: Work, parties: int | None) -> dict[str, Any]:
    """One line: name, parties, weights, batch, seconds (see `measure.summary`), compile_s, trace_s."""
    key = keys.derive(keys.root(0), "forward", work.name, parties or "plaintext")
    if parties is None:
        args = jax.tree.map(jax.numpy.float32, work.args)
        run, compiling = compiled(lambda _, *args: work.function(*args), key, *args)
    else:
        args = tuple(
            share(keys.derive(key, "argument", i), arg, parties=parties) if secret else arg
            for i, (arg, secret) in enumerate(zip(work.args, work.secret, strict=True))
        )
        run, compiling = compiled(work.secured(Protocol()), key, *args)
    jax.block_until_ready(run(key, *args))
    timed = calls(run, key, args, seconds=SECONDS, fewest=FEWEST)
    return {
        "name": "plaintext" if parties is None else f"{parties} parties",
        "parties": parties,
        "weights": "secret" if work.secret[0] and parties else "public",
        "batch": Sizes().forward,
        "seconds": summary([seconds for seconds, _ in timed]),
        **compiling,
    }


def main() -> None:
    """Measure, print and write."""
    args = read(Options(), __doc__)
    known = works()
    lines = [measured(known["forward"], None)]
    lines += [measured(known[name], parties) for name in ("forward-public", "forward") for parties in PARTIES]
    for line in lines:
        console.print(f"{line['name']}, {line['weights']} weights: {line['seconds']['median']:.6f} s")
    device = jax.devices()[0]
    document = {
        "versions": provenance.versions(),
        "machine": provenance.machine(),
        "device": {"platform": device.platform, "kind": device.device_kind},
        "at": provenance.now(),
        "results": lines,
    }
    write_json(args.results / f"forward-{device.platform}.json", document)
