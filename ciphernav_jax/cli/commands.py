"""What `ciphernav train` and `ciphernav evaluate` do."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from rich.console import Console

from ciphernav_jax import files
from ciphernav_jax.cli.options import Evaluate, Train
from ciphernav_jax.learning.progress import bar
from ciphernav_jax.navigation import driving, folders, metrics, trainings
from ciphernav_jax.navigation.classifier import FreshClassifier
from ciphernav_jax.navigation.folders import Trained
from ciphernav_jax.navigation.methods import METHODS
from ciphernav_jax.navigation.owners import statement
from ciphernav_jax.navigation.plain import EndToEnd
from ciphernav_jax.navigation.rollout import Episodes, random_walk
from ciphernav_jax.protocols import Protocol
from ciphernav_jax.world import dataset

console = Console()


def train(args: Train) -> None:
    """Train as asked, and say where the result is.

    Raises:
        ValueError: options that do not go together, or a damaged or foreign folder.
        FileNotFoundError: no data set.
    """
    secret = args.method == "secret"
    _check(args, secret)
    protocol = _protocol(args.variant)
    data = dataset.load(args.data)
    if args.method in METHODS:
        recipe = EndToEnd(loss=args.loss, **_given(epochs=args.epochs, batch=args.batch))
        with bar(args.method) as report:
            trainings.train_end_to_end(data, args.method, recipe, args.seed, args.out, report)
    else:
        teacher = _encoders(args, data)
        parties = (args.parties or 2) if secret else None
        if parties:
            console.print(statement(parties), highlight=False)
        recipe = FreshClassifier(**_given(steps=args.steps, batch=args.batch))
        with bar(f"secret, {parties} parties" if parties else args.method) as report:
            trainings.train_classifier(data, teacher, recipe, args.seed, args.out, report, parties, protocol)
    console.print(f"Trained: {args.out}. Next: ciphernav evaluate --model {args.out} --data TEST_SET")


def evaluate(args: Evaluate) -> None:
    """Drive in every test environment, print the table row, write metrics.json.

    Raises:
        ValueError: the training folder is unfinished, damaged or foreign; or the data set is.
        FileNotFoundError: no data set.
    """
    data = dataset.load(args.data)
    name, drive = _driver(args, data)
    out = args.out or (Path("out/random") if name == "random" else args.model / "evaluation")
    with files.claimed(out):
        with console.status(f"{len(data)} robots drive"):
            counts = metrics.tally(data, drive())
        described = {key: data.meta.get(key) for key in ("split", "count", "seed", "unseen_by")}
        document = {"method": name, "seed": args.seed, "data": described, "counts": counts}
        files.write_json(out / "metrics.json", document)
    console.print(metrics.table({name: counts}, str(args.data)))
    console.print(f"Written: {out / 'metrics.json'}")


def _driver(args: Evaluate, data: dataset.Dataset) -> tuple[str, Callable[[], Episodes]]:
    """The name of the row, and what drives."""
    if str(args.model) == "random":
        if args.parties or args.variant != "default":
            raise ValueError("--parties and --variant are for trained models; a random walk has no secrets")
        return "random", lambda: random_walk(data, args.seed)
    protocol = _protocol(args.variant)
    config, model = folders.load(args.model)
    if parties := config["parties"] or args.parties:
        console.print(statement(parties, public_weights=not config["parties"]), highlight=False)
    return folders.row(config, args.parties), lambda: driving.drive(
        data, config, model, args.seed, args.parties, protocol=protocol
    )


def _encoders(args: Train, data: dataset.Dataset) -> Trained:
    if args.encoders:
        config, teacher = folders.load(args.encoders)
        if config["method"] != "plaintext":
            raise ValueError(
                f"{args.encoders} holds a {config['method']} training; --encoders needs a plaintext one"
            )
        return teacher
    recipe = EndToEnd(loss=args.loss, **_given(epochs=args.epochs))
    with bar("encoders, in plaintext") as report:
        return trainings.train_end_to_end(data, "plaintext", recipe, args.seed, args.out / "encoders", report)


def _check(args: Train, secret: bool) -> None:
    if args.variant != "default" and not secret:
        raise ValueError(f"--variant is for --method secret; {args.method} has no secrets")
    if args.parties is not None and not secret:
        raise ValueError(f"--parties is for --method secret; {args.method} has no secrets")
    if args.method in METHODS and (args.encoders or args.steps):
        raise ValueError(
            f"--encoders and --steps are for secret and plaintext-classifier, not for {args.method}"
        )
    if args.encoders and (args.epochs or args.loss != "cross-entropy"):
        raise ValueError("--epochs and --loss are for encoders that are trained; --encoders keeps others")


def _protocol(text: str) -> Protocol | None:
    return None if text == "default" else Protocol.parse(text)


def _given(**options: int | None) -> dict[str, Any]:
    # What the command line leaves open is the recipe's to choose.
    return {name: value for name, value in options.items() if value is not None}
