"""Harms files, turns options to their ends, and kills commands, and judges what comes of it.

    python -m tests.fuzz --cases 1000          # files and options, in this process
    python -m tests.fuzz --cases 0 --kills 40  # commands killed at a random write to the disk, and run again

The verdict on each case is one of three. *Clear*: the command ends with 1 or 2 and one line (of the parser
a box) that names the file or the option. *Harmless*: it ends with 0 and leaves the same bytes as without the
harm. All else is *other*, and a fault: a traceback, a message that names nothing, a result that is silently
another one.

The commands are the real ones. Views are noise instead of rendered, trials of a sweep are not run, and
no pictures are drawn, so that a case takes a moment.
"""

import contextlib
import io
import itertools
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, NamedTuple, get_args, get_type_hints

import numpy as np
import tyro

from ciphernav_jax import cli, files, provenance
from ciphernav_jax.cli import options as of_library
from ciphernav_jax.comparison import Row, pictures, running
from ciphernav_jax.navigation import metrics
from ciphernav_jax.protocols import Protocol
from ciphernav_jax.world import dataset, shards
from ciphernav_jax.world.generate import Generate
from ciphernav_jax.world.grid import WALLS
from ciphernav_jax.world.poses import CAMERAS, IMAGE_SHAPE, POSE_CELL, POSES
from experiments import __main__ as experiments
from experiments import options
from experiments.report import figures, write

ROOT = Path(__file__).parents[1]
COUNT = 10
MADE = f"--count {COUNT} --workers 1"
TRAIN = "train --method map-only --data world/train --epochs 2 --seed 1"
SWEEP = "sweep --function tests.fuzz:squares --variant default truncation=nearest"
FRESH = "train --encoders seeing --data world/train --batch 8"
RESULTS = (
    "bench",
    *(f"paper/{name}" for name in ("map-only-0", "secret-2-0", "bounds", "forward-cpu", "variants")),
)


# What is faked ---------------------------------------------------------------------------------------------


def drawn(request: shards.Request, number: int) -> shards.Shard:
    """A shard with noise for views: a background for each layout, two views of each environment's own."""
    rng = np.random.default_rng([request.seed, number + 1])
    if number == shards.BACKGROUNDS:
        views = np.repeat(rng.integers(0, 256, (len(WALLS), 1, *IMAGE_SHAPE), np.uint8), POSES, axis=1)
        view_of = np.arange(views.shape[0] * POSES, dtype=np.int32).reshape(-1, POSES)
        return shards.Shard(views.reshape(-1, *IMAGE_SHAPE), view_of + len(WALLS) * POSES, "noise")
    indices = range(number * shards.SHARD, min((number + 1) * shards.SHARD, request.count))
    scenarios = [request.scenario(index) for index in indices]
    view_of = np.stack([s.layout * POSES + np.arange(POSES, dtype=np.int32) for s in scenarios])
    for row, scenario in enumerate(scenarios):
        there = ~scenario.blocked[POSE_CELL]
        there[: len(CAMERAS)] = True
        view_of[row, ~there] = -1
        view_of[row, :2] = len(WALLS) * POSES + 2 * row + np.arange(2)
    views = rng.integers(0, 256, (2 * len(scenarios), *IMAGE_SHAPE), np.uint8)
    return shards.Shard(views, view_of, "noise", shards._columns(scenarios))


def squares() -> tuple[Any, ...]:
    """What a sweep compares."""
    return (lambda x: x * x), np.ones(2)


def tried(
    subject: Any, protocol: Protocol, parties: int, key: Any, repeat: int | None, tell: Callable[[str], None]
) -> Row:
    """What a trial of a sweep could answer."""
    return Row(
        str(protocol), parties, protocol.ideal, seconds=0.01 * parties, rounds=43, error=1e-5, failed=7
    )


def tallied(*args: Any) -> dict[str, Any]:
    """The counts of episodes, and all their actions."""
    return tally(*args) | {"actions": args[1].actions.tolist()}


tally = metrics.tally


@contextlib.contextmanager
def faked() -> Iterator[None]:
    """No renderer, no trials, no pictures, no time."""
    fakes = [
        (shards, "SHARD", 4),
        (dataset, "draw_shards", lambda request, numbers, workers: (drawn(request, n) for n in numbers)),
        (running, "trial", tried),
        (write, "write_png", lambda path, figure, dpi: files.write_bytes(path, b"a picture")),
        (pictures, "draw", lambda rows, title, path: files.write_bytes(path, b"a picture")),
        (pictures, "figure", lambda rows, title: None),
        (figures, "svg", lambda picture: "<svg></svg>"),
        (metrics, "tally", tallied),
        (provenance, "now", lambda: "now"),
    ]
    before = [(module, name, getattr(module, name)) for module, name, _ in fakes]
    for module, name, fake in fakes:
        setattr(module, name, fake)
    try:
        yield
    finally:
        for module, name, real in before:
            setattr(module, name, real)


