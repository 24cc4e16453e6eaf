"""One's own molecule in phipsi and in OpenMM: ``python -m validation.openmm MY.pdb MY.xml``."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import openmm
from openmm import app, unit

import phipsi

from .compare import CannotCompare, Comparison

#: Relative difference that passes: rounding of both programs over a million pairs.
BOUND = 1e-11

#: Forces without an energy.
NO_ENERGY = {
    "AndersenThermostat",
    "CMMotionRemover",
    "MonteCarloAnisotropicBarostat",
    "MonteCarloBarostat",
    "MonteCarloFlexibleBarostat",
    "MonteCarloMembraneBarostat",
    "RPMDMonteCarloBarostat",
}

#: Sizes of the random displacements, nm: from that of a vibration to overlapping atoms.
DISPLACEMENTS = (0.002, 0.005, 0.01, 0.03)

#: Force groups of OpenMM.
GROUPS = 32


def load_ours(pdb: str, xml: str, ignore: Iterable[str] = ()) -> phipsi.molecule.System:
    """The user's files in phipsi."""
    try:
        return phipsi.molecule.System.from_files(pdb, xml, ignore=list(ignore))
    except phipsi.ModelError as error:
        raise CannotCompare(f"phipsi does not load it:\n{error}") from error
    except OSError as error:
        raise CannotCompare(f"cannot be read: {error}") from error


def load(xml: str, ignore: Iterable[str] = ()) -> openmm.System:
    """The System in OpenMM, without the forces that are ignored."""
    try:
        system = openmm.XmlSerializer.deserialize(Path(xml).read_text(encoding="utf-8"))
    except Exception as error:  # OpenMM raises bare exceptions
        raise CannotCompare(f"OpenMM does not load it: {error}") from error
    for i in reversed(range(system.getNumForces())):
        force = system.getForce(i)
        if force.getName() in ignore or type(force).__name__ in {*ignore, *NO_ENERGY}:
            system.removeForce(i)
    return system


class Theirs:
    """Energies and forces of every force of a System, by OpenMM's Reference platform: double precision."""

    def __init__(self, system: openmm.System) -> None:
        self.terms: list[str] = []
        self.classes: dict[str, str] = {}
        for i, force in enumerate(system.getForces()):
            name = _unused(force.getName(), self.terms)
            self.terms.append(name)
            self.classes[name] = type(force).__name__
            force.setForceGroup(min(i, GROUPS - 1))
        if len(self.terms) > GROUPS:
            raise CannotCompare(f"{len(self.terms)} forces, but OpenMM tells {GROUPS} apart: ignore some of them")
        platform = openmm.Platform.getPlatformByName("Reference")
        try:
            self.context = openmm.Context(system, openmm.VerletIntegrator(0.001), platform)
        except openmm.OpenMMException as error:
            raise CannotCompare(f"OpenMM does not evaluate it: {error}") from error

    def at(self, positions: np.ndarray, term: str) -> tuple[float, np.ndarray]:
        """Energy and forces of a term, kJ/mol, kJ/mol/nm."""
        self.context.setPositions(positions)
        state = self.context.getState(energy=True, forces=True, groups={self.terms.index(term)})
        energy = state.getPotentialEnergy().value_in_unit(unit.kilojoule_per_mole)
        forces = state.getForces(asNumpy=True).value_in_unit(unit.kilojoule_per_mole / unit.nanometer)
        return energy, np.array(forces)


def _unused(name: str, taken: list[str]) -> str:
    # The sum of our energies has the key "total".
    taken = [*taken, "total"]
    return next(n for n in (name, *(f"{name}#{k}" for k in range(2, len(taken) + 2))) if n not in taken)


def coulomb_constants() -> tuple[float, float]:
    """1/(4πε₀) of phipsi and of this OpenMM, kJ/mol nm/e²: two unit charges, 1 nm apart."""
    system, topology, nonbonded = openmm.System(), app.Topology(), openmm.NonbondedForce()
    residue = topology.addResidue("HE", topology.addChain())
    for name in ("HE1", "HE2"):
        system.addParticle(4.0)
        topology.addAtom(name, app.element.helium, residue)
        nonbonded.addParticle(1.0, 1.0, 0.0)
    system.addForce(nonbonded)
    positions = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    ours = phipsi.molecule.System.from_openmm(topology, system, positions).energy()["total"]
    return ours, Theirs(system).at(positions, "NonbondedForce")[0]


