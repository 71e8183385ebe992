"""What passes between the parties: which operations, how often, and what it tells them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

from ciphernav_jax import ring
from ciphernav_jax.parties import dealer, party, requests, sharing
from ciphernav_jax.parties.locality import inner_jaxprs
from ciphernav_jax.parties.messages import openings
from ciphernav_jax.parties.run import one_partys_jaxpr, online, plan
from ciphernav_jax.protocols import compare, convert, masked, multiply, relu, truncate

from ..slow import slow
from .simulated import BY_PARTIES, joint_uniformity, on_shares, views

COUNT = 64 * 128


def product(d, x, y):
    return multiply.bilinear(d, masked.open_masked(d, x), masked.open_masked(d, y), ring.TIMES)


def square(d, x):
    return multiply.square(d, masked.open_masked(d, x))


def inner_product(d, x, y):
    form = ring.DotProduct((((0,), (0,)), ((), ())))
    return multiply.bilinear(d, masked.open_masked(d, x), masked.open_masked(d, y), form)


def probabilistic(d, x):
    return truncate.probabilistic(d, x, 20).share()


def local(d, x):
    return truncate.local(x, 20)


def nearest(d, x):
    return truncate.nearest(d, x, 20).share()


def wrap_count(d, x):
    return truncate.wrap_count(d, x, 20)


def positive(d, x):
    return compare.positive(d, x).share()


def sign_of_words(d, x):
    return compare.positive(d, x, compare.Circuit(layout="words")).share()


def sign_by_full_adders(d, x):
    return compare.positive(d, x, compare.Circuit(adder="brent-kung")).share()


def sign_in_a_range(d, x):
    return compare.positive(d, x, compare.Circuit(sign_bit=30)).share()


def sign_by_resharing(d, x):
    return compare.resharing(d, x).share()


def fused(d, x):
    return relu.relu(d, x, 20).output


def back_and_forth(d, x):
    return convert.to_ring(d, convert.to_bits(d, x), x.shape)


# Program, number of inputs, openings stated by its docstring.
PROGRAMS = {
    "multiply": (product, 2, 2),
    "square": (square, 1, 1),
    "dot_general": (inner_product, 2, 2),
    "probabilistic truncation": (probabilistic, 1, 1),
    "local truncation": (local, 1, 0),
    "truncation to the nearest": (nearest, 1, 6),
    "truncation by wrap count": (wrap_count, 1, 1),
    "positive": (positive, 1, 7),
    "positive on words": (sign_of_words, 1, 8),
    "positive by Brent-Kung": (sign_by_full_adders, 1, 12),
    "positive in a range": (sign_in_a_range, 1, 6),
    "positive by re-sharing": (sign_by_resharing, 1, 8),
    "relu": (fused, 1, 7),
    "to bits and back": (back_and_forth, 1, 8),
}


def program_of_one_party(program, inputs, parties):
    """The jaxpr of the online program, its part of the dealer's randomness an input like its shares."""

    def alone(d, private, _):
        return program(d, *private), None

    shares = [jax.ShapeDtypeStruct((parties, 128), jnp.uint64)] * inputs
    needed = plan(alone, parties, shares, None)
    supply = [
        {name: jax.ShapeDtypeStruct((parties, *shape), jnp.uint64) for name, shape in values.items()}
        for values in needed.shapes
    ]
    return one_partys_jaxpr(online(alone, needed), parties, (supply, shares), None)[0]


def primitives(jaxpr):
    for equation in jaxpr.eqns:
        yield equation.primitive.name
        for inner in inner_jaxprs(equation):
            yield from primitives(inner)


def draws(jaxpr):
    return [n for n in primitives(jaxpr) if any(word in n for word in ("random", "rng", "threefry"))]


@pytest.mark.parametrize("name", PROGRAMS)
def test_only_openings_cross_parties_and_as_often_as_stated(name):
    program, inputs, stated = PROGRAMS[name]
    found = openings(program_of_one_party(program, inputs, 2))
    assert len(found) == stated
    assert all(opening.protocol and not opening.ideal for opening in found)


@pytest.mark.parametrize("name", PROGRAMS)
def test_online_programs_draw_no_randomness(name):
    program, inputs, _ = PROGRAMS[name]
    assert draws(program_of_one_party(program, inputs, 2).jaxpr) == []


def test_a_draw_would_be_noticed():
    def noisy(d, x):
        step = lambda c, _: (c + jax.random.bits(jax.random.key(0), (), jnp.uint64), None)  # noqa: E731
        return jax.jit(lambda v: lax.scan(step, v, length=2)[0])(x)

    assert draws(program_of_one_party(noisy, 1, 2).jaxpr)


