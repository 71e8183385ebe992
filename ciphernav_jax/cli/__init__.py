"""The command line: `ciphernav generate | train | evaluate | demo | sweep`.

- `options`: what each command can be told.
- `commands`: train and evaluate.
- `demo`: the whole job, small.
- `sweep`: variants compared on a function.

What a command needs is imported when it runs, so that `--help` is quick and the processes that
render never load JAX.
"""

from ciphernav_jax import extras

extras.require("navigation", "the command ciphernav")

import tyro  # noqa: E402

from ciphernav_jax import command_line  # noqa: E402
from ciphernav_jax.cli.options import Demo, Evaluate, Sweep, Train  # noqa: E402
from ciphernav_jax.world.generate import Generate  # noqa: E402


def main() -> None:
    """Parse the command line and run the command."""
    command = tyro.extras.subcommand_cli_from_dict(
        {
            "generate": Generate,
            "train": Train,
            "evaluate": Evaluate,
            "demo": Demo,
            "sweep": Sweep,
        },
        prog="ciphernav",
        description="A robot that navigates by other parties' cameras while nobody sees anybody's images.",
    )
    with command_line.one_line():
        command_line.check(command)
        _run(command)


def _run(command: Generate | Train | Evaluate | Demo | Sweep) -> None:
    match command:
        case Generate():
            from ciphernav_jax.world import generate

            generate.render(command)
        case Train():
            from ciphernav_jax.cli import commands

            commands.train(command)
        case Evaluate():
            from ciphernav_jax.cli import commands

            commands.evaluate(command)
        case Demo():
            from ciphernav_jax.cli import demo

            demo.demonstrate(command)
        case Sweep():
            from ciphernav_jax.cli import sweep

            sweep.compare_variants(command)