def compare(pdb: str, xml: str, seeds: Iterable[int], bound: float = BOUND, ignore: Iterable[str] = ()) -> Comparison:
    """Compares positions, energies and forces: at the positions of the file, then at random displacements of them."""
    s, ignore = load_ours(pdb, xml, ignore), list(ignore)
    theirs = Theirs(load(xml, ignore))
    if theirs.terms != s.terms:
        raise CannotCompare(f"the terms do not match: phipsi has {s.terms}, OpenMM has {theirs.terms}")
    result, names = Comparison(bound), s.atom_names

    def atom(at: tuple[int, ...]) -> str:
        return f"{names[at[0]]}, {'xyz'[at[1]]}"

    ours, other = coulomb_constants()
    constant = abs(ours - other) / other
    if constant > bound:
        result.leave_out("Coulomb constant", f"{ours!r} in phipsi, {other!r} in this OpenMM ({openmm.__version__})")
    for note in s.report.ignored:
        result.leave_out(note.place, f"ignored: {note.what}")
    result.note("positions", s.positions, _their_positions(pdb, result, s), atom)
    for k, seed in enumerate([None, *seeds]):
        x, where = s.positions, "positions of the file"
        if seed is not None:
            size = DISPLACEMENTS[(k - 1) % len(DISPLACEMENTS)]
            x = x + np.random.default_rng(seed).normal(0.0, size, x.shape)
            where = f"displaced by {size} nm, seed {seed}"
        _one_state(s, theirs, result, x, where, atom, constant)
    return result


def _one_state(
    s: phipsi.molecule.System, theirs: Theirs, result: Comparison, x: np.ndarray, where: str, atom, constant: float
) -> None:
    energy, their_energy, their_forces = s.energy(x), 0.0, np.zeros_like(x)
    evaluated = {term: theirs.at(x, term) for term in theirs.terms}
    # Terms cancel each other, and large pair energies cancel within a term: this is what rounding is relative to.
    energies = sum(abs(e) for e, _ in evaluated.values())
    largest = max((float(np.abs(f).max()) for _, f in evaluated.values()), default=0.0)
    for term, (e, f) in evaluated.items():
        factor, why = 1.0, ""
        if constant > result.bound and theirs.classes[term] in ("NonbondedForce", "GBSAOBCForce"):
            factor, why = 1 + 10 * constant / result.bound, "the Coulomb constants differ, see below"
        result.note(f"energy, {term}", energy[term], e, where, scale=energies, factor=factor, why=why)
        result.note(f"forces, {term}", s.forces(x, term=term), f, atom, scale=largest, factor=factor, why=why)
        their_energy, their_forces = their_energy + e, their_forces + f
    factor, why = (1.0, "") if constant <= result.bound else (1 + 10 * constant / result.bound, "as the terms")
    result.note("energy, total", energy["total"], their_energy, where, scale=energies, factor=factor, why=why)
    result.note("forces, total", s.forces(x), their_forces, atom, scale=largest, factor=factor, why=why)


def _their_positions(pdb: str, result: Comparison, s: phipsi.molecule.System) -> np.ndarray:
    try:
        file = app.PDBFile(pdb)
    except Exception as error:  # OpenMM raises bare exceptions
        result.leave_out("positions", f"OpenMM does not read the PDB ({error}): ours are used in both")
        return s.positions
    return file.getPositions(asNumpy=True).value_in_unit(unit.nanometer)


def main(arguments: list[str] | None = None) -> int:
    """Runs the comparison from the command line; the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m validation.openmm",
        description="Compares a molecule in phipsi and in OpenMM (Reference platform): energies and forces of every term.",
        epilog="example: python -m validation.openmm ala.pdb ala.xml. Exit 0: all agree, 1: not, 2: usage.",
    )
    parser.add_argument("pdb", help="the atoms")
    parser.add_argument("xml", help="the System, as openmm.XmlSerializer writes it")
    parser.add_argument("--states", type=int, default=8, help="random displacements (default 8)")
    parser.add_argument("--seed", type=int, default=0, help="of the first one (default 0)")
    parser.add_argument("--bound", type=float, default=BOUND, help=f"relative difference that passes (default {BOUND:g})")
    parser.add_argument("--ignore", metavar="NAME", action="append", default=[], help="leave out a force")
    given = parser.parse_args(arguments)
    if given.states < 0 or not given.bound > 0 or given.seed < 0:
        parser.error("--states and --seed must be at least 0, --bound positive")
    try:
        seeds = range(given.seed, given.seed + given.states)
        result = compare(given.pdb, given.xml, seeds, given.bound, given.ignore)
    except CannotCompare as reason:
        print(f"{given.pdb}, {given.xml}: {reason}", file=sys.stderr)
        return 1
    versions = f"phipsi {phipsi.__version__} and OpenMM {openmm.__version__} (Reference platform)"
    print(f"{given.pdb}, {given.xml}: {versions}, {given.states} random displacements")
    print(result.table())
    print("all agree" if result.agrees else "they differ")
    return 0 if result.agrees else 1


if __name__ == "__main__":
    sys.exit(main())
