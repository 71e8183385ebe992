"""A row of a table: trained, driven in both test sets, and written as one JSON file for each seed.

OUT/world/train        15,000 training environments
OUT/world/validation, validation-unseen   2,250 each, drawn as the test sets are, to choose recipes by
OUT/world/test         2,250 drawn independently of training, as the paper does
OUT/world/unseen       2,250 without any layout-with-obstacles that training has
OUT/models/ROW-SEED    a training folder; killed, it goes on to the same bits
OUT/models/sight-SEED  that of a robot's own eyes
RESULTS/ROW-SEED.json  configuration, seed, versions, machine, seconds, curve and raw counts

A row whose file is there is not run again, and is said to be kept. `--small` does all of it at a size to try
it out by, in OUT/small.
"""

import functools
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import jax
import numpy as np
import tyro
from numpy.typing import NDArray
from rich.console import Console

from ciphernav_jax import provenance
from ciphernav_jax.command_line import SEED, read
from ciphernav_jax.files import read_json, write_json
from ciphernav_jax.learning.progress import bar
from ciphernav_jax.navigation import classifier, driving, folders, metrics, trainings
from ciphernav_jax.navigation.classifier import FreshClassifier
from ciphernav_jax.navigation.methods import METHODS
from ciphernav_jax.navigation.owners import cast
from ciphernav_jax.navigation.plain import EndToEnd
from ciphernav_jax.navigation.policies import best_action
from ciphernav_jax.navigation.rollout import Episodes, random_walk
from ciphernav_jax.navigation.samples import start_headings, training_samples
from ciphernav_jax.navigation.sight import Looking
from ciphernav_jax.secret import cost, secure, share
from ciphernav_jax.world import dataset
from ciphernav_jax.world.dataset import Dataset
from ciphernav_jax.world.grid import STOP
from ciphernav_jax.world.shards import Request

console = Console(highlight=False)

TRAIN, TEST = 15_000, 2_250


class Size(NamedTuple):
    """How many environments the training set has, and each of the others."""

    train: int
    test: int


FULL, SMALL = Size(TRAIN, TEST), Size(200, 100)
TEST_SETS = ("test", "unseen")


@dataclass(frozen=True)
class Row:
    """A method with its recipe.

    Attributes:
        name: of its files; the table's titles are `metrics.title`'s.
        method: "random", one of `METHODS`, "plaintext-classifier", "secret" or "alone".
        recipe: how it is trained; None for the random walk, for a robot alone, and where `drives` is said.
        parties: who share a secret training.
        teacher: the row whose encoders a fresh classifier keeps, of the same seed.
        drives: the row whose training, of the same seed, drives; None for one of this row's own.
        eyes: how they are trained, of a robot that uses what it alone knows (`rollout.Careful`).
    """

    name: str
    method: str
    recipe: EndToEnd | FreshClassifier | None = None
    parties: int | None = None
    teacher: str = "plaintext"
    drives: str | None = None
    eyes: Looking | None = None


@dataclass
class Options:
    """What every script can be told."""

    seeds: Annotated[list[int], SEED, tyro.conf.arg(metavar="S [S ...]")] = field(
        default_factory=lambda: [0, 1, 2]
    )
    """One run each; everything random in it comes from its seed, but for the data sets."""
    out: Path = Path("out/paper")
    """Folder for the data sets and the training folders; several GB."""
    results: Path = Path("experiments/results/paper")
    """Folder for the JSON files. A run that has its file there is not done again."""

    @property
    def size(self) -> Size:
        """Of the data sets."""
        return FULL


def world(name: str, options: Options) -> Dataset:
    """A data set in OUT/world, generated where it is missing."""
    folder = options.out / "world" / name
    if name == "train":
        return dataset.generate(name, options.size.train, 0, folder)
    split = "validation" if name.startswith("validation") else "test"
    unseen_by = training(options.size.train) if name.endswith("unseen") else None
    return dataset.generate(split, options.size.test, 0, folder, unseen_by=unseen_by)


@functools.cache
def training(count: int) -> Request:
    """What the training set consists of; to know it, none of its views need be rendered."""
    return Request("train", count, 0)


@dataclass
class RowOptions(Options):
    """The options of a script whose results are rows."""

    rows: Annotated[list[str], tyro.conf.arg(metavar="ROW [ROW ...]")] = field(default_factory=list)
    """Which rows."""
    small: bool = False
    """To try the script out: 200 training and 100 test environments, a tenth of the steps of classifiers and
    of eyes. Everything is written to OUT/small, the JSON to OUT/small/results. These are no results of the
    paper's task, and stay apart from them."""

    @property
    def size(self) -> Size:
        """Of the data sets."""
        return SMALL if self.small else FULL


