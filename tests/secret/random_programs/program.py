"""A program: inputs, and steps that each apply an operation to earlier values."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from .operations import Plain
from .reference import Bounded, Reference


@dataclass(frozen=True)
class Step:
    """`name` applied to earlier values (inputs first, then results of steps) and to parameters."""

    name: str
    operands: tuple[int, ...]
    parameters: tuple[Any, ...] = ()

    def run(self, ops: Plain | Reference, values: list[Any]) -> Any:
        return getattr(ops, self.name)(*[values[i] for i in self.operands], *self.parameters)


@dataclass
class Program:
    inputs: list[Bounded]
    steps: list[Step] = field(default_factory=list)

    def __str__(self) -> str:
        lines = []
        for i, x in enumerate(self.inputs):
            lines.append(
                f"v{i} = {'secret' if x.secret else 'public'} {x.dtype}{list(x.shape)} {_shown(x.value)}"
            )
        for i, step in enumerate(self.steps, len(self.inputs)):
            arguments = [f"v{j}" for j in step.operands] + [_shown(p) for p in step.parameters]
            lines.append(f"v{i} = {step.name}({', '.join(arguments)})")
        return "\n".join(lines)

    def evaluate(self, ops: Plain | Reference, inputs: list[Any]) -> list[Any]:
        """The inputs and the results of all steps."""
        values = list(inputs)
        for step in self.steps:
            values.append(step.run(ops, values))
        return values

    def up_to(self, result: int) -> "Program":
        """Without what `result` does not depend on; it becomes the last step."""
        first, needed = len(self.inputs), {result}
        for i in range(len(self.steps) - 1, -1, -1):
            if i + first in needed:
                needed |= set(self.steps[i].operands)
        kept = sorted(needed | set(range(first)))
        number = {old: new for new, old in enumerate(kept)}
        steps = [self.steps[i - first] for i in kept if i >= first]
        moved = [replace(step, operands=tuple(number[j] for j in step.operands)) for step in steps]
        return Program(self.inputs, moved)._without_unused_inputs()

    def _without_unused_inputs(self) -> "Program":
        used = {i for step in self.steps for i in step.operands}
        kept = [i for i in range(len(self.inputs)) if i in used]
        number = {old: new for new, old in enumerate(kept)}
        shift = len(self.inputs) - len(kept)
        steps = [
            replace(s, operands=tuple(number[j] if j < len(self.inputs) else j - shift for j in s.operands))
            for s in self.steps
        ]
        return Program([self.inputs[i] for i in kept], steps)

    def with_input(self, step: int, value: Bounded, unit: float) -> "Program":
        """The result of a step becomes a secret input, rounded to the resolution."""
        if value.kind == "float":
            value = replace(value, value=np.round(value.value / unit) * unit)
        given = replace(value, error=np.zeros(value.shape), count=1.0)
        first = len(self.inputs)

        def number(i: int) -> int:
            return i if i < first else first if i == step + first else i + 1 if i < step + first else i

        steps = [
            replace(s, operands=tuple(map(number, s.operands))) for i, s in enumerate(self.steps) if i != step
        ]
        return Program([*self.inputs, given], steps).up_to(first + len(self.steps) - 1)


def _shown(x: Any) -> str:
    if isinstance(x, np.ndarray):
        flat = x.ravel()
        if flat.size > 8:
            return f"array of {x.shape}: {flat[:4].tolist()} ..."
        return repr(x.tolist())
    return repr(x)
