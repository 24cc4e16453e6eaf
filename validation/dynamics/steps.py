"""The largest steps at constant energy: torsions of phipsi and Verlet of OpenMM, from starts near 300 K.

The noise of Cartesian dynamics with a step of 1 fs is the measure, in the same molecule and the same length of run: torsions may have
as large a step as keeps below it. Starts are states of a bath whose mean temperature in a short run at constant energy is within 5 % of
300 K: the energy that noise and drift belong to is that of 300 K, in few degrees of freedom too.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import openmm

import phipsi

from . import molecules, noise
from .molecules import Molecule
from .noise import BOLTZMANN, RECORD_FS, Noise
from .results import Results

KELVIN = 300.0

#: Steps of torsions that are tried, fs: small ones for the order, which is fitted up to ``FIT_TO``.
FIT, FIT_TO = (1, 2, 4), 8
FINE = {"aladi": (6, 8, 10, 11, 12, 13, 14, 15, 16, 17, 18, 19, 20, 22), "ala10": (6, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18)}
FINE_OTHERS = (5, 6, 7, 8, 9, 10, 11, 12, 13, 14)
FREE, CONSTRAINED, HEAVY = (1, 1.5, 2, 2.5, 3), (1, 2, 3, 4, 5), (2, 3, 4, 5, 6, 7)

#: Lengths of runs, ps.
LENGTHS = {"aladi": 100.0, "ala10": 50.0}
LENGTH_OTHERS = 20.0

#: Largest relative distance of a start's mean temperature from 300 K.
NEAR = 0.05


class Case(NamedTuple):
    """A molecule in a program: what it is called, how it is changed, its steps."""

    label: str
    program: str
    change: Any
    arguments: dict[str, Any]
    steps_fs: tuple[float, ...]


def cases(name: str) -> list[Case]:
    """Of a molecule."""
    fine = FINE.get(name, FINE_OTHERS)
    same, to = (lambda m: m), molecules.heavy_hydrogens
    return [
        Case("Cartesian, all atoms", "OpenMM", same, {}, FREE),
        Case("Cartesian, X–H constrained", "OpenMM", molecules.constrained, {}, CONSTRAINED),
        Case("Cartesian, X–H constrained, H of 3 Da", "OpenMM", lambda m: molecules.constrained(to(m, 3.0)), {}, HEAVY),
        Case("torsions", "phipsi", same, {}, (*FIT, *fine)),
        Case("torsions, CH₃, NH₃, OH fused", "phipsi", same, {"rigid": ["methyl"]}, fine),
        Case("torsions, H of 3 Da", "phipsi", lambda m: to(m, 3.0), {}, fine),
        Case("torsions, H of 4 Da", "phipsi", lambda m: to(m, 4.0), {}, fine),
    ]


def is_near(kelvin: float) -> bool:
    return abs(kelvin / KELVIN - 1) < NEAR


def torsion_start(t: phipsi.molecule.TorsionModel, seed: int, warm_ps: float = 20.0) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates and velocities near 300 K."""
    bath = {"ensemble": "langevin", "temperature_K": KELVIN, "friction_per_ps": 5}
    t.minimize()
    t.run(round(250 * warm_ps), dt_fs=4, seed=seed, every=round(250 * warm_ps), **bath)
    for k in range(1, 200):
        t.run(250, dt_fs=4, seed=1000 * seed + k, every=250, **bath)
        q, v = t.q, t.v
        if is_near(t.run(1000, dt_fs=4, every=10).temperature_K.mean()):
            return q, v
        t.q, t.v = q, v
    raise SystemExit("no start near 300 K was found in 200 ps")


def torsion_runs(molecule: Molecule, case: Case, starts: int, ps: float) -> list[list[Noise]]:
    """For each step, a run from each start; ends where all starts failed."""
    found: list[list[Noise]] = []
    t = phipsi.molecule.TorsionModel(molecule.phipsi(), **case.arguments)
    states = [torsion_start(t, seed) for seed in range(1, starts + 1)]
    for dt in case.steps_fs:
        found.append([_torsion_run(t, case.label, dt, *state, ps) for state in states])
        if all(np.isnan(n.noise) for n in found[-1]):
            break
    return found


def _torsion_run(t: phipsi.molecule.TorsionModel, label: str, dt: float, q: np.ndarray, v: np.ndarray, ps: float) -> Noise:
    t.q, t.v = q, v
    every = max(1, round(RECORD_FS / dt))
    begun = time.process_time()
    try:
        r = t.run(every * max(20, round(1e3 * ps / dt / every)), dt_fs=dt, every=every)
    except phipsi.NumericalError:
        return noise.failed(label, dt)
    spent = time.process_time() - begun
    if not np.isfinite(r.conserved).all() or np.ptp(r.conserved) > 1e3:
        return noise.failed(label, dt)
    return noise.noise_of(label, dt, r.time_ps, r.conserved, t.degrees_of_freedom, spent, float(r.temperature_K.mean()))