# Scenes ----------------------------------------------------------------------------------------------------


class Ended(NamedTuple):
    """A command's exit code, and what it wrote on standard error."""

    code: int
    error: str


def command() -> None:
    """`ciphernav`, or `python -m experiments` where the command is one of its."""
    (experiments if sys.argv[1] in ("bench", "report") else cli).main()


def run(words: list[str], folder: Path) -> Ended:
    """A command in a folder, in this process; a traceback counts as code -1."""
    before, error = os.getcwd(), io.StringIO()
    os.chdir(folder)
    sys.argv = ["ciphernav", *words]
    try:
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(error):
            command()
        return Ended(0, error.getvalue())
    except SystemExit as stopped:
        return Ended(stopped.code if isinstance(stopped.code, int) else 1, error.getvalue())
    except Exception as unexpected:
        return Ended(-1, repr(unexpected))
    finally:
        os.chdir(before)


@dataclass(frozen=True)
class Scene:
    """A command, the files that it reads, and where it writes; all in folders of the ground."""

    name: str
    command: str
    reads: str
    """A folder: each of its files is harmed."""
    needs: tuple[str, ...] = ()
    """Further folders that it reads."""
    writes: str = "out"


SCENES = (
    Scene("test set", "evaluate --model plain --data world/test --out out", "world/test", ("plain",)),
    Scene("training set", f"{TRAIN} --out out", "world/train"),
    Scene("data set made again", f"generate --out world/train {MADE}", "world/train", writes="world/train"),
    Scene("data set not to repeat", "generate --unseen-by world/train --count 6 --out out", "world/train"),
    Scene("generation killed", f"generate --out begun {MADE}", "begun.partial", writes="begun"),
    Scene("generation killed at its end", f"generate --out ended {MADE}", "ended.partial", writes="ended"),
    Scene("training", "evaluate --model plain --data world/test --out out", "plain", ("world/test",)),
    Scene("training made again", f"{TRAIN} --out plain", "plain", ("world/train",), "plain"),
    Scene("training killed", f"{TRAIN} --out halfway", "halfway", ("world/train",), "halfway"),
    Scene(
        "sweep",
        f"{SWEEP} --out sweep --parties 2 3",
        "sweep",
        writes="sweep",
    ),
    Scene("report", "report --results results --out out", "results"),
)
SECRET = (
    Scene(
        "encoders",
        f"{FRESH} --method plaintext-classifier --steps 2 --out out",
        "seeing",
        ("world/train",),
    ),
    Scene("secret", "evaluate --model secret --data world/test --out out", "secret", ("world/test",)),
)
"""Scenes that compile for a while."""


class Stop(Exception):
    pass


def ground(folder: Path, *, secret: bool) -> None:
    """Everything that the scenes read, as the commands make it."""

    def made(words: str) -> None:
        ended = run(words.split(), folder)
        assert ended.code == 0, ended

    for split in ("train", "test"):
        made(f"generate --split {split} --out world/{split} {MADE}")
    made(f"{TRAIN} --out plain")
    halfway(folder)
    shutil.copytree(folder / "world" / "train", folder / "whole")
    interrupted(folder, "begun", after=2)
    interrupted(folder, "ended", after=None)
    made(f"{SWEEP} --out sweep --parties 2")
    for name in RESULTS:
        (folder / "results" / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / "experiments" / "results" / f"{name}.json", folder / "results" / f"{name}.json")
    if secret:
        made("train --method plaintext --data world/train --epochs 1 --out seeing")
        made(f"{FRESH} --method secret --steps 2 --out secret")


def halfway(folder: Path) -> None:
    """The training of `plain`, as a kill after its first epoch leaves it."""
    from ciphernav_jax.navigation import trainings
    from ciphernav_jax.navigation.plain import EndToEnd

    def stop(*_: Any) -> None:
        raise Stop

    config = files.read_json(folder / "plain" / "config.json")
    recipe = EndToEnd(**config["recipe"])
    with contextlib.suppress(Stop):
        data = dataset.load(folder / "world" / "train")
        trainings.train_end_to_end(data, "map-only", recipe, config["seed"], folder / "halfway", stop)


