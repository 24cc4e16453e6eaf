"""A solute in torsions among waters that are rigid or points, on forces of an OpenMM Context with a periodic box."""

from __future__ import annotations

import numpy as np
import openmm
import pytest
from openmm import app, unit

import phipsi

from .common import EPSILON, MOLECULE

System, TorsionModel = phipsi.molecule.System, phipsi.molecule.TorsionModel

#: Edge of the box, nm.
EDGE = 1.9


def water(topology, method, rigid):
    field = app.ForceField("amber14-all.xml", "amber14/tip3p.xml")
    made = field.createSystem(topology, nonbondedMethod=method, nonbondedCutoff=0.8 * unit.nanometer, rigidWater=rigid)
    for force in made.getForces():
        if isinstance(force, openmm.NonbondedForce):
            force.setUseDispersionCorrection(False)
    return made


def context_of(system, positions):
    context = openmm.Context(system, openmm.VerletIntegrator(0.001), openmm.Platform.getPlatform("Reference"))
    context.setPositions(positions)
    return context


@pytest.fixture(scope="module")
def box():
    """Alanine dipeptide in a box of water: topology, minimised positions, number of waters."""
    pdb = app.PDBFile(str(MOLECULE[0]))
    field = app.ForceField("amber14-all.xml", "amber14/tip3p.xml")
    modeller = app.Modeller(pdb.topology, pdb.positions)
    modeller.addSolvent(field, boxSize=openmm.Vec3(EDGE, EDGE, EDGE) * unit.nanometer)
    system = water(modeller.topology, app.CutoffPeriodic, False)
    context = openmm.Context(system, openmm.VerletIntegrator(0.001), openmm.Platform.getPlatform("CPU"))
    context.setPositions(modeller.positions)
    openmm.LocalEnergyMinimizer.minimize(context, maxIterations=100)
    positions = context.getState(getPositions=True).getPositions(asNumpy=True)._value
    waters = sum(residue.name == "HOH" for residue in modeller.topology.residues())
    return modeller.topology, positions, waters


def test_waters_are_rigid_or_points(box):
    topology, positions, waters = box
    flexible = System.from_openmm(topology, water(topology, app.CutoffPeriodic, False), positions)
    rigid = System.from_openmm(topology, water(topology, app.CutoffPeriodic, True), positions)
    solute = 13
    assert TorsionModel(rigid).degrees_of_freedom == TorsionModel(flexible).degrees_of_freedom == solute + 6 * waters
    assert TorsionModel(flexible, free="water").degrees_of_freedom == solute + 9 * waters
    listed = TorsionModel(flexible, free=range(22, 25))
    assert listed.degrees_of_freedom == solute + 6 * waters + 3
    assert TorsionModel(flexible).recluster(free="water")[0].degrees_of_freedom == solute + 9 * waters
    with pytest.raises(phipsi.ModelError, match="constraint"):
        TorsionModel(rigid, free="water")
    with pytest.raises(phipsi.ArgumentError, match="water"):
        TorsionModel(flexible, free="solvent")
    with pytest.raises(phipsi.ArgumentError, match="free"):
        TorsionModel(flexible, free=[10**6])


@pytest.mark.parametrize("free, step", [(None, 4), ("water", 1)])
def test_a_box_of_water_keeps_momentum_and_energy(box, free, step):
    """Energy of second order; momentum to rounding; rigid waters keep their shape. Forces are those of a Context."""
    topology, positions, waters = box
    system = water(topology, app.CutoffPeriodic, free is None)
    s = System.from_openmm(topology, system, positions)
    context = context_of(system, positions)
    t = TorsionModel(s, forces=context, free=free)
    t.run(40, dt_fs=step, ensemble="langevin", temperature_K=300, friction_per_ps=20, seed=1)
    start, velocities = t.positions.copy(), t.velocities.copy()
    masses = np.array([system.getParticleMass(i)._value for i in range(s.n_atoms)])
    noise = []
    for dt in (step, step / 2):
        t = TorsionModel(s, forces=context, positions=start, free=free)
        t.velocities = velocities
        run = t.run(round(16 * step / dt), dt_fs=dt)
        noise.append(np.ptp(run.conserved))
        momentum = masses @ t.velocities - masses @ velocities
        # Each step rounds the forces, whose sum is zero, and the velocities, a few operations each.
        pushed = dt * 1e-3 * np.abs(context.getState(getForces=True).getForces(asNumpy=True)._value).sum(axis=0).max()
        moved = masses @ np.abs(velocities).max(axis=1)
        assert np.abs(momentum).max() < 16 * step / dt * 16 * EPSILON * (pushed + moved)
        if free is None:
            shapes = [np.linalg.norm(x[22::3] - x[23::3], axis=1) for x in (t.positions, start)]
            # Positions are rounded on the scale of the box, some operations each.
            assert np.abs(shapes[0] - shapes[1]).max() < 64 * EPSILON * EDGE
    # A quarter but for what jumps at the cutoff.
    assert noise[1] < noise[0] / 2.5


def test_a_context_gives_the_run_of_the_native_terms(box):
    topology, positions, _ = box
    system = water(topology, app.CutoffPeriodic, True)
    s = System.from_openmm(topology, system, positions)
    a, b = (TorsionModel(s, forces=f).run(10, dt_fs=2, seed=1) for f in (context_of(system, positions), None))
    # Forces differ by some ε of their sums; ten steps do not let it grow beyond a thousandfold.
    assert np.abs(a.positions - b.positions).max() < 1e3 * 10 * EPSILON * EDGE


def test_ewald_sums_come_from_a_context(box):
    topology, positions, _ = box
    system = water(topology, app.PME, True)
    with pytest.raises(phipsi.ModelError, match="PME"):
        System.from_openmm(topology, system, positions)
    s = System.from_openmm(topology, system, positions, ignore=["NonbondedForce"])
    context = context_of(system, positions)
    t = TorsionModel(s, forces=context)
    expected = context.getState(getEnergy=True).getPotentialEnergy()._value
    # Positions are those of rigid clusters, rounded.
    assert t.energy()["total"] == pytest.approx(expected, rel=1e-9)
