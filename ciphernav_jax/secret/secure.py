"""From functions on floats to functions on secrets.

`secure(f)` traces f to a jaxpr and evaluates that jaxpr inside one party's program, with one rule for each
primitive (`rules`). Gradients need nothing of their own: `secure(jax.value_and_grad(loss))` traces to a jaxpr
in which the backward pass is ordinary arithmetic.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.sharding import Mesh

import ciphernav_jax.secret.tournaments  # noqa: F401  (registers its rules)
from ciphernav_jax import jax_private, ring
from ciphernav_jax.jax_private import ClosedJaxpr, Jaxpr, JaxprEqn, Literal, Tracer
from ciphernav_jax.protocols import Protocol
from ciphernav_jax.protocols.jaxprs import wrapped
from ciphernav_jax.protocols.locality import equations, leaves
from ciphernav_jax.protocols.party import from_party_zero
from ciphernav_jax.protocols.run import run
from ciphernav_jax.ring.fixed_point import no_gradient, require_x64
from ciphernav_jax.secret import bounds, fresh, integers
from ciphernav_jax.secret.array import Secret, is_secret
from ciphernav_jax.secret.findings import Findings, NotUsable
from ciphernav_jax.secret.loops import LOOPS
from ciphernav_jax.secret.places import Place, of_function, place
from ciphernav_jax.secret.programs import Compiled
from ciphernav_jax.secret.rules import MOVES, RULES, TYPED, Unsupported, at_rest
from ciphernav_jax.secret.value import Context, Value
from ciphernav_jax.secret.witness import Notes, Witness


@dataclass(frozen=True, eq=False)
class Secure:
    """A function evaluated on secrets; made by `secure`, moved to devices by `deploy`."""

    function: Callable[..., Any]
    protocol: Protocol
    mesh: Mesh | None = None
    jitted: Callable[..., Any] = field(init=False, repr=False)
    closed_over: list[Tracer] = field(init=False, repr=False, default_factory=list)

    def __post_init__(self):
        # jit keeps public arguments abstract, so that what a program asks the dealer for never depends on
        # them.
        object.__setattr__(self, "jitted", Compiled(partial(self.witnessed, witness=None)))

    def __call__(self, key: Array, *args: Any) -> Any:
        """Evaluates the function; `key` is the dealer's random key, fresh for each call."""
        return self.computed(key, self.checked(key, args))

    def computed(self, key: Array, args: tuple[Any, ...]) -> Any:
        """The results of a call, its arguments being prepared; raises where a public number is not usable."""
        results, (_, findings) = self.jitted(key, args)
        self.require_sound(key, findings)
        return results

    def require_sound(self, key: Array, findings: Findings) -> None:
        """Raises where a call turned out unsound once it was traced: a public number is not usable; or the
        function reads numbers of a loop by itself, and has one key for all iterations.
        """
        findings.check()
        fresh.of_each_iteration(key, self.closed_over, "step")

    def checked(self, key: Array, args: tuple[Any, ...]) -> tuple[Any, ...]:
        """The arguments of a call, ready to be traced; raises where `key` is no key, or not a fresh one."""
        args = self.prepared(key, args)
        fresh.of_each_iteration(key, args, "step")
        fresh.of_each_call(key, args, "step", how=(id(self.function), self.protocol))
        return args

    def prepared(self, key: Array, args: tuple[Any, ...]) -> tuple[Any, ...]:
        """What `checked` gives, whatever else the key has hidden."""
        require_x64()
        if not isinstance(key, jax.Array) or not (
            jnp.issubdtype(key.dtype, jax.dtypes.prng_key) or key.dtype == jnp.uint32
        ):
            raise TypeError(
                "the first argument of a secure function is the dealer's random key, "
                f"jax.random.key(seed), got {type(key).__name__}"
            )
        return jax.tree.map(lambda x: x if isinstance(x, Secret) else no_gradient(x), args, is_leaf=is_secret)

    def evaluate(self, key: Array, args: tuple[Any, ...], run: Callable[..., Any] = run) -> Any:
        """Traces the function and has its program run: `run(program, key, parties, private, public, mesh,
        generator)` is that of `protocols.run`, or another that looks at what passes.
        """
        return self.witnessed(key, args, None, run)[0]

    def witnessed(
        self, key: Array, args: tuple[Any, ...], witness: Witness | None, run: Callable[..., Any] = run
    ) -> tuple[Any, tuple[Notes | None, Findings]]:
        """As `evaluate`, with the notes that such a witness takes of the program, and what was found of
        public numbers. Where something was, all secret results are poisoned.
        """
        named, tree = jax.tree_util.tree_flatten_with_path(args, is_leaf=is_secret)
        names, leaves = [jax.tree_util.keystr(path) for path, _ in named], [x for _, x in named]
        leaves = [x.party_first() if isinstance(x, Secret) else x for x in leaves]
        secrets = [x for x in leaves if isinstance(x, Secret)]
        parties = _check_secrets(secrets, self.protocol)

        abstract = [jax.ShapeDtypeStruct(x.shape, x.dtype) if isinstance(x, Secret) else x for x in leaves]
        jaxpr, shapes = jax.make_jaxpr(self.function, return_shape=True)(*jax.tree.unflatten(tree, abstract))
        self.closed_over[:] = [x for x in jaxpr.consts if isinstance(x, Tracer)]
        key = fresh.of_each_entry(key, (args, self.closed_over), "step")
        _require_local(jaxpr.jaxpr, of_function(self.function))
        live = jax_private.without_dead_code(jaxpr.jaxpr)
        outputs, out_tree = jax.tree.flatten(shapes)
        made: list[int | None] = []  # of each output the fractional bits, or None where it is public

        def program(dealer, private, public):
            context = Context(self.protocol, dealer, witness and witness.inside(), of_function(self.function))
            private, public = iter(private), iter(public)
            values = [
                Value(context, x.frac_bits, bounds.shared(self.protocol, x.dtype), share=next(private))
                if isinstance(x, Secret)
                else next(public)
                for x in leaves
            ]
            if context.witness:
                for name, x, value in zip(names, leaves, values, strict=True):
                    if isinstance(x, Secret):
                        context.witness.given(f"args{name}", value, x.dtype)
            results = _evaluate_jaxpr(context, live, jaxpr.consts, values)
            with jax.named_scope("primitive:output"):
                results = [_finish(x, out.dtype) for x, out in zip(results, outputs, strict=True)]
                notes = context.notes()
                results = _poisoned(results, notes[1])
            made[:] = [x.frac_bits if isinstance(x, Value) else None for x in results]
            return (
                [x.share for x in results if isinstance(x, Value)],
                ([x for x in results if not isinstance(x, Value)], notes),
            )

        private, (public, notes) = run(
            program,
            key,
            parties,
            [x.shares for x in secrets],
            [x for x in leaves if not isinstance(x, Secret)],
            self.mesh,
            self.protocol.generator,
        )
        private, public = iter(private), iter(public)
        results = [
            next(public)
            if frac_bits is None
            else Secret(next(private), frac_bits, np.dtype(out.dtype), out.ndim)
            for frac_bits, out in zip(made, outputs, strict=True)
        ]
        return jax.tree.unflatten(out_tree, results), notes


