"""Objects of OpenMM as plain tables. OpenMM is imported only here, when it is asked for."""

from __future__ import annotations

from typing import Any

__all__ = ["Engine", "engine_of", "tables"]


def tables(topology: Any, system: Any, positions: Any) -> tuple[str, list, list, Any]:
    """The System as XML; (name, residue name, chain, residue number, residue, element) of every atom; bonds; positions, nm."""
    import openmm
    from openmm import unit

    atoms = [
        (
            atom.name,
            atom.residue.name,
            str(atom.residue.chain.id),
            _number(atom.residue),
            atom.residue.index,
            atom.element.symbol if atom.element is not None else "",
        )
        for atom in topology.atoms()
    ]
    bonds = [sorted((bond[0].index, bond[1].index)) for bond in topology.bonds()]
    if unit.is_quantity(positions):
        positions = positions.value_in_unit(unit.nanometer)
    # Lists of Vec3, with or without a unit of their own.
    positions = [[x.value_in_unit(unit.nanometer) if unit.is_quantity(x) else x for x in row] for row in positions]
    return openmm.XmlSerializer.serialize(system), atoms, bonds, positions


def _number(residue: Any) -> int:
    """The residue's number; its place where the number is none."""
    try:
        return int(residue.id)
    except ValueError:
        return residue.index + 1


class Engine:
    """Energies and forces of a Context, in the units of phipsi: positions (n_atoms, 3), nm -> kJ/mol, kJ/mol/nm.

    The precision is that of its platform: double on Reference, single on most others, which then bounds how well energy is
    conserved. A context with a periodic box is used as it is.
    """

    def __init__(self, context: Any) -> None:
        self.context = context

    def __call__(self, positions: Any) -> tuple[float, Any]:
        self.context.setPositions(positions)
        state = self.context.getState(getEnergy=True, getForces=True)
        return state.getPotentialEnergy()._value, state.getForces(asNumpy=True)._value


def engine_of(forces: Any, n: int) -> Any:
    """The Engine of a Context of n particles; anything else as it is."""
    # Who has a Context has imported OpenMM.
    import sys

    openmm = sys.modules.get("openmm")
    if openmm is None or not isinstance(forces, openmm.Context):
        return forces
    found = forces.getSystem().getNumParticles()
    if found != n:
        from .errors import ArgumentError

        message = f"`forces` is a Context of {found} particles, but {n} are required, those of the System"
        raise ArgumentError(message, argument="forces", found=(found,), required=(n,))
    return Engine(forces)
