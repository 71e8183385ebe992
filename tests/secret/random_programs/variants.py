"""Which protocols the programs run on, and some programs of one of them."""

import time
from dataclasses import fields
from typing import Any, get_args, get_type_hints

import jax

import ciphernav_jax as cn

from .checking import check, minimised
from .drawing import random_program
from .reference import Reference

Task = tuple[str, int, int, list[int], int]  # variant, parties, seed, numbers of programs, most entries

PARTIES = [2, 3, 4, 7]


def variants() -> dict[str, cn.Protocol]:
    """The default, and each other choice of one variant, under the name that it has in tables."""
    hints = get_type_hints(cn.Protocol)
    choices = [{}] + [
        {field.name: choice}
        for field in fields(cn.Protocol)
        for choice in get_args(hints[field.name])
        if isinstance(choice, str) and choice != field.default and field.name != "opened"
    ]
    choices += [{"frac_bits": 16}, {"frac_bits": 24}, {"range_bits": 10}]
    # The ripple adder takes a round a bit: here it gets few.
    protocols = [
        cn.Protocol(**c, **({"range_bits": 4} if c.get("adder") == "ripple" else {})) for c in choices
    ]
    return {str(protocol): protocol for protocol in protocols}


def part(task: Task) -> dict[str, Any]:
    """Some programs of one variant and number of parties: what was found, in words."""
    jax.config.update("jax_numpy_dtype_promotion", "strict")
    name, parties, seed, numbers, widest = task
    protocol, start, found = variants()[name], time.process_time(), []
    for number in numbers:
        # Other programs for each variant, and the same ones in every run.
        program = random_program(
            (seed, parties, *name.encode(), number), Reference(protocol, parties), widest=widest
        )
        if check(program, protocol, parties):
            fewer, finding = minimised(program, protocol, parties)
            found.append({"number": number, "what": finding.what, "program": str(fewer)})
    done = {"variant": name, "parties": parties, "seed": seed, "numbers": numbers, "found": found}
    return done | {"cpu_seconds": round(time.process_time() - start, 1)}
