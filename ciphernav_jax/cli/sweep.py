"""What `ciphernav sweep` does."""

import importlib
import os
import sys
from collections.abc import Callable
from typing import Any

from rich.console import Console

from ciphernav_jax.cli.options import Sweep
from ciphernav_jax.comparison import compare
from ciphernav_jax.comparison.subject import words
from ciphernav_jax.navigation import classifier
from ciphernav_jax.navigation.classifier import FreshClassifier
from ciphernav_jax.protocols import Protocol

console = Console(highlight=False)

Given = tuple[Callable[..., Any], tuple[Any, ...], tuple[int, ...]]
"""A function, its arguments, and which of them are public."""


def compare_variants(args: Sweep) -> None:
    """Compare as asked, print the tables, and say where they are.

    Raises:
        ValueError: a variant, or a function, that there is not; or OUT holds another comparison.
        What the function was refused with, where it was with all variants.
    """
    protocols = [Protocol.parse(text) for text in args.variant]
    function, given, public = named(args.function) if args.function is not None else training_step(args.seed)
    try:
        compared = compare(
            function,
            *given,
            parties=args.parties,
            protocols=protocols,
            public=public,
            out=args.out,
            repeat=args.repeat,
            seed=args.seed,
        )
    except TypeError as error:  # of the function and its arguments, which are the user's
        raise ValueError(words(error)) from error
    console.print(compared)
    console.print(f"Written: {args.out}/comparison.json, comparison.md, comparison.png")


def named(name: str) -> Given:
    """What the function of that name, package.module:name, gives to compare: a function and its arguments.

    Raises:
        ValueError: there is no such function; or it fails, or gives something else.
    """
    module, colon, attribute = name.partition(":")
    if not (module and colon and attribute):
        raise ValueError(f"--function is written package.module:name, not {name!r}")
    if os.getcwd() not in sys.path:
        sys.path.insert(0, os.getcwd())  # as `python -m` does
    try:
        make = getattr(importlib.import_module(module), attribute)
        made = make()
    except Exception as error:  # whatever the user's own code does
        raise ValueError(f"--function {name}: {words(error)}") from error
    if not isinstance(made, tuple) or len(made) < 2 or not callable(made[0]):
        raise ValueError(f"--function {name} must return a function and its arguments, (function, *args)")
    return made[0], made[1:], ()


def training_step(seed: int) -> Given:
    """A step of training the paper's classifier on random features, all of it secret but the rate."""
    step, given = classifier.training_step(FreshClassifier(), seed)
    return step, given, (len(given) - 1,)
