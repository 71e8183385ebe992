import jax
import numpy as np
import pytest

from ciphernav_jax.ring import chacha

block = jax.jit(chacha.block)


def hexwords(text):
    return [int(word, 16) for word in text.split()]


def stream_words(text):
    """Key stream bytes, as the RFC prints them, as little-endian words."""
    return np.frombuffer(bytes.fromhex(text), "<u4").tolist()


# RFC 8439, 2.3.2, and appendix A.1, test vectors 1 and 2.
VECTORS = {
    "2.3.2": (
        np.frombuffer(bytes(range(32)), "<u4"),
        [1, 0x09000000, 0x4A000000, 0],
        hexwords(
            "e4e7f110 15593bd1 1fdd0f50 c47120a3 c7f4d1c7 0368c033 9aaa2204 4e6cd4c3"
            " 466482d2 09aa9f07 05d7c214 a2028bd9 d19c12b5 b94e16de e883d0cb 4e3c50a2"
        ),
    ),
    "A.1 first": (
        [0] * 8,
        [0, 0, 0, 0],
        stream_words(
            "76b8e0ada0f13d90405d6ae55386bd28bdd219b8a08ded1aa836efcc8b770dc7"
            "da41597c5157488d7724e03fb8d84a376a43b8f41518a11cc387b669b2ee6586"
        ),
    ),
    "A.1 second": (
        [0] * 8,
        [1, 0, 0, 0],
        stream_words(
            "9f07e7be5551387a98ba977c732d080dcb0f29a048e3656912c6533e32ee7aed"
            "29b721769ce64e43d57133b074d839d531ed1f28510afb45ace10a1f4b794d6f"
        ),
    ),
}


@pytest.mark.parametrize("name", VECTORS)
def test_known_answers_of_the_rfc(name):
    key, counter, expected = VECTORS[name]
    got = block(list(np.array(key, np.uint32)), list(np.array(counter, np.uint32)))
    assert [int(word) for word in got] == expected


def test_quarter_round_of_the_rfc():
    # RFC 8439, 2.1.1.
    words = np.array(hexwords("11111111 01020304 9b8d6f43 01234567"), np.uint32)
    got = jax.jit(chacha._quarter_round)(*words)
    assert [int(word) for word in got] == hexwords("ea2a92f4 cb1cf8ce 4581472e 5881c4bb")


def test_many_blocks_at_once_equal_one_at_a_time():
    rng = np.random.default_rng(1)
    key, nonce = rng.integers(0, 2**32, 8, np.uint32), rng.integers(0, 2**32, 3, np.uint32)
    numbers = np.array([0, 1, 2, 2**31, 2**32 - 1], np.uint32)
    together = np.array(block(list(key), [numbers, *nonce]))
    for i, number in enumerate(numbers):
        assert together[:, i].tolist() == [int(w) for w in block(list(key), [number, *nonce])]
