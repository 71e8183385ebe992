"""What parties see: their own shares, what is opened, what others send, and nothing of what others hold."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import ciphernav_jax as cn
from ciphernav_jax.secret import view

PARTIES = 3
X = np.array([[0.5, -2.0, 3.25]], np.float32)
W = np.array([[1.0, 2.0], [-1.0, 0.5], [0.25, 4.0]], np.float32)


def network(x, w):
    return jax.nn.relu(x @ w)


STEP = cn.secure(network)
ARGS = cn.share(jax.random.key(1), (X, W), parties=PARTIES)
RESULT, VIEW = view(STEP)(jax.random.key(2), *ARGS)


def words(arrays):
    return np.concatenate([np.ravel(x) for x in arrays]) if arrays else np.zeros(0, np.uint64)


def of(*parties):
    seen = VIEW.of(parties)
    return words(seen.numbers), words(seen.bits)


def test_the_result_is_that_of_the_step_and_the_messages_are_the_transcripts():
    np.testing.assert_array_equal(RESULT.shares, STEP(jax.random.key(2), *ARGS).shares)
    messages = cn.transcript(STEP)(jax.random.key(2), *ARGS)[1]
    assert [m.opening for m in VIEW.messages] == [m.opening for m in messages]
    for mine, theirs in zip(VIEW.messages, messages, strict=True):
        np.testing.assert_array_equal(mine.sent, theirs.sent)


def test_a_party_sees_its_shares_and_all_messages():
    numbers, bits = of(1)
    for share in ARGS:
        assert np.isin(share.shares[1], numbers).all()
    for shares, binary in zip(VIEW.dealt, VIEW.binary, strict=True):
        assert np.isin(shares[1], bits if binary else numbers).all()
    for message in VIEW.messages:
        here = bits if message.opening.collective == "open_xor" else numbers
        assert np.isin(message.opened, here).all()
        assert np.isin(np.asarray(message.sent)[[0, 2]], here).all()


def test_a_party_sees_nothing_of_what_others_hold():
    seen = np.concatenate(of(1))
    for hidden in [*(s.shares for s in ARGS), *VIEW.dealt]:
        assert not np.isin(np.asarray(hidden)[[0, 2]], seen).any()


def test_the_size_is_that_of_the_cost():
    counted = cn.cost(STEP, *ARGS)
    opened = sum(opening.words for opening in counted.openings)
    # All but one draw a dependent value's share, all draw a uniform one's: P times what each holds.
    held = (counted.uniform_words + sum(row.bytes_dealt // 8 for row in counted.by_request)) // PARTIES
    # Inputs, what is dealt, what is opened, and what two others send of it.
    assert sum(x.size for x in of(1)) == X.size + W.size + held + 3 * opened
    assert sum(x.size for x in of(0, 1)) == X.size + W.size + held + 2 * opened


def test_several_parties_add_up_their_shares_and_all_of_them_know_everything():
    np.testing.assert_array_equal(VIEW.of([0, 2]).numbers[0], ARGS[0].shares[0] + ARGS[0].shares[2])
    every = VIEW.of(range(PARTIES))
    encoded = (np.concatenate([X.ravel(), W.ravel()]) * 2.0**20).astype(np.int64).view(np.uint64)
    np.testing.assert_array_equal(words(every.numbers[:2]), encoded)
    together = [x for x, binary in zip(VIEW.dealt, VIEW.binary, strict=True) if binary]
    np.testing.assert_array_equal(every.bits[0], np.bitwise_xor.reduce(np.asarray(together[0]), axis=0))


def test_it_works_under_vmap_and_refuses_other_functions():
    keys = jax.random.split(jax.random.key(3), 4)
    _, several = jax.vmap(lambda key: view(cn.secure(jnp.multiply))(key, ARGS[0], ARGS[0]))(keys)
    assert several.messages[0].opened.shape == (4, 1, 3)
    assert len(np.unique(several.messages[0].opened)) == 12
    with pytest.raises(TypeError, match="secure"):
        view(network)
