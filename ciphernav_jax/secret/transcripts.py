"""Everything that passes between the parties in one call."""

from collections.abc import Callable
from typing import Any

from jax import Array

from ciphernav_jax.parties.recording import Message
from ciphernav_jax.secret.compiled import Compiled
from ciphernav_jax.secret.secured import Secure, require_step


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

    Example:
        >>> import jax, jax.numpy as jnp, numpy as np
        >>> import ciphernav_jax as cn
        >>> x = cn.share(jax.random.key(0), np.array([1.5, -2.0]), parties=2)
        >>> result, messages = cn.transcript(cn.secure(jnp.square))(jax.random.key(1), x)
        >>> [message.opening.collective for message in messages], messages[0].sent.shape
        (['open_sum', 'open_sum'], (2, 2))
    """
    require_step(step)

    @Compiled
    def evaluate(key, given):
        return step.call(given).recorded(key)

    def observed(key: Array, *args: Any, **kwargs: Any) -> tuple[Any, tuple[Message, ...]]:
        return evaluate(key, step.checked(key, *args, **kwargs))

    return observed
