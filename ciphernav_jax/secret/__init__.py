"""From functions on floats to functions on secrets. In import order:

- `seal`: what `jax.tree.map` may do with the shares of a secret.
- `fresh`: whether a random key is given twice, and to what.
- `inside`: whether a function on secrets is being traced.
- `array`: `Secret`, `share`, `reveal`.
- `resharing`: secrets handed on to other parties.
- `arguments`: what a function is called with.
- `places`: the line of the user's function that an operation comes from.
- `bounds`: how large values may be.
- `findings`: what the run finds of public numbers where they meet secrets.
- `value`: a party's share inside a program, with pending truncations and what was computed from it.
- `integers`: wrapped around, as JAX's are.
- `scaling`: products with public numbers.
- `witness`: notes of a program's values and truncations, beside a float64 evaluation.
- `rules`: one rule for each primitive.
- `evaluator`: a jaxpr on secrets, equation by equation.
- `call`: one call, as a value.
- `compiled`: what is compiled, let go before memory maps run out.
- `secured`: `secure` and `deploy`.
- `simulating`: floats to floats through the protocol, differentiable.
- `costs`: rounds, bytes and correlated randomness of a function, from its trace.
- `transcripts`: every message of a call.
- `views`: what parties see of a call, messages and all else.
- `validation`: where a function loses range or resolution, line by line.
- `auditing`: the truncations of a call, and how many fail.
"""

from ciphernav_jax.secret.array import Secret, is_secret, reveal, share
from ciphernav_jax.secret.auditing import audit
from ciphernav_jax.secret.costs import LAN, WAN, Cost, Network, cost
from ciphernav_jax.secret.fresh import KeyReuseWarning
from ciphernav_jax.secret.resharing import reshare
from ciphernav_jax.secret.secured import deploy, secure
from ciphernav_jax.secret.simulating import simulate
from ciphernav_jax.secret.transcripts import transcript
from ciphernav_jax.secret.validation import Report, ValidationError, validate
from ciphernav_jax.secret.views import View, view

__all__ = [
    "LAN",
    "WAN",
    "Cost",
    "KeyReuseWarning",
    "Network",
    "Report",
    "Secret",
    "ValidationError",
    "View",
    "audit",
    "cost",
    "deploy",
    "is_secret",
    "reshare",
    "reveal",
    "secure",
    "share",
    "simulate",
    "transcript",
    "validate",
    "view",
]
