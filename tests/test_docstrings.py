"""The examples in docstrings: they run and give what is shown, and each public name has one."""

import doctest
import importlib
import inspect
import warnings
from pathlib import Path

import pytest

import ciphernav_jax as cn
from ciphernav_jax.secret import fresh

PACKAGE = Path(cn.__file__).parent
MODULES = sorted(
    ".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts)
    for path in PACKAGE.rglob("*.py")
    if ">>> " in path.read_text()
)
EXAMPLES = {
    example.name: example
    for name in MODULES
    for example in doctest.DocTestFinder().find(importlib.import_module(name))
    if example.examples
}


@pytest.mark.parametrize("name", EXAMPLES)
def test_an_example_gives_what_is_shown(name):
    fresh.forget()  # each is read by itself
    with warnings.catch_warnings():
        warnings.simplefilter("error", cn.KeyReuseWarning)
        assert doctest.DocTestRunner(verbose=False).run(EXAMPLES[name]).failed == 0


def test_every_public_name_has_an_example():
    """But for errors and warnings, which the others raise."""
    called = [thing for thing in (getattr(cn, name) for name in cn.__all__) if callable(thing)]
    assert called
    for thing in called:
        if not (inspect.isclass(thing) and issubclass(thing, Exception)):
            assert f"{thing.__module__}.{thing.__qualname__}" in EXAMPLES
