"""The works in SPU: its compiler reads the JAX functions; parties are threads, the protocol is MORE[0]."""

# pyright: reportMissingImports=false
import sys
import threading

import jax
import jax.numpy as jnp
from harness import job, save, timed
from spu import api, libspu
from spu.utils import frontend

JOB = job()


def forward(weights, x):
    for kernel, bias in weights[:-1]:
        x = jax.nn.relu(x @ kernel + bias)
    kernel, bias = weights[-1]
    return x @ kernel + bias


def train(weights, x, y):
    def error(weights):
        return jnp.sum(jnp.square(forward(weights, x) - y))

    loss, gradient = jax.value_and_grad(error)(weights)
    return jax.tree_util.tree_map(lambda w, g: w - JOB.rate * g, weights, gradient), loss


def product(x, y):
    return x @ y


def relu(x):
    return jax.nn.relu(x)


def main():
    function, args = {
        "product": (product, tuple(JOB.data)),
        "relu": (relu, tuple(JOB.data)),
        "forward": (forward, (JOB.weights, JOB.data[0])),
        "forward-public": (forward, (JOB.weights, JOB.data[0])),
        "train": (train, (JOB.weights, *JOB.data)),
    }[JOB.work]
    flat = jax.tree_util.tree_leaves(args)
    visibility = [libspu.Visibility.VIS_SECRET] * len(flat)
    if JOB.work == "forward-public":
        visibility[: 2 * len(JOB.weights)] = [libspu.Visibility.VIS_PUBLIC] * (2 * len(JOB.weights))
    executable, _ = frontend.compile(
        frontend.Kind.JAX,
        function,
        args,
        {},
        [f"in{i}" for i in range(len(flat))],
        visibility,
        lambda outputs: [f"out{i}" for i in range(len(outputs))],
    )
    config = libspu.RuntimeConfig(
        protocol=getattr(libspu.ProtocolKind, JOB.more[0]), field=libspu.FieldType.FM64
    )
    io = api.Io(JOB.parties, config)
    shares = [io.make_shares(array, v) for array, v in zip(flat, visibility, strict=True)]
    description = libspu.link.Desc()
    for rank in range(JOB.parties):
        description.add_party(f"id_{rank}", f"thread_{rank}")
    barrier = threading.Barrier(JOB.parties)
    seconds: list = [None] * JOB.parties
    outputs: list = [None] * JOB.parties

    def party(rank):
        runtime = api.Runtime(libspu.link.create_mem(description, rank), config)
        for name, share in zip(executable.input_names, shares, strict=True):
            runtime.set_var(name, share[rank])
        seconds[rank], _ = timed(lambda: runtime.run(executable), barrier.wait, JOB.repeats)
        outputs[rank] = [runtime.get_var(name) for name in executable.output_names]

    threads = [threading.Thread(target=party, args=(rank,)) for rank in range(JOB.parties)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    if any(output is None for output in outputs):
        sys.exit("a party failed")
    save(JOB.result, seconds[0], [io.reconstruct(list(parts)) for parts in zip(*outputs, strict=True)])


main()
