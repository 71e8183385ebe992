"""An agent in the environment learns to do what the expert does, from the map alone and in plaintext.

python examples/imitation.py
"""

import gymnasium
import jax
import numpy as np
import optax
from flax import nnx

import ciphernav_jax  # noqa: F401  (registers the environment)


def expert(env, episodes):
    """The maps that the expert saw, and what it did: the shortest path, then stop."""
    maps, actions = [], []
    for seed in range(episodes):
        observation, _ = env.reset(seed=seed, options={"obstacles": ()})
        for action in (*env.unwrapped.scenario.path, 0):
            maps.append(observation["map"])
            actions.append(action)
            observation, *_ = env.step(action)
    return jax.nn.one_hot(np.array(maps), 5, dtype=np.float32).reshape(len(maps), -1), np.array(actions)


def train(maps, actions, steps):
    """A small network on the map's codes."""
    rngs = nnx.Rngs(0)
    model = nnx.Sequential(nnx.Linear(125, 64, rngs=rngs), nnx.relu, nnx.Linear(64, 5, rngs=rngs))
    optimizer = nnx.Optimizer(model, optax.adam(1e-2), wrt=nnx.Param)

    @nnx.jit
    def step(model, optimizer):
        def loss(model):
            return optax.softmax_cross_entropy_with_integer_labels(model(maps), actions).mean()

        optimizer.update(model, nnx.grad(loss)(model))

    for _ in range(steps):
        step(model, optimizer)
    return model


def main(episodes=200, steps=150, trials=20):
    env = gymnasium.make("ciphernav_jax/ObstacleWorld-v0")
    model, won = train(*expert(env, episodes), steps), 0
    for seed in range(10_000, 10_000 + trials):
        observation, info = env.reset(seed=seed, options={"obstacles": ()})
        while info["outcome"] == "running":
            codes = jax.nn.one_hot(observation["map"], 5, dtype=np.float32).reshape(1, -1)
            observation, *_, info = env.step(int(model(codes).argmax()))
        won += info["outcome"] == "success"
    print(f"{won} of {trials} episodes without obstacles succeed")
    return won


if __name__ == "__main__":
    main()