def interrupted(folder: Path, name: str, after: int | None) -> None:
    """The data set `name`, as a kill after so many shards leaves it; for None, before its last rename."""

    def few(request: shards.Request, numbers: Any, workers: int) -> Iterator[shards.Shard]:
        for number in itertools.islice(numbers, after):
            yield drawn(request, number)
        if after is not None:
            raise Stop

    def no_rename(source: Any, target: Any) -> None:
        if Path(target) == folder / name:
            raise Stop
        replace(source, target)

    replace, draw = os.replace, dataset.draw_shards
    dataset.draw_shards = few
    os.replace = no_rename
    try:
        dataset.generate("train", COUNT, 0, folder / name, progress=False)
    except Stop:
        pass
    finally:
        os.replace, dataset.draw_shards = replace, draw


def left(folder: Path) -> dict[str, Any]:
    """All that a command left in a folder, without times, and JSON without its white space."""
    found: dict[str, Any] = {}
    for path in sorted(folder.rglob("*")):
        name = str(path.relative_to(folder))
        if path.name == "curve.json":
            points = json.loads(path.read_text())["points"]
            found[name] = [{k: v for k, v in p.items() if "seconds" not in k} for p in points]
        elif path.suffix == ".json":
            found[name] = json.loads(path.read_text())
        elif path.is_file() and path.name != "checkpoint.npz":
            found[name] = path.read_bytes()
    return found


def missing(found: dict[str, Any]) -> int:
    """How often a report says that something is missing, or was not measured."""
    said = (b"Missing; it is made by", b"not measured")
    return sum(found["paper.md"].count(words) for words in said)


# Harm ------------------------------------------------------------------------------------------------------


def flip(path: Path, rng: random.Random, _: list[Path]) -> None:
    """One bit."""
    content = bytearray(path.read_bytes())
    if content:
        content[rng.randrange(len(content))] ^= 1 << rng.randrange(8)
    path.write_bytes(content)


def cut(path: Path, rng: random.Random, _: list[Path]) -> None:
    """The end gone."""
    os.truncate(path, rng.randrange(path.stat().st_size or 1))


def empty(path: Path, *_: Any) -> None:
    """Nothing left."""
    os.truncate(path, 0)


def lengthen(path: Path, rng: random.Random, _: list[Path]) -> None:
    """Something behind it."""
    with open(path, "ab") as file:
        file.write(rng.randbytes(1 + rng.randrange(9000)))


def blank(path: Path, rng: random.Random, _: list[Path]) -> None:
    """A block of zeros, as of a bad sector."""
    content = bytearray(path.read_bytes())
    start = rng.randrange(len(content) or 1)
    content[start : start + 512] = bytes(len(content[start : start + 512]))
    path.write_bytes(content)


def lose(path: Path, *_: Any) -> None:
    """Gone."""
    path.unlink()


def folder_instead(path: Path, *_: Any) -> None:
    """A folder in its place."""
    path.unlink()
    path.mkdir()


def dangle(path: Path, *_: Any) -> None:
    """A link to nowhere in its place."""
    path.unlink()
    path.symlink_to("nowhere")


def swap(path: Path, rng: random.Random, others: list[Path]) -> None:
    """Another of our files in its place."""
    shutil.copy(rng.choice(others), path)


def noise(path: Path, rng: random.Random, _: list[Path]) -> None:
    """Noise of the same length."""
    path.write_bytes(rng.randbytes(path.stat().st_size))


def reshape(path: Path, rng: random.Random, _: list[Path]) -> None:
    """The same kind of file with content of another shape, without a right digest."""
    if path.suffix == ".json":
        value = json.loads(path.read_text())
        parents = [value]
        for parent in parents:
            children = parent.values() if isinstance(parent, dict) else parent
            parents += [child for child in children if isinstance(child, dict | list) and child]
        parent = rng.choice(parents)
        place = rng.choice(list(parent) if isinstance(parent, dict) else range(len(parent)))
        if rng.random() < 0.3:
            del parent[place]
        else:
            parent[place] = rng.choice([None, [], {}, "words", -1, 1e308, True, [[]], parent[place] == 0])
        path.write_text(
            rng.choice([json.dumps(value), json.dumps(value, indent=2), "[]", "{}", "null", "[" * 10**5])
        )
        return
    dtype = rng.choice([np.int8, np.float32, np.uint64, np.bool_])
    array = np.ones(tuple(rng.randrange(4) for _ in range(rng.randrange(4))), dtype)
    with open(path, "wb") as file:
        np.savez(file, **{"0": array}) if path.suffix == ".npz" else np.save(file, array)


