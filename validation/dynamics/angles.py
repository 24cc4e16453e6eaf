"""Which distribution of φ and ψ is sampled: alanine dipeptide in torsions and with all atoms.

Without forces between pairs and without torsion terms about φ and ψ, that of springs which are very stiff is flat: with Fixman's
potential torsions must be flat too, and not without it. With all forces, the flexible molecule is simulated with constants of bonds,
angles and impropers times 1, 10, 100: with larger ones it should come nearer to torsions with Fixman's potential whose clusters have the
geometry of springs at rest. Averages of flexible molecules do not depend on masses: there hydrogens have 12 Da, which allows longer steps.
"""

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

#: Temperature of the distributions, K: at 300 K the flexible molecule does not cross to φ > 0 often enough.
KELVIN = 600.0

#: Factors of the springs, steps that are short for them, fs, and lengths of runs, ns.
FACTORS = ((1, 3.0, 20.0), (10, 0.95, 10.0), (100, 0.3, 5.0))

#: Interval of samples, ps.
SAMPLE_PS = 1.0

#: Samples of the flat distributions, one each picosecond.
FLAT = 180000


def of(topology: Any, positions: np.ndarray) -> np.ndarray:
    """The first φ and ψ of every frame, rad: (n, 2)."""
    frames = mdtraj.Trajectory(positions.astype(np.float32), mdtraj.Topology.from_openmm(topology))
    (_, phi), (_, psi) = mdtraj.compute_phi(frames), mdtraj.compute_psi(frames)
    if not phi.shape[1] or not psi.shape[1]:
        return np.empty((0, 2))
    return np.column_stack([phi[:, 0], psi[:, 0]])


def amides(molecule: Molecule) -> list[list[int]]:
    """Atoms of ω on either side of the first φ and ψ, of caps too: CA or CH₃, C, N, CA or CH₃."""
    at, beside = backbone(molecule), {}
    for i, j in molecules.bonds(molecule.system):
        beside.setdefault(i, []).append(j)
        beside.setdefault(j, []).append(i)
    elements = [a.element.symbol for a in molecule.topology.atoms()]
    carbon = lambda i: next(j for j in beside[i] if elements[j] == "C" and j not in (at["C"], at["before"]))  # noqa: E731
    return [[carbon(at["before"]), at["before"], at["N"], at["CA"]], [at["CA"], at["C"], at["after"], carbon(at["after"])]]


def with_amides(molecule: Molecule, positions: np.ndarray) -> np.ndarray:
    """φ, ψ and both ω of every frame, rad: at 600 K amides may turn to cis, where φ and ψ have another distribution."""
    frames = mdtraj.Trajectory(positions.astype(np.float32), mdtraj.Topology.from_openmm(molecule.topology))
    return np.column_stack([of(molecule.topology, positions), mdtraj.compute_dihedrals(frames, amides(molecule))])


def trans(samples: np.ndarray) -> np.ndarray:
    """φ and ψ of those samples whose amides are all trans."""
    return samples[(np.abs(samples[:, 2:]) > np.pi / 2).all(axis=1), :2]


def backbone(molecule: Molecule) -> dict[str, int]:
    """Atoms about the first φ and ψ: C of the residue before, N, CA, C, N of the next one."""
    topology = mdtraj.Topology.from_openmm(molecule.topology)
    frame = mdtraj.Trajectory(molecule.positions[None].astype(np.float32), topology)
    phi, psi = mdtraj.compute_phi(frame)[0][0], mdtraj.compute_psi(frame)[0][0]
    return {"before": int(phi[0]), "N": int(phi[1]), "CA": int(phi[2]), "C": int(phi[3]), "after": int(psi[3])}


def torsion_samples(
    molecule: Molecule, samples: int, dt_fs: float, fixman: bool, kelvin: float = KELVIN, trajectory_ps: float = 0.1, **arguments: Any
) -> tuple[np.ndarray, float]:
    """Hybrid Monte Carlo of phipsi, a sample each picosecond, and its acceptance."""
    t = phipsi.molecule.TorsionModel(molecule.phipsi(), **arguments)
    steps = round(1e3 * trajectory_ps / dt_fs)
    every = steps * round(SAMPLE_PS / (1e-3 * dt_fs * steps))
    bath = {"dt_fs": dt_fs, "ensemble": "hmc", "temperature_K": kelvin, "fixman": fixman, "trajectory_steps": steps, "every": every}
    t.run(20 * every, seed=1, **bath)
    r = t.run(every * samples, seed=2, **bath)
    return with_amides(molecule, r.positions[1:]), float(r.acceptance)


