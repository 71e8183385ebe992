"""`python -m experiments bench | report | primitives | pages | programs | paper NAME`.

What a command needs is imported when it runs, so that `--help` is quick.
"""

import importlib
import sys

import tyro

from ciphernav_jax import command_line
from experiments.options import Bench, Pages, Primitives, Programs, Report

PAPER = (
    "accuracy",
    "paper_recipe",
    "fewest_steps",
    "beyond",
    "forward",
    "variants",
    "bounds",
    "episodes",
    "reconstruction",
    "own_runs",
    "queries",
)
"""The scripts of the paper's tables and figures, and of what it left open: modules of `experiments.paper`."""


def main() -> None:
    """Parse the command line and run the command."""
    with command_line.one_line():
        if sys.argv[1:2] == ["paper"]:
            _paper(sys.argv[2:])
            return
        command = tyro.extras.subcommand_cli_from_dict(
            {
                "bench": Bench,
                "report": Report,
                "primitives": Primitives,
                "pages": Pages,
                "programs": Programs,
            },
            prog="python -m experiments",
            description="What ciphernav_jax is measured by. The paper's tables and figures, a script each: "
            f"python -m experiments paper NAME; the names are {', '.join(PAPER)}.",
        )
        command_line.check(command)
        _run(command)


def _paper(words: list[str]) -> None:
    name = words[0] if words else ""
    if name not in PAPER:
        raise ValueError(
            f"no experiment {name!r} of the paper: write python -m experiments paper NAME; "
            f"the names are {', '.join(PAPER)}"
        )
    # The script reads its own options.
    sys.argv = [f"python -m experiments paper {name}", *words[1:]]
    importlib.import_module(f"experiments.paper.{name}").main()


def _run(command: Bench | Report | Primitives | Pages | Programs) -> None:
    match command:
        case Bench():
            from ciphernav_jax.protocols import Protocol
            from experiments import bench, peers

            bench.benchmark(
                parties=command.parties,
                names=command.work,
                protocols=[Protocol.parse(text) for text in command.variant],
                out=command.out,
                seed=command.seed,
                repeat=command.repeat,
                with_peers=peers.PEERS if command.peers else (),
                time_limit=command.time_limit,
            )
        case Report():
            from experiments.report import write

            write.write_report(command.results, command.out, command.readme)
        case Primitives():
            from experiments import primitives

            print(primitives.markdown(), end="")
        case Pages():
            from experiments import pages

            pages.write()
        case Programs():
            from experiments import programs

            programs.compile_many(command.count)


if __name__ == "__main__":
    main()
