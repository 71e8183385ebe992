"""Draws and checks random programs of every variant and several numbers of parties; prints what it finds.

    python -m tests.secret.random_programs --jobs 2             # 100 of each: about 7,000 programs, an hour
    python -m tests.secret.random_programs --count 20 --only truncation=nearest --parties 2 3
    python -m tests.secret.random_programs --only default --parties 2 --numbers 17     # one program again

A file keeps what is done, and a run that was stopped goes on from it. Exit code 1 where anything was found.
To try another commit, copy this folder into its `tests/secret`.
"""

import argparse
import json
import multiprocessing
import os
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from .variants import PARTIES, Task, part, variants

PART = 10  # programs that are checked, and kept as done, together
# Most of the time goes into compiling single operations: they are compiled in haste, and once for all jobs.
QUICK = "--xla_backend_optimization_level=0 --xla_llvm_disable_expensive_passes=true"
CACHED = {
    "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0",
    "JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES": "-1",
}


def tasks(options: argparse.Namespace) -> Iterator[Task]:
    chosen = {name: of for name, of in variants().items() if not options.only or name in options.only}
    numbers = options.numbers or list(range(options.count))
    for name, protocol in chosen.items():
        for parties in options.parties:
            if protocol.truncation != "local" or parties == 2:
                for i in range(0, len(numbers), PART):
                    yield name, parties, options.seed, numbers[i : i + PART], options.widest


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="programs", description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument(
        "--count", type=int, default=100, help="programs of each variant and number of parties"
    )
    parser.add_argument("--parties", type=int, nargs="+", default=PARTIES)
    parser.add_argument("--only", nargs="+", help=f"variants: {'; '.join(variants())}")
    parser.add_argument("--numbers", type=int, nargs="+", help="these programs alone")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--widest", type=int, default=2**20, help="most entries of an array")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--out", type=Path, help="file of results, a line of JSON for each part")
    options = parser.parse_args()

    known = (
        [json.loads(line) for line in options.out.read_text().splitlines()]
        if options.out and options.out.exists()
        else []
    )
    done = {(x["variant"], x["parties"], x["seed"], *x["numbers"]) for x in known}
    left = [task for task in tasks(options) if (*task[:3], *task[3]) not in done]
    pool = multiprocessing.get_context("spawn").Pool
    with tempfile.TemporaryDirectory() as cache:
        os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} {QUICK}"
        os.environ |= CACHED | {"JAX_COMPILATION_CACHE_DIR": cache}
        with pool(options.jobs, maxtasksperchild=25) as jobs:
            for result in jobs.imap_unordered(part, left):
                known.append(result)
                if options.out:
                    with options.out.open("a") as file:
                        file.write(json.dumps(result) + "\n")
                show(result)
    total, found = sum(len(x["numbers"]) for x in known), sum(len(x["found"]) for x in known)
    print(f"{total} programs, {found} found, {sum(x['cpu_seconds'] for x in known):.0f} s of CPU")
    return 1 if found else 0


def show(result: dict[str, Any]) -> None:
    print(
        f"{result['variant']}, P = {result['parties']}: {len(result['numbers'])} programs, "
        f"{len(result['found'])} found, {result['cpu_seconds']} s of CPU",
        flush=True,
    )
    for x in result["found"]:
        program = "".join(f"    {line}\n" for line in x["program"].splitlines())
        print(f"  number {x['number']}: {x['what']}\n{program}", flush=True)


if __name__ == "__main__":
    sys.exit(main())
