"""The command line: `ciphernav generate | train | evaluate | demo`.

- `options`: what each command can be told.
- `commands`: train and evaluate.
- `demo`: the whole job, small.

What a command needs is imported when it runs, so that `--help` is quick and the processes that
render never load JAX.
"""

import sys

import tyro

from ciphernav_jax.cli.options import Demo, Evaluate, Train
from ciphernav_jax.world.generate import Generate


def main() -> None:
    """Parse the command line and run the command."""
    command = tyro.extras.subcommand_cli_from_dict(
        {"generate": Generate, "train": Train, "evaluate": Evaluate, "demo": Demo},
        prog="ciphernav",
        description="A robot that navigates by other parties' cameras while nobody sees anybody's images.",
    )
    try:
        _run(command)
    except (ValueError, FileNotFoundError, FileExistsError, RuntimeError) as error:
        print(f"ciphernav: {error}", file=sys.stderr)
        sys.exit(1)


def _run(command: Generate | Train | Evaluate | Demo) -> None:
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
