"""The renderers at work: a data set's environments in shards, drawn by clean worker processes.

A shard is decided by the request and its number alone, whoever draws it. Workers are fresh
interpreters rather than forks or copies of the caller: OpenGL hangs after a fork, and what else
a process has imported can change pixels.
"""

import subprocess
import sys
import traceback
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from functools import cached_property
from multiprocessing import Pipe
from multiprocessing.connection import Connection, wait

import numpy as np
from numpy.typing import NDArray

from ciphernav_jax.lifeline import end_with_parent, lifeline
from ciphernav_jax.world import planner, visibility
from ciphernav_jax.world.grid import WALLS
from ciphernav_jax.world.poses import CAMERAS, IMAGE_SHAPE, POSE_CELL, POSES
from ciphernav_jax.world.scenario import MAX_OBSTACLES, Scenario, draw, key

SHARD = 100
"""Environments in a shard: some three seconds of one core."""
BACKGROUNDS = -1
"""The number of the shard that holds the views without obstacles, which all others refer to."""
_TIMEOUT = 300.0
"""Seconds in which some worker has to deliver a shard."""


@dataclass(frozen=True)
class Request:
    """What a data set is to contain; two equal requests give equal bytes.

    `seen` are the keys (see `Scenario.key`) that must not come up.
    """

    split: str
    count: int
    seed: int
    seen: frozenset[tuple[int, int]] = frozenset()

    @property
    def shards(self) -> int:
        """How many shards of environments there are, without the backgrounds."""
        return -(-self.count // SHARD)

    def scenario(self, index: int) -> Scenario:
        """Environment `index`: odd ones need a detour, even ones do not, so the mix is half and half."""
        stream = f"{self.split} unseen" if self.seen else self.split
        rng = np.random.default_rng([self.seed, *stream.encode(), index])
        return draw(rng, detour=index % 2 == 1, seen=self.seen)

    @cached_property
    def columns(self) -> dict[str, NDArray]:
        """The arrays that describe all its environments, see `Dataset`; nothing is rendered for them."""
        return _columns([self.scenario(index) for index in range(self.count)])

    def pairs(self) -> frozenset[tuple[int, int]]:
        """The (layout, obstacle cells) pairs that occur, see `Scenario.key`."""
        return frozenset(map(key, self.columns["layout"], self.columns["obstacles"]))


@dataclass(frozen=True)
class Shard:
    """Rendered views, and the environments that they belong to.

    Attributes:
        views: uint8[M, 45, 60, 3], the images drawn for this shard.
        view_of: int32[n, 104], for each environment and pose (see `poses`): -1 where there is no
            view; 104 * layout + pose, a background; or 12 * 104 + i, image i of `views`.
        columns: the environments' other arrays, by name, each with n rows.
        gl: the OpenGL renderer that drew.
    """

    views: NDArray[np.uint8]
    view_of: NDArray[np.int32]
    gl: str
    columns: dict[str, NDArray] = field(default_factory=dict)


def draw_shard(request: Request, number: int) -> Shard:
    """Draws shard 0, 1, ... of the request's environments, or `BACKGROUNDS`."""
    if number == BACKGROUNDS:
        return _draw(
            [(layout, ()) for layout in range(len(WALLS))], WALLS, list(np.ones((len(WALLS), POSES, 1)))
        )
    indices = range(number * SHARD, min((number + 1) * SHARD, request.count))
    scenarios = [request.scenario(index) for index in indices]
    seen = [visibility.visible(s.layout, s.obstacles) for s in scenarios]
    shard = _draw(
        [(s.layout, s.obstacles) for s in scenarios], np.stack([s.blocked for s in scenarios]), seen
    )
    shard.columns.update(_columns(scenarios))
    return shard


def _draw(worlds: Sequence, blocked: NDArray[np.bool_], seen: Sequence[NDArray]) -> Shard:
    """Draws the views of (layout, obstacles) in which something is seen; the rest are backgrounds."""
    from ciphernav_jax.world.renderer import renderer  # here, so that OpenGL is opened in workers only

    view_of = np.full((len(worlds), POSES), -1, np.int32)
    images = [np.empty((0, *IMAGE_SHAPE), np.uint8)]
    drawn = len(WALLS) * POSES
    for row, (layout, obstacles) in enumerate(worlds):
        there = ~blocked[row, POSE_CELL]
        there[: len(CAMERAS)] = True  # a fixed camera stands above an obstacle in its cell
        view_of[row, there] = layout * POSES + np.flatnonzero(there)
        poses = np.flatnonzero(there & np.any(seen[row], axis=1))
        view_of[row, poses] = drawn + np.arange(len(poses))
        drawn += len(poses)
        images.append(renderer().render(layout, obstacles, poses.tolist()))
    return Shard(np.concatenate(images), view_of, renderer().gl)


def _columns(scenarios: Sequence[Scenario]) -> dict[str, NDArray]:
    """The arrays of a data set that describe its environments, see `Dataset`."""
    count = len(scenarios)
    columns: dict[str, NDArray] = {
        "layout": np.array([s.layout for s in scenarios], np.uint8),
        "obstacles": np.stack([s.obstacle_cells for s in scenarios]),
        "start_heading": np.array([s.start_heading for s in scenarios], np.uint8),
        "goal": np.array([s.goal for s in scenarios], np.uint8),
        "actions": np.stack([planner.labels(s.path) for s in scenarios]),
        "detour": np.array([s.detour for s in scenarios]),
        "obstacle_cell": np.full((count, MAX_OBSTACLES), -1, np.int8),
        "obstacle_shape": np.full((count, MAX_OBSTACLES), -1, np.int8),
        "obstacle_colour": np.full((count, MAX_OBSTACLES), -1, np.int8),
        "obstacle_position": np.zeros((count, MAX_OBSTACLES, 2)),
        "obstacle_yaw": np.zeros((count, MAX_OBSTACLES)),
    }
    for row, scenario in enumerate(scenarios):
        for slot, obstacle in enumerate(scenario.obstacles):
            columns["obstacle_cell"][row, slot] = obstacle.cell
            columns["obstacle_shape"][row, slot] = obstacle.shape
            columns["obstacle_colour"][row, slot] = obstacle.colour
            columns["obstacle_position"][row, slot] = obstacle.x, obstacle.z
            columns["obstacle_yaw"][row, slot] = obstacle.yaw
    return columns


def draw_shards(request: Request, numbers: Sequence[int], workers: int) -> Iterator[Shard]:
    """Draws the shards of the given numbers in `workers` processes and yields them in that order.

    Raises:
        GLUnavailable: when the workers have no OpenGL.
        RuntimeError: when a worker dies.
        TimeoutError: when no worker delivers anything for five minutes.
    """
    waiting, finished = deque(numbers), {}
    with ExitStack() as stack:
        stdin = stack.enter_context(lifeline())
        busy = [stack.enter_context(_Worker(stdin)) for _ in range(min(workers, len(numbers)))]
        for worker in busy:
            worker.order(request, waiting.popleft())
        for number in numbers:
            while number not in finished:
                ready = wait([worker.pipe for worker in busy], _TIMEOUT)
                if not ready:
                    raise TimeoutError(
                        f"No shard was rendered within {_TIMEOUT:.0f} s; run the same again to resume."
                    )
                for worker in [worker for worker in busy if worker.pipe in ready]:
                    drawn, finished[drawn] = worker.receive()
                    if waiting:
                        worker.order(request, waiting.popleft())
                    else:
                        busy.remove(worker)
            yield finished.pop(number)


class _Worker:
    """A rendering process. It ends with this one, see `lifeline`, which is its standard input."""

    def __init__(self, stdin: int):
        self._stdin = stdin

    def __enter__(self) -> "_Worker":
        self.pipe, theirs = Pipe()
        program = f"from ciphernav_jax.world.shards import serve; serve({theirs.fileno()})"
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-c", program],
                stdin=self._stdin,
                pass_fds=[theirs.fileno()],
                start_new_session=True,  # Ctrl-C is for this process, which then ends the others
            )
        return self

    def __exit__(self, *_) -> None:
        self.pipe.close()
        self._process.kill()
        self._process.wait()

    def order(self, request: Request, number: int) -> None:
        with suppress(BrokenPipeError):  # a dead worker shows when its shard is received
            self.pipe.send((request, number))

    def receive(self) -> tuple[int, Shard]:
        try:
            number, result = self.pipe.recv()
        except (EOFError, ConnectionResetError):
            raise RuntimeError(
                f"A rendering process died (exit status {self._process.wait()}); "
                "run the same again to resume."
            ) from None
        if isinstance(result, Exception):
            raise result
        return number, result


def serve(descriptor: int) -> None:
    """A worker's life: receives (request, number), sends (number, shard or error), until the pipe ends."""
    end_with_parent()
    with Connection(descriptor) as pipe, suppress(EOFError, BrokenPipeError, ConnectionResetError):
        while True:
            request, number = pipe.recv()
            try:
                result = draw_shard(request, number)
            except Exception as error:
                error.add_note(traceback.format_exc())
                result = error
            pipe.send((number, result))
