"""Keys are made and derived in `ring.keys` alone: what folds in a number by hand may fold it in twice."""

import ast
from pathlib import Path

from ciphernav_jax.ring import keys

ROOT = Path(__file__).parents[1]

MAKERS = {"key", "PRNGKey", "split", "fold_in", "clone", "wrap_key_data"}
ALLOWED = {
    ("ciphernav_jax/ring/keys.py", "wrap_key_data"),  # the one place
    ("ciphernav_jax/parties/repeat.py", "wrap_key_data"),  # a session's seed, which the dealer draws
    # Of these the shape alone is used.
    ("ciphernav_jax/secret/costs.py", "key"),
    ("experiments/primitives.py", "key"),
    ("experiments/paper/runs.py", "key"),
}


def made(source: str) -> set[str]:
    """The functions of jax.random that make keys and that a module calls or passes on."""
    found = set()
    for node in ast.walk(ast.parse(source)):
        if (
            isinstance(node, ast.Attribute)
            and node.attr in MAKERS
            and ast.unparse(node.value).endswith("random")
        ):
            found.add(node.attr)
        if isinstance(node, ast.ImportFrom) and node.module and node.module.endswith("random"):
            found |= {name.name for name in node.names} & MAKERS
    return found


def test_a_stray_is_seen():
    assert made("import jax\nkey = jax.random.fold_in(key, 3)") == {"fold_in"}
    assert made("from jax import random\nf(random.split)") == {"split"}
    assert made("from jax.random import PRNGKey, normal") == {"PRNGKey"}
    assert made("'jax.random.key(0)'  # jax.random.split(key)\nsplit(key)\nparts.key") == set()


def test_keys_are_made_and_derived_in_one_place():
    found = {
        (path.relative_to(ROOT).as_posix(), name)
        for package in ("ciphernav_jax", "experiments")
        for path in (ROOT / package).rglob("*.py")
        for name in made(path.read_text())
    }
    assert Path(keys.__file__).relative_to(ROOT).as_posix() in {path for path, _ in found}
    assert found == ALLOWED, "derive keys with ring.keys.derive(key, purpose)"
