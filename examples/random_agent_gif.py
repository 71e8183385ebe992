"""A robot that moves at random wherever its map has no wall, as a GIF.

python examples/random_agent_gif.py --out out/random.gif
"""

import argparse
from pathlib import Path

import gymnasium
import numpy as np
from PIL import Image

import ciphernav_jax  # noqa: F401  (registers the environment)
from ciphernav_jax.world.grid import WALL, move


def episode(env, seed):
    """The pictures of one episode, and how it ended."""
    rng = np.random.default_rng(seed)
    observation, info = env.reset(seed=seed)
    frames = [env.render()]
    while info["outcome"] == "running":
        cells = {action: move(info["cell"], action) for action in (1, 2, 3, 4)}
        free = [action for action, cell in cells.items() if cell >= 0 and observation["map"][cell] != WALL]
        observation, *_, info = env.step(rng.choice(free))
        frames.append(env.render())
    return frames, info["outcome"]


def main(out=Path("out/random.gif"), episodes=3):
    env = gymnasium.make("ciphernav_jax/ObstacleWorld-v0", render_mode="rgb_array")
    pictures = []
    for seed in range(episodes):
        frames, outcome = episode(env, seed)
        print(f"episode {seed}: {len(frames) - 1} actions, {outcome}")
        pictures += [Image.fromarray(frame).quantize(64) for frame in frames]
    out.parent.mkdir(parents=True, exist_ok=True)
    pictures[0].save(out, save_all=True, append_images=pictures[1:], duration=400, loop=0)
    print(f"Written: {out}")


if __name__ == "__main__":
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--out", type=Path, default=Path("out/random.gif"))
    options.add_argument("--episodes", type=int, default=3)
    main(**vars(options.parse_args()))