def script(doc: str | None, rows: Sequence[Row], default: RowOptions, teachers: Sequence[Row] = ()) -> None:
    """The main program of a script: its rows with all seeds, and a table of them.

    Args:
        doc: the script's docstring, which `--help` shows.
        rows: what can be asked for.
        default: the options when nothing is asked for.
        teachers: other rows whose encoders these keep.

    Raises:
        ValueError: a row that is not there.
    """
    args = read(default, doc)
    known = {row.name: row for row in rows}
    if unknown := [name for name in args.rows if name not in known]:
        raise ValueError(f"no row {', '.join(unknown)}; the rows are {', '.join(known)}")
    known |= {row.name: row for row in teachers}
    heading = "On the independent test set"
    if args.small:
        if args.results != default.results:
            raise ValueError("--small writes its JSON to OUT/small/results; leave --results out")
        args = replace(args, out=args.out / "small", results=args.out / "small" / "results")
        known = {name: shortened(row) for name, row in known.items()}
        heading += f", small: {SMALL.train} environments to train, {SMALL.test} to test; not the paper's task"
    runs = [(known[name], seed) for name in args.rows for seed in args.seeds]
    kept = [result_file(*run, args) for run in runs if result_file(*run, args).exists()]
    counts = {}
    for row, seed in runs:
        document = run_row(row, seed, known, args)
        counts[f"{row.name}, seed {seed}"] = document["results"]["test"]["counts"]
    console.print(metrics.table(counts, heading))
    if kept:
        other = "--out FOLDER" if args.small else f"--results {args.out / 'results'}"
        console.print(
            f"{len(kept)} of {len(runs)} runs were kept from {args.results}, and not run now. To run them, "
            f"name a folder without them: {other}. Trainings and data sets in {args.out} are kept too.",
            soft_wrap=True,
        )


