"""A buffer that XLA frees is there the next time. In processes of their own: the setting is the process's."""

import functools
import json
import os

import pytest

from tests.fresh import printed

PROGRAM = """
import json, resource, jax, jax.numpy as jnp
if {ours}:
    import ciphernav_jax
v = jnp.arange(6_000_000, dtype=jnp.float32)
f = jax.jit(lambda x: jnp.sort(v * x)[::1000])  # buffers of 24 MB, which XLA allocates together
for _ in range(3):
    f(1.0).block_until_ready()
before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
for _ in range(4):
    f(1.0).block_until_ready()
print(json.dumps((resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before) / 4))
"""
on_glibc = pytest.mark.skipif(
    "CS_GNU_LIBC_VERSION" not in getattr(os, "confstr_names", ()), reason="glibc's allocator"
)


@functools.cache
def faults(ours: bool, **variables: str) -> float:
    return json.loads(printed(PROGRAM.format(ours=ours), without=("MALLOC_", "GLIBC_TUNABLES"), **variables))


@on_glibc
def test_large_buffers_are_not_faulted_in_again():
    assert faults(ours=True) < faults(ours=False) / 4


@on_glibc
def test_what_the_environment_says_of_the_allocator_holds():
    assert faults(ours=True, MALLOC_ARENA_TEST="8") > 4 * faults(ours=True)
