"""Programs evaluated on secrets, and what is found reduced to a step or two."""

import itertools
import math
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from unittest.mock import patch

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.core import Tracer
from jax.extend.core import jaxpr_as_fun

import ciphernav_jax as cn
from ciphernav_jax import ring

from .operations import Plain
from .program import Program
from .reference import FLOAT_ERROR, Outside, Reference

LARGE = 1000  # results with more entries are not looked at themselves


@dataclass(frozen=True)
class Finding:
    """The result of a step is not what it should be; or there is none, and `result` is None."""

    result: int | None
    what: str


def check(program: Program, protocol: cn.Protocol, parties: int, seed: int = 0) -> Finding | None:
    """Evaluates a program on secrets; the first result that is off by more than its bound.

    It is not compiled: each operation is, once for all programs with arrays of the same shapes.
    """
    with np.errstate(all="ignore"):
        expected = program.evaluate(Reference(protocol, parties), program.inputs)
    looked_at = [i for i in range(len(program.inputs), len(expected)) if expected[i].value.size <= LARGE]
    try:
        results = _evaluated(program, looked_at, protocol, parties, seed)
    except Exception as error:
        return Finding(None, f"{type(error).__name__}: {error}")
    for i, got in zip(looked_at, results, strict=True):
        want, got = expected[i], np.asarray(got)
        if got.dtype != want.dtype or got.shape != want.shape:
            return Finding(i, f"got {got.dtype}{list(got.shape)}, expected {want.dtype}{list(want.shape)}")
        error = want.error
        if want.kind == "float":
            error = error + np.abs(want.value) * (2.0**-23 if want.dtype == np.float32 else FLOAT_ERROR)
        off = np.abs(np.asarray(got, np.float64) - np.asarray(want.value, np.float64))
        wrong = ~(off <= error)
        if np.any(wrong):
            at = tuple(int(k) for k in np.argwhere(wrong)[0])
            return Finding(
                i, f"at {list(at)} got {got[at]!r}, expected {want.value[at]!r} within {error[at]:.3g}"
            )
    return None


def _evaluated(program: Program, looked_at: list[int], protocol: cn.Protocol, parties: int, seed: int):
    def function(*inputs):
        values = program.evaluate(Plain(), inputs)
        return [values[i] for i in looked_at]

    plain = [x.value.astype(x.dtype) for x in program.inputs]
    # No two programs share keys, which would be warned of.
    keys = jax.random.split(jax.random.key(zlib.crc32(f"{seed} {program}".encode())), len(plain) + 1)
    # Traced as ever, so that loops and inner functions stay what they are; then evaluated step by step.
    traced = jaxpr_as_fun(jax.make_jaxpr(function)(*plain))
    with step_by_step():
        given = [
            cn.share(key, v, parties=parties, protocol=protocol) if x.secret else v
            for key, x, v in zip(keys[1:], program.inputs, plain, strict=True)
        ]
        return cn.reveal(cn.secure(traced, protocol=protocol)(keys[0], *given))


@contextmanager
def step_by_step() -> Iterator[None]:
    """Functions on secrets are not compiled in here: each operation is, once for all with the same shapes."""
    with jax.disable_jit(), patch.object(ring, "draw", drawn), patch.object(lax, "slice", cut):
        yield


_DRAW = jax.jit(ring.draw, static_argnums=(1, 2))


def drawn(key, shapes, generator="threefry"):
    """As `ring.draw`, from the same stream, whose length is rounded up: compiled for few lengths, where else
    every program's would be compiled anew.
    """
    sizes = [math.prod(shape) for shape in shapes]
    with jax.disable_jit(False):
        (words,) = _DRAW(key, ((1 << max(12, sum(sizes).bit_length()),),), generator)
    words = words if isinstance(words, Tracer) else np.asarray(words)
    ends = itertools.accumulate(sizes)
    return [
        jnp.asarray(words[end - size : end].reshape(shape))
        for end, size, shape in zip(ends, sizes, shapes, strict=True)
    ]


@partial(jax.jit, static_argnums=2)
def _cut(x, starts, sizes):
    return lax.dynamic_slice(x, starts, sizes)


def cut(x, starts, ends):
    """As `lax.slice`, without being compiled for each length: the dealer's streams are cut often."""
    if not isinstance(x, Tracer):
        return jnp.asarray(np.asarray(x)[tuple(map(slice, starts, ends))])
    with jax.disable_jit(False):
        return _cut(x, starts, tuple(end - start for start, end in zip(starts, ends, strict=True)))


def minimised(program: Program, protocol: cn.Protocol, parties: int) -> tuple[Program, Finding]:
    """The same fault with fewer steps: others are dropped, and results of earlier ones given as inputs."""
    reference = Reference(protocol, parties)

    def again_found(program: Program) -> Finding | None:
        """With other masks as well: a value out of range comes out right by chance."""
        return next((x for seed in range(4) if (x := check(program, protocol, parties, seed))), None)

    def smaller(found: Finding, program: Program):
        """The program up to a fault, without what it does not depend on."""
        first = len(program.inputs)
        for i in range(first, first + len(program.steps)) if found.result is None else [found.result]:
            part = program.up_to(i)
            again = again_found(part)
            if again and (again.result is None) == (found.result is None):
                return again, part
        return found, program

    found = check(program, protocol, parties)
    assert found
    found, program = smaller(found, program)
    step = len(program.steps) - 2
    while step >= 0:
        with np.errstate(all="ignore"):
            value = program.evaluate(reference, program.inputs)[len(program.inputs) + step]
        most = np.max(np.abs(value.value), initial=0) if value.kind == "float" else 0
        if value.value.size <= LARGE and most < reference.product_bound:
            try:
                fewer = program.with_input(step, value, reference.unit)
                still = again_found(fewer)
            except Outside:
                still = None
            if still and (still.result is None) == (found.result is None):
                found, program = smaller(still, fewer)
                step = len(program.steps) - 1
        step -= 1
    return program, found
