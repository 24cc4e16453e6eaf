"""Torsion dynamics of phipsi beside Cartesian dynamics of OpenMM, on one page.

    python -m validation.dynamics                           alanine dipeptide
    python -m validation.dynamics MY.pdb MY.xml             one's own molecule, without cutoff
    python -m validation.dynamics --ps 50 --out dynamics.html

Constant energy from 300 K: noise and drift of the energy against the step and against the wall time of a picosecond, for rigid
clusters joined by torsions (phipsi, double precision), for all atoms and for all atoms with bonds to hydrogen constrained (OpenMM,
Verlet; Reference platform, double precision). Then the distribution of the first backbone φ and ψ at 300 K: hybrid Monte Carlo of
phipsi with and without Fixman's potential, Langevin dynamics of OpenMM; distances between distributions beside those between two
halves of one run, which is what chance alone gives.
"""

from __future__ import annotations

import argparse
import datetime
import platform
import time
from html import escape
from pathlib import Path
from typing import Any, NamedTuple

import mdtraj
import numpy as np
import openmm
from openmm import app, unit

import phipsi

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"

KELVIN = 300.0

#: Steps that are tried, fs.
TORSION_STEPS = (1, 2, 4, 6, 8, 12, 16)
CARTESIAN_STEPS = (0.5, 1, 1.5, 2, 2.5, 3, 4)

#: Interval of recorded energies, fs.
RECORD_FS = 50.0

#: Bins of each angle.
BINS = 24


class Noise(NamedTuple):
    """Energy of a run at constant energy: RMS about a straight line, kJ/mol; its slope and the error of it, kJ/mol/ps per degree of
    freedom; wall time of a picosecond, s. NaN where the run failed."""

    program: str
    step_fs: float
    noise: float
    drift: float
    drift_error: float
    wall_s_per_ps: float


def noise_of(program: str, step_fs: float, time_ps: np.ndarray, energy: np.ndarray, freedom: int, wall_s: float) -> Noise:
    """Fits a line; the error of its slope is that of a line through the means of ten blocks, which are nearly independent."""
    line = np.polynomial.Polynomial.fit(time_ps, energy, 1)
    blocks = [b.mean() for b in np.array_split(energy, 10)]
    times = np.array([b.mean() for b in np.array_split(time_ps, 10)])
    through, covariance = np.polyfit(times, blocks, 1, cov=True)
    noise = float(np.sqrt(np.mean((energy - line(time_ps)) ** 2)))
    return Noise(program, step_fs, noise, through[0] / freedom, float(np.sqrt(covariance[0, 0])) / freedom, wall_s / np.ptp(time_ps))


def failed(program: str, step_fs: float) -> Noise:
    """A run that did not reach its end."""
    return Noise(program, step_fs, *[float("nan")] * 4)


def torsion_noise(s: Any, ps: float, steps_fs: tuple[float, ...]) -> list[Noise]:
    """phipsi at every step, from one start at 300 K."""
    t = phipsi.molecule.TorsionModel(s)
    t.minimize()
    t.run(2000, dt_fs=4, ensemble="langevin", temperature_K=KELVIN, friction_per_ps=5, seed=1, every=2000)
    q, v = t.q, t.v
    found = []
    for dt in steps_fs:
        t.q = q
        t.v = v
        every = max(1, round(RECORD_FS / dt))
        n = every * max(20, round(1e3 * ps / dt / every))
        begun = time.perf_counter()
        try:
            r = t.run(n, dt_fs=dt, every=every)
        except phipsi.NumericalError:
            found.append(failed("phipsi, torsions", dt))
            continue
        wall = time.perf_counter() - begun
        found.append(noise_of("phipsi, torsions", dt, r.time_ps, r.conserved, t.degrees_of_freedom, wall))
    return found


def openmm_system(xml: Path, constrain: bool) -> openmm.System:
    """The System, with bonds to hydrogen as constraints of their lengths at rest."""
    system = openmm.XmlSerializer.deserialize(xml.read_text())
    if constrain:
        for force in system.getForces():
            if not isinstance(force, openmm.HarmonicBondForce):
                continue
            for k in range(force.getNumBonds()):
                i, j, length, _ = force.getBondParameters(k)
                # Heavy hydrogens too.
                if min(system.getParticleMass(a)._value for a in (i, j)) < 4.1:
                    system.addConstraint(i, j, length)
    return system


