"""The block function of Threefry-2x32 with 20 rounds (Salmon et al., *Parallel random numbers: as easy as
1, 2, 3*, SC 2011, section 4.2): Threefish, the cipher in Skein, with smaller words and no tweak."""

from collections.abc import Sequence

import numpy as np
from jax import Array

ROUNDS = 20
ROTATIONS = (13, 15, 26, 6, 17, 29, 16, 24)
PARITY = np.uint32(0x1BD11BDA)


def block(key: Sequence[Array], counter: Sequence[Array]) -> tuple[Array, Array]:
    """Two uniform words for each counter: uint32 arrays of the shape of key and counter, broadcast.

    Args:
        key: two words, uint32 of any shape.
        counter: two words, uint32 of any shape. Different counters give different pairs of words.
    """
    schedule = (key[0], key[1], key[0] ^ key[1] ^ PARITY)
    a, b = counter[0] + schedule[0], counter[1] + schedule[1]
    for i in range(ROUNDS):
        distance = ROTATIONS[i % 8]
        a = a + b
        b = (b << np.uint32(distance) | b >> np.uint32(32 - distance)) ^ a
        if i % 4 == 3:
            injection = i // 4 + 1
            a = a + schedule[injection % 3]
            b = b + (schedule[(injection + 1) % 3] + np.uint32(injection))
    return a, b