def view(program, inputs, parties, secret):
    """Every party's every message and every opened value, for many copies of a secret."""
    count = COUNT // 4 if program is back_and_forth else COUNT
    secrets = [np.full(count, secret % 2**64, np.uint64)] * inputs
    messages = views(program, parties)(1, *secrets)
    rows = [np.asarray(row) for message in messages for row in message.sent]
    joined = [message for message in messages if message.opening.collective != "open_shares"]
    return rows + [np.asarray(message.opened) for message in joined]


@pytest.mark.parametrize("secret", [*slow(0), -3 * 2**20 - 1])
@pytest.mark.parametrize(
    ("name", "parties"),
    [*((n, 2) for n in PROGRAMS if n != "local truncation"), ("relu", 5), ("truncation by wrap count", 3)],
)
def test_what_is_sent_and_opened_is_uniform_whatever_the_secret(name, parties, secret):
    program, inputs, stated = PROGRAMS[name]
    seen = view(program, inputs, parties, secret)
    assert len(seen) == stated * (parties + (name != "truncation by wrap count"))
    assert joint_uniformity(seen) > 1e-7


def zeros(shares):
    return jnp.zeros_like(shares)


def repeated(shares):
    """Each party's first word in place of all of its words."""
    return jnp.broadcast_to(
        shares.reshape(len(shares), -1).T[0].reshape(-1, *[1] * (shares.ndim - 1)), shares.shape
    )


class Faulty(tuple):
    """The shape of uniform words that are dealt badly."""


@pytest.mark.parametrize("fault", [*slow(zeros), repeated])
@pytest.mark.parametrize(
    ("name", "request_type"),
    [
        ("multiply", requests.Mask),
        ("square", requests.Mask),
        ("dot_general", requests.Mask),
        ("probabilistic truncation", requests.Mask),
        ("positive", requests.Mask),
        ("positive", requests.AndTriple),
        ("positive", requests.SharedBits),
        ("relu", requests.Mask),
        ("truncation to the nearest", requests.AndTriple),
        ("truncation by wrap count", requests.WrapCount),
        ("positive by re-sharing", requests.AndTriple),
        ("to bits and back", requests.AndTriple),
        ("to bits and back", requests.SharedBits),
    ],
)
def test_a_mask_that_is_zero_or_used_again_is_noticed(monkeypatch, name, request_type, fault):
    uniform, of_all = request_type.uniform.func, dealer._Streams.of_all
    shapes = property(lambda self: {name: Faulty(shape) for name, shape in uniform(self).items()})
    monkeypatch.setattr(request_type, "uniform", shapes)

    def dealt(self, shape):
        return fault(of_all(self, shape)) if isinstance(shape, Faulty) else of_all(self, shape)

    monkeypatch.setattr(dealer._Streams, "of_all", dealt)
    program, inputs, _ = PROGRAMS[name]
    assert joint_uniformity(view(program, inputs, 2, 5)) < 1e-30


@pytest.mark.parametrize("parties", BY_PARTIES)
def test_the_shares_that_a_protocol_leaves_are_fresh(parties):
    """All but one party's output shares are uniform, so that opening a result shows the result alone."""
    x = np.full(COUNT, 3 * 2**20, np.uint64)
    shares = np.asarray(on_shares(fused, parties)(2, x))
    np.testing.assert_array_equal(sharing.join_sum(shares), np.full(COUNT, 3))
    for left_out in range(parties):
        assert joint_uniformity(list(np.delete(shares, left_out, axis=0))) > 1e-7


@pytest.mark.parametrize("parties", BY_PARTIES)
def test_openings_give_every_party_the_joined_value(parties):
    def program(private, public):
        return (party.open_sum(private), party.open_xor(private), party.from_party_zero(public)), None

    x = np.random.default_rng(3).integers(0, 2**64, (parties, 10), dtype=np.uint64)
    simulated = jax.jit(lambda x, public: party.simulate(program, parties)(x, public)[0])
    total, parity, held = simulated(x, jnp.full(10, 7, jnp.uint64))
    for row in range(parties):
        np.testing.assert_array_equal(total[row], x.sum(axis=0))
        np.testing.assert_array_equal(parity[row], np.bitwise_xor.reduce(x))
    for joined in (sharing.join_sum(held), sharing.join_xor(held)):
        np.testing.assert_array_equal(joined, np.full(10, 7))


@pytest.mark.parametrize("names", [("device",), ("party", "model")])
def test_deploying_over_another_mesh_raises(names):
    mesh = jax.make_mesh((1,) * len(names), names, devices=jax.devices()[:1])
    with pytest.raises(ValueError, match='one axis "party"'):
        party.deploy(lambda private, public: (private, public), mesh)