def openmm_start(system: openmm.System, positions: Any) -> openmm.State:
    """A state at 300 K."""
    integrator = openmm.LangevinMiddleIntegrator(KELVIN, 5, 0.001)
    integrator.setRandomNumberSeed(1)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatform("Reference"))
    context.setPositions(positions)
    openmm.LocalEnergyMinimizer.minimize(context)
    context.setVelocitiesToTemperature(KELVIN, 1)
    integrator.step(8000)
    return context.getState(getPositions=True, getVelocities=True)


def cartesian_noise(system: openmm.System, positions: Any, program: str, ps: float, steps_fs: tuple[float, ...]) -> list[Noise]:
    """OpenMM at every step, from one start at 300 K."""
    start = openmm_start(system, positions)
    freedom = 3 * system.getNumParticles() - system.getNumConstraints()
    found = []
    for dt in steps_fs:
        integrator = openmm.VerletIntegrator(1e-3 * dt)
        integrator.setConstraintTolerance(1e-10)
        context = openmm.Context(system, integrator, openmm.Platform.getPlatform("Reference"))
        context.setPositions(start.getPositions())
        context.setVelocities(start.getVelocities())
        every = max(1, round(RECORD_FS / dt))
        energies, begun = [], time.perf_counter()
        try:
            for _ in range(max(20, round(1e3 * ps / dt / every))):
                integrator.step(every)
                state = context.getState(getEnergy=True)
                energies.append((state.getPotentialEnergy() + state.getKineticEnergy())._value)
        except openmm.OpenMMException:
            energies = [float("nan")]
        wall = time.perf_counter() - begun
        if not np.isfinite(energies).all() or np.ptp(energies) > 1e3:
            found.append(failed(program, dt))
            continue
        times = 1e-3 * dt * every * np.arange(1, len(energies) + 1)
        found.append(noise_of(program, dt, times, np.array(energies), freedom, wall))
    return found


def angles(topology: Any, positions: np.ndarray) -> np.ndarray:
    """The first φ and ψ of every frame, rad: (n, 2)."""
    frames = mdtraj.Trajectory(positions.astype(np.float32), mdtraj.Topology.from_openmm(topology))
    (_, phi), (_, psi) = mdtraj.compute_phi(frames), mdtraj.compute_psi(frames)
    if not phi.shape[1] or not psi.shape[1]:
        return np.empty((0, 2))
    return np.column_stack([phi[:, 0], psi[:, 0]])


def histogram(samples: np.ndarray) -> np.ndarray:
    """Frequencies of φ and ψ."""
    edges = np.linspace(-np.pi, np.pi, BINS + 1)
    counts, _, _ = np.histogram2d(samples[:, 0], samples[:, 1], bins=(edges, edges))
    return counts / max(1.0, counts.sum())


def hellinger(a: np.ndarray, b: np.ndarray) -> float:
    """Hellinger's distance of two distributions: 0 for equal ones, 1 for such without overlap."""
    return float(np.sqrt(max(0.0, 1 - np.sum(np.sqrt(a * b)))))


def distributions(s: Any, pdb: app.PDBFile, systems: dict[str, openmm.System], ps: float) -> dict[str, np.ndarray]:
    """φ and ψ by each program: (n, 2)."""
    found = {}
    for name, fixman in (("phipsi, torsions, with Fixman's potential", True), ("phipsi, torsions, rigid", False)):
        t = phipsi.molecule.TorsionModel(s)
        t.minimize()
        r = t.run(round(1e3 * ps / 10), dt_fs=10, ensemble="hmc", temperature_K=KELVIN, fixman=fixman, seed=1, every=20, trajectory_steps=5)
        found[name] = angles(pdb.topology, r.positions)
    for name, system in systems.items():
        start = openmm_start(system, pdb.positions)
        integrator = openmm.LangevinMiddleIntegrator(KELVIN, 1, 0.002)
        integrator.setRandomNumberSeed(1)
        context = openmm.Context(system, integrator, openmm.Platform.getPlatform("Reference"))
        context.setPositions(start.getPositions())
        context.setVelocities(start.getVelocities())
        frames = []
        for _ in range(max(2, round(ps / 0.2))):
            integrator.step(100)
            frames.append(context.getState(getPositions=True).getPositions(asNumpy=True)._value)
        found[name] = angles(pdb.topology, np.array(frames))
    return found


def table(header: list[str], rows: list[list[str]]) -> str:
    """An HTML table."""
    line = lambda cells, tag: "<tr>" + "".join(f"<{tag}>{escape(c)}</{tag}>" for c in cells) + "</tr>"  # noqa: E731
    return f"<table>{line(header, 'th')}{''.join(line(row, 'td') for row in rows)}</table>"


