import jax
import numpy as np
import pytest
from jax.extend.random import threefry_2x32

from ciphernav_jax.ring import threefry

block = jax.jit(threefry.block)

# The known answers that come with Random123, the authors' implementation: key, counter, words.
VECTORS = (
    ((0x00000000, 0x00000000), (0x00000000, 0x00000000), (0x6B200159, 0x99BA4EFE)),
    ((0xFFFFFFFF, 0xFFFFFFFF), (0xFFFFFFFF, 0xFFFFFFFF), (0x1CB996FC, 0xBB002BE7)),
    ((0x13198A2E, 0x03707344), (0x243F6A88, 0x85A308D3), (0xC4923A9C, 0x483DF7A0)),
)


@pytest.mark.parametrize(("key", "counter", "expected"), VECTORS)
def test_known_answers(key, counter, expected):
    got = block(np.array(key, np.uint32), np.array(counter, np.uint32))
    assert tuple(int(word) for word in got) == expected


def test_many_blocks_equal_those_of_jax():
    rng = np.random.default_rng(1)
    key, counter = rng.integers(0, 2**32, 2, np.uint32), rng.integers(0, 2**32, (2, 999), np.uint32)
    expected = threefry_2x32(key, counter.reshape(-1)).reshape(2, 999)
    np.testing.assert_array_equal(np.stack(block(key, counter)), expected)