def shortened(row: Row) -> Row:
    """The row with a tenth of its steps; epochs of encoders are short by themselves where there is little."""
    recipe, eyes = row.recipe, row.eyes
    if isinstance(recipe, FreshClassifier):
        recipe = replace(recipe, steps=recipe.steps // 10)
    return replace(row, recipe=recipe, eyes=eyes and replace(eyes, steps=eyes.steps // 10))


def result_file(row: Row, seed: int, options: Options) -> Path:
    """Where a run's JSON is."""
    return options.results / f"{row.name}-{seed}.json"


def run_row(row: Row, seed: int, teachers: dict[str, Row], options: Options) -> dict[str, Any]:
    """Train, drive and write RESULTS/ROW-SEED.json, unless it is there.

    Returns:
        What the file holds: row, seed, configuration, versions, machine, at; seconds of the training (with
        compile apart) and of the driving; curve; results: for each test set counts and by_length (see
        `by_length`); for a classifier epochs, how often it went over its samples; and for a secret training
        cost: of a step and of a decision, see `Cost.as_dict`. Of careful robots the training is that of their
        eyes, and results say in `alone` how many came to plan for themselves.

    Raises:
        ValueError: the file there is of another configuration.
    """
    path = result_file(row, seed, options)
    configuration = configured(row, options.size)
    if path.exists():
        document = read_json(path)
        if document.get("configuration") != configuration:
            raise ValueError(f"{path} is of another configuration; remove it, or choose another --results")
        made = f"made {document['at']} with " + ", ".join(
            f"{name} {document['versions'].get(name)}" for name in ("ciphernav_jax", "jax")
        )
        console.print(f"{row.name}, seed {seed}: kept, not run; {path}, {made}", soft_wrap=True)
        return document

    console.print(f"{row.name}, seed {seed}")
    driver, curve = _driver(row, seed, teachers, options)
    seconds: dict[str, float] = {
        "train": sum(point["seconds"] for point in curve),
        "compile": sum(point.get("compile_seconds", 0.0) for point in curve),
    }
    results = {}
    for name in TEST_SETS:
        environments = world(name, options)
        began = time.perf_counter()
        episodes = driver(environments)
        seconds[f"drive {name}"] = time.perf_counter() - began
        results[name] = {
            "counts": metrics.tally(environments, episodes),
            "by_length": by_length(environments, episodes),
        }
        if episodes.alone is not None:
            results[name]["alone"] = int(episodes.alone.sum())
    document = {
        "row": row.name,
        "seed": seed,
        "configuration": configuration,
        "versions": provenance.versions(),
        "machine": provenance.machine(),
        "at": provenance.now(),
        "seconds": {name: round(value, 3) for name, value in seconds.items()},
        "curve": curve,
        "results": results,
    }
    if isinstance(row.recipe, FreshClassifier):
        document["epochs"] = round(epochs(row.recipe, seed, options), 3)
        if row.parties:
            document["cost"] = costs(row.recipe, row.parties)
            document["held"] = {party.name: party.slots for party in cast(row.parties)}
    write_json(path, document)
    return read_json(path)


def configured(row: Row, size: Size = FULL) -> dict[str, Any]:
    """What a result file says of its row and of the data; a file that says otherwise is of another run."""
    return {"row": asdict(row), **size._asdict()}


def train_row(row: Row, seed: int, teachers: dict[str, Row], options: Options) -> Path:
    """The training folder of a row, trained where it is not yet; its teacher before."""
    folder = options.out / "models" / f"{row.name}-{seed}"
    environments = world("train", options)
    if isinstance(row.recipe, EndToEnd):
        with bar(f"{row.name}, seed {seed}") as report:
            trainings.train_end_to_end(environments, row.method, row.recipe, seed, folder, report)
    else:
        assert row.recipe is not None, "a random walk is not trained"
        teacher = folders.load(train_row(teachers[row.teacher], seed, teachers, options))[1]
        with bar(f"{row.name}, seed {seed}") as report:
            trainings.train_classifier(environments, teacher, row.recipe, seed, folder, report, row.parties)
    return folder


def _driver(
    row: Row, seed: int, teachers: dict[str, Row], options: Options
) -> tuple[Callable[[Dataset], Episodes], list[dict]]:
    """How it drives in a data set, and its training curve; of careful robots that of their eyes."""
    if row.method == "random":
        return lambda environments: random_walk(environments, seed), []
    eyes, curve = _eyes(row.eyes, seed, options) if row.eyes else (None, [])
    if row.method == "alone":
        return functools.partial(_drive_alone, eyes=eyes), curve
    folder = train_row(teachers[row.drives] if row.drives else row, seed, teachers, options)
    config, model = folders.load(folder)

    def drive(environments: Dataset) -> Episodes:
        return driving.drive(environments, config, model, seed, eyes=eyes)

    return drive, curve or folders.curve(folder)


def _eyes(recipe: Looking, seed: int, options: Options) -> tuple[Any, list[dict]]:
    """Weights of a robot's sight, trained where they are not yet, and the curve of that."""
    folder = options.out / "models" / f"sight-{seed}"
    with bar(f"sight, seed {seed}") as report:
        weights = trainings.train_sight(world("train", options), recipe, seed, folder, report)
    return weights, folders.curve(folder)


def _drive_alone(environments: Dataset, eyes: Any) -> Episodes:
    """Nobody answers: the robot plans for itself from the start."""

    def silence(step: int, cells: NDArray[np.int64], headings: NDArray[np.int64]) -> NDArray[np.int64]:
        return np.full(len(cells), STOP)

    headings = start_headings(environments, METHODS["plaintext"])
    return driving.drive_carefully(environments, silence, headings, eyes)


def epochs(recipe: FreshClassifier, seed: int, options: Options) -> float:
    """How often a training goes over its samples."""
    samples = training_samples(
        world("train", options), METHODS["plaintext"], seed, recipe.errands, recipe.stray
    )
    return recipe.steps * recipe.batch / len(samples)


def by_length(environments: Dataset, episodes: Episodes) -> dict[str, metrics.Counts]:
    """The counts of `metrics.tally` for each length of the shortest path, in moves without the stop."""
    lengths = (np.asarray(environments.actions) > 0).sum(axis=1)
    return {
        str(length): metrics.tally(environments, episodes, lengths == length)
        for length in np.unique(lengths).tolist()
    }


@functools.cache
def costs(recipe: FreshClassifier, parties: int) -> dict[str, Any]:
    """Rounds and bytes of a training step and of one robot's decision, from traces alone."""
    step, (state, slots, labels, decay) = classifier.training_step(recipe)

    def shapes(values: Any) -> Any:
        return jax.eval_shape(lambda key: share(key, values, parties=parties), jax.random.key(0))

    training = cost(secure(step), *shapes((state, slots, labels)), decay)
    decision = cost(secure(best_action), *shapes((state[0], tuple(slot[:1] for slot in slots))))
    return {"training step": training.as_dict(), "decision": decision.as_dict()}