def reseal(path: Path, rng: random.Random, others: list[Path]) -> None:
    """Of another shape with a right digest, as another version of the program could have written it."""
    if path.suffix != ".json":
        return reshape(path, rng, others)
    value = json.loads(path.read_text())
    value.pop(files.DIGEST, None)
    del value[rng.choice(list(value))]
    files.write_json(path, value)
    return None


HARMS = (
    *(flip, flip, flip, flip, cut, cut, empty, lengthen, blank, noise),
    *(lose, folder_instead, dangle, swap, swap, reshape, reshape, reseal),
)


class Case(NamedTuple):
    """What was done, and the verdict on what came of it."""

    what: str
    verdict: str
    ended: Ended


def clear(ended: Ended, *names: str) -> bool:
    """Whether a command said why it cannot be done."""
    named = any(name in ended.error for name in names)
    if ended.code == 2:
        return named
    return (
        ended.code == 1 and named and ended.error.startswith("ciphernav: ") and ended.error.count("\n") == 1
    )


class Fuzz:
    """A ground in a folder, and cases on copies of it.

    Args:
        folder: an empty one.
        secret: also scenes that compile for a while.
    """

    def __init__(self, folder: Path, *, secret: bool = False):
        self.ground, self._copy = folder / "ground", folder / "copy"
        self.ground.mkdir()
        ground(self.ground, secret=secret)
        self._scenes = SCENES + SECRET * secret
        self._every = [path for path in self.ground.rglob("*") if path.is_file()]
        self._expected = {scene.name: self._done(scene, lambda: None)[1] for scene in self._scenes}

    def _done(self, scene: Scene, harm: Callable[[], None]) -> tuple[Ended, dict[str, Any]]:
        shutil.rmtree(self._copy, ignore_errors=True)
        for folder in (scene.reads, *scene.needs):
            shutil.copytree(self.ground / folder, self._copy / folder)
        harm()
        ended = run(scene.command.split(), self._copy)
        return ended, left(self._copy / scene.writes) if ended.code == 0 else {}

    def file(self, rng: random.Random) -> Case:
        """One file harmed."""
        scene, harm = rng.choice(self._scenes), rng.choice(HARMS)
        there = sorted(p for p in (self.ground / scene.reads).rglob("*") if p.is_file())
        return self.harm(scene, harm, rng.choice(there).relative_to(self.ground), rng)

    def harm(self, scene: Scene, harm: Callable[..., None], path: Path, rng: random.Random) -> Case:
        """This file of this scene harmed so."""
        ended, found = self._done(scene, lambda: harm(self._copy / path, rng, self._every))
        verdict = "other"
        if ended.code == 0:
            verdict = "harmless" if found == self._expected[scene.name] else "other"
            if scene.name == "report" and missing(found) > missing(self._expected[scene.name]):
                verdict = "clear"  # it says so, with the command that makes it
        elif clear(ended, path.name, str(path.parent)):
            verdict = "clear"
        return Case(f"{scene.name}: {harm.__name__} {path}", verdict, ended)

    def option(self, rng: random.Random) -> Case:
        """One option turned to a value that must be refused."""
        words, option = rng.choice(REFUSED)
        shutil.rmtree(self._copy, ignore_errors=True)
        for folder in ("world", "plain", "results", "sweep"):
            shutil.copytree(self.ground / folder, self._copy / folder)
        (self._copy / "nothing").mkdir()
        (self._copy / "file").write_text("text")
        ended = run(words, self._copy)
        value = words[-1] if words[-1] != option else option
        refused = clear(ended, option, option.strip("-").replace("-", "_"), value)
        return Case(" ".join(words)[:200], "clear" if refused else "other", ended)


# Options ---------------------------------------------------------------------------------------------------

