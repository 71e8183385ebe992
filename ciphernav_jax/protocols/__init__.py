"""What parties do with shares, each protocol written once as the program of one party.

In import order:
- `party`: the party axis, its collectives, and who runs a program.
- `sharing`: additive shares and shares by exclusive or.
- `suite`: `Protocol`, the choice of variants.
- `dealer`: correlated randomness: requests, plan, generation.
- `repeat`: randomness for the bodies of loops and for branches.
- `masked`: values opened under a mask.
- `multiply`: Beaver products, elementwise, square, `dot_general`, and conjunction of words.
- `adders`: carries and borrows of binary adders.
- `convert`: arithmetic to binary and back.
- `compare`: the sign of a value.
- `truncate`: back to f fractional bits after a product.
- `relu`: ReLU and selection.
- `ideal`: what a trusted third party would compute, for sweeps; not protocols.
- `jaxprs`: what the equations of a traced program wrap, and under which names they stand.
- `locality`: that nothing but openings crosses, and at the same points for all.
- `run`: a program together with its dealer, planned, dealt and run.
- `messages`: all openings of a traced program with their rounds.
- `record`: a run that keeps what is sent and opened.

The adversary is semi-honest: parties follow the program and may pool what they see, up to P - 1 of them; the
dealer is trusted.
"""

from ciphernav_jax.protocols.suite import Protocol

__all__ = ["Protocol"]
