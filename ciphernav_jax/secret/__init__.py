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
- `programs`: what is compiled, let go before memory maps run out.
- `secure`: `secure` and `deploy`.
- `simulate`: floats to floats through the protocol, differentiable.
- `cost`: rounds, bytes and correlated randomness of a function, from its trace.
- `transcript`: every message of a call.
- `view`: what parties see of a call, messages and all else.
- `validate`: where a function loses range or resolution, line by line.
- `audit`: the truncations of a call, and how many fail.
"""

from ciphernav_jax.secret.array import Secret, is_secret, reveal, share
from ciphernav_jax.secret.audit import audit
from ciphernav_jax.secret.cost import LAN, WAN, Cost, Network, cost
from ciphernav_jax.secret.fresh import KeyReuseWarning
from ciphernav_jax.secret.resharing import reshare
from ciphernav_jax.secret.secure import deploy, secure
from ciphernav_jax.secret.simulate import simulate
from ciphernav_jax.secret.transcript import transcript
from ciphernav_jax.secret.validate import Report, ValidationError, validate
from ciphernav_jax.secret.view import View, view

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
