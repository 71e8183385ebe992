"""One operating-system process for each of two parties, joined by a TCP socket: real messages, counted.

python -m tests.secret.message_process OUT RANK PORT

A party's jaxpr is evaluated on the party's own shares. All equations that can be evaluated are; then
all openings that wait go out together in one message, the other party's is awaited, and so on to the end.
The package's own count of rounds and bytes, which this is to check, has no part in it.
"""

import json
import socket
import struct
import sys
import time
from functools import partial
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

import ciphernav_jax as cn
from ciphernav_jax.jax_private import Literal
from ciphernav_jax.parties.dealer import deal
from ciphernav_jax.parties.run import one_partys_jaxpr, online

from ..patience import PATIENCE_S
from .training import training_step

PARTIES = 2
CALLS = {"jit": "jaxpr", "closed_call": "call_jaxpr", "custom_jvp_call": "call_jaxpr"}


def calls():
    """Name -> step, key and shared arguments, the same in every process."""
    rng = np.random.default_rng(11)

    def drawn(*shape):
        return rng.normal(size=shape).astype(np.float32)

    share = partial(cn.share, jax.random.key(8), parties=PARTIES)
    weights = {"first": drawn(6, 5), "second": drawn(5, 3)}
    return {
        "relu": (cn.secure(jax.nn.relu), jax.random.key(5), share((drawn(70),))),
        "training step": (
            cn.secure(training_step),
            jax.random.key(6),
            share((weights, drawn(9, 6), drawn(9, 3))),
        ),
    }


class Link:
    """A connection to the other party that counts its messages and their bytes."""

    def __init__(self, rank, port):
        self.socket = self._accepted(port) if rank == 0 else self._connected(port)
        self.socket.settimeout(PATIENCE_S)
        self.messages = self.bytes = 0

    def _accepted(self, port):
        with socket.create_server(("127.0.0.1", port)) as server:
            server.settimeout(PATIENCE_S)
            return server.accept()[0]

    def _connected(self, port):
        deadline = time.monotonic() + PATIENCE_S
        while True:
            try:
                return socket.create_connection(("127.0.0.1", port))
            except ConnectionRefusedError:
                if time.monotonic() > deadline:
                    raise
                time.sleep(0.1)

    def exchange(self, payload):
        """Sends one message, and receives one."""
        self.messages += 1
        self.bytes += len(payload)
        self.socket.sendall(struct.pack("<Q", len(payload)) + payload)
        (length,) = struct.unpack("<Q", self._received(8))
        return self._received(length)

    def _received(self, length):
        data = b""
        while len(data) < length:
            part = self.socket.recv(length - len(data))
            if not part:
                raise ConnectionError("the other party hung up")
            data += part
        return data


class Cell:
    """A variable of the program, empty until it is known."""

    def __init__(self, *value):
        self.content = value

    @property
    def value(self):
        return self.content[0]


def flattened(jaxpr, consts, arguments, steps):
    """Lists a jaxpr's equations, those of the jaxprs it calls in their place; returns the cells it gives."""
    cells = dict(zip([*jaxpr.constvars, *jaxpr.invars], [*map(Cell, consts), *arguments], strict=True))

    def cell(atom):
        return Cell(atom.val) if isinstance(atom, Literal) else cells[atom]

    for eqn in jaxpr.eqns:
        operands = [cell(atom) for atom in eqn.invars]
        if eqn.primitive.name in CALLS:
            inner = eqn.params[CALLS[eqn.primitive.name]]
            results = flattened(inner.jaxpr, inner.consts, operands, steps)
        else:
            results = [Cell() for _ in eqn.outvars]
            steps.append((eqn, operands, results))
        cells.update(zip(eqn.outvars, results, strict=True))
    return [cell(atom) for atom in jaxpr.outvars]


def evaluate(jaxpr, inputs, rank, link):
    """One party's results, from its own inputs and the other party's messages."""
    steps = []
    outputs = flattened(jaxpr.jaxpr, jaxpr.consts, map(Cell, inputs), steps)
    while steps:
        possible, waiting, late = [], [], []
        there = {}
        for step in steps:
            eqn, operands, results = step
            if not all(cell.content or cell in there for cell in operands):
                late.append(step)
            elif eqn.primitive.name in ("psum", "all_gather"):
                waiting.append((eqn.primitive.name, operands[0], results[0]))
            else:
                possible.append(step)
                there.update(dict.fromkeys(results))
        read = {cell for _, operands, _ in late for cell in operands} | {cell for _, cell, _ in waiting}
        compute(possible, [cell for cell in there if cell in read or cell in outputs], rank)
        if waiting:
            open_all(waiting, rank, link)
        steps = late
    return [cell.value for cell in outputs]


def compute(steps, results, rank):
    """Fills the cells `results` by local equations, compiled together."""
    given = list({cell: None for _, operands, _ in steps for cell in operands if cell.content})

    def all_of_them(values):
        env = dict(zip(given, values, strict=True))
        for eqn, operands, cells in steps:
            if eqn.primitive.name == "axis_index":
                env[cells[0]] = jnp.int32(rank)
                continue
            bound = [env[cell] for cell in operands]
            made = eqn.primitive.bind(*bound, **eqn.primitive.get_bind_params(eqn.params))
            env.update(zip(cells, made if eqn.primitive.multiple_results else [made], strict=True))
        return [env[cell] for cell in results]

    for cell, value in zip(results, jax.jit(all_of_them)([cell.value for cell in given]), strict=True):
        cell.content = (value,)


def open_all(waiting, rank, link):
    """All that waits in one message: for each opening the words of this party, and the other's come back."""
    mine = [np.asarray(operand.value, np.uint64) for _, operand, _ in waiting]
    theirs = np.frombuffer(link.exchange(b"".join(x.tobytes() for x in mine)), np.uint64)
    for (name, _, result), own in zip(waiting, mine, strict=True):
        other, theirs = theirs[: own.size].reshape(own.shape), theirs[own.size :]
        rows = np.stack([own, other] if rank == 0 else [other, own])
        result.content = (jnp.asarray(rows.sum(axis=0, dtype=np.uint64) if name == "psum" else rows),)


def run_as(call, key, rank, link):
    """The results of a call that is run as one party; the shares that come out are this party's alone."""
    needed = call.plan()
    dealing = partial(deal, plan=needed, parties=call.parties, generator=call.protocol.generator)
    private = jax.jit(dealing)(key), call.private
    jaxpr, shapes = one_partys_jaxpr(online(call.program, needed), call.parties, private, call.public)
    own = jax.tree.map(lambda x: np.asarray(x)[rank], private)
    results = evaluate(jaxpr, jax.tree.leaves((own, call.public)), rank, link)
    mine, known = jax.tree.unflatten(jax.tree.structure(shapes), results)
    return call.rebuild((jax.tree.map(lambda x: x[None], mine), known))[0]


def main() -> None:
    out, rank, port = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
    link = Link(rank, port)
    counts = {}
    for name, (step, key, args) in calls().items():
        link.messages = link.bytes = 0
        result = run_as(step.call(step.given(*args)), key, rank, link)
        np.savez(out / f"{name}{rank}.npz", *jax.tree.leaves(result))
        counts[name] = {"messages": link.messages, "bytes": link.bytes}
    (out / f"counts{rank}.json").write_text(json.dumps(counts))


if __name__ == "__main__":
    main()
