import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from ciphernav_jax import ring
from ciphernav_jax.parties import sharing
from ciphernav_jax.parties.dealer import Plan, Planner, Supply, corrected, deal, words_needed
from ciphernav_jax.parties.requests import (
    AndTriple,
    Bilinear,
    Mask,
    Ref,
    SharedBits,
    WrapCount,
    Zero,
)
from ciphernav_jax.parties.run import plan, run
from ciphernav_jax.ring import bits, keys

from ..slow import slow
from .simulated import BY_PARTIES, PARTIES, joint_uniformity

ROWS_BY_COLUMNS = (((1,), (0,)), ((), ()))
REQUESTS = (
    Mask((3, 5)),
    Mask((5, 2), shift=20),
    Mask((5, 26), shift=7, bits=64, pairs=31),
    Mask((70,), bits=20, pairs=3),
    Bilinear(Ref(0, "mask"), Ref(0, "mask"), ring.TIMES),
    Bilinear(Ref(2, "high"), Ref(2, "top"), ring.TIMES),
    Bilinear(Ref(0, "mask"), Ref(1, "mask"), ring.DotProduct(ROWS_BY_COLUMNS)),
    SharedBits((5, 26)),
    SharedBits((3,), rows=(64,)),
    AndTriple((4, 2), 3),
    Mask(()),
    Mask((7, 3), shift=20, bits=64, words=True),
    Zero((4, 3)),
    Zero((2, 5), xor=True),
)


def ask(dealer, private, public):
    """A program that takes everything there is and hands it out."""
    return [dict(dealer.take(request)) for request in REQUESTS], None


@functools.cache
def needed() -> Plan:
    return plan(ask, 2, None, None)


@functools.cache
def dealt(parties):
    return jax.jit(lambda key: deal(key, needed(), parties))(jax.random.key(11))


def joined(parties):
    """The dealer's values, from all parties' shares."""
    return [
        {
            name: np.asarray((sharing.join_xor if name in request.binary else sharing.join_sum)(shares))
            for name, shares in values.items()
        }
        for request, values in zip(REQUESTS, dealt(parties), strict=True)
    ]


def test_the_plan_is_what_the_program_takes_in_its_order():
    assert needed().requests == REQUESTS
    for parties in PARTIES:
        assert plan(ask, parties, None, None) == needed()
        shapes = tuple({name: x.shape[1:] for name, x in values.items()} for values in dealt(parties))
        assert shapes == needed().shapes


@pytest.mark.parametrize("parties", BY_PARTIES)
def test_each_party_is_handed_its_own_part_of_what_was_dealt(parties):
    handed, _ = jax.jit(lambda key: run(ask, key, parties, None, None))(jax.random.key(11))
    for given, expected in zip(handed, dealt(parties), strict=True):
        assert given.keys() == expected.keys()
        for name, shares in given.items():
            np.testing.assert_array_equal(shares, expected[name])


@pytest.mark.parametrize("parties", [*BY_PARTIES, *slow(8)])
def test_parts_of_a_mask_belong_to_the_same_mask(parties):
    for request, values in zip(REQUESTS, joined(parties), strict=True):
        if not isinstance(request, Mask):
            continue
        r = values["mask"]
        assert r.shape == request.shape
        assert ("high" in values) == (request.shift > 0)
        if request.shift:
            np.testing.assert_array_equal(values["high"], r >> np.uint64(request.shift))
            np.testing.assert_array_equal(values["top"], r >> np.uint64(63))
        assert ("bits" in values) == (request.bits > 0)
        assert ("pairs" in values) == (request.pairs > 0)
        if request.words:
            np.testing.assert_array_equal(values["bits"], r)
        elif request.bits:
            rows = [r >> np.uint64(i) & np.uint64(1) for i in range(request.bits)]
            np.testing.assert_array_equal(bits.unpack(values["bits"], request.shape), np.stack(rows))
            pairs = [rows[2 * i] & rows[2 * i + 1] for i in range(request.pairs)]
            np.testing.assert_array_equal(bits.unpack(values["pairs"], request.shape), np.stack(pairs))