COMMANDS = {
    "generate": (Generate, "--out out --count 6 --workers 1"),
    "train": (of_library.Train, "--method map-only --data world/train --out out --epochs 1"),
    "evaluate": (of_library.Evaluate, "--model plain --data world/test --out out"),
    "demo": (of_library.Demo, "--out out --train 4 --test 4 --epochs 1 --steps 1"),
    "bench": (options.Bench, "--out out --work product"),
    "sweep": (of_library.Sweep, "--function tests.fuzz:squares --out out --parties 2 --variant default"),
    "report": (options.Report, "--results results --out out"),
}
NUMBERS = ("-1", str(10**24), "x", "", "1.5", "nan", "1e3", "0x10", "- 1", "1,000")
LARGE = str(10**12)
REALS = ("-1", "nan", "inf", "-inf", "x", "", "1e30")
VARIANTS = (
    *("", "x", "=", "truncation=", "truncation=x", "truncation", "Truncation=floor", "frac_bits=0"),
    *("frac_bits=None", "frac_bits=31", "frac_bits=1.5", "frac_bits=-1", "frac_bits=", "range_bits=99"),
    *(
        "range_bits=x",
        "frac_bits=16,",
        "frac_bits=16,frac_bits=16",
        "default,default",
        "adder=ripple adder=x",
    ),
    *("generator=md5", "opened=all", "argmax=none", f"frac_bits={10**24}"),
)
ABSENT = ("missing", "/dev/null", "/dev/null/x", "file", "nothing", "x" * 300, "/proc/self/mem")
UNWRITABLE = ("/dev/null", "/dev/null/x", "/proc/x", "file", "file/x", "x" * 300)


def refused() -> Iterator[tuple[list[str], str]]:
    """Words of a command, and the option in them that must be refused."""
    for command, (kind, base) in COMMANDS.items():
        hints = get_type_hints(kind)
        for about in fields(kind):
            option, hint = "--" + about.name.replace("_", "-"), hints[about.name]
            several, inner = "list" in str(hint), get_args(hint) or (hint,)
            for value in values(about.name, inner):
                yield [command, *without(base, option), option, value], option
            if several:
                yield [command, *without(base, option), option], option
        yield [command, *base.split(), "--nothing", "1"], "--nothing"
    for words, option in (
        ("evaluate --model random --data world/test --parties 2", "--parties"),
        ("evaluate --model random --data world/test --variant opened=logits", "--variant"),
        ("evaluate --model plain --data world/test --variant opened=logits", "--parties"),
        ("train --method map-only --data world/train --out out --parties 2", "--parties"),
        ("train --method map-only --data world/train --out out --steps 2", "--steps"),
        ("train --method secret --data world/train --out out --encoders plain --epochs 2", "--epochs"),
        ("train --method secret --data world/train --out out --encoders plain", "--encoders"),
    ):
        yield words.split(), option


def values(name: str, inner: tuple[Any, ...]) -> tuple[str, ...]:
    """Values of an option that must be refused."""
    if name in ("out",):
        return UNWRITABLE
    if name == "results":
        return tuple(value for value in ABSENT if value != "nothing")
    if name == "readme":
        return tuple(value for value in ABSENT if value not in ("file", "/dev/null"))
    if name == "variant":
        return VARIANTS
    if name == "function":
        return ("", "x", "SECRET", "tests.fuzz:nothing")
    if int in inner:
        return (*NUMBERS, *(() if name == "seed" else ("0", LARGE)))
    if float in inner:
        return REALS
    if Path in inner:
        return ABSENT
    if bool in inner:
        return ("x",)
    return ("", "x", "SECRET", "None")


def without(base: str, option: str) -> list[str]:
    """The words without an option and its value."""
    words = base.split()
    if option in words:
        del words[words.index(option) : words.index(option) + 2]
    return words


REFUSED = list(refused())


# Kills -----------------------------------------------------------------------------------------------------

PROGRAM = """
import atexit, os, signal, sys, threading
sys.path.insert(0, {root!r})
from tests import fuzz
calls, at, seconds, here = 0, {at}, {seconds}, os.getcwd()
def kill():
    os.kill(os.getpid(), signal.SIGKILL)
def counted(function):
    def call(place, *args, **kwargs):
        global calls
        if isinstance(place, int) or os.path.abspath(place).startswith(here):
            calls += 1
            if calls == at:
                kill()
        return function(place, *args, **kwargs)
    return call
for name in ("replace", "fsync", "mkdir", "unlink", "rmdir"):
    setattr(os, name, counted(getattr(os, name)))
if seconds:
    timer = threading.Timer(seconds, kill)
    timer.daemon = True
    timer.start()
atexit.register(lambda: print(calls, file=sys.stderr))
with fuzz.faked():
    fuzz.command()
"""


class Job(NamedTuple):
    """A command that is killed and run again: its words, the folders that it reads, and the one it writes."""

    words: str
    needs: tuple[str, ...] = ()
    writes: str = "made"