def secure(function: Callable[..., Any], *, protocol: Protocol | None = None) -> Secure:
    """The same function, evaluated by all parties on secrets.

    A public number that is added to secrets, compared with them or selected beside them may be of any size:
    a mask of -inf, -1e9 or `finfo.min` does what one means. Beyond 2^(61 - frac_bits) it stands for that.

    Args:
        function: any JAX function of float arrays (pytrees of them) whose primitives have a rule: MLPs, ReLU,
            squared losses, comparisons, `jnp.where`, sums, reshapes, and `jax.grad` of them; `lax.scan`,
            `fori_loop`, `map`, and `while_loop`, `cond`, `switch` on public predicates. What it closes over
            is public. Python numbers in it are constants: powers of two and integers multiply exactly. What
            no result is made of is not computed, and may have no rule (all that a `while` carries is).
        protocol: the variants; the precision must be that of the secrets given.

    Returns:
        `step(key, *args)`. `args` are pytrees that mix `Secret` and public arrays, `key` the dealer's random
        key: use a fresh one for each call. What depends on a `Secret` comes out as `Secret`, the rest public.
        Works under `jax.jit`, `jax.lax.scan` and `jax.vmap`; is itself jitted.

    Raises (when called):
        NotImplementedError: the function uses an operation that has no rule, or reaches out of itself
            (callbacks, `jax.debug.print`); the message names it, its line in the function, and a way out.
        ValueError: no secret among the arguments; secrets of different numbers of parties; a precision
            other than the protocol's; local truncation for more than two parties; a `vmap` or a loop over
            arguments with one key for all; a public number that meets a secret and is NaN, or multiplies or
            divides it and is not finite, out of range, or a zero divisor. The message names the line in the
            function. Under a trace around the call nobody can look at the number; then `reveal` gives NaN
            for all secret float results, -2^63 for int64.
        TypeError: it is being differentiated; write `secure(jax.grad(f))`.

    Warns (when called):
        KeyReuseWarning: a key is given a second time, with other arguments or to another function.
    """
    return Secure(function, protocol or Protocol())


