"""The whole job, small: from MiniWorld pixels to a robot that navigates on secrets.

OUT/world/train, world/test   the data sets
OUT/models/...                a training folder for each method
OUT/table.json, table.md      the paper's accuracy table, ours beside it; what it was made on
OUT/curves.png, episodes.png  training curves; episodes with map, path and the five views
"""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path

from rich.console import Console

from ciphernav_jax import files, provenance
from ciphernav_jax.cli.options import Demo
from ciphernav_jax.files import write_json, write_text
from ciphernav_jax.learning.progress import bar
from ciphernav_jax.navigation import driving, folders, metrics, pictures, trainings
from ciphernav_jax.navigation.classifier import FreshClassifier
from ciphernav_jax.navigation.owners import cast, statement
from ciphernav_jax.navigation.plain import EndToEnd
from ciphernav_jax.navigation.rollout import Episodes, random_walk
from ciphernav_jax.world import dataset
from ciphernav_jax.world.dataset import Dataset

PLAIN = ("map-only", "plaintext")

console = Console(highlight=False)


class Clock:
    """Seconds by part."""

    def __init__(self):
        self.seconds: dict[str, float] = {}

    @contextmanager
    def part(self, name: str) -> Iterator[None]:
        """Time a part and add it to `seconds`."""
        start = time.perf_counter()
        yield
        self.seconds[name] = self.seconds.get(name, 0.0) + round(time.perf_counter() - start, 1)


def demonstrate(args: Demo) -> None:
    """Do everything, and leave it in `args.out`.

    Raises:
        ValueError: fewer than two parties, or a folder with something else in it.
        BusyError: another process is at work in the folder.
        RuntimeError: no OpenGL; the message says what to install.
    """
    for parties in args.parties:
        cast(parties)
    with files.claimed(args.out):
        _run(args)


def _run(args: Demo) -> None:
    clock, resumed = Clock(), (args.out / "models").exists()

    console.rule("1. A world, rendered by MiniWorld")
    with clock.part("generate"):
        train, test = (
            dataset.generate(split, count, args.seed, args.out / "world" / split, workers=args.workers)
            for split, count in (("train", args.train), ("test", args.test))
        )

    console.rule("2. Encoders and classifier in plaintext: nothing is secret yet")
    episodes = {"random": random_walk(test, args.seed)}
    plain_recipe, secret_recipe = EndToEnd(epochs=args.epochs), FreshClassifier(steps=args.steps)
    models = {name: args.out / "models" / name for name in (*PLAIN, "plaintext-classifier")}
    for name in PLAIN:
        with clock.part(f"train {name}"), bar(metrics.title(name)) as report:
            trainings.train_end_to_end(train, name, plain_recipe, args.seed, models[name], report)
    teacher = folders.load(models["plaintext"])[1]

    console.rule("3. A new classifier from scratch, on features that their owners computed")
    name = "plaintext-classifier"
    with clock.part(f"train {name}"), bar(metrics.title(name)) as report:
        trainings.train_classifier(train, teacher, secret_recipe, args.seed, models[name], report)
    for parties in args.parties:
        console.print(statement(parties))
        name = f"secret-{parties}"
        models[name] = args.out / "models" / name
        with clock.part(f"train {name}"), bar(metrics.title(name)) as report:
            trainings.train_classifier(
                train, teacher, secret_recipe, args.seed, models[name], report, parties
            )

    console.rule("4. Robots drive; the secret ones ask for every action under secret sharing")
    for name, folder in models.items():
        config, model = folders.load(folder)
        with clock.part(f"drive {name}"), console.status(f"{metrics.title(name)}: {len(test)} episodes"):
            episodes[name] = driving.drive(test, config, model, args.seed)

    console.rule("5. The table")
    _write(args, test, episodes, clock, resumed, (plain_recipe, secret_recipe))
    _draw(args.out, test, episodes, models, args.parties[-1])
    console.print(f"Written: {args.out}/table.json, table.md, curves.png, episodes.png")


def _write(
    args: Demo, test: Dataset, episodes: dict[str, Episodes], clock: Clock, resumed: bool, recipes: tuple
) -> None:
    counts = {name: metrics.tally(test, driven) for name, driven in episodes.items()}
    table = metrics.table(counts, f"{len(test)} test environments, half of which need a detour")
    console.print(table)
    document = {
        "configuration": {
            "seed": args.seed,
            "train": args.train,
            "test": args.test,
            "parties": args.parties,
            "end_to_end": asdict(recipes[0]),
            "classifier": asdict(recipes[1]),
        },
        "versions": provenance.versions(),
        "machine": provenance.machine(),
        "seconds": clock.seconds,
        "resumed": resumed,  # then the seconds are of what was left to do
        "counts": counts,
        "accuracy": {name: metrics.accuracy(metrics.overall(halves)) for name, halves in counts.items()},
    }
    write_json(args.out / "table.json", document)
    write_text(args.out / "table.md", f"{table.markdown()}\n")


def _draw(
    out: Path, test: Dataset, episodes: dict[str, Episodes], models: dict[str, Path], parties: int
) -> None:
    drawn = {metrics.title(name): folders.curve(folder) for name, folder in models.items()}
    plain = {metrics.title(name): drawn.pop(metrics.title(name)) for name in PLAIN}
    pictures.curves(plain, drawn, out / "curves.png")
    drivers = ["map-only", f"secret-{parties}"]
    blind, seeing = (episodes[name] for name in drivers)
    shown = pictures.interesting(test, blind, seeing) or [0]
    driven = {metrics.title(name): episodes[name] for name in drivers}
    pictures.episodes(test, driven, shown, out / "episodes.png")
