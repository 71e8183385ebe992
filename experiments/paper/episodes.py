"""Episodes to look at (paper: pictures of successes, failures and inefficient paths), and what parties saw.

    python -m experiments paper episodes                    # of fewest-5; a minute
    python -m experiments paper episodes --driver secret-2

It drives with a finished training through the test set and writes RESULTS/episodes-SEED.json,
which holds all that `report` needs to draw: scenarios, paths and views; and of one long episode
also the shares that each party held, so that one sees them to be noise. A training without parties drives
among five, its classifier public.
"""

import base64
import io
from dataclasses import asdict, dataclass, field
from typing import Annotated, Any

import numpy as np
import tyro
from numpy.typing import NDArray
from PIL import Image

from ciphernav_jax import provenance
from ciphernav_jax.command_line import SEED, read
from ciphernav_jax.files import write_json
from ciphernav_jax.navigation import driving, features, folders, pictures
from ciphernav_jax.navigation.features import Features
from ciphernav_jax.navigation.owners import CAMERAS
from ciphernav_jax.navigation.rollout import Episodes, Outcome
from ciphernav_jax.ring import keys
from ciphernav_jax.secret import Secret, share
from ciphernav_jax.world.dataset import Dataset
from experiments.paper.runs import Options, console, world

PARTIES = 5  # of a training that has none

# How many of each kind; the longest success is the one with everything that its parties saw.
SUCCESSES, FAILURES, INEFFICIENT = 5, 2, 4


@dataclass
class Pictures(Options):
    """Choose episodes of a trained robot, and write what draws them."""

    seeds: Annotated[list[int], SEED, tyro.conf.arg(metavar="S [S ...]")] = field(default_factory=lambda: [0])
    """Of the trainings, and of the shares."""
    driver: str = "fewest-5"
    """The row that drives, trained before. The trainings of `accuracy` leave hardly a failure to show."""


def choose(dataset: Dataset, driven: Episodes) -> dict[str, list[int]]:
    """Environments to show, as far as there are: the longest of each kind, in different layouts.

    Returns:
        By kind: "success" with a detour, "failure" of each sort, "inefficient": a success that took more
        actions than the shortest path.
    """
    won = driven.outcome == Outcome.SUCCESS
    longer = driven.lengths > (np.asarray(dataset.actions) >= 0).sum(axis=1)
    failures = [
        env
        for kind in Outcome
        if kind is not Outcome.SUCCESS
        for env in pictures.longest(dataset, driven, driven.outcome == kind, FAILURES)
    ]
    return {
        "success": pictures.longest(dataset, driven, won & ~longer & np.asarray(dataset.detour), SUCCESSES),
        "failure": failures,
        "inefficient": pictures.longest(dataset, driven, won & longer, INEFFICIENT),
    }


def episode(dataset: Dataset, driven: Episodes, env: int) -> dict[str, Any]:
    """One episode in plain values: scenario, path, outcome, and each camera's view."""
    return {
        "environment": env,
        "scenario": asdict(dataset.scenario(env)),
        "cells": [cell for cell in driven.cells[env].tolist() if cell >= 0],
        "actions": [action for action in driven.actions[env].tolist() if action >= 0],
        "shortest": int((dataset.actions[env] >= 0).sum()),
        "detour": bool(dataset.detour[env]),
        "outcome": Outcome(driven.outcome[env]).name.lower(),
        "views": {
            camera: png(dataset.views[view])
            for camera, view in zip(CAMERAS, dataset.cameras[env], strict=True)
        },
    }


def watched(dataset: Dataset, driven: Episodes, env: int, seen: Features, parties: int, seed: int) -> dict:
    """The same with what the parties had: the robot's view at each step, and everybody's shares.

    Shares are made as `policies.secret_policy` makes them: of the cameras' features once, of the robot's view
    and map at each step. What is kept of them is the highest byte: base64 of uint8[P, width].
    """
    told = episode(dataset, driven, env)
    key = keys.derive(keys.root(seed), "watched", env)
    cameras = share(keys.derive(key, "cameras"), [camera[env] for camera in seen.cameras], parties=parties)
    told["shares"] = dict(zip(CAMERAS, map(_top_bytes, cameras), strict=True))
    told["steps"] = []
    heading, goal = int(dataset.start_heading[env]), int(dataset.goal[env])
    for step, (cell, action) in enumerate(zip(told["cells"], told["actions"], strict=True), 1):
        robot = seen.robot(*map(np.asarray, (env, cell, heading, goal)))
        view, place = share(keys.derive(key, "robot", step), robot, parties=parties)
        told["steps"].append(
            {
                "view": png(dataset.views[dataset.agent[env, cell, heading]]),
                "shares": {"agent": _top_bytes(view), "map": _top_bytes(place)},
            }
        )
        heading = action - 1
    return told


def png(image: NDArray[np.uint8]) -> str:
    """An image as a PNG file in base64."""
    file = io.BytesIO()
    Image.fromarray(np.asarray(image)).save(file, format="png", optimize=True)
    return base64.b64encode(file.getvalue()).decode()


def _top_bytes(secret: Secret) -> str:
    return base64.b64encode((np.asarray(secret.shares) >> np.uint64(56)).astype(np.uint8).tobytes()).decode()


def watch(seed: int, options: Pictures) -> None:
    """Drive, choose, and write RESULTS/episodes-SEED.json."""
    config, model = folders.load(options.out / "models" / f"{options.driver}-{seed}")
    parties = config["parties"] or PARTIES
    environments = world("test", options)
    driven = driving.drive(environments, config, model, seed, parties)
    seen = features.standardise(model.encode(environments, folders.sees(config)), model.scales)
    chosen = choose(environments, driven)
    watch = chosen["success"].pop(0)
    path = options.results / f"episodes-{seed}.json"
    document = {
        "seed": seed,
        "driver": options.driver,
        "parties": parties,
        "versions": provenance.versions(),
        "machine": provenance.machine(),
        "at": provenance.now(),
        "watched": watched(environments, driven, watch, seen, parties, seed),
        "episodes": {
            kind: [episode(environments, driven, env) for env in envs] for kind, envs in chosen.items()
        },
    }
    write_json(path, document)
    console.print(f"Written: {path}")


def main() -> None:
    """Every seed asked for."""
    options = read(Pictures(), __doc__)
    for seed in options.seeds:
        watch(seed, options)
