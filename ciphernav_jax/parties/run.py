"""A program with its dealer: plan what it asks for, deal that, and run it.

The programs here take the dealer as first argument: `program(dealer, private, public) -> (private, public)`.
"""

from collections.abc import Callable
from typing import Any

import jax
from jax import Array
from jax.sharding import Mesh

from ciphernav_jax.parties import party
from ciphernav_jax.parties.dealer import Dealer, Plan, Planner, Supply, deal
from ciphernav_jax.parties.locality import require_in_step
from ciphernav_jax.ring.random import Generator

DealtProgram = Callable[[Dealer, Any, Any], tuple[Any, Any]]


def plan(program: DealtProgram, parties: int, private: Any, public: Any) -> Plan:
    """What the program asks the dealer for, from a trace alone: nothing is computed."""
    planner = Planner()

    def trace(private, public):
        return program(planner, private, public)

    jax.eval_shape(party.simulate(trace, parties), private, public)
    return planner.plan()


def online(program: DealtProgram, needed: Plan) -> party.Program:
    """The online phase of a program: its private inputs are a pair, (what the dealer supplied, its own)."""

    def with_supply(private, public):
        supply, private = private
        return program(Supply(needed, supply), private, public)

    return with_supply


def one_partys_jaxpr(program: party.Program, parties: int, private: Any, public: Any) -> tuple[Any, Any]:
    """What one of the parties computes, traced and not run.

    Args:
        program: one party's program.
        parties: P.
        private: pytree of arrays, or of their `jax.ShapeDtypeStruct`, with the party as leading axis.
        public: pytree of arrays or of their `jax.ShapeDtypeStruct`.

    Returns:
        The jaxpr of the program on one party's inputs, and the pytree of shapes that it returns.

    Raises:
        ValueError: what is opened depends on what other parties do not know (`locality.require_in_step`).
    """
    mine = jax.eval_shape(lambda private: jax.tree.map(lambda x: x[0], private), private)
    trace = jax.make_jaxpr(program, axis_env=[(party.AXIS, parties)], return_shape=True)
    jaxpr, shapes = trace(mine, public)
    require_in_step(jaxpr, own=len(jax.tree.leaves(mine)))
    return jaxpr, shapes


def run(
    program: DealtProgram,
    key: Array,
    parties: int,
    private: Any,
    public: Any,
    mesh: Mesh | None = None,
    generator: Generator = "threefry",
) -> tuple[Any, Any]:
    """Plans, deals and runs a program: by simulation, or with one device a party where `mesh` is given.

    Args:
        program: one party's program.
        key: random key of the dealer; the same key gives the same shares bit for bit, simulated or deployed.
        parties: P >= 2.
        private: pytree of arrays with the party as leading axis.
        public: pytree of arrays that all parties know.
        mesh: one device for each party; None for a simulation.
        generator: where the dealer's uniform words come from.

    Returns:
        The private outputs, with the party as leading axis, and the public ones.
    """
    if mesh is not None and mesh.size != parties:
        raise ValueError(f"the mesh has {mesh.size} devices, but the shares belong to {parties} parties")
    needed = plan(program, parties, private, public)
    supply = deal(key, needed, parties, generator)
    if mesh is None:
        return party.simulate(online(program, needed), parties)((supply, private), public)
    supply = party.on_every_device(supply, mesh)
    return party.deploy(online(program, needed), mesh)((supply, private), public)
