"""What JAX does not promise to keep has one address, and means the same on every JAX that is supported."""

import re
from pathlib import Path

import jax
import jax.numpy as jnp
import pytest
from jax import lax
from jax._src import compilation_cache

from ciphernav_jax import jax_private

PACKAGE = Path(jax_private.__file__).parent
PRIVATE = re.compile(r"\b(from jax import .*|jax\.)(_src|core|extend|interpreters|experimental)\b")

pytestmark = pytest.mark.newest_jax


def test_private_parts_of_jax_are_named_in_one_module_alone():
    strays = {
        str(path.relative_to(PACKAGE)): line
        for path in PACKAGE.rglob("*.py")
        for line in path.read_text().splitlines()
        if PRIVATE.search(line)
    }
    assert set(strays) == {"jax_private.py"}, strays


def equation(function, *args):
    (found,) = jax.make_jaxpr(function)(*args).eqns
    return found


def test_a_scans_operands_are_told_apart():
    def scanned(a, b, start, xs):
        return lax.scan(lambda carry, x: (carry * a + b, carry * x), start, xs)[0]

    eqn = equation(scanned, 1.0, 2.0, 3.0, jnp.ones(5))
    assert jax_private.scan_parts(eqn.params, "abcx") == (["a", "b"], ["c"], ["x"])


@pytest.fixture
def cache(tmp_path):
    """JAX's persistent compilation cache in a folder of its own, where every program is kept."""
    names = {
        "jax_compilation_cache_dir": str(tmp_path),
        "jax_persistent_cache_min_compile_time_secs": 0,
        "jax_persistent_cache_min_entry_size_bytes": -1,
        "jax_enable_compilation_cache": True,
    }
    before = {name: getattr(jax.config, name) for name in names}
    for name, value in names.items():
        jax.config.update(name, value)
    compilation_cache.reset_cache()
    yield tmp_path
    for name, value in before.items():
        jax.config.update(name, value)
    compilation_cache.reset_cache()


def test_without_the_compilation_cache_nothing_is_kept_or_read_and_then_it_is_as_before(cache, monkeypatch):
    read = []
    monkeypatch.setattr(
        compilation_cache, "get_executable_and_time", lambda *args: read.append(args) or (None, None)
    )

    def compiled(number):
        jax.jit(lambda x: x * number).lower(1.0).compile()
        return len(list(cache.glob("*-cache"))), len(read)

    assert compiled(3.25) == (1, 1)
    with jax_private.without_compilation_cache():
        assert compiled(3.25) == compiled(3.5) == (1, 1)
    assert compiled(3.5) == (2, 2)
    with (
        jax_private.without_compilation_cache(),
        pytest.raises(ZeroDivisionError),
        jax_private.without_compilation_cache(),
    ):
        raise ZeroDivisionError
    enabled = "jax_enable_compilation_cache"
    assert getattr(jax.config, enabled)


@pytest.mark.parametrize(
    ("function", "count"),
    [
        (jnp.sin, 1),
        (lambda x: lax.split(x, (1, 3)), 2),
        (jax.jit(lambda x: (x, x + 1, x * 2)), 3),
        (jax.nn.relu, 1),  # holds a jaxpr, and is bound with a function
        (lambda x: lax.while_loop(lambda x: x[0] < 9, lambda x: x + 1, x), 1),
    ],
)
def test_an_equation_is_bound_to_other_operands(function, count):
    x = jnp.arange(4.0)
    results = jax_private.bind(equation(function, jnp.zeros(4)), [x])
    assert len(results) == count
    assert jnp.array_equal(jnp.concatenate(results), jnp.concatenate(jax.tree.leaves(function(x))))


def test_an_equation_says_where_it_was_written():
    with jax.named_scope("outside"):
        eqn = equation(lambda x: jax.named_scope("inside")(jnp.sin)(x), 1.0)
    assert "inside" in jax_private.name_stack(eqn)
    assert Path(__file__).name in jax_private.place(eqn)
    file, line, function = jax_private.frames(eqn)[0]
    assert (file, "<lambda>" in function) == (__file__, True)
    assert "eqn = equation(" in Path(file).read_text().splitlines()[line - 1]


def test_a_body_has_a_trace_of_its_own():
    seen = []

    def body(carry, _):
        seen.append(jax_private.get_opaque_trace_state())
        return carry, None

    lax.scan(body, 0.0, None, length=2)
    assert seen[0] != jax_private.get_opaque_trace_state()


def test_the_traces_under_way_say_what_they_are_for_and_values_say_where_they_come_from():
    outside = jnp.ones(3)
    found = {}

    def body(carry, x):
        def branch(y):
            found["for"] = [jax_private.traced_for(trace) for trace in jax_private.traces()]
            derived = jnp.sin(outside)
            found["input"] = jax_private.origins(y)
            found["constant"] = jax_private.origins(jax_private.origins(derived)[0])
            jax.vmap(lambda z: found.update(vmapped=jax_private.origins(z)[0] is y))(y)
            found["another's"] = jax_private.trace_of(x) is list(jax_private.traces())[1]
            return y

        return carry, lax.cond(x[0] > 0, branch, branch, x)

    lax.scan(body, 0, jnp.ones((2, 3)))
    assert found["for"] == ["cond", "scan", None]
    assert found["input"] is None
    assert found["constant"][0] is outside
    assert found["vmapped"]
    assert found["another's"]
