"""From functions on floats to functions on secrets.

- `array`: `Secret`, `share`, `reveal`.
- `value`: a party's share inside a program, with pending truncations and what was computed from it.
- `rules`: one rule for each primitive.
- `secure`: the jaxpr evaluator; `secure` and `deploy`.
"""

from ciphernav_jax.secret.array import Secret, reveal, share
from ciphernav_jax.secret.secure import deploy, secure

__all__ = ["Secret", "deploy", "reveal", "secure", "share"]