@pytest.mark.parametrize("parties", [*BY_PARTIES, *slow(8)])
def test_shares_of_nothing_are_random_and_give_nothing(parties):
    for request, values, shares in zip(REQUESTS, joined(parties), dealt(parties), strict=True):
        if isinstance(request, Zero):
            assert not values["zero"].any()
            for mine in shares["zero"]:
                assert len(np.unique(mine)) == mine.size


@pytest.mark.parametrize("parties", [*BY_PARTIES, *slow(8)])
def test_wraps_are_those_of_the_parties_own_numbers(parties):
    request = WrapCount((300,))
    asked = plan(lambda dealer, *_: (dict(dealer.take(request)), None), parties, None, None)
    (supply,) = jax.jit(lambda key: deal(key, asked, parties))(jax.random.key(14))
    assert supply["mask"].shape == (parties, 300)
    wraps = np.asarray(sharing.join_sum(supply["wraps"])).view(np.int64)
    for r, wrapped in zip(np.asarray(supply["mask"]).T.view(np.int64), wraps, strict=True):
        total = sum(map(int, r))
        inside = (total + 2**63) % 2**64 - 2**63
        assert total == inside + 2**64 * int(wrapped)
    assert len(np.unique(wraps)) >= min(parties, 3)


@pytest.mark.parametrize("parties", [*BY_PARTIES, *slow(8)])
def test_products_are_those_of_the_values_they_name(parties):
    values = joined(parties)
    a, b = values[0]["mask"], values[1]["mask"]
    np.testing.assert_array_equal(values[4]["product"], a * a)
    np.testing.assert_array_equal(values[5]["product"], values[2]["high"] * values[2]["top"])
    np.testing.assert_array_equal(values[6]["product"], a @ b)


@pytest.mark.parametrize("parties", [*BY_PARTIES, *slow(8)])
def test_bits_shared_both_ways_are_the_same_bits(parties):
    for request, values in zip(REQUESTS, joined(parties), strict=True):
        if isinstance(request, SharedBits):
            assert values["bits"].shape == (*request.rows, *request.shape)
            np.testing.assert_array_equal(bits.unpack(values["words"], request.shape), values["bits"])
            assert 0 < values["bits"].mean() < 1
            assert set(np.unique(values["bits"])) == {0, 1}


@pytest.mark.parametrize("parties", [*BY_PARTIES, *slow(8)])
def test_a_triple_of_words_is_a_conjunction(parties):
    triple = joined(parties)[REQUESTS.index(AndTriple((4, 2), 3))]
    assert triple["right"].shape == (3, 4, 2)
    np.testing.assert_array_equal(triple["product"], triple["left"][None] & triple["right"])


def test_no_two_shares_of_a_plan_are_the_same_word():
    together = np.concatenate([np.ravel(x) for values in dealt(3) for x in values.values()])
    assert len(np.unique(together)) == together.size


@pytest.mark.parametrize(("parties", "generator"), [(2, "threefry"), (5, "threefry"), (3, "chacha20")])
def test_a_party_draws_all_its_shares_from_its_own_seed_but_those_that_it_is_sent(parties, generator):
    """So that a dealer sends a seed, and what `corrected` says."""
    sent = corrected(needed(), parties)
    assert {party for of_request in sent for party in of_request.values()} == set(range(parties))
    supply = jax.jit(lambda key: deal(key, needed(), parties, generator))(jax.random.key(11))
    length = max(words_needed(needed(), parties))
    for party in range(parties):
        uniform, dependent = [], []
        for request, values, corrections in zip(REQUESTS, supply, sent, strict=True):
            uniform += [np.ravel(values[name][party]) for name in request.uniform]
            dependent += [np.ravel(values[name][party]) for name, to in corrections.items() if to != party]
        own = np.concatenate([*uniform, *dependent])
        assert own.size == words_needed(needed(), parties)[party]
        seed = keys.derive(jax.random.key(11), "dealer", "party", party)
        (stream,) = jax.jit(ring.draw, static_argnums=(1, 2))(seed, ((length,),), generator)
        np.testing.assert_array_equal(own, stream[: own.size])


