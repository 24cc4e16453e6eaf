"""Molecules as both programs get them: an OpenMM System, its topology and positions, and changes of the System."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import openmm
from openmm import app, unit

import phipsi

from .. import forces

#: Masses up to which an atom is taken for a hydrogen, heavy ones included, Da.
HYDROGEN = 4.1


class Molecule(NamedTuple):
    """A System with the topology and positions (nm) that belong to it."""

    name: str
    topology: app.Topology
    system: openmm.System
    positions: np.ndarray

    def clone(self) -> openmm.System:
        """The System, to be changed."""
        return openmm.XmlSerializer.clone(self.system)

    def phipsi(self, ignore: Any = ()) -> phipsi.molecule.System:
        """The same for phipsi."""
        return phipsi.molecule.System.from_openmm(self.topology, self.system, self.positions, ignore=list(ignore))


def from_files(pdb: Path, xml: Path) -> Molecule:
    """From a PDB file and a System in XML."""
    file = app.PDBFile(str(pdb))
    positions = file.getPositions(asNumpy=True).value_in_unit(unit.nanometer)
    return Molecule(pdb.stem, file.topology, openmm.XmlSerializer.deserialize(xml.read_text(encoding="utf-8")), np.array(positions))


def from_folder(folder: Path, name: str, environment: str = "vacuum") -> Molecule:
    """From a folder of molecules: ``vacuum``, or ``GBSAOBC``: with a GBSAOBCForce of ``implicit/obc2.xml``'s parameters."""
    text = forces.read(folder / name / f"{name}.{'vacuum' if environment == 'vacuum' else 'obc2'}.xml")
    if text is None:
        raise SystemExit(f"{folder / name}: no System for {environment}; give a folder with one folder for each molecule")
    file = app.PDBFile(str(folder / name / f"{name}.pdb"))
    system = openmm.XmlSerializer.deserialize(text)
    system = system if environment == "vacuum" else forces.native(system)
    return Molecule(name, file.topology, system, np.array(file.getPositions(asNumpy=True).value_in_unit(unit.nanometer)))


def masses(system: openmm.System) -> np.ndarray:
    """Da."""
    return np.array([system.getParticleMass(i).value_in_unit(unit.dalton) for i in range(system.getNumParticles())])


def bonds(system: openmm.System) -> list[tuple[int, int]]:
    """The springs of HarmonicBondForce."""
    found = [f for f in system.getForces() if isinstance(f, openmm.HarmonicBondForce)]
    return [tuple(f.getBondParameters(k)[:2]) for f in found for k in range(f.getNumBonds())]


def heavy_hydrogens(molecule: Molecule, mass: float) -> Molecule:
    """Hydrogens of ``mass`` Da at the cost of the atoms that they are bonded to."""
    system, m = molecule.clone(), masses(molecule.system)
    for pair in bonds(system):
        light, heavy = sorted(pair, key=lambda a: m[a])
        if m[light] < 1.5 <= m[heavy]:
            system.setParticleMass(heavy, system.getParticleMass(heavy)._value - (mass - m[light]))
            system.setParticleMass(light, mass)
    return molecule._replace(system=system)


def constrained(molecule: Molecule) -> Molecule:
    """Bonds to hydrogens as constraints of their lengths at rest."""
    system, m = molecule.clone(), masses(molecule.system)
    for force in system.getForces():
        for k in range(force.getNumBonds()) if isinstance(force, openmm.HarmonicBondForce) else ():
            i, j, length, _ = force.getBondParameters(k)
            if min(m[i], m[j]) < HYDROGEN:
                system.addConstraint(i, j, length)
    return molecule._replace(system=system)


def is_improper(system: openmm.System, atoms: tuple[int, int, int, int]) -> bool:
    """Whether a torsion's atoms are not bonded one to the next."""
    pairs = {frozenset(b) for b in bonds(system)}
    return any(frozenset(p) not in pairs for p in zip(atoms, atoms[1:]))


