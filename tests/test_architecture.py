"""The house as its maps draw it: floors import downwards alone, and modules in the order that is said."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
LIBRARY = ROOT / "ciphernav_jax"

# What each part of the library may import of the others.
BASE = {
    "startup",
    "extras",
    "files",
    "lifeline",
    "command_line",
    "provenance",
    "tables",
}
ENGINE = ("ring", "parties", "protocols", "secret")
MAY_IMPORT = {
    **dict.fromkeys(sorted(BASE), BASE),
    "jax_private": set(),
    **{name: {*BASE, "jax_private", *ENGINE[:i]} for i, name in enumerate(ENGINE)},
    "comparison": {*BASE, "jax_private", *ENGINE},
    "world": BASE,
    "models": BASE,
    "learning": {*BASE, *ENGINE},
    "navigation": {*BASE, *ENGINE, "learning", "world", "models", "__version__"},
    "cli": {*BASE, *ENGINE, "comparison", "learning", "world", "models", "navigation"},
}


def imported(path):
    """The modules that a file imports, written out, with those that it takes out of packages; for types alone
    it may import any.
    """
    tree, found = ast.parse(path.read_text()), set()
    tree.body = [node for node in tree.body if not ast.unparse(node).startswith("if TYPE_CHECKING")]
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {name.name for name in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found |= {f"{node.module}.{name.name}" for name in node.names}
    return found


def modules(folder):
    """The modules and packages in a package."""
    there = {p.stem for p in folder.iterdir() if p.suffix == ".py" or (p / "__init__.py").exists()}
    return there - {"__init__"}


def listed(package):
    """The modules that a package's docstring lists, in its order."""
    lines = re.findall(r"^- ((?:`\w+`(?:, )?)+):", (package / "__init__.py").read_text(), re.MULTILINE)
    return re.findall(r"`(\w+)`", " ".join(lines))


def test_every_part_has_its_floor():
    assert modules(LIBRARY) == set(MAY_IMPORT)


@pytest.mark.parametrize("part", MAY_IMPORT)
def test_floors_import_downwards_alone(part):
    one = LIBRARY / f"{part}.py"
    for path in [one] if one.exists() else (LIBRARY / part).rglob("*.py"):
        parts = {name.split(".")[1] for name in imported(path) if name.startswith("ciphernav_jax.")}
        strays = parts - MAY_IMPORT[part] - {part}
        assert not strays, f"{path.relative_to(ROOT)} imports {strays}"


def test_the_library_never_imports_experiments_or_tests():
    names = {name.split(".")[0] for path in LIBRARY.rglob("*.py") for name in imported(path)}
    assert "ciphernav_jax" in names
    assert not names & {"experiments", "tests"}


PACKAGES = sorted(
    path.parent for path in [*LIBRARY.rglob("__init__.py"), *ROOT.glob("experiments/**/__init__.py")]
)


@pytest.mark.parametrize("package", PACKAGES, ids=lambda path: str(path.relative_to(ROOT)))
def test_modules_stand_in_the_order_that_their_package_says(package):
    order = listed(package)
    assert sorted(order) == sorted(modules(package) - {"__main__"})
    if package == LIBRARY:
        return  # see its floors
    name = ".".join(package.relative_to(ROOT).parts)
    for i, module in enumerate(order):
        path = package / f"{module}.py"
        for other in order[i + 1 :] if path.exists() else ():
            above = {x for x in imported(path) if x.startswith(f"{name}.{other}.") or x == f"{name}.{other}"}
            assert not above, f"{module} imports {above}, which stands after it"
