"""From functions on floats to functions on secrets.

`secure(f)` traces f to a jaxpr (`call`) and evaluates that jaxpr inside one party's program (`evaluator`),
with one rule for each primitive (`rules`). Gradients need nothing of their own:
`secure(jax.value_and_grad(loss))` traces to a jaxpr in which the backward pass is ordinary arithmetic.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, overload

from jax import Array
from jax.sharding import Mesh

from ciphernav_jax.jax_private import Tracer
from ciphernav_jax.protocols import Protocol
from ciphernav_jax.protocols.suite import chosen
from ciphernav_jax.ring.fixed_point import require_x64
from ciphernav_jax.secret import fresh, inside
from ciphernav_jax.secret.arguments import Arguments, given
from ciphernav_jax.secret.call import Call, call
from ciphernav_jax.secret.compiled import Compiled
from ciphernav_jax.secret.findings import Findings
from ciphernav_jax.secret.places import Place, of_function
from ciphernav_jax.secret.witness import Notes, Witness


@dataclass(frozen=True, eq=False, repr=False)
class Secure:
    """A function evaluated on secrets; made by `secure`, moved to devices by `deploy`. It has the function's
    name and docstring.
    """

    function: Callable[..., Any]
    protocol: Protocol
    static_argnames: tuple[str, ...] = ()
    mesh: Mesh | None = None
    jitted: Callable[..., Any] = field(init=False)
    closed_over: list[Tracer] = field(init=False, default_factory=list)
    place: Place = field(init=False)

    def __post_init__(self):
        # jit keeps public arguments abstract, so that what a program asks the dealer for never depends on
        # them.
        object.__setattr__(self, "place", of_function(self.function))
        object.__setattr__(self, "jitted", Compiled(partial(self.witnessed, witness=None)))
        for name in ("__name__", "__qualname__", "__module__", "__doc__"):
            if hasattr(self.function, name):
                object.__setattr__(self, name, getattr(self.function, name))

    def __repr__(self) -> str:
        name = getattr(self.function, "__name__", type(self.function).__name__)
        return f"secure({name})" if self.protocol == Protocol() else f"secure({name}, {self.protocol})"

    def __call__(self, key: Array, *args: Any, **kwargs: Any) -> Any:
        """Evaluates the function; `key` is the dealer's random key, fresh for each call."""
        return self.computed(key, self.checked(key, *args, **kwargs))

    def given(self, *args: Any, **kwargs: Any) -> Arguments:
        """The arguments of a call, ready to be traced."""
        inside.require_outside(repr(self), "Call the function that it was made from: step.function(x).")
        return given(self.function, self.static_argnames, args, kwargs)

    def computed(self, key: Array, given: Arguments) -> Any:
        """The results of a call; raises where a public number is not usable."""
        results, (_, findings) = self.jitted(key, given)
        self.require_sound(key, findings)
        return results

    def require_sound(self, key: Array, findings: Findings) -> None:
        """Raises where a call turned out unsound once it was traced: a public number is not usable; or the
        function reads numbers of a loop by itself, and has one key for all iterations.
        """
        findings.check()
        fresh.of_each_iteration(key, self.closed_over, "step")

    def checked(self, key: Array, *args: Any, **kwargs: Any) -> Arguments:
        """What `given` gives; raises where `key` is no key, or not a fresh one."""
        require_x64()
        fresh.require_key(key, "step")
        given = self.given(*args, **kwargs)
        fresh.of_each_iteration(key, given, "step")
        how = (id(self.function), self.protocol, given.static)
        fresh.of_each_call(key, given, "step", how=how)
        return given

    def call(self, given: Arguments, witness: Witness | None = None) -> Call:
        """The call with these arguments, traced, as a value. Nothing is run."""
        return call(self.function, self.protocol, given, self.place, witness)

    def witnessed(
        self, key: Array, given: Arguments, witness: Witness | None
    ) -> tuple[Any, tuple[Notes | None, Findings]]:
        """The results of a call, the notes that such a witness takes of it, and what was found of public
        numbers. Where something was, all secret results are poisoned.
        """
        traced = self.call(given, witness)
        self.closed_over[:] = traced.closed_over
        return traced.run(key, self.mesh)


@overload
def secure(
    function: Callable[..., Any],
    *,
    protocol: Protocol | None = None,
    static_argnames: str | Sequence[str] = (),
) -> Secure: ...


@overload
def secure(
    function: None = None, *, protocol: Protocol | None = None, static_argnames: str | Sequence[str] = ()
) -> Callable[[Callable[..., Any]], Secure]: ...