def deploy(step: Secure, mesh: Mesh) -> Secure:
    """The same program with one device, or one process, for each party.

    Args:
        step: made by `secure`.
        mesh: a mesh with the one axis "party", as many devices as parties;
            `jax.make_mesh((parties,), ("party",))`.

    Returns:
        A function like `step`. The shares it gives are bit-identical to the simulation's. The dealer's part
        is computed from `key` by every process, which stands in for a dealer that hands each party its own: a
        test of the program on real messages, not yet a deployment among parties that distrust one another.
    """
    if step.protocol.ideal:
        raise ValueError(
            f"an ideal variant is no protocol that parties could carry out ({step.protocol}). "
            "Deploy a step with real variants."
        )
    return replace(step, mesh=mesh)


def _check_secrets(secrets: list[Secret], protocol: Protocol) -> int:
    if not secrets:
        raise ValueError(
            "no argument is secret, so there are no parties to compute. "
            "Share at least one argument with share(key, values, parties=P)."
        )
    parties = {x.parties for x in secrets}
    if len(parties) > 1:
        raise ValueError(
            f"the secrets belong to different numbers of parties: {sorted(parties)}. "
            "Share all of them among the same parties."
        )
    for x in secrets:
        expected = protocol.frac_bits if jnp.issubdtype(x.dtype, np.floating) else 0
        if x.frac_bits != expected:
            raise ValueError(
                f"a secret has {x.frac_bits} fractional bits, the protocol {expected}. "
                "Give share and secure the same protocol."
            )
    return parties.pop()


def _require_local(jaxpr: Jaxpr, function: Place) -> None:
    for eqn in equations(jaxpr):
        if leaves(eqn):
            raise NotImplementedError(
                f"cannot evaluate `{eqn.primitive.name}` in a function on secrets: it reaches out of the "
                "function, where nobody can follow what a party tells. It comes from "
                f"{place(eqn, function)}. Print and call Python outside, on public arguments and on what was "
                "revealed; and give the function what a callback returns as an argument."
            )


def _finish(x: Any, dtype: np.dtype) -> Any:
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


def _evaluate_jaxpr(context: Context, jaxpr: Jaxpr, consts: list[Any], args: list[Any]) -> list[Any]:
    """Evaluates a jaxpr on secret `Value`s and public arrays; public-only parts run as plain JAX."""
    env: dict[Any, Any] = {}

    def read(atom):
        return np.asarray(atom.val) if isinstance(atom, Literal) else env[atom]

    def write(variables, values):
        env.update(zip(variables, values, strict=True))

    write(jaxpr.constvars, [x if isinstance(x, Tracer) else np.asarray(x) for x in consts])
    write(jaxpr.invars, args)
    for eqn in jaxpr.eqns:
        operands = [read(atom) for atom in eqn.invars]
        if not any(isinstance(x, Value) for x in operands):
            write(eqn.outvars, _evaluate_public(eqn, operands))
            continue
        here = replace(context, place=place(eqn, context.place))
        if (inner := wrapped(eqn)) is not None:
            write(eqn.outvars, _evaluate_jaxpr(here, *inner, operands))
        else:
            write(eqn.outvars, _evaluate_secret(here, eqn, operands))
    return [read(atom) for atom in jaxpr.outvars]


def _evaluate_closed(context: Context, jaxpr: ClosedJaxpr, args: list[Any]) -> list[Any]:
    return _evaluate_jaxpr(context, jaxpr.jaxpr, jaxpr.consts, args)


def _evaluate_public(eqn: JaxprEqn, operands: list[Any]) -> list[Any]:
    """A step on public values alone; what is known while tracing stays known, as a numpy array."""
    if all(isinstance(x, np.ndarray) for x in operands):
        with jax.ensure_compile_time_eval():
            return jax.tree.map(_known, jax_private.bind(eqn, operands))
    return jax_private.bind(eqn, operands)


def _known(x: Any) -> Any:
    """A numpy array, but for random keys, which have none."""
    return x if jnp.issubdtype(x.dtype, jax.dtypes.extended) else np.asarray(x)


