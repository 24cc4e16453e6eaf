"""What a step costs: the dynamics part of torsions beside the forces of OpenMM's CPU platform, nanoseconds a day, growth with the clusters.

Programs are timed in turns in one run, each on one thread; the table has medians of processor times over the rounds, which other work on
the machine changes least. The dynamics part is a step of the same molecule without forces: positions, generalised forces, and the
implicit drift solved to rounding are what remains.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import openmm

import phipsi

from . import molecules
from .molecules import Molecule
from .results import Results

KELVIN = 300.0

#: Step of the dynamics part, fs.
STEP_FS = 5.0

#: Cautious steps of torsions beside OpenMM's 4 fs, fs; the largest ones that were measured are timed too.
TORSION_STEPS = {"ala10": 10.0, "trpcage": 6.0}

#: Step of OpenMM with hydrogens of 3 Da and bonds to them constrained, fs.
HEAVY_FS = 4.0

#: Copies of Trp-cage (100 clusters), and the cutoff of their forces, nm.
COPIES, CUTOFF = (1, 10, 100), 1.0


def spent(call: Callable[[], Any]) -> tuple[float, float]:
    """Processor and wall seconds of a call."""
    processor, wall = time.process_time(), time.perf_counter()
    call()
    return time.process_time() - processor, time.perf_counter() - wall


def in_turns(calls: dict[str, tuple[Callable[[int], Any], int]], rounds: int) -> dict[str, dict[str, float]]:
    """Of functions of a count, called with a count each: medians over the rounds of the seconds for one, and the least wall time."""
    times: dict[str, list[tuple[float, float]]] = {name: [] for name in calls}
    for call, count in calls.values():
        call(max(1, count // 10))
    for _ in range(rounds):
        for name, (call, count) in calls.items():
            processor, wall = spent(lambda call=call, count=count: call(count))
            times[name].append((processor / count, wall / count))
    found = {}
    for name, pairs in times.items():
        processor, wall = np.array(pairs).T
        found[name] = {"processor_s": float(np.median(processor)), "spread": float(np.ptp(processor) / np.median(processor)), "wall_s": float(wall.min())}
    return found


def without_forces(molecule: Molecule) -> phipsi.molecule.System:
    """In phipsi without forces: bonds are those of the topology."""
    return molecule.phipsi(ignore=sorted({type(f).__name__ for f in molecule.system.getForces()}))


def warm(molecule: Molecule, seed: int = 1) -> phipsi.molecule.TorsionModel:
    """In torsions, in a bath of 300 K for 4 ps."""
    t = phipsi.molecule.TorsionModel(molecule.phipsi())
    t.minimize()
    t.run(1000, dt_fs=4, ensemble="langevin", temperature_K=KELVIN, friction_per_ps=20, seed=seed, every=1000)
    return t


def stepper(t: phipsi.molecule.TorsionModel, dt_fs: float, **bath: Any) -> Callable[[int], Any]:
    """So many steps of torsions, again from the same state."""
    q, v = t.q, t.v

    def run(count: int) -> None:
        t.q, t.v = q, v
        t.run(count, dt_fs=dt_fs, every=count, seed=1, **bath)

    return run


def moving_freely(t: phipsi.molecule.TorsionModel, molecule: Molecule) -> phipsi.molecule.TorsionModel:
    """The state of a model without forces."""
    free = phipsi.molecule.TorsionModel(without_forces(molecule._replace(positions=t.positions)))
    free.velocities = t.velocities
    return free


def evaluator(molecule: Molecule, positions: np.ndarray, platform: str, threads: int | None) -> Callable[[int], Any]:
    """So many energies and forces of OpenMM."""
    context = molecules.new_context(molecule.system, openmm.VerletIntegrator(0.001), platform, threads)
    context.setPositions(positions)

    def run(count: int) -> None:
        for _ in range(count):
            context.getState(energy=True, forces=True)

    return run


def cartesian_stepper(molecule: Molecule) -> Callable[[int], Any]:
    """So many steps of OpenMM's CPU platform on one thread: Langevin, 4 fs, hydrogens of 3 Da, bonds to them constrained."""
    heavy = molecules.constrained(molecules.heavy_hydrogens(molecule, 3.0))
    integrator = openmm.LangevinMiddleIntegrator(KELVIN, 1, 1e-3 * HEAVY_FS)
    integrator.setRandomNumberSeed(1)
    context = molecules.new_context(heavy.system, integrator, "CPU")
    context.setPositions(molecule.positions)
    openmm.LocalEnergyMinimizer.minimize(context)
    context.setVelocitiesToTemperature(KELVIN, 1)
    integrator.step(500)
    # The function keeps the Context, which the integrator does not.
    return lambda count: context.getIntegrator().step(count)


