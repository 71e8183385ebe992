"""How functions on secrets are called: keywords, static arguments, decorators, and a newcomer's mistakes."""

import ast
import inspect
import warnings
from operator import attrgetter
from pathlib import Path
from typing import Any, cast

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import ciphernav_jax as cn

KEY = jax.random.key(0)
X = np.array([[1.5, -2.0], [0.5, 3.0]])


@pytest.fixture(scope="module")
def x():
    return cn.share(jax.random.key(1), X, parties=2)


def scaled(x, *, by, power=1):
    """Scales."""
    return x * by + power


def test_keyword_arguments_may_be_secret_or_public(x):
    step = cn.secure(scaled)
    np.testing.assert_array_equal(cn.reveal(step(KEY, x, by=2.0)), X * 2 + 1)
    np.testing.assert_array_equal(cn.reveal(step(KEY, x=x, by=2.0, power=3)), X * 2 + 3)
    other = cn.share(jax.random.key(2), np.ones(2), parties=2)
    np.testing.assert_allclose(cn.reveal(step(jax.random.key(3), X, by=other)), X + 1, atol=1e-6)
    assert (cn.cost(step, x, by=other).rounds, cn.cost(step, X, by=x).rounds) == (2, 1)
    assert cn.transcript(step)(jax.random.key(4), x, by=other)[1]
    _, report = cn.validate(step)(jax.random.key(5), x, by=other)
    assert {row.place.function for row in report.rows} >= {"args[0]", "kwargs['by']"}


def widened(x, n, mode="repeat"):
    return jnp.concatenate([x] * n) if mode == "repeat" else jnp.broadcast_to(x, (n, *x.shape))


def test_static_arguments_are_traced_with(x):
    step = cn.secure(widened, static_argnames=("n", "mode"))
    assert step(KEY, x, 3).shape == (6, 2)
    assert step(KEY, x, n=3, mode="stack").shape == (3, 2, 2)
    assert cn.cost(step, x, 2).rounds == 0
    jitted = jax.jit(step, static_argnums=2)
    assert jitted(KEY, x, 2).shape == (4, 2)
    with pytest.raises(TypeError, match="the static argument n is a list, which cannot be hashed"):
        step(KEY, x, [3])
    with pytest.raises(TypeError, match="holds a secret"):
        step(KEY, X, x)


def test_the_same_key_with_other_static_arguments_is_warned_of(x):
    step = cn.secure(widened, static_argnames=("n", "mode"))
    key = jax.random.key(77)
    step(key, x, 3)
    with pytest.warns(cn.KeyReuseWarning, match="a second time"):
        step(key, x, 2)


def test_it_decorates():
    @cn.secure(protocol=cn.Protocol(truncation="nearest"))
    def f(x):
        """Twice."""
        return 2 * x

    @cn.secure
    def g(x):
        return x

    assert attrgetter("__name__", "__doc__", "__module__")(f) == ("f", "Twice.", __name__)
    assert f.protocol.truncation == "nearest"
    assert repr(f) == "secure(f, truncation=nearest)"
    assert repr(g) == "secure(g)"


def test_names_and_signature_are_the_functions():
    step = cn.secure(scaled)
    assert attrgetter("__name__")(step) == "scaled"
    assert inspect.getdoc(step) == "Scales."


def double(x):
    return 2 * x


DOUBLED = cn.secure(double)
CLOSED_OVER = r"closes over public values alone. Give it the Secret as an argument: secure\(f\)\(key, x\)"