JOBS = {
    "generate": Job(f"generate --out made {MADE}"),
    "train": Job(f"{TRAIN} --out made", ("world/train",)),
    "train in secret": Job(
        f"{FRESH} --method secret --steps 80 --out made",
        ("world/train", "seeing"),
    ),
    "evaluate": Job("evaluate --model plain --data world/test --out made", ("world/test", "plain")),
    "sweep": Job(f"{SWEEP} --out made --parties 2 3"),
    "report": Job("report --results results --out made", ("results",)),
}


class Kills:
    """Jobs that are killed in processes of their own, on a ground."""

    def __init__(self, ground: Path, folder: Path):
        self._ground, self._folder = ground, folder
        self._whole: dict[str, tuple[int, float, dict[str, Any]]] = {}
        self.count = 0

    def _run(self, words: str, at: int = 0, seconds: float = 0.0) -> tuple[int, str]:
        code = PROGRAM.format(root=str(ROOT), at=at, seconds=seconds)
        command = [sys.executable, "-c", code, *words.split()]
        done = subprocess.run(command, cwd=self._folder, capture_output=True, text=True, check=False)
        return done.returncode, done.stderr

    def _prepare(self, job: Job) -> None:
        shutil.rmtree(self._folder, ignore_errors=True)
        self._folder.mkdir()
        for need in job.needs:
            shutil.copytree(self._ground / need, self._folder / need)

    def whole(self, name: str) -> tuple[int, float, dict[str, Any]]:
        """Of a job that nobody kills: its calls to the disk, its seconds, and what it leaves."""
        if name not in self._whole:
            self._prepare(JOBS[name])
            began = time.perf_counter()
            code, said = self._run(JOBS[name].words)
            assert code == 0, said
            seconds = time.perf_counter() - began
            self._whole[name] = int(said.split()[-1]), seconds, left(self._folder / JOBS[name].writes)
        return self._whole[name]

    def kill(self, name: str, rng: random.Random, *, clock: bool = False) -> Case:
        """A job killed up to three times, each at a call to the disk, and then run to its end.

        With `clock` some kills are at a moment instead, which may come too late.
        """
        job, (calls, seconds, expected) = JOBS[name], self.whole(name)
        self._prepare(job)
        moments = []
        for _ in range(rng.randint(1, 3)):
            moment = {"at": rng.randint(1, calls)}
            if clock and rng.random() < 0.3:
                moment = {"seconds": seconds * rng.random()}
            if self._run(job.words, **moment)[0] == -signal.SIGKILL:
                moments.append(moment)
        self.count += len(moments)
        code, said = self._run(job.words)
        same = code == 0 and left(self._folder / job.writes) == expected
        return Case(f"{name}: killed {moments}", "harmless" if same else "other", Ended(code, said))


# ------------------------------------------------------------------------------------------------------------


@dataclass
class Options:
    """How much to try."""

    cases: int = 1000
    """Harmed files and options, by turns."""
    kills: int = 0
    """Commands killed, by turns."""
    seed: int = 0
    """Of everything random."""
    secret: bool = True
    """Also what compiles for a while: encoders, and trainings in secret."""


def main() -> int:
    """Print every case that is *other*, and the counts; 1 if there is any such case."""
    args, counts = tyro.cli(Options, description=__doc__), Counter()
    with tempfile.TemporaryDirectory() as folder, faked():
        fuzz = Fuzz(Path(folder), secret=args.secret)
        for number in range(args.cases):
            rng = random.Random(f"{args.seed} {number}")
            case = fuzz.option(rng) if number % 3 == 2 else fuzz.file(rng)
            report(case, number, counts, "option" if number % 3 == 2 else "file")
            if number % 100 == 99:
                print(f"{number + 1} cases", flush=True)
        kills = Kills(fuzz.ground, Path(folder) / "killed")
        jobs = [name for name in JOBS if args.secret or "secret" not in name]
        for number, name in enumerate(itertools.islice(itertools.cycle(jobs), args.kills)):
            case = kills.kill(name, random.Random(f"{args.seed} {number}"), clock=True)
            report(case, number, counts, f"kill of {name}")
        print(f"{kills.count} kills")
    for (kind, verdict), count in sorted(counts.items()):
        print(f"{kind}: {verdict} {count}")
    return int(any(verdict == "other" for _, verdict in counts))


def report(case: Case, number: int, counts: Counter, kind: str) -> None:
    counts[kind, case.verdict] += 1
    if case.verdict == "other":
        print(f"{number} OTHER {case.what}: {case.ended.code} {case.ended.error[-500:]!r}", flush=True)


if __name__ == "__main__":
    sys.exit(main())
