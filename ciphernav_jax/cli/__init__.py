"""The command line: `ciphernav generate | train | evaluate | demo | bench | sweep | report`.

- `options`: what each command can be told.
- `commands`: train and evaluate.
- `demo`: the whole job, small.

`bench`, `sweep` and `report` are in the package `experiments`.

What a command needs is imported when it runs, so that `--help` is quick and the processes that
render never load JAX.
"""

import tyro

from ciphernav_jax import command_line
from ciphernav_jax.cli.options import Bench, Demo, Evaluate, Report, Sweep, Train
from ciphernav_jax.world.generate import Generate


def main() -> None:
    """Parse the command line and run the command."""
    command = tyro.extras.subcommand_cli_from_dict(
        {
            "generate": Generate,
            "train": Train,
            "evaluate": Evaluate,
            "demo": Demo,
            "bench": Bench,
            "sweep": Sweep,
            "report": Report,
        },
        prog="ciphernav",
        description="A robot that navigates by other parties' cameras while nobody sees anybody's images.",
    )
    with command_line.one_line():
        command_line.check(command)
        _run(command)


def _run(command: Generate | Train | Evaluate | Demo | Bench | Sweep | Report) -> None:
    match command:
        case Generate():
            from ciphernav_jax.world import generate

            generate.run(command)
        case Train():
            from ciphernav_jax.cli import commands

            commands.train(command)
        case Evaluate():
            from ciphernav_jax.cli import commands

            commands.evaluate(command)
        case Demo():
            from ciphernav_jax.cli import demo

            demo.run(command)
        case Bench():
            from ciphernav_jax.experiments import bench, peers, variants

            bench.run(
                parties=command.parties,
                names=command.work,
                protocols=[variants.parse(text) for text in command.variant],
                out=command.out,
                seed=command.seed,
                repeat=command.repeat,
                with_peers=peers.PEERS if command.peers else (),
                time_limit=command.time_limit,
            )
        case Sweep():
            from ciphernav_jax.experiments import sweep, variants
            from ciphernav_jax.experiments.trial import Effort

            sweep.run(
                parties=command.parties,
                protocols=[variants.parse(text) for text in command.variant],
                out=command.out,
                seed=command.seed,
                effort=Effort(steps=command.steps, time_limit=command.time_limit),
            )
        case Report():
            from ciphernav_jax.experiments.report import write

            write.run(command.results, command.out, command.readme)
