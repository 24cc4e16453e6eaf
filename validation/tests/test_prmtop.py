"""AMBER's files against OpenMM's reader of them, term by term; Systems and results as pickles."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import openmm
import pytest
from openmm import app, unit

import phipsi

from .common import AMBER, MOLECULE

System = phipsi.molecule.System

FF14SB, COORDINATES = AMBER
FF19SB = Path(__file__).parents[1] / "data" / "prmtop" / "ala_dipeptide_ff19sb.prmtop"


def energies(prmtop: Path, **arguments):
    """Energy and forces of each force of OpenMM's System of the file."""
    system = app.AmberPrmtopFile(str(prmtop)).createSystem(nonbondedMethod=app.NoCutoff, constraints=None, **arguments)
    system = openmm.XmlSerializer.deserialize(openmm.XmlSerializer.serialize(system))
    forces = [f for f in system.getForces() if f.getName() != "CMMotionRemover"]
    for group, force in enumerate(forces):
        force.setForceGroup(group)
    context = openmm.Context(system, openmm.VerletIntegrator(0.001), openmm.Platform.getPlatform("Reference"))

    def evaluate(x):
        context.setPositions(x)
        found = {}
        for group, force in enumerate(forces):
            state = context.getState(getEnergy=True, getForces=True, groups={group})
            energy = state.getPotentialEnergy().value_in_unit(unit.kilojoule_per_mole)
            found[force.getName()] = energy, state.getForces(asNumpy=True)._value
        return found

    return evaluate


@pytest.mark.parametrize("solvent", [None, "obc2"])
@pytest.mark.parametrize("prmtop", [FF14SB, FF19SB])
def test_energies_of_every_term(prmtop, solvent):
    s = System.from_prmtop(prmtop, COORDINATES, implicit_solvent=solvent)
    assert not s.report.warnings
    arguments = {} if solvent is None else {"implicitSolvent": app.OBC2, "solventDielectric": 78.5, "soluteDielectric": 1.0}
    evaluate = energies(prmtop, **arguments)
    assert np.abs(s.positions - app.AmberInpcrdFile(str(COORDINATES)).getPositions(asNumpy=True)._value).max() < 1e-9
    random = np.random.default_rng(1)
    for size in (0.0, 0.002, 0.01):
        x = s.positions + size * random.normal(size=s.positions.shape)
        wanted, found = evaluate(x), s.energy(x)
        assert sorted(wanted) == sorted(s.terms)
        for name, (energy, forces) in wanted.items():
            # Both read eight digits; they differ in the rounding of conversions only.
            assert abs(found[name] - energy) < 1e-9 * (1 + abs(energy)), name
            assert np.abs(s.forces(x, term=name) - forces).max() < 1e-9 * (1 + np.abs(forces).max()), name


def test_a_torsion_model_of_it():
    s, other = System.from_prmtop(FF14SB, COORDINATES), System.from_files(*MOLECULE)
    assert s.bonds == other.bonds and [n.split(":")[1] for n in s.atom_names] == [n.split(":")[1] for n in other.atom_names]
    assert s.atomic_numbers == other.atomic_numbers
    t = phipsi.molecule.TorsionModel(s, rigid="omega")
    assert t.degrees_of_freedom == 11 and abs(t.run(20, dt_fs=2).drift) < 1


def test_mistakes(tmp_path):
    with pytest.raises(FileNotFoundError):
        System.from_prmtop("no.prmtop", COORDINATES)
    with pytest.raises(phipsi.ArgumentError, match="obc2"):
        System.from_prmtop(FF14SB, COORDINATES, implicit_solvent="gbn2")
    with pytest.raises(phipsi.ArgumentError, match="solvent_dielectric"):
        System.from_prmtop(FF14SB, COORDINATES, implicit_solvent="obc2", solvent_dielectric=-1)
    with pytest.raises(phipsi.ModelError, match="begin with %VERSION"):
        System.from_prmtop(COORDINATES, FF14SB)
    short = tmp_path / "short.inpcrd"
    short.write_text("\n".join(COORDINATES.read_text().splitlines()[:5]))
    with pytest.raises(phipsi.ModelError, match="66"):
        System.from_prmtop(FF14SB, short)


def test_pickles():
    pdb = app.PDBFile(str(MOLECULE[0]))
    made = openmm.XmlSerializer.deserialize(MOLECULE[1].read_text())
    systems = [
        System.from_files(*MOLECULE, ignore=["NonbondedForce"]),
        System.from_prmtop(FF19SB, COORDINATES, implicit_solvent="obc2"),
        System.from_openmm(pdb.topology, made, pdb.positions),
    ]
    for s in systems:
        again = pickle.loads(pickle.dumps(s))
        assert again.energy() == s.energy() and again.bonds == s.bonds and again.atom_names == s.atom_names
    r = phipsi.molecule.TorsionModel(systems[0]).run(20, dt_fs=2, ensemble="hmc", fixman=True)
    again = pickle.loads(pickle.dumps(r))
    for name in dir(r):
        if not name.startswith("_"):
            assert np.array_equal(getattr(again, name), getattr(r, name)), name
