"""The acid test of the architecture: one program, three ways to run it, the same shares bit for bit."""

import socket
import subprocess
import sys
from pathlib import Path

import jax
import numpy as np
import pytest

import ciphernav_jax as cn
from ciphernav_jax.parties import party

from ..patience import PATIENCE_S
from .party_process import PARTIES, everything, inputs

pytestmark = [pytest.mark.newest_jax, pytest.mark.slow]

ROOT = Path(__file__).parents[2]


def start(out, *arguments):
    return subprocess.Popen(
        [sys.executable, "-m", "tests.secret.party_process", str(out), *arguments],
        cwd=ROOT,
        stderr=subprocess.PIPE,
        text=True,
    )


def finish(process):
    try:
        _, errors = process.communicate(timeout=PATIENCE_S)
    finally:
        process.kill()
    assert process.returncode == 0, errors


@pytest.fixture(scope="module")
def simulated():
    result = cn.secure(everything)(jax.random.key(9), *inputs())
    return [np.asarray(x.shares) for x in jax.tree.leaves(result, is_leaf=lambda x: isinstance(x, cn.Secret))]


def test_two_devices_compute_the_simulation_s_shares(simulated, tmp_path):
    finish(start(tmp_path, "devices"))
    deployed = np.load(tmp_path / "devices.npz")
    for name, shares in zip(deployed, simulated, strict=True):
        np.testing.assert_array_equal(deployed[name], shares)


def test_two_processes_compute_the_simulation_s_shares(simulated, tmp_path):
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = str(free.getsockname()[1])
    processes = [start(tmp_path, "process", str(rank), port) for rank in range(PARTIES)]
    for process in processes:
        finish(process)
    for rank in range(PARTIES):
        own = np.load(tmp_path / f"process{rank}.npz")
        for name, shares in zip(own, simulated, strict=True):
            np.testing.assert_array_equal(own[name], shares[rank : rank + 1])


def test_the_simulated_step_is_the_plain_one(simulated):
    """So that the equalities above are not between equally wrong shares."""
    plain = jax.tree.leaves(everything(*cn.reveal(inputs())))
    for shares, value in zip(simulated, plain, strict=True):
        signed = shares.sum(axis=0, dtype=np.uint64).astype(np.int64)
        np.testing.assert_allclose(signed * 2.0**-20, value, rtol=1e-5, atol=1e-4)


def test_a_mesh_of_other_axes_is_refused():
    mesh = jax.make_mesh((1,), ("data",))
    with pytest.raises(ValueError, match='one axis "party"'):
        party.deploy(lambda private, public: (private, public), mesh)


def test_a_mesh_of_another_size_is_refused():
    step = cn.deploy(cn.secure(lambda x: x), jax.make_mesh((1,), ("party",)))
    with pytest.raises(ValueError, match="the mesh has 1 devices, but the shares belong to 2 parties"):
        step(jax.random.key(0), cn.share(jax.random.key(1), np.ones(3, np.float32), parties=2))