def stiffened(molecule: Molecule, factor: float) -> Molecule:
    """Constants of bonds, angles and improper torsions times ``factor``: of what rigid clusters hold still."""
    system = molecule.clone()
    for force in system.getForces():
        if isinstance(force, openmm.HarmonicBondForce):
            for k in range(force.getNumBonds()):
                i, j, length, constant = force.getBondParameters(k)
                force.setBondParameters(k, i, j, length, factor * constant)
        elif isinstance(force, openmm.HarmonicAngleForce):
            for k in range(force.getNumAngles()):
                a, b, c, angle, constant = force.getAngleParameters(k)
                force.setAngleParameters(k, a, b, c, angle, factor * constant)
        elif isinstance(force, openmm.PeriodicTorsionForce):
            for k in range(force.getNumTorsions()):
                a, b, c, d, n, phase, constant = force.getTorsionParameters(k)
                if is_improper(system, (a, b, c, d)):
                    force.setTorsionParameters(k, a, b, c, d, n, phase, factor * constant)
    return molecule._replace(system=system)


def springs_at_rest(molecule: Molecule) -> Molecule:
    """Positions at the minimum of bonds, angles and impropers alone: the geometry that clusters have where these are very stiff."""
    system = molecule.clone()
    for i in reversed(range(system.getNumForces())):
        if not isinstance(system.getForce(i), (openmm.HarmonicBondForce, openmm.HarmonicAngleForce, openmm.PeriodicTorsionForce)):
            system.removeForce(i)
    for force in system.getForces():
        for k in range(force.getNumTorsions()) if isinstance(force, openmm.PeriodicTorsionForce) else ():
            a, b, c, d, n, phase, constant = force.getTorsionParameters(k)
            if not is_improper(system, (a, b, c, d)):
                force.setTorsionParameters(k, a, b, c, d, n, phase, 0.0)
    context = new_context(system, openmm.VerletIntegrator(0.001))
    context.setPositions(molecule.positions)
    openmm.LocalEnergyMinimizer.minimize(context, 1e-4, 10000)
    positions = context.getState(getPositions=True).getPositions(asNumpy=True).value_in_unit(unit.nanometer)
    return molecule._replace(positions=np.array(positions))


def without_pairs(molecule: Molecule, axes: list[tuple[int, int]]) -> Molecule:
    """Without forces between pairs, and without torsion terms about these bonds."""
    system, turned = molecule.clone(), {frozenset(a) for a in axes}
    for i in reversed(range(system.getNumForces())):
        kind = type(system.getForce(i)).__name__
        if kind not in ("HarmonicBondForce", "HarmonicAngleForce", "PeriodicTorsionForce"):
            system.removeForce(i)
    for force in system.getForces():
        for k in range(force.getNumTorsions()) if isinstance(force, openmm.PeriodicTorsionForce) else ():
            a, b, c, d, n, phase, constant = force.getTorsionParameters(k)
            if frozenset((b, c)) in turned and not is_improper(system, (a, b, c, d)):
                force.setTorsionParameters(k, a, b, c, d, n, phase, 0.0)
    return molecule._replace(system=system)


def copies(molecule: Molecule, count: int, cutoff: float) -> Molecule:
    """The molecule ``count`` times side by side, with a cutoff (nm) of forces between pairs."""
    topology = app.Topology()
    for _ in range(count):
        atoms = {}
        for chain in molecule.topology.chains():
            to = topology.addChain()
            for residue in chain.residues():
                within = topology.addResidue(residue.name, to, residue.id)
                for atom in residue.atoms():
                    atoms[atom] = topology.addAtom(atom.name, atom.element, within)
        for a, b in molecule.topology.bonds():
            topology.addBond(atoms[a], atoms[b])
    system = forces.copies(molecule.system, count)
    forces.cut(system, cutoff, any(isinstance(f, openmm.GBSAOBCForce) for f in system.getForces()))
    return Molecule(molecule.name, topology, system, np.array(forces.apart(molecule.positions.tolist(), count)))


def new_context(system: openmm.System, integrator: openmm.Integrator, platform: str = "Reference", threads: int | None = 1) -> openmm.Context:
    """A Context; the CPU platform on so many threads, on as many as it takes by itself where that is None."""
    properties = {"Threads": str(threads)} if platform == "CPU" and threads else {}
    return openmm.Context(system, integrator, openmm.Platform.getPlatform(platform), properties)
