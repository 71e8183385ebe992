"""One call of a function on secrets, as a value: what its parties have to carry out."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.sharding import Mesh

from ciphernav_jax import jax_private, ring
from ciphernav_jax.jax_private import Jaxpr, Tracer
from ciphernav_jax.parties import run
from ciphernav_jax.parties.dealer import Plan
from ciphernav_jax.parties.locality import inner_jaxprs, leaves
from ciphernav_jax.parties.party import from_party_zero
from ciphernav_jax.parties.recording import Message, run_recorded
from ciphernav_jax.protocols import Protocol
from ciphernav_jax.secret import bounds, fresh, inside
from ciphernav_jax.secret.arguments import Arguments
from ciphernav_jax.secret.array import Secret, is_secret
from ciphernav_jax.secret.evaluator import evaluate, evaluate_closed
from ciphernav_jax.secret.findings import Findings
from ciphernav_jax.secret.places import Place, place
from ciphernav_jax.secret.rules.operands import at_rest
from ciphernav_jax.secret.value import Context, Value
from ciphernav_jax.secret.witness import Notes, Witness

Noted = tuple[Notes | None, Findings]


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class _Output:
    """A secret result as a program returns it."""

    share: Array
    frac_bits: int = field(metadata={"static": True})


@dataclass(frozen=True)
class Call:
    """What runs a call, counts it, or watches it needs of it, and nothing else.

    Attributes:
        program: one party's, `program(dealer, private, public) -> (private, public)` (`parties.run`).
        parties: P.
        private: the secret arguments' shares, uint64[P, ...] each.
        public: the other arguments.
        rebuild: of what the program returns the function's results; the notes of its witness, None without
            one; and what was found of public numbers. Where something was, all secret results are poisoned.
        given: the arguments; the dealer's randomness hides them, and what is closed over.
        closed_over: what the function reads by itself, of a trace around the call.
        protocol: the variants.
    """

    program: run.DealtProgram
    parties: int
    private: list[Any]
    public: list[Any]
    rebuild: Callable[[tuple[Any, Any]], tuple[Any, Noted]]
    given: Arguments
    closed_over: list[Tracer]
    protocol: Protocol

    def run(self, key: Array, mesh: Mesh | None = None) -> tuple[Any, Noted]:
        """The results, from the dealer's random key; see `rebuild`."""
        key, generator = self.key_of_each(key), self.protocol.generator
        returned = run.run(self.program, key, self.parties, self.private, self.public, mesh, generator)
        return self.rebuild(returned)

    def recorded(self, key: Array) -> tuple[Any, tuple[Message, ...]]:
        """As `run`, simulated: the results alone, and all messages."""
        key, generator = self.key_of_each(key), self.protocol.generator
        returned, messages = run_recorded(
            self.program, key, self.parties, self.private, self.public, generator
        )
        return self.rebuild(returned)[0], messages

    def plan(self) -> Plan:
        """What the program asks the dealer for. Nothing is run."""
        return run.plan(self.program, self.parties, self.private, self.public)

    def key_of_each(self, key: Array) -> Array:
        """The key; raises under a `vmap` with one key for all entries."""
        return fresh.of_each_entry(key, (self.given, self.closed_over), "step")


