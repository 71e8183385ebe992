"""Protocol variants as words of a command line."""

from dataclasses import fields
from typing import Any

from ciphernav_jax.protocols import Protocol


def parse(text: str) -> Protocol:
    """`default`, or what differs from it: `truncation=nearest,frac_bits=16`.

    Raises:
        ValueError: a field or a variant that `Protocol` does not have, or one said twice; the message lists
            those it has.
    """
    if text == "default":
        return Protocol()
    known = [field.name for field in fields(Protocol)]
    chosen: dict[str, Any] = {}
    for word in text.split(","):
        name, equals, value = (part.strip() for part in word.partition("="))
        if not equals or name not in known or name in chosen:
            raise ValueError(
                f"cannot read the variant {word!r}: write NAME=VALUE, several names with commas, or default; "
                f"the names are {', '.join(known)}"
            )
        chosen[name] = value
    try:
        for name in chosen.keys() & {"frac_bits", "range_bits"}:
            chosen[name] = _number(name, chosen[name])
        return Protocol(**chosen)
    except ValueError as error:
        raise ValueError(f"no variant {text!r}: {error}") from None


def _number(name: str, value: str) -> int | None:
    if (name, value) == ("range_bits", "None"):
        return None
    try:
        return int(value)
    except ValueError:
        raise ValueError(f"{name} is a number of bits, not {value!r}") from None
