"""Peptides that keep their fold: Ala10 and Trp-cage with GBSAOBC at 300 K, in torsions and with all atoms."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mdtraj
import numpy as np
import openmm

import phipsi

from . import molecules, statistics
from .molecules import Molecule
from .results import Results

KELVIN = 300.0

#: Friction of both baths, 1/ps, and interval of frames, ps.
FRICTION, FRAME_PS = 1.0, 0.5

#: Lengths of runs, ps, and steps of torsions, fs.
LENGTH_PS, STEPS_FS = 200.0, {"ala10": 8.0, "trpcage": 5.0}


def torsions(molecule: Molecule, ps: float) -> np.ndarray:
    """Positions of Langevin dynamics in torsions, with Fixman's potential, from the minimum."""
    t, dt = phipsi.molecule.TorsionModel(molecule.phipsi()), STEPS_FS[molecule.name]
    t.minimize()
    every = round(1e3 * FRAME_PS / dt)
    bath = {"ensemble": "langevin", "temperature_K": KELVIN, "friction_per_ps": FRICTION, "fixman": True}
    return t.run(every * round(ps / FRAME_PS), dt_fs=dt, every=every, seed=1, **bath).positions


def all_atoms(molecule: Molecule, ps: float) -> np.ndarray:
    """The same of OpenMM's CPU platform: 4 fs, hydrogens of 3 Da, bonds to them constrained."""
    heavy = molecules.constrained(molecules.heavy_hydrogens(molecule, 3.0))
    integrator = openmm.LangevinMiddleIntegrator(KELVIN, FRICTION, 0.004)
    integrator.setRandomNumberSeed(1)
    context = molecules.new_context(heavy.system, integrator, "CPU")
    context.setPositions(heavy.positions)
    openmm.LocalEnergyMinimizer.minimize(context)
    context.setVelocitiesToTemperature(KELVIN, 1)
    frames = [context.getState(getPositions=True).getPositions(asNumpy=True)._value]
    for _ in range(round(ps / FRAME_PS)):
        integrator.step(round(FRAME_PS / 0.004))
        frames.append(context.getState(getPositions=True).getPositions(asNumpy=True)._value)
    return np.array(frames)


def fold(molecule: Molecule, positions: np.ndarray) -> dict[str, Any]:
    """Root mean square distance of the α carbons from the structure of the file, nm, and helical residues by DSSP."""
    topology = mdtraj.Topology.from_openmm(molecule.topology)
    frames = mdtraj.Trajectory(positions.astype(np.float32), topology)
    start = mdtraj.Trajectory(molecule.positions[None].astype(np.float32), topology)
    alpha = topology.select("name CA and element C")
    distance = mdtraj.rmsd(frames, start, atom_indices=alpha)
    helical = (mdtraj.compute_dssp(frames) == "H").sum(axis=1)
    late = len(frames) // 2
    return {
        "residues": len(alpha),
        "distance": float(distance[late:].mean()),
        "largest": float(distance.max()),
        "helical_start": int((mdtraj.compute_dssp(start) == "H").sum()),
        "helical": float(helical[late:].mean()),
        "helical_least": int(helical[late:].min()),
        "frames": len(frames),
    }


def backbone_angles(molecule: Molecule, positions: np.ndarray) -> np.ndarray:
    """φ and ψ of all residues that have both, frame by frame of the second half: (n, 2)."""
    topology = mdtraj.Topology.from_openmm(molecule.topology)
    frames = mdtraj.Trajectory(positions[len(positions) // 2 :].astype(np.float32), topology)
    (by_phi, phi), (by_psi, psi) = mdtraj.compute_phi(frames), mdtraj.compute_psi(frames)
    at = {tuple(atoms[:3]): k for k, atoms in enumerate(by_psi)}
    pairs = [(k, at[tuple(atoms[1:])]) for k, atoms in enumerate(by_phi) if tuple(atoms[1:]) in at]
    # All residues of a frame together, so that halves are halves of the run.
    return np.stack([np.column_stack([phi[:, i], psi[:, j]]) for i, j in pairs], axis=1).reshape(-1, 2)


def measure(folder: Path, results: Results, scale: float = 1.0) -> list[dict[str, Any]]:
    """Both molecules in both programs."""
    found = []
    for name in ("ala10", "trpcage"):
        molecule, ps = molecules.from_folder(folder, name, "GBSAOBC"), scale * LENGTH_PS
        samples = {}
        for program, run in (("phipsi, torsions", torsions), ("OpenMM, X–H constrained", all_atoms)):
            positions = results.array(f"folds.{name}.{program}", lambda run=run: run(molecule, ps))
            samples[program] = backbone_angles(molecule, positions)
            found.append({"name": name, "program": program, "ps": ps, **fold(molecule, positions)})
            print(found[-1], flush=True)
        ours, theirs = samples.values()
        found[-2]["distance_of_angles"] = statistics.distance(ours, theirs)
        found[-2]["halves"], found[-1]["halves"] = statistics.halves(ours), statistics.halves(theirs)
    return found