def _evaluate_secret(context: Context, eqn: JaxprEqn, operands: list[Any]) -> list[Any]:
    """A step on secrets, by its rule, told to the witness where there is one."""
    name, witness = eqn.primitive.name, context.witness
    if witness:
        witness.at(name, context.place)
    result = _apply_rule(context, eqn, operands)
    of_rule = list(result) if eqn.primitive.multiple_results else [result]
    # Of arrays without axes numpy makes numbers, which would not count as known.
    results: list[Any] = [np.asarray(x) if isinstance(x, np.generic) else x for x in of_rule]
    for poisoned in [x.poisoned for x in operands if isinstance(x, Value) and x.poisoned is not None]:
        if name in MOVES:
            for x in results:
                if isinstance(x, Value):  # and not what a constant chose beside it
                    x.poisoned = poisoned if x.poisoned is None else poisoned | x.poisoned
        else:
            context.find(f"`{name}` computes with what was read at an index out of range: NaN", poisoned)
    if witness and name not in LOOPS:  # the equations of the bodies have told it
        witness.evaluated(eqn, operands, results)
    return results


def _apply_rule(context: Context, eqn: JaxprEqn, operands: list[Any]) -> Any:
    name = eqn.primitive.name
    try:
        if name in LOOPS:
            rule = partial(LOOPS[name], _evaluate_closed)
        elif name in RULES:
            _check_dtype(name, eqn)
            rule = RULES[name]
            if name in TYPED:
                dtype = eqn.outvars[0].aval.dtype  # pyright: ignore[reportAttributeAccessIssue]
                rule = partial(rule, dtype=dtype)
        else:
            raise Unsupported("it has no rule")
        with jax.named_scope(f"primitive:{name}"):
            if name in LOOPS:
                return rule(context, *operands, **eqn.params)
            return integers.of_its_type(eqn, rule(context, *integers.looked_at(eqn, operands), **eqn.params))
    except integers.BelowZero:
        raise NotImplementedError(
            f"cannot evaluate `{name}` on secret uint64s: the result may fall below 0 and wrap around, where "
            f"it could not be compared. It comes from {context.place}. Convert to int64 first."
        ) from None
    except NotUsable as problem:
        raise ValueError(f"{problem}, in `{name}`. It comes from {context.place}.") from None
    except Unsupported as problem:
        raise NotImplementedError(
            f"cannot evaluate `{name}` on secrets: {problem}. It comes from {context.place}. {_way_out(name)}"
        ) from None


# Operations that mean something else for integers.
BITS_ALONE = {"and", "or", "xor", "not", "reduce_and", "reduce_or"}
FLOATS_ALONE = {"div"}


def _check_dtype(name: str, eqn: JaxprEqn) -> None:
    dtype = eqn.invars[0].aval.dtype  # pyright: ignore[reportAttributeAccessIssue]
    if name in BITS_ALONE and dtype != np.bool_:
        raise Unsupported(f"it works on the bits of a secret {dtype}; only bools have a rule")
    if name in FLOATS_ALONE and not jnp.issubdtype(dtype, np.floating):
        raise Unsupported(f"the quotient of a secret {dtype} is rounded; only floats have a rule")


WAYS_OUT = {
    "exp": "Train with a squared loss and open the logits, or approximate it by a polynomial.",
    "log": "Train with a squared loss, or approximate it by a polynomial.",
    "logistic": "Use ReLU, or a piecewise linear sigmoid: jnp.clip(x / 4 + 0.5, 0, 1).",
    "tanh": "Use ReLU, or the piecewise linear jnp.clip(x, -1, 1).",
    "sqrt": "Keep the square, or reveal it where that is agreed.",
    "conv_general_dilated": "Write the convolution as a product of patches (stacked slices) with the kernel.",
    "while": "Loop a public number of times and keep what is done with jnp.where: the end of a loop shows.",
    "cond": "Compute all branches and select with jnp.where: a branch taken on a secret shows which it was.",
}


DEFAULT_WAY_OUT = (
    "Compute it on public values before sharing, or build it from what has a rule: sums, products, powers, "
    "ReLU, max, min, abs, sign, comparisons, jnp.where, arg max, indexing by public indices, reshaping, and "
    "loops and branches that public values decide (all of them: ciphernav_jax.secret.rules)."
)


def _way_out(name: str) -> str:
    return WAYS_OUT.get(name, DEFAULT_WAY_OUT)