def chart(found: list[Noise], x: str, label: str) -> str:
    """Noise against a column, both logarithmic, as SVG."""
    width, height, left, bottom = 640, 360, 70, 50
    points = [(n.program, getattr(n, x), n.noise) for n in found if np.isfinite(n.noise) and n.noise > 0]
    if not points:
        return ""
    xs, ys = (np.log10([p[k] for p in points]) for k in (1, 2))
    (x0, x1), (y0, y1) = ((np.floor(2 * v.min() - 0.1) / 2, np.ceil(2 * v.max() + 0.1) / 2) for v in (xs, ys))
    place_x = lambda v: left + (v - x0) / (x1 - x0) * (width - left - 20)  # noqa: E731
    place_y = lambda v: height - bottom - (v - y0) / (y1 - y0) * (height - bottom - 20)  # noqa: E731
    parts = [f'<svg viewBox="0 0 {width} {height}" width="{width}" role="img">']
    for v in range(int(np.ceil(x0)), int(np.floor(x1)) + 1):
        parts.append(f'<path class="g" d="M{place_x(v):.1f} 20V{height - bottom}"/>')
        parts.append(f'<text x="{place_x(v):.1f}" y="{height - bottom + 18}" text-anchor="middle">{10.0**v:g}</text>')
    for v in range(int(np.ceil(y0)), int(np.floor(y1)) + 1):
        parts.append(f'<path class="g" d="M{left} {place_y(v):.1f}H{width - 20}"/>')
        parts.append(f'<text x="{left - 6}" y="{place_y(v) + 4:.1f}" text-anchor="end">{10.0**v:g}</text>')
    for k, program in enumerate(dict.fromkeys(p[0] for p in points)):
        own = [(place_x(a), place_y(b)) for (p, *_), a, b in zip(points, xs, ys) if p == program]
        parts.append(f'<polyline class="c{k}" points="{" ".join(f"{a:.1f},{b:.1f}" for a, b in own)}"/>')
        parts += [f'<circle class="c{k}" cx="{a:.1f}" cy="{b:.1f}" r="3"/>' for a, b in own]
        parts.append(f'<text class="c{k}" x="{left + 10}" y="{36 + 17 * k}">{escape(program)}</text>')
    parts.append(f'<text x="{width / 2}" y="{height - 10}" text-anchor="middle">{escape(label)}</text>')
    parts.append(f'<text x="14" y="{height / 2}" transform="rotate(-90 14 {height / 2})" text-anchor="middle">energy noise, kJ/mol</text></svg>')
    return "".join(parts)


def ramachandran(name: str, density: np.ndarray) -> str:
    """A map of φ (to the right) and ψ (up)."""
    size, top = 9, np.sqrt(density.max()) or 1.0
    cells = [
        f'<rect x="{size * i}" y="{size * (BINS - 1 - j)}" width="{size}" height="{size}" fill-opacity="{np.sqrt(density[i, j]) / top:.2f}"/>'
        for i in range(BINS)
        for j in range(BINS)
        if density[i, j] > 0
    ]
    side = size * BINS
    return (
        f'<figure><svg viewBox="0 0 {side} {side}" width="{side}" class="map"><rect class="frame" width="{side}" height="{side}"/>'
        f"{''.join(cells)}</svg><figcaption>{escape(name)}</figcaption></figure>"
    )


STYLE = (
    "body{font:15px/1.5 sans-serif;max-width:1000px;margin:2em auto;padding:0 1em;color:#1c2126;background:#fff}table{border-collapse:collapse}"
    "td,th{padding:.2em .8em;text-align:right;border-bottom:1px solid #d5dbe1}td:first-child,th:first-child{text-align:left}"
    "text{font:13px sans-serif;fill:#1c2126}.g{stroke:#d5dbe1;fill:none}polyline{fill:none;stroke-width:2}figure{display:inline-block;margin:1em}"
    ".c0{stroke:#1d6fb8}.c1{stroke:#c2410c}.c2{stroke:#15803d}text[class]{stroke:none}text.c0{fill:#1d6fb8}text.c1{fill:#c2410c}text.c2{fill:#15803d}"
    ".map rect{fill:#1d6fb8}.map .frame{fill:none;stroke:#7f97b0}"
)