def dynamics_part(folder: Path, rounds: int) -> dict[str, Any]:
    """Trp-cage: the dynamics part beside energy and forces with GBSAOBCForce of OpenMM's CPU platform."""
    vacuum, born = (molecules.from_folder(folder, "trpcage", e) for e in ("vacuum", "GBSAOBC"))
    t = warm(vacuum)
    calls = {
        "phipsi, dynamics part": (stepper(moving_freely(t, vacuum), STEP_FS), 1000),
        "phipsi, whole step, vacuum": (stepper(t, STEP_FS), 500),
        "phipsi, whole step, GBSAOBC": (stepper(warm(born), STEP_FS), 300),
        "OpenMM CPU, 1 thread, energy and forces, GBSAOBC": (evaluator(born, t.positions, "CPU", 1), 100),
        "OpenMM CPU, threads by default, energy and forces, GBSAOBC": (evaluator(born, t.positions, "CPU", None), 100),
    }
    found = {"times": in_turns(calls, rounds), "clusters": len(t.clusters), "freedom": t.degrees_of_freedom}
    part = found["times"]["phipsi, dynamics part"]
    for k, name in (("ratio", list(calls)[3]), ("ratio_default", list(calls)[4])):
        found[k] = part["processor_s"] / found["times"][name]["processor_s"]
        found[f"{k}_wall"] = part["wall_s"] / found["times"][name]["wall_s"]
    return found


def per_day(folder: Path, rounds: int, largest: dict[str, float]) -> list[dict[str, Any]]:
    """Nanoseconds a day of one core's processor time, in a bath of 300 K, at a cautious and at the largest step."""
    found, bath = [], {"ensemble": "langevin", "temperature_K": KELVIN, "friction_per_ps": 1.0}
    for name, environment in ((n, e) for n in TORSION_STEPS for e in ("vacuum", "GBSAOBC")):
        molecule = molecules.from_folder(folder, name, environment)
        theirs, t = cartesian_stepper(molecule), warm(molecule)
        for dt in sorted({TORSION_STEPS[name], largest.get(name, TORSION_STEPS[name])}):
            calls = {
                "phipsi": (stepper(t, dt, **bath), 300),
                "phipsi, Fixman": (stepper(t, dt, fixman=True, **bath), 300),
                "OpenMM": (theirs, 200),
            }
            times = in_turns(calls, rounds)
            days = {k: 86400 * 1e-6 * (HEAVY_FS if k == "OpenMM" else dt) / times[k]["processor_s"] for k in calls}
            found.append({"name": name, "environment": environment, "step_fs": dt, "times": times, "ns_per_day": days})
            print(f"{name}, {environment}, {dt:g} fs: {days}", flush=True)
    return found


def growth(folder: Path, rounds: int) -> list[dict[str, Any]]:
    """Copies of Trp-cage side by side: the time of a cluster in a step, whole and its dynamics part."""
    one = molecules.from_folder(folder, "trpcage")
    t = warm(one)
    one, velocities, found = one._replace(positions=t.positions), t.velocities, []
    for count in COPIES:
        many = molecules.copies(one, count, CUTOFF)
        whole = phipsi.molecule.TorsionModel(many.phipsi())
        whole.velocities = np.concatenate([velocities] * count)
        calls = {"whole step": (stepper(whole, STEP_FS), max(60, 300 // count))}
        calls["dynamics part"] = (stepper(moving_freely(whole, many), STEP_FS), max(60, 500 // count))
        times, clusters = in_turns(calls, rounds), len(whole.clusters)
        found.append({"copies": count, "atoms": many.system.getNumParticles(), "clusters": clusters, "times": times})
        print(f"{clusters} clusters: {times}", flush=True)
    return found


def measure(folder: Path, results: Results, rounds: int, largest: dict[str, float] | None = None) -> dict[str, Any]:
    """All costs, with the load of the machine."""

    def loaded(make: Callable[[], Any]) -> dict[str, Any]:
        value = make()
        return {"load": os.getloadavg()[0], "rounds": rounds, "value": value}

    to_try = {name: step for name, step in (largest or {}).items() if step > 0}
    return {
        "part": results.once("cost.part", lambda: loaded(lambda: dynamics_part(folder, rounds))),
        "day": results.once("cost.day", lambda: loaded(lambda: per_day(folder, rounds, to_try))),
        "growth": results.once("cost.growth", lambda: loaded(lambda: growth(folder, rounds))),
    }


def largest_steps(found: list[dict[str, Any]]) -> dict[str, float]:
    """Of plain torsions: the smaller of the steps that noise and drift allow."""
    plain = {f["name"]: next(c for c in f["cases"] if c["label"] == "torsions") for f in found}
    return {name: min(c["noise_step"], c["drift_step"]) for name, c in plain.items()}
