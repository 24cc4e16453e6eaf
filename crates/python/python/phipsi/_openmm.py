"""Objects of OpenMM as plain tables. OpenMM is imported only here, when it is asked for."""

from __future__ import annotations

from typing import Any

__all__ = ["tables"]


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