def cartesian_samples(molecule: Molecule, dt_fs: float, ns: float, kelvin: float = KELVIN, friction: float = 1.0) -> np.ndarray:
    """Langevin dynamics of OpenMM, a sample each picosecond."""
    integrator = openmm.LangevinMiddleIntegrator(kelvin, friction, 1e-3 * dt_fs)
    integrator.setRandomNumberSeed(1)
    integrator.setConstraintTolerance(1e-8)
    context = molecules.new_context(molecule.system, integrator)
    context.setPositions(molecule.positions)
    openmm.LocalEnergyMinimizer.minimize(context)
    context.setVelocitiesToTemperature(kelvin, 1)
    steps = round(1e3 * SAMPLE_PS / dt_fs)
    integrator.step(20 * steps)
    frames = []
    for _ in range(round(1e3 * ns / SAMPLE_PS)):
        integrator.step(steps)
        frames.append(context.getState(getPositions=True).getPositions(asNumpy=True)._value)
    return with_amides(molecule, np.array(frames))


def all_of_12(molecule: Molecule) -> Molecule:
    """Hydrogens of 12 Da, beside the other atoms as they are."""
    system = molecule.clone()
    for i, mass in enumerate(molecules.masses(system)):
        if mass < 1.5:
            system.setParticleMass(i, 12.0)
    return molecule._replace(system=system)


def flat(plain: Molecule, results: Results, scale: float) -> list[dict[str, Any]]:
    """Of torsions without forces between pairs, with and without Fixman's potential."""
    at, found = backbone(plain), []
    bare = molecules.without_pairs(plain, [(at["N"], at["CA"]), (at["CA"], at["C"])])
    for fixman in (True, False):

        def run(fixman: bool = fixman) -> np.ndarray:
            return torsion_samples(bare, round(scale * FLAT), 20.0, fixman, 300.0, trajectory_ps=0.5)[0]

        samples, k = statistics.independent(results.array(f"flat.{'fixman' if fixman else 'rigid'}", run)[:, :2])
        p, rms, chance = statistics.flatness(samples)
        found.append({"fixman": fixman, "samples": len(samples), "every": k, "p": p, "rms": rms, "chance": chance})
        print(f"flat, fixman {fixman}: {found[-1]}", flush=True)
    return found


def runs(plain: Molecule, scale: float) -> dict[str, Any]:
    """All runs with all forces: name → function that gives samples."""
    at, found = backbone(plain), {}
    for factor, dt, ns in FACTORS:
        changed = all_of_12(molecules.stiffened(plain, factor))
        found[f"all atoms, springs × {factor}"] = lambda m=changed, dt=dt, ns=ns: cartesian_samples(m, dt, scale * ns)
    found["all atoms, X–H constrained"] = lambda: cartesian_samples(molecules.constrained(plain), 2.0, scale * 8)
    rest = molecules.springs_at_rest(plain)
    angle = {"angles": [[at["before"], at["N"], at["CA"]], [at["N"], at["CA"], at["C"]]]}
    for label, molecule, dt, fixman, ns, arguments in (
        ("torsions with Fixman's potential, springs at rest", rest, 10.0, True, 20, {}),
        ("torsions, springs at rest", rest, 10.0, False, 20, {}),
        ("torsions with Fixman's potential, minimum", plain, 10.0, True, 20, {}),
        ("torsions and two backbone angles, with Fixman's potential", plain, 5.0, True, 20, angle),
        ("torsions and an angle at each, with Fixman's potential", plain, 4.0, True, 10, {"clusters": "torsion+angle"}),
    ):
        found[label] = lambda m=molecule, dt=dt, f=fixman, ns=ns, a=arguments: torsion_samples(m, round(1e3 * scale * ns), dt, f, **a)[0]
    return found


def compared(samples: dict[str, np.ndarray], cis: dict[str, float]) -> dict[str, Any]:
    """Of every run: samples, share of cis amides left out, share and crossings of φ > 0, distances to the runs of all atoms, those of halves;
    the distances once more of the samples beside φ > 0."""
    there = {label: statistics.beside(x) for label, x in samples.items()}
    targets, found = [label for label in samples if "all atoms" in label], {}
    for label, x in samples.items():
        inside, crossed = statistics.crossings(x)
        found[label] = {
            "samples": len(x),
            "cis": cis[label],
            "positive": inside,
            "crossings": crossed,
            "halves": statistics.halves(x),
            "halves_beside": statistics.halves(there[label]),
            "distances": {t: statistics.distance(x, samples[t]) for t in targets},
            "distances_beside": {t: statistics.distance(there[label], there[t]) for t in targets},
            "density": statistics.histogram(x).tolist(),
        }
    return found


def measure(folder: Path, results: Results, scale: float = 1.0) -> dict[str, Any]:
    """Flatness, and all distributions with their distances."""
    plain = molecules.from_folder(folder, "aladi")
    found: dict[str, Any] = {"kelvin": KELVIN, "flat": flat(plain, results, scale)}
    samples, cis = {}, {}
    for label, run in runs(plain, scale).items():
        every = results.array(f"angles.{label}", run)
        samples[label] = trans(every)
        cis[label] = 1 - len(samples[label]) / len(every)
        print(f"{label}: {len(every)} samples, halves apart by {statistics.halves(samples[label]):.3f}", flush=True)
    found["runs"] = compared(samples, cis)
    return found
