"""Everything that passes between the parties in one call."""

from collections.abc import Callable
from typing import Any

from jax import Array

from ciphernav_jax.protocols.record import Message, run_recorded
from ciphernav_jax.secret.cost import require_step
from ciphernav_jax.secret.programs import Compiled
from ciphernav_jax.secret.secure import Secure


def transcript(step: Secure) -> Callable[..., tuple[Any, tuple[Message, ...]]]:
    """The function with its transcript: what each party sees beside its own inputs and randomness.

    Returns:
        `observed(key, *args) -> (result, messages)`: the result of `step(key, *args)` bit for bit, and a
        `Message` for each opening in the program's order. Jitted; works under `jax.vmap`, over keys say. A
        step that was given to `deploy` is simulated, and sends the same.

    Ideal variants open nothing to any party, and leave nothing in the transcript. What the dealer hands out
    is not in it either.

    Raises:
        TypeError: `step` was not made by `secure`.
        NotImplementedError (when called): something is opened in a `lax.cond` or a `lax.while_loop`.
    """
    require_step(step)

    @Compiled
    def evaluate(key, args):
        seen: list[Message] = []

        def watch(program, key, parties, private, public, mesh, generator):
            results, messages = run_recorded(program, key, parties, private, public, generator)
            seen.extend(messages)
            return results

        return step.evaluate(key, args, watch), tuple(seen)

    def observed(key: Array, *args: Any) -> tuple[Any, tuple[Message, ...]]:
        return evaluate(key, step.checked(key, args))

    return observed
