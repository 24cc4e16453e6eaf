"""With every atom a body of its own, the method is OpenMM's Verlet: the first hundred steps to the growth of rounding."""

from __future__ import annotations

import gzip

import numpy as np
import openmm
import pytest
from openmm import app, unit

import phipsi

from .common import EPSILON
from .test_molecule import DATA

STEPS, FS = 100, 1.0


def theirs(system: openmm.System, x: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Positions after every step. OpenMM's velocities are half a step earlier than its positions: v(−h/2) = v − h f/2m."""
    context = openmm.Context(system, openmm.VerletIntegrator(1e-3 * FS), openmm.Platform.getPlatform("Reference"))
    context.setPositions(x)
    force = context.getState(getForces=True).getForces(asNumpy=True)._value
    masses = np.array([system.getParticleMass(i)._value for i in range(system.getNumParticles())])
    context.setVelocities(v - 0.5e-3 * FS * force / masses[:, None])
    found = [x]
    for _ in range(STEPS):
        context.getIntegrator().step(1)
        found.append(context.getState(getPositions=True).getPositions(asNumpy=True)._value)
    return np.array(found)


@pytest.mark.parametrize(("name", "environment"), [("aladi", "vacuum"), ("aladi", "obc2_native"), ("met_enkephalin", "vacuum")])
def test_all_atoms_as_bodies_are_their_verlet(name, environment):
    pdb = app.PDBFile(str(DATA / name / f"{name}.pdb"))
    text = gzip.decompress((DATA / name / f"{name}.{environment}.xml.gz").read_bytes()).decode()
    system = openmm.XmlSerializer.deserialize(text)
    x = np.array(pdb.getPositions(asNumpy=True).value_in_unit(unit.nanometer))
    t = phipsi.molecule.TorsionModel(phipsi.molecule.System.from_openmm(pdb.topology, system, x), clusters="cartesian")
    assert t.degrees_of_freedom == 3 * len(x)
    t.draw_velocities(600, seed=1)
    v = t.velocities
    ours = t.run(STEPS, dt_fs=FS, every=1).positions
    them = theirs(system, x, v)
    # They have moved by more than a hundredth of a nanometre: a bond length would be a tenth.
    assert np.abs(them[-1] - x).max() > 1e-2
    # Rounding grows as any small displacement does: by so much until each step, measured in OpenMM alone.
    small = 1e-9
    moved = theirs(system, x + small * np.random.default_rng(2).choice([-1, 1], x.shape), v)
    growth = np.maximum.accumulate(np.maximum(1.0, np.abs(moved - them).max(axis=(1, 2)) / small))
    # A step rounds positions a few times, and velocities by forces whose terms cancel to a hundredth: 16 ε a step, summed as the worst.
    bound = 16 * EPSILON * np.abs(x).max() * np.arange(1, STEPS + 2) * growth
    apart = np.abs(ours - them).max(axis=(1, 2))
    print(f"{name}, {environment}: {apart[-1]:.1e} nm after {STEPS} steps, growth {growth[-1]:.1f}, at most {(apart / bound).max():.2f} of the bound")
    assert np.all(apart <= bound)
    # Half a step matters: with velocities of the same instant they are apart by far more.
    assert np.abs(at_once(system, x, v) - them[-1]).max() > 1e3 * bound[-1]


def at_once(system: openmm.System, x: np.ndarray, v: np.ndarray) -> np.ndarray:
    """The last positions with velocities that are not put back by half a step."""
    context = openmm.Context(system, openmm.VerletIntegrator(1e-3 * FS), openmm.Platform.getPlatform("Reference"))
    context.setPositions(x)
    context.setVelocities(v)
    context.getIntegrator().step(STEPS)
    return context.getState(getPositions=True).getPositions(asNumpy=True)._value
