"""Shape annotations, executed: while tests run, a function of the package that is given or gives an array of
another dtype or shape than it writes raises.

Dtypes and shapes alone are looked at. All other types are pyright's, and so is whether an array is JAX's or
numpy's: a test that gives a wrong one wants the package's own answer to it.
"""

from collections.abc import Callable
from functools import reduce
from operator import or_
from types import UnionType
from typing import Any, Union, get_args, get_origin

from beartype import beartype
from jaxtyping import AbstractArray


def check(function: Callable) -> Callable:
    """The function, which raises where an annotated array is not of the dtype and shape that are written."""
    if function.__name__ == "__init__":  # JAX unflattens pytrees with whatever it maps over them
        return function
    held = {name: _held(annotation) for name, annotation in function.__annotations__.items()}
    function.__annotations__ = {
        name: annotation for name, annotation in held.items() if annotation is not None
    }
    return beartype(function)


def _held(annotation: Any) -> Any:
    """What is held of it; None where it speaks of no array."""
    if isinstance(annotation, type) and issubclass(annotation, AbstractArray):
        return annotation.dtype[Any, annotation.dim_str]
    parts = get_args(annotation)
    held = [_held(part) for part in parts]
    if not any(held):
        return None
    parts = tuple(part if of is None else of for part, of in zip(parts, held, strict=True))
    origin = get_origin(annotation)
    return reduce(or_, parts) if origin in (Union, UnionType) else origin[parts]
