"""One molecule: noise and drift against the step, and the first φ and ψ at 300 K, in phipsi and in OpenMM.

phipsi's hybrid Monte Carlo with and without Fixman's potential, and OpenMM's Langevin dynamics; distances between distributions beside
those between two halves of one run, which is what chance alone gives.
"""

from __future__ import annotations

import datetime
import platform
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
import openmm

import phipsi

from . import angles, html, molecules, statistics, steps
from .molecules import Molecule
from .noise import RECORD_FS, Noise

KELVIN = 300.0

#: Steps that are tried, fs.
TORSION_STEPS = (1, 2, 4, 6, 8, 12, 16)
CARTESIAN_STEPS = (0.5, 1, 1.5, 2, 2.5, 3, 4)

#: Names of the Cartesian programs and what is changed for them.
CARTESIAN = {"OpenMM, all atoms": lambda m: m, "OpenMM, X–H constrained": molecules.constrained}


def torsion_noise(molecule: Molecule, ps: float, steps_fs: tuple[float, ...]) -> list[Noise]:
    """phipsi at every step, from one start at 300 K."""
    case = steps.Case("phipsi, torsions", "phipsi", None, {}, tuple(steps_fs))
    return [n for runs in steps.torsion_runs(molecule, case, 1, ps) for n in runs]


def cartesian_noise(molecule: Molecule, program: str, ps: float, steps_fs: tuple[float, ...]) -> list[Noise]:
    """OpenMM at every step, from one start at 300 K."""
    start = steps.cartesian_start(molecule, 1)
    return [steps.cartesian_run(molecule.system, start, program, dt, ps) for dt in steps_fs]


def distributions(molecule: Molecule, ps: float) -> dict[str, np.ndarray]:
    """φ and ψ by each program: (n, 2)."""
    found = {}
    for name, fixman in (("phipsi, torsions, with Fixman's potential", True), ("phipsi, torsions, rigid", False)):
        t = phipsi.molecule.TorsionModel(molecule.phipsi())
        t.minimize()
        r = t.run(round(1e3 * ps / 10), dt_fs=10, ensemble="hmc", temperature_K=KELVIN, fixman=fixman, seed=1, every=20, trajectory_steps=5)
        found[name] = angles.of(molecule.topology, r.positions)
    for name, change in CARTESIAN.items():
        changed = change(molecule)
        start = steps.cartesian_start(changed, 1)
        integrator = openmm.LangevinMiddleIntegrator(KELVIN, 1, 0.002)
        integrator.setRandomNumberSeed(1)
        context = molecules.new_context(changed.system, integrator)
        context.setPositions(start.getPositions())
        context.setVelocities(start.getVelocities())
        frames = []
        for _ in range(max(2, round(ps / 0.2))):
            integrator.step(100)
            frames.append(context.getState(getPositions=True).getPositions(asNumpy=True)._value)
        found[name] = angles.of(molecule.topology, np.array(frames))
    return found


def compare(pdb: Path, xml: Path, ps: float, sampled_ps: float, torsion: Any = TORSION_STEPS, cartesian: Any = CARTESIAN_STEPS):
    """Noises and samples of one molecule."""
    molecule = molecules.from_files(pdb, xml)
    noises = torsion_noise(molecule, ps, torsion)
    for name, change in CARTESIAN.items():
        noises += cartesian_noise(change(molecule), name, ps, cartesian)
    return noises, distributions(molecule, sampled_ps) if sampled_ps > 0 else {}


def series(noises: list[Noise], x: str) -> html.Series:
    """Noise against a column, for each program."""
    names = dict.fromkeys(n.program for n in noises)
    return {name: [(getattr(n, x), n.noise) for n in noises if n.program == name] for name in names}


def page(title: str, noises: list[Noise], samples: dict[str, np.ndarray], ps: float, sampled_ps: float) -> str:
    """The page in HTML; nothing is loaded from elsewhere."""
    rows = [
        [n.program, f"{n.step_fs:g}", f"{n.noise:.3g}", f"{n.drift:.1e} ± {n.drift_error:.0e}", f"{1e3 * n.processor_s_per_ps:.3g}", f"{n.kelvin:.0f}"]
        if np.isfinite(n.noise)
        else [n.program, f"{n.step_fs:g}", "failed", "", "", ""]
        for n in noises
    ]
    parts = [
        html.start(title),
        f"<p>{datetime.date.today()}; {escape(platform.processor() or platform.machine())}; phipsi {phipsi.__version__}, OpenMM "
        f"{openmm.version.short_version} on its Reference platform; one run of each, on a machine that may have had other work.</p>",
        f"<h2>Constant energy</h2><p>{ps:g} ps each from 300 K, energies every {RECORD_FS:g} fs. Noise: root mean square of the total energy about a "
        "straight line. Drift: slope of a line through ten blocks, per degree of freedom. Processor times include the energies; K: mean temperature.</p>",
        html.chart(series(noises, "step_fs"), "step, fs"),
        html.chart(series(noises, "processor_s_per_ps"), "processor time of a picosecond, s"),
        html.table(["", "step, fs", "noise, kJ/mol", "drift, kJ/mol/ps", "ms a ps", "K"], rows),
    ]
    samples = {name: x for name, x in samples.items() if len(x)}
    if samples:
        densities = {name: statistics.histogram(x) for name, x in samples.items()}
        halves = {name: statistics.hellinger(statistics.histogram(x[: len(x) // 2]), statistics.histogram(x[len(x) // 2 :])) for name, x in samples.items()}
        rows = [
            [name, str(len(samples[name])), f"{halves[name]:.3f}", *(f"{statistics.hellinger(densities[name], d):.3f}" for d in densities.values())]
            for name in samples
        ]
        parts += [
            f"<h2>φ and ψ at 300 K</h2><p>{sampled_ps:g} ps each; φ to the right, ψ up, from −180° to 180°; shades by the root of the density. Hellinger's "
            "distances, and that of the two halves of each run: a distance that is not larger says nothing.</p>",
            *(html.ramachandran(name, d) for name, d in densities.items()),
            html.table(["", "samples", "own halves", *densities], rows),
        ]
    return "\n".join(parts)