def cartesian_start(molecule: Molecule, seed: int, warm_ps: float = 10.0) -> openmm.State:
    """A state near 300 K; the CPU platform is fast enough for the bath of large ones."""
    platform = "CPU" if molecule.system.getNumParticles() > 100 else "Reference"
    bath = openmm.LangevinMiddleIntegrator(KELVIN, 5, 0.001)
    bath.setRandomNumberSeed(seed)
    warm = molecules.new_context(molecule.system, bath, platform)
    warm.setPositions(molecule.positions)
    openmm.LocalEnergyMinimizer.minimize(warm)
    warm.setVelocitiesToTemperature(KELVIN, seed)
    bath.step(round(1e3 * warm_ps))
    freedom = 3 * molecule.system.getNumParticles() - molecule.system.getNumConstraints()
    plain = openmm.VerletIntegrator(0.001)
    plain.setConstraintTolerance(1e-8)
    still = molecules.new_context(molecule.system, plain, platform)
    for _ in range(200):
        bath.step(500)
        state = warm.getState(getPositions=True, getVelocities=True)
        still.setPositions(state.getPositions())
        still.setVelocities(state.getVelocities())
        kinetic = []
        for _ in range(80):
            plain.step(25)
            kinetic.append(still.getState(getEnergy=True).getKineticEnergy()._value)
        if is_near(2 * float(np.mean(kinetic)) / (freedom * BOLTZMANN)):
            return state
    raise SystemExit("no start near 300 K was found in 100 ps")


def cartesian_runs(molecule: Molecule, case: Case, starts: int, ps: float) -> list[list[Noise]]:
    """For each step, a run from each start; ends where all starts failed."""
    found: list[list[Noise]] = []
    states = [cartesian_start(molecule, seed) for seed in range(1, starts + 1)]
    for dt in case.steps_fs:
        found.append([cartesian_run(molecule.system, state, case.label, dt, ps) for state in states])
        if all(np.isnan(n.noise) for n in found[-1]):
            break
    return found


def cartesian_run(system: openmm.System, start: openmm.State, label: str, dt: float, ps: float) -> Noise:
    """OpenMM's Verlet on its Reference platform."""
    freedom = 3 * system.getNumParticles() - system.getNumConstraints()
    integrator = openmm.VerletIntegrator(1e-3 * dt)
    integrator.setConstraintTolerance(1e-10)
    context = molecules.new_context(system, integrator)
    context.setPositions(start.getPositions())
    context.setVelocities(start.getVelocities())
    every = max(1, round(RECORD_FS / dt))
    kinetic, energies, begun = [], [], time.process_time()
    try:
        for _ in range(max(20, round(1e3 * ps / dt / every))):
            integrator.step(every)
            state = context.getState(getEnergy=True)
            kinetic.append(state.getKineticEnergy()._value)
            energies.append(kinetic[-1] + state.getPotentialEnergy()._value)
            if not np.isfinite(energies[-1]) or abs(energies[-1] - energies[0]) > 1e3:
                return noise.failed(label, dt)
    except openmm.OpenMMException:
        return noise.failed(label, dt)
    times = 1e-3 * dt * every * np.arange(1, len(energies) + 1)
    kelvin = 2 * float(np.mean(kinetic)) / (freedom * BOLTZMANN)
    return noise.noise_of(label, dt, times, np.array(energies), freedom, time.process_time() - begun, kelvin)


def _medians(plain: Molecule, case: Case, starts: int, ps: float) -> list[dict[str, Any]]:
    run = torsion_runs if case.program == "phipsi" else cartesian_runs
    medians = [noise.median(runs) for runs in run(case.change(plain), case, starts, ps)]
    for n in medians:
        print(f"{plain.name} {n.program:38} {n.step_fs:5g} fs  noise {n.noise:8.3g}  drift {n.drift:9.1e} ± {n.drift_error:.0e}  {n.kelvin:4.0f} K", flush=True)
    return [n._asdict() for n in medians]


def measure(folder: Path, name: str, starts: int, results: Results, scale: float = 1.0) -> dict[str, Any]:
    """All cases of a molecule in vacuum: medians over the starts, runs of ``scale`` times their length."""
    plain = molecules.from_folder(folder, name)
    ps = scale * LENGTHS.get(name, LENGTH_OTHERS)
    found: dict[str, Any] = {"name": name, "atoms": plain.system.getNumParticles(), "starts": starts, "ps": ps, "cases": []}
    for case in cases(name):
        runs = results.once(f"steps.{name}.{case.label}", lambda case=case: _medians(plain, case, starts, ps))
        found["cases"].append({"label": case.label, "program": case.program, "runs": runs})
    summarize(found)
    return found


def summarize(found: dict[str, Any]) -> None:
    """Adds the largest steps of every case, and the order of the plain torsions."""
    reference = next(r["noise"] for r in found["cases"][0]["runs"] if r["step_fs"] == 1)
    found["reference_noise"] = reference
    for case in found["cases"]:
        steps = [r["step_fs"] for r in case["runs"]]
        case["noise_step"] = noise.largest_step(steps, [r["noise"] for r in case["runs"]], reference)
        case["drift_step"] = noise.largest_step(steps, [r["drift"] for r in case["runs"]], 1e-3)
        passed = [r for r in case["runs"] if r["step_fs"] <= max(case["noise_step"], case["drift_step"])]
        case["kelvin"] = [f([r["kelvin"] for r in passed]) for f in (min, max)] if passed else None
        fit = [(r["step_fs"], r["noise"]) for r in case["runs"] if r["step_fs"] <= FIT_TO]
        if case["program"] == "phipsi" and steps[0] == FIT[0]:
            case["order"] = noise.order(*map(list, zip(*fit)))