MISTAKES = {
    "no key": (
        lambda x: cn.secure(jnp.sin)(x),
        "first argument of a secure function is the dealer's.*a Secret",
    ),
    "a seed for a key": (lambda x: cn.secure(jnp.sin)(0, x), "jax.random.key.seed.*a int"),
    "a seed to share with": (
        lambda x: cn.share(0, X, parties=2),
        "first argument of share is its owner's.*a int",
    ),
    "swapped": (lambda x: cn.share(X, KEY, parties=2), "first argument of share.*ndarray"),
    "a string": (lambda x: cn.secure(widened)(KEY, x, 2, "repeat"), "has a str.*static_argnames"),
    "a function": (lambda x: cn.secure(widened)(KEY, x, jnp.sin), "static_argnames"),
    "twice secure": (lambda x: cn.secure(cn.secure(jnp.sin)), "secure already"),
    "shared twice": (lambda x: cn.share(KEY, x, parties=2), "a Secret is shared already"),
    "an operator": (lambda x: x + 1, "secure"),
    "a float": (lambda x: float(x), "reveal"),
    "a seed to hand on with": (lambda x: cn.reshare(0, x, parties=3), "first argument of reshare.*a int"),
    "nothing to share": (lambda x: cn.share(KEY, None, parties=2), "nothing to share.*None"),
    "a string to share": (lambda x: cn.share(KEY, "1.5", parties=2), "dtype <U3; share floats"),
    "an object among others": (
        lambda x: cn.share(KEY, {"a": X, "b": [np.array([X, None], object)]}, parties=2),
        r"dtype object, values\['b'\]\[0\]; share floats",
    ),
    "an object, floats only": (
        lambda x: cn.share(KEY, np.array([1.5, None], object), parties=2, floats_only=True),
        "dtype object; share floats",
    ),
    "half a party": (lambda x: cn.share(KEY, X, parties=2.0), "how many there are, an int, and not a float"),
    "a variant for a protocol": (lambda x: cn.share(KEY, X, parties=2, protocol="nearest"), "Protocol.parse"),
    "secure of it": (lambda x: cn.secure(cast(Any, x)), "secure takes a function, and not a Secret"),
    "secure by a name": (lambda x: cn.secure(jnp.sin, protocol=cast(Any, "nearest")), "Protocol.parse"),
    "deploy of a plain function": (lambda x: cn.deploy(jnp.sin, None), r"made by secure\(f\)"),
    "deploy on nothing": (lambda x: cn.deploy(cn.secure(jnp.sin), None), "jax.make_mesh"),
    "cost of a plain function": (lambda x: cn.cost(jnp.sin, x), r"made by secure\(f\)"),
    "compare of a secure one": (lambda x: cn.compare(cn.secure(jnp.sin), X), "the one that it was made from"),
    "jnp": (lambda x: jnp.sum(x), "no public value.*secure.*reveal"),
    "jnp beside an array": (lambda x: jnp.ones(2) + x, "no public value.*secure.*reveal"),
    "lax": (lambda x: jax.lax.sin(x), "type .*Secret"),
    "numpy": (lambda x: np.asarray(x), "no public value.*secure.*reveal"),
    "a comparison": (lambda x: 1 if x > 0 else 2, "x > y.*secure"),
    "an if": (lambda x: 1 if x else 2, "jnp.where.*reveal"),
    "digits": (lambda x: f"{x:.3f}", "no digits.*reveal"),
    "in place": (lambda x: x.__setitem__(0, 1.0), r"x.at\[i\].set"),
    "entries of a scalar": (lambda x: list(x[0, 0]), r"len\(\) of a secret scalar"),
    "secure in secure": (
        lambda x: cn.secure(lambda x: DOUBLED(KEY, x))(KEY, x),
        r"secure\(double\) is called inside a function on secrets.*step.function",
    ),
    "jitted secure in secure": (
        lambda x: cn.secure(lambda x: jax.jit(DOUBLED)(KEY, x))(KEY, x),
        "is called inside a function on secrets.*step.function",
    ),
    "cost in secure": (lambda x: cn.secure(lambda x: cn.cost(DOUBLED, x))(KEY, x), "step.function"),
    "share in secure": (
        lambda x: cn.secure(lambda x: cn.share(KEY, X, parties=2))(KEY, x),
        "share is called inside a function on secrets.*counts as public",
    ),
    "reveal in secure": (
        lambda x: cn.secure(lambda x: cn.reveal(x))(KEY, x),
        "reveal is called inside a function on secrets.*Return the values",
    ),
    "reshare in secure": (
        lambda x: cn.secure(lambda x: cn.reshare(KEY, x, parties=3))(KEY, x),
        "reshare is called inside a function on secrets.*Return the values",
    ),
    "closed over": (lambda x: cn.secure(lambda y: y + x)(KEY, x), CLOSED_OVER),
    "closed over by jnp": (lambda x: cn.secure(lambda y: y + jnp.sum(x))(KEY, x), CLOSED_OVER),
    "closed over, an entry": (lambda x: cn.secure(lambda y: x[0] * x[1])(KEY, x), CLOSED_OVER),
    "closed over and returned": (lambda x: cn.secure(lambda y: {"y": y, "x": x})(KEY, x), CLOSED_OVER),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_a_newcomers_mistakes_are_answered_with_what_to_write(name, x):
    mistake, message = MISTAKES[name]
    with pytest.raises(TypeError, match=message):
        mistake(x)


NO_PARTIES = "no argument is secret.*closes over is none, give it as an argument"
DISAGREEING = {
    "only closed over": (lambda x: cn.secure(lambda: x + 1)(KEY), NO_PARTIES),
    "closed over beside public": (lambda x: cn.secure(lambda y: y + x)(KEY, X), NO_PARTIES),
    "parties": (
        lambda x: cn.secure(jnp.add)(KEY, x, cn.share(jax.random.key(30), X, parties=3)),
        r"different numbers of parties: \[2, 3\].*reshare",
    ),
    "protocols": (
        lambda x: cn.secure(jnp.sin, protocol=cn.Protocol(frac_bits=16))(KEY, x),
        "20 fractional bits, the protocol 16.*the same protocol",
    ),
    "static names": (
        lambda x: cn.secure(widened, static_argnames="times")(KEY, x, 3),
        "static_argnames has 'times'; the parameters are x, n, mode",
    ),
}


@pytest.mark.parametrize("name", DISAGREEING)
def test_arguments_that_do_not_belong_together_are_told_apart(name, x):
    mistake, message = DISAGREEING[name]
    with pytest.raises(ValueError, match=message):
        mistake(x)


def test_after_a_refusal_one_is_outside_again(x):
    with pytest.raises(TypeError, match="inside a function on secrets"):
        cn.secure(cn.reveal)(KEY, x)
    np.testing.assert_array_equal(cn.reveal(DOUBLED(KEY, x)), 2 * X)
    assert f"{x}" == f"{x!r}"


def test_what_is_public_already_is_revealed_as_it_is():
    assert cn.reveal(X) is X
    assert cn.reveal({"a": None, "b": "c"}) == {"a": None, "b": "c"}


@pytest.mark.parametrize("name", ["item", "tolist"])
def test_numbers_are_had_by_opening(name, x):
    with pytest.raises(AttributeError, match=rf"reveal\(x\).{name}\(\)"):
        getattr(x, name)


@pytest.mark.parametrize("name", ["sum", "mean", "T", "max", "reshape", "astype", "at"])
def test_methods_of_arrays_say_where_they_belong(name, x):
    with pytest.raises(AttributeError, match=rf"secure\(lambda x: x\.{name}"):
        getattr(x, name)


def test_the_public_names_are_those_that_an_editor_sees():
    assert sorted(cn.__all__) == sorted([*cn._HOME, *cn._PACKAGES])
    assert all(getattr(cn, name) is not None for name in cn.__all__)
    tree = ast.parse(Path(cn.__file__).read_text())
    (block,) = [
        node
        for node in tree.body
        if isinstance(node, ast.If) and ast.unparse(node).startswith("if TYPE_CHECKING")
    ]
    seen = {name.name for node in block.body if isinstance(node, ast.ImportFrom) for name in node.names}
    assert seen == set(cn.__all__)


def test_integers_may_stay_public():
    state = {"count": jnp.int32(3), "mean": jnp.array([0.5, 1.5]), "done": np.array(False)}
    shared = cn.share(jax.random.key(20), state, parties=2, floats_only=True)
    assert isinstance(shared["mean"], cn.Secret)
    assert shared["count"] is state["count"]
    assert shared["done"] is state["done"]


def test_integers_that_stay_public_are_not_hidden_by_the_key():
    """The same floats once more, with another count: nothing leaks, and nothing is warned of."""
    key, mean = jax.random.key(21), jnp.array([0.5, 1.5])
    with warnings.catch_warnings():
        warnings.simplefilter("error", cn.KeyReuseWarning)
        for count in (3, 4):
            cn.share(key, {"count": jnp.int32(count), "mean": mean}, parties=2, floats_only=True)
    with pytest.warns(cn.KeyReuseWarning):
        cn.share(key, {"count": 4, "mean": mean + 1}, parties=2, floats_only=True)