def secure(
    function: Callable[..., Any] | None = None,
    *,
    protocol: Protocol | None = None,
    static_argnames: str | Sequence[str] = (),
) -> Any:
    """The same function, evaluated by all parties on secrets.

    A public number that is added to secrets, compared with them or selected beside them may be of any size:
    a mask of -inf, -1e9 or `finfo.min` does what one means. Beyond 2^(61 - frac_bits) it stands for that.

    Args:
        function: any JAX function of float arrays (pytrees of them) whose primitives have a rule: MLPs, ReLU,
            squared losses, comparisons, `jnp.where`, sums, reshapes, and `jax.grad` of them; `lax.scan`,
            `fori_loop`, `map`, and `while_loop`, `cond`, `switch` on public predicates. What it closes over
            is public. Python numbers in it are constants: powers of two and integers multiply exactly. What
            no result is made of is not computed, and may have no rule (all that a `while` carries is).
            Left out, `secure(...)` decorates a function: `@cn.secure(protocol=...)`.
        protocol: the variants; the precision must be that of the secrets given.
        static_argnames: parameters whose values the function is traced with, as by `jax.jit`: a size, a
            string, a function. They must be hashable, and are public.

    Returns:
        `step(key, *args, **kwargs)`. The arguments are pytrees that mix `Secret` and public arrays, `key` the
        dealer's random key: use a fresh one for each call. What depends on a `Secret` comes out as `Secret`,
        the rest public.
        Works under `jax.jit`, `jax.lax.scan` and `jax.vmap`; is itself jitted.

    Raises (when called):
        NotImplementedError: the function uses an operation that has no rule, or reaches out of itself
            (callbacks, `jax.debug.print`); the message names it, its line in the function, and a way out.
        ValueError: no secret among the arguments; a name in `static_argnames` that no parameter has; secrets
            of different numbers of parties; a precision other than the protocol's; local truncation for more
            than two parties; a `vmap` or a loop over arguments with one key for all; a public number that
            meets a secret and is NaN, or multiplies or divides it and is not finite, out of range, or a zero
            divisor. The message names the line in the function. Under a trace around the call nobody can look
            at the number; then `reveal` gives NaN for all secret float results, -2^63 for int64.
        TypeError: it is being differentiated; write `secure(jax.grad(f))`. It is called inside a function on
            secrets, or the function closes over a `Secret`. The key is none, or an argument is no array and
            not static.

    Warns (when called):
        KeyReuseWarning: a key is given a second time, with other arguments or to another function.

    Example:
        >>> import jax, jax.numpy as jnp, numpy as np
        >>> import ciphernav_jax as cn
        >>> x = cn.share(jax.random.key(0), np.array([1.5, -2.0]), parties=2)
        >>> step = cn.secure(lambda x, y: jnp.maximum(x + y, 0.0))
        >>> cn.reveal(step(jax.random.key(1), x, np.array([0.5, 0.5]))).tolist()
        [2.0, 0.0]
    """
    if function is None:
        return partial(secure, protocol=protocol, static_argnames=static_argnames)
    if isinstance(function, Secure):
        raise TypeError("the function is secure already: give it secrets as it is")
    if not callable(function):
        raise TypeError(f"secure takes a function, and not a {type(function).__name__}: secure(f)(key, x)")
    static = (static_argnames,) if isinstance(static_argnames, str) else tuple(static_argnames)
    return Secure(function, chosen(protocol), static)


def require_step(step: Any) -> None:
    """Raises TypeError for what `secure` has not made."""
    if not isinstance(step, Secure):
        raise TypeError(f"expected a function made by secure(f), got {type(step).__name__}")


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

    Raises:
        TypeError: `step` was not made by `secure`, or this is no mesh.
        ValueError: an ideal variant. When called: the mesh has other axes, or not a device for each party.

    Example:
        >>> import jax, jax.numpy as jnp
        >>> import ciphernav_jax as cn
        >>> mesh = jax.make_mesh((len(jax.devices()),), ("party",))
        >>> cn.deploy(cn.secure(jnp.square), mesh)
        secure(square)
    """
    require_step(step)
    if not isinstance(mesh, Mesh):
        raise TypeError(
            f'a {type(mesh).__name__} is no mesh of devices: jax.make_mesh((parties,), ("party",)) is one'
        )
    if step.protocol.ideal:
        raise ValueError(
            f"an ideal variant is no protocol that parties could carry out ({step.protocol}). "
            "Deploy a step with real variants."
        )
    return replace(step, mesh=mesh)
