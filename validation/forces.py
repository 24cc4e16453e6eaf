"""Time and accuracy of energy and forces against OpenMM: ``python -m validation.forces [FOLDER] [NAME…]``.

FOLDER holds a folder for each molecule, as ``validation/data/molecules``: ``NAME.vacuum.xml[.gz]``, ``NAME.obc2.xml[.gz]`` and
``NAME.ref.json[.gz]``, whose ``md`` snapshot is evaluated. Three environments: vacuum; GBSAOBCForce; the CustomGBForce of
``implicit/obc2.xml``. With ``--cutoff`` both programs cut off at that distance (CutoffNonPeriodic).

Every round times each program on each System for a while, one after the other, OpenMM with its platforms Reference and CPU, and
keeps the best time of an evaluation; the table has the best of all rounds, and the ratio to the CPU platform on as many threads.
On a machine with other work, evaluations of more than a few milliseconds are interrupted: the ratio of processor times does not count
the interruptions.
An evaluation of OpenMM is ``context.getState(energy=True, forces=True)``, from Python, without reading the arrays (about 3 µs of
overhead); that of phipsi is ``ForceField::evaluate`` in ``crates/molecule/examples/forces.rs``, which this script builds. Force
errors are largest differences from the Reference platform, over the largest force.
"""

from __future__ import annotations

import argparse
import gzip
import json
import os
import platform
import subprocess
import sys
import tempfile
import time
from datetime import date
from pathlib import Path

import numpy as np
import openmm
import openmm.unit

ROOT = Path(__file__).resolve().parent.parent
#: Offset of radii in GBSAOBCForce, nm.
OFFSET = 0.009
ENVIRONMENTS = ("vacuum", "GBSAOBC", "CustomGB")


def read(path: Path) -> str | None:
    """The text of a file, or of the same with ``.gz``."""
    zipped = path.with_name(path.name + ".gz")
    if path.exists():
        return path.read_text(encoding="utf-8")
    return gzip.decompress(zipped.read_bytes()).decode() if zipped.exists() else None


def native(system: openmm.System) -> openmm.System:
    """The System with a GBSAOBCForce in place of the CustomGBForce of ``implicit/obc2.xml``."""
    for i, force in enumerate(system.getForces()):
        if isinstance(force, openmm.CustomGBForce):
            born = openmm.GBSAOBCForce()
            born.setSolventDielectric(78.5)
            for k in range(force.getNumParticles()):
                charge, offset_radius, scaled_radius = force.getParticleParameters(k)
                born.addParticle(charge, offset_radius + OFFSET, scaled_radius / offset_radius)
            system.removeForce(i)
            system.addForce(born)
            return system
    raise SystemExit("the System has no CustomGBForce")


def copies(system: openmm.System, count: int) -> openmm.System:
    """A System of so many of the same molecule, which do not know each other's bonds."""
    many, n = openmm.System(), system.getNumParticles()
    for _ in range(count):
        for i in range(n):
            many.addParticle(system.getParticleMass(i))
    for force in system.getForces():
        if isinstance(force, openmm.CMMotionRemover):
            continue
        all_of_it = openmm.XmlSerializer.clone(force)
        for first in range(n, count * n, n):
            add(force, all_of_it, first)
        many.addForce(all_of_it)
    return many


def add(force: openmm.Force, to: openmm.Force, first: int) -> None:
    """Adds the entries of a force once more, with ``first`` added to the particles."""
    if isinstance(force, openmm.HarmonicBondForce):
        for i in range(force.getNumBonds()):
            a, b, *numbers = force.getBondParameters(i)
            to.addBond(a + first, b + first, *numbers)
    elif isinstance(force, openmm.HarmonicAngleForce):
        for i in range(force.getNumAngles()):
            a, b, c, *numbers = force.getAngleParameters(i)
            to.addAngle(a + first, b + first, c + first, *numbers)
    elif isinstance(force, openmm.PeriodicTorsionForce):
        for i in range(force.getNumTorsions()):
            a, b, c, d, *numbers = force.getTorsionParameters(i)
            to.addTorsion(a + first, b + first, c + first, d + first, *numbers)
    elif isinstance(force, openmm.CustomGBForce):
        for i in range(force.getNumParticles()):
            to.addParticle(force.getParticleParameters(i))
    elif isinstance(force, (openmm.NonbondedForce, openmm.GBSAOBCForce)):
        for i in range(force.getNumParticles()):
            to.addParticle(*force.getParticleParameters(i))
        for i in range(force.getNumExceptions() if isinstance(force, openmm.NonbondedForce) else 0):
            a, b, *numbers = force.getExceptionParameters(i)
            to.addException(a + first, b + first, *numbers)
    else:
        raise SystemExit(f"no copies of a {type(force).__name__}")


