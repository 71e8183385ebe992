"""The party axis: how a program written for one party is run by all of them.

A *program* is what one party does: `program(private, public) -> (private, public)`, where `private` is a
pytree of that party's own inputs in the plain shape of the values, and `public` is known to all. The
collectives `open_sum`, `open_xor` and `open_shares` are its only way to reach the other parties. Whatever
else it does is local, so the collectives in a program's jaxpr are all that passes between parties: the
transcript, the rounds, the bytes.

Who runs the program is chosen outside:
- `simulate`: `jax.vmap` over a leading party axis; all parties in one XLA program.
- `deploy`: `jax.shard_map` over a mesh axis; one device, or one process, for each party.
"""

import functools
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array, lax
from jax.sharding import AxisType, Mesh, NamedSharding, PartitionSpec
from jaxtyping import UInt64

# No axis of a user's own `vmap` has this name: a sum over that would be over the parties, in silence.
AXIS = "ciphernav_jax parties"
MESH_AXIS = "party"

Program = Callable[[Any, Any], tuple[Any, Any]]


def labelled(program: Callable[..., Any]) -> Callable[..., Any]:
    """Decorates a protocol: what it sends is counted under its name (`jax.named_scope`)."""

    @functools.wraps(program)
    def under_its_name(*args, **kwargs):
        with jax.named_scope(label(program.__name__)):
            return program(*args, **kwargs)

    return under_its_name


def label(name: str) -> str:
    """The scope of what is sent under a protocol's name."""
    return f"protocol:{name}"


def open_sum(x: UInt64[Array, "..."]) -> UInt64[Array, "..."]:
    """Opens an additively shared value: every party sends its share to all others, and all add them up.

    [x] -> x = x_0 + ... + x_{P-1} mod 2^64. One round; each party sends 8 bytes an entry to each other party.
    Every party learns x (and the shares, which are uniform but for their sum).
    """
    with jax.named_scope("open_sum"):
        return lax.psum(x, AXIS)


def open_xor(x: UInt64[Array, "..."]) -> UInt64[Array, "..."]:
    """Opens words shared by exclusive or: x = x_0 ^ ... ^ x_{P-1}. One round, otherwise as `open_sum`."""
    with jax.named_scope("open_xor"):
        return lax.reduce_xor(lax.all_gather(x, AXIS), axes=(0,))


def open_shares(x: UInt64[Array, "..."]) -> UInt64[Array, "p ..."]:
    """Opens every party's own number to all others, the party as leading axis. One round, otherwise as
    `open_sum`.
    """
    with jax.named_scope("open_shares"):
        return lax.all_gather(x, AXIS)


def ideal_sum(x: UInt64[Array, "..."]) -> UInt64[Array, "..."]:
    """What a trusted third party would learn from all shares. **Not a message, and not a protocol**: it
    stands in the *ideal* variants alone, which show what a function gives without the cost of its protocol.
    """
    with jax.named_scope("ideal_sum"):
        return lax.psum(x, AXIS)


def from_party_zero(public: UInt64[Array, "..."]) -> UInt64[Array, "..."]:
    """A sharing of a public value, additive or by exclusive or: party 0 holds it, the others hold 0."""
    return jnp.where(lax.axis_index(AXIS) == 0, public, jnp.zeros_like(public))


def simulate(program: Program, parties: int) -> Program:
    """Runs a program as all parties at once, under `jax.vmap`.

    Private inputs and outputs have a leading axis of length `parties`; public ones have none, and what is
    computed from public values alone is computed once.
    """
    return jax.vmap(program, in_axes=(0, None), out_axes=(0, None), axis_name=AXIS, axis_size=parties)


def deploy(program: Program, mesh: Mesh) -> Program:
    """Runs a program with one device for each party, under `jax.shard_map` over the mesh axis "party".

    The same calling convention as `simulate`; private arrays are sharded over the mesh, public ones
    replicated. The devices may belong to different processes (`jax.distributed`). Shares and opened values
    are bit-identical to the simulation's.

    Raises:
        ValueError: the mesh has no axis "party", or other axes beside it.
    """
    if tuple(mesh.axis_names) != (MESH_AXIS,):
        raise ValueError(
            f'deploy needs a mesh with the one axis "{MESH_AXIS}", got axes {tuple(mesh.axis_names)}. '
            f'Make it with jax.make_mesh((parties,), ("{MESH_AXIS}",)).'
        )

    def one_device(private, public):
        mine = jax.tree.map(lambda x: x[0], private)
        mine, opened = program(mine, public)
        return jax.tree.map(lambda x: x[None], mine), opened

    split, same = PartitionSpec(AXIS), PartitionSpec()
    on_devices = jax.shard_map(
        one_device,
        # The caller's mesh, by the name that the collectives know.
        mesh=Mesh(mesh.devices, (AXIS,), axis_types=(AxisType.Auto,)),
        in_specs=(split, same),
        out_specs=(split, same),
        # An exclusive or over gathered shares is the same everywhere, which JAX cannot infer.
        check_vma=False,
    )

    def deployed(private, public):
        mine, opened = on_devices(private, public)
        rows = NamedSharding(_automatic(mesh), PartitionSpec(MESH_AXIS))
        return lax.with_sharding_constraint(mine, rows), opened

    return deployed


def on_every_device(x: Any, mesh: Mesh) -> Any:
    """Pins a computation to whole copies on every device, so that XLA does not split the dealer among
    parties.
    """
    return lax.with_sharding_constraint(x, NamedSharding(_automatic(mesh), PartitionSpec()))


def _automatic(mesh: Mesh) -> Mesh:
    """The mesh with sharding outside the program left to XLA, whatever type of axis the caller's has."""
    return Mesh(mesh.devices, mesh.axis_names, axis_types=(AxisType.Auto,))
