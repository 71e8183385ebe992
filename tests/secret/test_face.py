"""How functions on secrets are called: keywords, static arguments, decorators, and a newcomer's mistakes."""

import ast
import inspect
import warnings
from pathlib import Path

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

    assert (f.__name__, f.__doc__, f.__module__) == ("f", "Twice.", __name__)
    assert f.protocol.truncation == "nearest"
    assert repr(f) == "secure(f, truncation=nearest)"
    assert repr(g) == "secure(g)"


def test_names_and_signature_are_the_functions():
    step = cn.secure(scaled)
    assert step.__name__ == "scaled"
    assert inspect.getdoc(step) == "Scales."


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
}


@pytest.mark.parametrize("name", MISTAKES)
def test_a_newcomers_mistakes_are_answered_with_what_to_write(name, x):
    mistake, message = MISTAKES[name]
    with pytest.raises(TypeError, match=message):
        mistake(x)


@pytest.mark.parametrize("name", ["sum", "mean", "T", "max", "reshape", "astype", "at"])
def test_methods_of_arrays_say_where_they_belong(name, x):
    with pytest.raises(AttributeError, match=rf"secure\(lambda x: x\.{name}"):
        getattr(x, name)


def test_the_public_names_are_those_that_an_editor_sees():
    assert sorted(cn.__all__) == sorted([*cn._HOME, *cn._PACKAGES])
    assert all(getattr(cn, name) is not None for name in cn.__all__)
    tree = ast.parse(Path(cn.__file__).read_text())
    (block,) = [node for node in tree.body if ast.unparse(node).startswith("if TYPE_CHECKING")]
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
