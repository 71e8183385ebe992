"""Which variant of each protocol is used."""

from dataclasses import dataclass, fields
from typing import Any, Literal, get_args, get_type_hints

from ciphernav_jax.ring.random import Generator

Multiplication = Literal["beaver", "ideal"]
Truncation = Literal["probabilistic", "local", "wrap-count", "nearest", "floor", "ideal"]
Comparison = Literal["masked", "masked-words", "resharing", "ideal"]
Adder = Literal["carry-tree", "kogge-stone", "brent-kung", "ripple"]
Argmax = Literal["auto", "pairwise", "tree"]
Opened = Literal["argmax", "logits"]


@dataclass(frozen=True)
class Protocol:
    """The choice of protocol variants; a value: frozen, hashable, compared by its fields.

    All variants but the *ideal* ones are for semi-honest parties, up to P - 1 of which may collude, and a
    trusted dealer.

    Attributes:
        frac_bits: fractional bits f of secret values, 1 to 30. The resolution is 2^-f; values, and products
            before their truncation, must stay within +-2^(62 - 2 f). The default 20 gives a resolution of
            1e-6 and a range of 4 million: errors ten times below what 16 bits leave, and three orders of
            magnitude above the batch sums of the paper's classifier.
        multiplication: "beaver" (the dealer's triples), or "ideal" (see below).
        truncation: "probabilistic" (unbiased, never fails in range, any number of parties), "nearest" and
            "floor" (exact, several rounds), "wrap-count" (CrypTen's, fails now and then), "local" (no
            communication, two parties only, fails now and then), or "ideal". See `protocols.truncate`.
        comparison: the sign of a value from one opening under a mask with shared bits, "masked" (bit-sliced)
            or "masked-words" (a word for each value); from shares of each party's share, "resharing"
            (CrypTen's); or "ideal". See `protocols.compare`.
        adder: how carries are found in it: "carry-tree" (what the top bit needs, no more), "kogge-stone",
            "brent-kung", "ripple" (63 rounds, for reference). See `protocols.adders`.
        range_bits: k where all values whose sign is taken, or that are compared with one another, are known
            to stay below 2^k in magnitude; then the circuit looks at those bits alone, and at one more for a
            difference of two that are compared. Another value gets a wrong sign. None for the whole range.
        argmax: "pairwise" (all pairs at once, two comparisons deep), "tree" (n - 1 comparisons, log2 n deep),
            or "auto": all pairs for up to 25 entries, otherwise the tree.
        opened: what a classifier shows of its result: the "argmax" alone, or the "logits" as the paper does.
        generator: where uniform words come from: "threefry" or "chacha20". See `ring.random`.

    The *ideal* variants reconstruct, compute, and share afresh, as a trusted third party would: the result
    has the distribution that the real protocol gives, at a fraction of the cost. They are for sweeps, they
    have no messages to count, and `deploy` refuses them.

    Example:
        >>> import ciphernav_jax as cn
        >>> print(cn.Protocol(truncation="nearest", frac_bits=16))
        frac_bits=16, truncation=nearest
    """

    frac_bits: int = 20
    multiplication: Multiplication = "beaver"
    truncation: Truncation = "probabilistic"
    comparison: Comparison = "masked"
    adder: Adder = "carry-tree"
    range_bits: int | None = None
    argmax: Argmax = "auto"
    opened: Opened = "argmax"
    generator: Generator = "threefry"

    def __post_init__(self):
        for name in ("frac_bits", "range_bits"):
            bits = getattr(self, name)
            if type(bits) is not int and (bits is not None or name == "frac_bits"):
                raise ValueError(f"{name} is a number of bits, an int, and not {bits!r}")
        if not 1 <= self.frac_bits <= 30:
            raise ValueError(f"frac_bits must lie in 1..30, got {self.frac_bits}")
        if self.range_bits is not None and not 0 <= self.range_bits <= 62 - 2 * self.frac_bits:
            raise ValueError(
                f"range_bits must lie in 0..{62 - 2 * self.frac_bits} (62 - 2 frac_bits), "
                f"got {self.range_bits}"
            )
        for name, hint in get_type_hints(Protocol).items():
            choices, chosen = get_args(hint), getattr(self, name)
            if name not in ("frac_bits", "range_bits") and chosen not in choices:
                raise ValueError(f"unknown {name} {chosen!r}; the variants are {', '.join(choices)}")

    @property
    def bound(self) -> float:
        """2^(62 - 2 f): values and products must stay below it in magnitude."""
        return 2.0 ** (62 - 2 * self.frac_bits)

    @property
    def ideal(self) -> bool:
        """Whether any variant is ideal: then this is no protocol, but what one should compute."""
        return "ideal" in (self.multiplication, self.truncation, self.comparison)

    def __str__(self) -> str:
        """The default is "default"; others name what differs from it."""
        changed = [
            f"{field.name}={getattr(self, field.name)}"
            for field in fields(self)
            if getattr(self, field.name) != field.default
        ]
        return ", ".join(changed) or "default"

    @staticmethod
    def parse(text: str) -> "Protocol":
        """The protocol that is written as `str` writes it: `default`, or what differs from it.

        Raises:
            ValueError: a field or a variant that `Protocol` does not have, or one said twice; the message
                lists those it has.

        Example:
            >>> Protocol.parse("truncation=nearest, frac_bits=16").frac_bits
            16
        """
        if text == "default":
            return Protocol()
        known = [field.name for field in fields(Protocol)]
        chosen: dict[str, Any] = {}
        for word in text.split(","):
            name, equals, value = (part.strip() for part in word.partition("="))
            if not equals or name not in known or name in chosen:
                raise ValueError(
                    f"cannot read the variant {word!r}: write NAME=VALUE, several names with commas, or "
                    f"default; the names are {', '.join(known)}"
                )
            chosen[name] = value
        try:
            for name in chosen.keys() & {"frac_bits", "range_bits"}:
                chosen[name] = _bits(name, chosen[name])
            return Protocol(**chosen)
        except ValueError as error:
            raise ValueError(f"no variant {text!r}: {error}") from None


def chosen(protocol: Protocol | None) -> Protocol:
    """The protocol, or the default where it is None; raises TypeError for what is no protocol."""
    if not isinstance(protocol, Protocol | None):
        raise TypeError(
            f"the protocol is a Protocol, and not {protocol!r}: write Protocol(truncation=...), or "
            "Protocol.parse(text)"
        )
    return protocol or Protocol()


def _bits(name: str, value: str) -> int | None:
    if (name, value) == ("range_bits", "None"):
        return None
    try:
        return int(value)
    except ValueError:
        raise ValueError(f"{name} is a number of bits, not {value!r}") from None