def page(title: str, noises: list[Noise], samples: dict[str, np.ndarray], ps: float, sampled_ps: float) -> str:
    """The page in HTML; nothing is loaded from elsewhere."""
    rows = [
        [n.program, f"{n.step_fs:g}", f"{n.noise:.3g}", f"{n.drift:.1e} ± {n.drift_error:.0e}", f"{1e3 * n.wall_s_per_ps:.3g}"]
        if np.isfinite(n.noise)
        else [n.program, f"{n.step_fs:g}", "failed", "", ""]
        for n in noises
    ]
    parts = [
        f"<!doctype html><html lang=en><meta charset=utf-8><title>{escape(title)}</title><style>{STYLE}</style><h1>{escape(title)}</h1>",
        f"<p>{datetime.date.today()}; {escape(platform.processor() or platform.machine())}; phipsi {phipsi.__version__}, OpenMM "
        f"{openmm.version.short_version} on its Reference platform; one run of each, on a machine that may have had other work.</p>",
        f"<h2>Constant energy</h2><p>{ps:g} ps each from 300 K, energies every {RECORD_FS:g} fs. Noise: root mean square of the total energy about a "
        "straight line. Drift: slope of a line through ten blocks, per degree of freedom. Wall time includes the energies.</p>",
        chart(noises, "step_fs", "step, fs"),
        chart(noises, "wall_s_per_ps", "wall time of a picosecond, s"),
        table(["", "step, fs", "noise, kJ/mol", "drift, kJ/mol/ps", "ms a ps"], rows),
    ]
    samples = {name: x for name, x in samples.items() if len(x)}
    if samples:
        densities = {name: histogram(x) for name, x in samples.items()}
        halves = {name: hellinger(histogram(x[: len(x) // 2]), histogram(x[len(x) // 2 :])) for name, x in samples.items()}
        rows = [
            [name, str(len(samples[name])), f"{halves[name]:.3f}", *(f"{hellinger(densities[name], d):.3f}" for d in densities.values())]
            for name in samples
        ]
        parts += [
            f"<h2>φ and ψ at 300 K</h2><p>{sampled_ps:g} ps each; φ to the right, ψ up, from −180° to 180°; shades by the root of the density. Hellinger's "
            "distances, and that of the two halves of each run: a distance that is not larger says nothing.</p>",
            *(ramachandran(name, d) for name, d in densities.items()),
            table(["", "samples", "own halves", *densities], rows),
        ]
    return "\n".join(parts)


def compare(pdb_path: Path, xml: Path, ps: float, sampled_ps: float, torsion: Any = TORSION_STEPS, cartesian: Any = CARTESIAN_STEPS):
    """Noises and samples of one molecule."""
    pdb = app.PDBFile(str(pdb_path))
    s = phipsi.molecule.System.from_files(pdb_path, xml)
    systems = {name: openmm_system(xml, constrain) for name, constrain in (("OpenMM, all atoms", False), ("OpenMM, X–H constrained", True))}
    noises = torsion_noise(s, ps, torsion)
    for name, system in systems.items():
        noises += cartesian_noise(system, pdb.positions.in_units_of(unit.nanometer), name, ps, cartesian)
    samples = distributions(s, pdb, systems, sampled_ps) if sampled_ps > 0 else {}
    return noises, samples


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="python -m validation.dynamics", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="*", type=Path, metavar="FILE", help="a PDB file and its OpenMM System; default: alanine dipeptide")
    parser.add_argument("--ps", type=float, default=20.0, help="length of each run at constant energy")
    parser.add_argument("--sample-ps", type=float, default=1000.0, help="length of each run for the distribution of angles; 0: none")
    parser.add_argument("--out", type=Path, default=Path("dynamics.html"))
    options = parser.parse_args(arguments)
    if len(options.files) not in (0, 2):
        parser.error("give a PDB file and its System, or neither")
    pdb, xml = options.files or (EXAMPLES / "ala_dipeptide.pdb", EXAMPLES / "ala_dipeptide.xml")
    noises, samples = compare(pdb, xml, options.ps, options.sample_ps)
    title = f"Torsion dynamics beside Cartesian dynamics: {pdb.stem}"
    options.out.write_text(page(title, noises, samples, options.ps, options.sample_ps), encoding="utf-8")
    for n in noises:
        print(f"{n.program:26} {n.step_fs:5g} fs  noise {n.noise:9.3g} kJ/mol  drift {n.drift:9.1e} ± {n.drift_error:.0e}  {1e3 * n.wall_s_per_ps:8.3g} ms a ps")
    print(f"written: {options.out}")


if __name__ == "__main__":
    main()