def apart(positions: list, count: int) -> list:
    """The positions again and again on a grid, 0.3 nm apart."""
    x = np.array(positions)
    step = np.ptp(x, axis=0) + 0.3
    side = round(count ** (1 / 3) + 0.5)
    places = [np.array([k % side, k // side % side, k // side**2]) * step for k in range(count)]
    return np.concatenate([x + place for place in places]).tolist()


def cut(system: openmm.System, distance: float, implicit: bool) -> None:
    """Cuts all forces between pairs off at a distance, as ``ForceField.createSystem`` does."""
    for force in system.getForces():
        if isinstance(force, (openmm.NonbondedForce, openmm.GBSAOBCForce, openmm.CustomGBForce)):
            force.setNonbondedMethod(type(force).CutoffNonPeriodic)
            force.setCutoffDistance(distance)
        if isinstance(force, openmm.NonbondedForce) and implicit:
            force.setReactionFieldDielectric(1.0)


def timed(call, seconds: float) -> tuple[float, float]:
    """Least seconds of a call, and the processor's time of one on all threads."""
    call()
    least, calls, start, processor = float("inf"), 0, time.perf_counter(), time.process_time()
    while time.perf_counter() - start < seconds:
        begin = time.perf_counter()
        call()
        least = min(least, time.perf_counter() - begin)
        calls += 1
    return least, (time.process_time() - processor) / calls


class Case:
    """One System at one structure."""

    def __init__(self, name: str, environment: str, system: openmm.System, positions: list, folder: Path) -> None:
        self.name, self.environment, self.atoms = name, environment, system.getNumParticles()
        self.files = [folder / f"{name}.{environment}.xml", folder / f"{name}.json"]
        self.files[0].write_text(openmm.XmlSerializer.serialize(system), encoding="utf-8")
        self.files[1].write_text(json.dumps(positions), encoding="utf-8")
        self.system, self.positions = system, positions
        self.times: dict[tuple[str, int], float] = {}
        self.processor: dict[tuple[str, int], float] = {}
        self.forces: dict[str, np.ndarray] = {}
        self.energies: dict[str, float] = {}

    def theirs(self, name: str, threads: int, seconds: float) -> None:
        properties = {"Threads": str(threads)} if name == "CPU" else {}
        kind = openmm.Platform.getPlatformByName(name)
        context = openmm.Context(self.system, openmm.VerletIntegrator(0.001), kind, properties)
        context.setPositions(self.positions)
        state = context.getState(energy=True, forces=True)
        unit = openmm.unit.kilojoule_per_mole
        self.energies[name] = state.getPotentialEnergy().value_in_unit(unit)
        self.forces[name] = state.getForces(asNumpy=True).value_in_unit(unit / openmm.unit.nanometer)
        self.note(name, threads, timed(lambda: context.getState(energy=True, forces=True), seconds))

    def ours(self, program: Path, threads: int, seconds: float) -> None:
        environment = {**os.environ, "RAYON_NUM_THREADS": str(threads)}
        call = [str(program), *map(str, self.files), str(seconds)]
        found = json.loads(subprocess.run(call, env=environment, check=True, capture_output=True, text=True).stdout)
        self.energies["phipsi"] = sum(found["energies"].values())
        self.forces["phipsi"] = np.array(found["forces"])
        self.note("phipsi", threads, (found["best_s"], found["processor_s"] or float("nan")))

    def note(self, program: str, threads: int, found: tuple[float, float]) -> None:
        for times, seconds in zip((self.times, self.processor), found):
            times[program, threads] = min(seconds, times.get((program, threads), float("inf")))

    def error(self, program: str) -> float:
        reference = self.forces["Reference"]
        return float(np.abs(self.forces[program] - reference).max() / np.abs(reference).max())


def cases(folder: Path, names: list[str], environments: list[str], count: int, cutoff: float | None, scratch: Path):
    """The Systems of all molecules."""
    for name in names:
        reference = read(folder / name / f"{name}.ref.json")
        if reference is None:
            raise SystemExit(f"{folder / name}: no {name}.ref.json; give a folder with one folder for each molecule")
        all_positions = {c["id"]: c["positions"] for c in json.loads(reference)["conformations"]}
        positions = all_positions.get("md") or next(iter(all_positions.values()))
        for environment in environments:
            text = read(folder / name / f"{name}.{'vacuum' if environment == 'vacuum' else 'obc2'}.xml")
            if text is None:
                continue
            system = openmm.XmlSerializer.deserialize(text)
            if environment == "GBSAOBC":
                system = native(system)
            if count > 1:
                system = copies(system, count)
            if cutoff is not None:
                cut(system, cutoff, environment != "vacuum")
            yield Case(name, environment, system, apart(positions, count), scratch)


def build() -> Path:
    """The example of the crate, with threads."""
    arguments = ["cargo", "build", "--release", "-p", "phipsi-molecule", "--features", "parallel", "--example", "forces"]
    subprocess.run(arguments, cwd=ROOT, check=True)
    return Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target")) / "release" / "examples" / "forces"


def shown(seconds: float | None) -> str:
    return "-" if seconds is None else f"{seconds * 1e6:.3g}"


def table(all_cases: list[Case], threads: list[int]) -> str:
    """Times in µs, ratios and force errors, as Markdown."""
    head = ["", "atoms", "OpenMM Reference"]
    head += [f"OpenMM CPU, {t}" for t in threads] + [f"phipsi, {t}" for t in threads] + [f"ratio, {t}" for t in threads]
    least = min(threads)
    head += [f"processor time of OpenMM CPU, {least}", f"of phipsi, {least}", "ratio", "force error of OpenMM CPU", "of phipsi"]
    rows = [head, ["---"] * len(head)]
    for case in all_cases:
        row = [f"{case.name}, {case.environment}", str(case.atoms), shown(case.times.get(("Reference", 1)))]
        for program in ("CPU", "phipsi"):
            row += [shown(case.times.get((program, t))) for t in threads]
        row += [f"{case.times['phipsi', t] / case.times['CPU', t]:.2f}" for t in threads]
        theirs, ours = case.processor["CPU", least], case.processor["phipsi", least]
        row += [shown(theirs), shown(ours), f"{ours / theirs:.3f}"]
        row += [f"{case.error(program):.0e}" for program in ("CPU", "phipsi")]
        rows.append(row)
    return "\n".join("| " + " | ".join(row) + " |" for row in rows)


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m validation.forces", description=__doc__.split("\n\n")[0])
    parser.add_argument("folder", nargs="?", type=Path, default=ROOT / "validation" / "data" / "molecules")
    parser.add_argument("names", nargs="*", default=[], help="molecules (default: aladi, met_enkephalin, ala10, trpcage, bpti)")
    parser.add_argument("--threads", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=0.3, help="of each program in a round")
    parser.add_argument("--cutoff", type=float, help="nm; without it there is none")
    parser.add_argument("--copies", type=int, default=1, help="of each molecule, side by side")
    parser.add_argument("--environments", nargs="+", choices=ENVIRONMENTS, default=ENVIRONMENTS)
    parser.add_argument("--program", type=Path, help="the example, built before")
    arguments = parser.parse_args()
    known = [n for n in ("aladi", "met_enkephalin", "ala10", "trpcage", "bpti") if (arguments.folder / n).is_dir()]
    program = arguments.program or build()
    with tempfile.TemporaryDirectory() as scratch:
        names, environments = arguments.names or known, arguments.environments
        found = cases(arguments.folder, names, environments, arguments.copies, arguments.cutoff, Path(scratch))
        all_cases = list(found)
        for turn in range(arguments.rounds):
            for case in all_cases:
                # The Reference platform takes seconds on large molecules: once is enough for its forces.
                if turn == 0 or case.atoms < 200:
                    case.theirs("Reference", 1, arguments.seconds)
                for threads in arguments.threads:
                    case.theirs("CPU", threads, arguments.seconds)
                    case.ours(program, threads, arguments.seconds)
    cutoff = "no cutoff" if arguments.cutoff is None else f"cutoff {arguments.cutoff} nm"
    print(f"{date.today()}, {platform.processor() or platform.machine()}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}")
    print(f"OpenMM {openmm.__version__}; energy and forces, µs, best of {arguments.rounds} rounds; {cutoff}\n")
    print(table(all_cases, arguments.threads))
    worst = max(case.error("phipsi") for case in all_cases)
    return 0 if worst <= 1e-11 else 1


if __name__ == "__main__":
    sys.exit(main())