def test_what_is_uniform_is_sent_to_nobody_and_all_else_to_one():
    for request, of_request, values in zip(REQUESTS, corrected(needed(), 3), needed().shapes, strict=True):
        assert {*of_request} | {*request.uniform} == {*values}
    uniform = {name for request in REQUESTS for name in request.uniform}
    dependent = {name for of_request in corrected(needed(), 3) for name in of_request}
    assert uniform == {"mask", "left", "right", "words"}
    assert dependent == {"high", "top", "bits", "pairs", "product", "zero"}


@pytest.mark.parametrize("parties", BY_PARTIES)
def test_all_but_one_party_see_uniform_words_for_every_kind_of_request(parties):
    size = 64 * 64
    requests = (
        Mask((size,), 20, bits=64, pairs=31),
        Bilinear(Ref(0, "high"), Ref(0, "top"), ring.TIMES),
        SharedBits((size,)),
        AndTriple((512,), 2),
    )
    asked = plan(lambda dealer, *_: ([dict(dealer.take(r)) for r in requests], None), parties, None, None)
    supply = jax.jit(lambda key: deal(key, asked, parties))(jax.random.key(12))
    for left_out in range(parties):
        company = [
            np.delete(x, left_out, axis=0) for values in supply for x in map(np.asarray, values.values())
        ]
        assert joint_uniformity([row for rows in company for row in rows]) > 1e-7


def test_a_dealer_that_hands_out_values_in_the_clear_is_noticed(monkeypatch):
    monkeypatch.setattr(sharing, "split_sum", lambda x, uniform, place: [x, 0 * x])
    asked = plan(lambda dealer, *_: (dict(dealer.take(Mask((8192,), 20))), None), 2, None, None)
    (supply,) = deal(jax.random.key(13), asked, 2)
    assert joint_uniformity([supply["high"][0]]) < 1e-100
    assert joint_uniformity([supply["top"][1]]) < 1e-100


def test_a_program_that_departs_from_its_plan_raises():
    supply = Supply(needed(), [{}] * len(REQUESTS))
    with pytest.raises(RuntimeError, match="departed from its plan"):
        supply.take(Mask((3, 6)))
    only = Supply(Plan((Mask((1,)),), ({"mask": (1,)},)), [{"mask": jnp.zeros(1, jnp.uint64)}])
    only.take(Mask((1,)))
    with pytest.raises(RuntimeError, match="nothing more"):
        only.take(Mask((1,)))


def test_a_program_whose_requests_change_between_traces_raises():
    shapes = iter([(3,), (4,)])

    def fickle(dealer, private, public):
        return dealer.take(Mask(next(shapes)))["mask"], None

    with pytest.raises(RuntimeError, match="must not depend on the values"):
        run(fickle, jax.random.key(0), 2, None, None)


@pytest.mark.parametrize("loop", ["scan", "vmap"])
def test_randomness_taken_in_a_loop_would_repeat_and_raises(loop):
    def program(dealer, private, public):
        def body(x):
            return x + dealer.take(Mask(()))["mask"]

        if loop == "vmap":
            return jax.vmap(body)(private), None
        return jax.lax.scan(lambda carry, x: (carry, body(x)), 0, private)[1], None

    with pytest.raises(RuntimeError, match="every iteration would get the same"):
        run(program, jax.random.key(0), 2, jnp.zeros((2, 4), jnp.uint64), None)


def test_planning_computes_nothing():
    planner = Planner()
    jax.eval_shape(lambda: dict(planner.take(Mask((10**9, 10**3), 20, bits=64))))
    assert planner.plan().shapes[0]["mask"] == (10**9, 10**3)


def test_dealing_for_fewer_than_two_parties_raises():
    with pytest.raises(ValueError, match="at least two parties"):
        deal(jax.random.key(0), needed(), 1)