def call(
    function: Callable[..., Any],
    protocol: Protocol,
    given: Arguments,
    whole: Place,
    witness: Witness | None = None,
) -> Call:
    """Traces a function on secrets; nothing is run.

    Args:
        function, protocol: as for `secure`.
        given: the arguments, or their shapes.
        whole: the place of operations of which no line is known.
        witness: who watches the program.

    Raises:
        As `secure` does when it is called.
    """
    named, tree = jax.tree_util.tree_flatten_with_path(given, is_leaf=is_secret)
    names, leaves = [jax.tree_util.keystr(path)[1:] for path, _ in named], [x for _, x in named]
    leaves = [x.party_first() if isinstance(x, Secret) else x for x in leaves]
    secrets = [x for x in leaves if isinstance(x, Secret)]
    parties = _check_secrets(secrets, protocol)

    abstract = [jax.ShapeDtypeStruct(x.shape, x.dtype) if isinstance(x, Secret) else x for x in leaves]

    def called(given: Arguments) -> Any:
        args, kwargs = given.plain
        return function(*args, **kwargs)

    with inside.traced():
        jaxpr, shapes = jax.make_jaxpr(called, return_shape=True)(jax.tree.unflatten(tree, abstract))
    if any(map(is_secret, jax.tree.leaves(shapes, is_leaf=is_secret))):
        raise TypeError(f"the function returns a Secret that is no argument. {inside.CLOSED_OVER}")
    _require_local(jaxpr.jaxpr, whole)
    live = jax_private.without_dead_code(jaxpr.jaxpr)
    outputs, out_tree = jax.tree.flatten(shapes)

    def program(dealer, private, public):
        context = Context(protocol, dealer, evaluate_closed, witness and witness.inside(), whole)
        private, public = iter(private), iter(public)
        values = [
            Value(context, x.frac_bits, bounds.shared(protocol, x.dtype), share=next(private))
            if isinstance(x, Secret)
            else next(public)
            for x in leaves
        ]
        if context.witness:
            for name, x, value in zip(names, leaves, values, strict=True):
                if isinstance(x, Secret):
                    context.witness.given(name, value, x.dtype)
        results = evaluate(context, live, jaxpr.consts, values)
        with jax.named_scope("primitive:output"):
            results = [_finished(x, out.dtype) for x, out in zip(results, outputs, strict=True)]
            notes = context.notes()
            results = _poisoned(results, notes[1])
        secret = {i: _Output(x.share, x.frac_bits) for i, x in enumerate(results) if isinstance(x, Value)}
        return secret, ({i: x for i, x in enumerate(results) if i not in secret}, notes)

    def rebuild(returned: tuple[Any, Any]) -> tuple[Any, Noted]:
        secret, (public, notes) = returned
        made = {
            i: Secret(x.share, x.frac_bits, np.dtype(outputs[i].dtype), outputs[i].ndim)
            for i, x in secret.items()
        }
        results = made | public
        return jax.tree.unflatten(out_tree, [results[i] for i in range(len(outputs))]), notes

    closed_over = [x for x in jaxpr.consts if isinstance(x, Tracer)]
    return Call(
        program,
        parties,
        [x.shares for x in secrets],
        [x for x in leaves if not isinstance(x, Secret)],
        rebuild,
        given,
        closed_over,
        protocol,
    )


def _check_secrets(secrets: list[Secret], protocol: Protocol) -> int:
    if not secrets:
        raise ValueError(
            "no argument is secret, so there are no parties to compute. "
            "Share at least one argument with share(key, values, parties=P); a Secret that the function "
            "closes over is none, give it as an argument."
        )
    parties = {x.parties for x in secrets}
    if len(parties) > 1:
        raise ValueError(
            f"the secrets belong to different numbers of parties: {sorted(parties)}. "
            "Share all of them among the same parties, or hand some on: reshare(key, x, parties=P)."
        )
    for x in secrets:
        expected = protocol.frac_bits if jnp.issubdtype(x.dtype, np.floating) else 0
        if x.frac_bits != expected:
            raise ValueError(
                f"a secret has {x.frac_bits} fractional bits, the protocol {expected}. "
                "Give share and secure the same protocol."
            )
    return parties.pop()


def _require_local(jaxpr: Jaxpr, outside: Place) -> None:
    for eqn in jaxpr.eqns:
        for inner in inner_jaxprs(eqn):
            _require_local(inner, place(eqn, outside))
        if leaves(eqn):
            raise NotImplementedError(
                f"cannot evaluate `{eqn.primitive.name}` in a function on secrets: it reaches out of the "
                "function, where nobody can follow what a party tells. It comes from "
                f"{place(eqn, outside)}. Print and call Python outside, on public arguments and on what was "
                "revealed; and give the function what a callback returns as an argument."
            )


def _finished(x: Any, dtype: np.dtype) -> Any:
    """An output with the precision that a `Secret` of its dtype has."""
    return at_rest(x.context, x, dtype) if isinstance(x, Value) else x


def _poisoned(results: list[Any], findings: Findings) -> list[Any]:
    """Results of which the secret ones stand for no number where any problem was found."""
    if not findings.found:
        return results
    bad = findings.any()

    def poisoned(share: Array) -> Array:
        return jnp.where(bad, from_party_zero(jnp.full(share.shape, ring.POISON, jnp.uint64)), share)

    return [x.like(poisoned(x.share)) if isinstance(x, Value) else x for x in results]
