"""The whole comparison as a page: tables of all parts, and what was asked for beside what was found."""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import openmm

import phipsi

from . import angles, cost, folds, html, steps
from .results import Results

PARTS = ("steps", "cost", "angles", "folds")

NAMES = {"aladi": "alanine dipeptide", "ala10": "Ala10", "trpcage": "Trp-cage"}

#: Largest steps that are asked for, fs: by noise, by drift; and what is hoped for.
NOISE_BAR = {"aladi": (15, 16), "ala10": (12, 14), "trpcage": (6, 8)}
DRIFT_BAR = {"aladi": (15, 18), "ala10": (12, 14), "trpcage": (6, 8)}

#: Dynamics part of a step over the forces of OpenMM's CPU platform: asked for, hoped for.
COST_BAR = (0.08, 0.04)


def measure(folder: Path, parts: list[str], results: Results, starts: int, rounds: int, scale: float) -> dict[str, Any]:
    """All parts."""
    found: dict[str, Any] = {}
    if "steps" in parts:
        found["steps"] = [steps.measure(folder, name, starts, results, scale) for name in NAMES]
    if "cost" in parts:
        found["cost"] = cost.measure(folder, results, rounds, cost.largest_steps(found.get("steps", [])))
    if "angles" in parts:
        found["angles"] = angles.measure(folder, results, scale)
    if "folds" in parts:
        found["folds"] = results.once("folds", lambda: folds.measure(folder, results, scale))
    return found


def verdicts(found: dict[str, Any]) -> list[tuple[str, float, float, float, bool]]:
    """What was asked for: what, required, hoped for, found, whether it is met."""
    rows = []
    for one in found.get("steps", []):
        plain = next(c for c in one["cases"] if c["label"] == "torsions")
        name = one["name"]
        for kind, bar in (("noise", NOISE_BAR[name]), ("drift", DRIFT_BAR[name])):
            step = plain[f"{kind}_step"]
            rows.append((f"{NAMES[name]}: largest step by {kind}, fs", *bar, step, step >= bar[0]))
    if "cost" in found:
        part = found["cost"]["part"]["value"]
        for key, of in (("ratio", "one thread"), ("ratio_default", "threads by default")):
            rows.append((f"Trp-cage: dynamics part over OpenMM's forces, {of}", *COST_BAR, part[key], part[key] <= COST_BAR[0]))
    return rows


def page(found: dict[str, Any], command: str) -> html.Page:
    """The page."""
    p = html.Page("Torsion dynamics beside OpenMM")
    p.text(
        f"Written by `{command}`. {time.strftime('%Y-%m-%d')}; {platform.machine()}, {_processor()}, {os.cpu_count()} cores, shared with other "
        f"work; phipsi {phipsi.__version__}, OpenMM {openmm.version.short_version}; parts one after the other. ff14SB; PDB files and Systems of the folder of molecules. Rigid "
        "clusters joined by all torsions (phipsi, double precision) beside all atoms (OpenMM; Reference platform, double precision, where none is named)."
    )
    rows = verdicts(found)
    if rows:
        p.heading("Asked for and found")
        p.table(["", "required", "hoped for", "found"], [[w, f"{a:g}", f"{h:g}", f"{x:.3g}"] for w, a, h, x, _ in rows])
        missed = [f"{what} is {x:.3g} where {a:g} is required" for what, a, _, x, met in rows if not met]
        p.text(f"Missed: {'; '.join(missed)}." if missed else "All that is required is met.")
        short = [f"{what} is {x:.3g} where {h:g} was hoped for" for what, a, h, x, met in rows if met and (x < h if a < h else x > h)]
        if short:
            p.text(f"Short of what was hoped for: {'; '.join(short)}.")
    sections: dict[str, Callable[[html.Page, Any], None]] = {"steps": _steps, "cost": _cost, "angles": _angles, "folds": _folds}
    for part, write in sections.items():
        if part in found:
            write(p, found[part])
    return p


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or platform.system()
    return next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), platform.system())


def _steps(p: html.Page, found: list[dict[str, Any]]) -> None:
    p.heading("Largest steps at constant energy")
    lengths = ", ".join(f"{f['ps']:g} ps ({NAMES[f['name']]})" for f in found)
    p.text(
        f"In vacuum, from {found[0]['starts']} starts whose mean temperature is within 5 % of 300 K: runs of "
        f"{lengths}, energies every {steps.RECORD_FS:g} fs. Noise: root mean square of the energy about a straight "
        "line. Drift: slope of a line through the means of ten blocks, per degree of freedom, ± its error; the energy that a "
        "symplectic method keeps is another one, so that energies of short runs also move without drift. Medians over the starts; a run that fails counts as the noisiest. "
        "A largest step is one that passes with all smaller ones that were tried: by noise, below that of all atoms at 1 fs; by drift, "
        "at most 1e-3 kJ/mol/ps per degree of freedom. K: mean temperatures, least and largest of the medians at the steps that pass. "
        "Torsions are those of all bonds, ω, CH₃, NH₃ and OH included. H of 3 or 4 Da: at the cost of the atom beside."
    )
    rows = []
    for f in found:
        for k, c in enumerate(f["cases"]):
            at = {r["step_fs"]: r["noise"] for r in c["runs"]}
            some = [f"{at[s]:.2g}" if np.isfinite(at.get(s, np.nan)) else "failed" if s in at else "–" for s in (1, 2, 4, 8, 12)]
            order = f"{c['order']:.2f}" if "order" in c else "–"
            kelvin = f"{c['kelvin'][0]:.0f} … {c['kelvin'][1]:.0f}" if c["kelvin"] else "–"
            largest = [_largest(c, kind) for kind in ("noise_step", "drift_step")]
            rows.append([NAMES[f["name"]] if k == 0 else "", c["label"], *largest, *some, order, kelvin])
    p.table(["", "", "largest step by noise, fs", "by drift, fs", "noise at 1 fs, kJ/mol", "2", "4", "8", "12", "order", "K"], rows)
    p.text(
        f"Order: slope of the logarithm of the noise against that of the step, 1 to {steps.FIT_TO} fs. ≥: all steps that were tried pass; <: none does. Drift of plain torsions and of all "
        "atoms at the steps about their largest ones (the page in HTML has all cases at all steps):"
    )
    header = ["", "", "step, fs", "noise, kJ/mol", "drift, kJ/mol/ps per degree of freedom", "K"]
    rows, few = [], []
    for f in found:
        for c in f["cases"]:
            for r in c["runs"]:
                good = np.isfinite(r["noise"])
                drift = [f"{r['drift']:.1e} ± {r['drift_error']:.0e}", f"{r['kelvin']:.0f}"] if np.isfinite(r["drift"]) else ["failed", "–"]
                rows.append([NAMES[f["name"]], c["label"], f"{r['step_fs']:g}", f"{r['noise']:.2g}" if good else "failed", *drift])
                near = min(c["noise_step"], c["drift_step"]) / 2 <= r["step_fs"] <= 1.2 * max(c["noise_step"], c["drift_step"])
                if near and c["label"] in ("torsions", "Cartesian, all atoms", "Cartesian, X–H constrained"):
                    few.append(rows[-1])
    p.table(header, few)
    p.table(header, rows, is_long=True)
    for f in found:
        p.figure(f"<h3>{NAMES[f['name']]}</h3>")
        p.figure(html.chart({c["label"]: [(r["step_fs"], r["noise"]) for r in c["runs"]] for c in f["cases"]}, "step, fs"))


def _largest(case: dict[str, Any], kind: str) -> str:
    tried = [r["step_fs"] for r in case["runs"]]
    if not case[kind]:
        return f"< {min(tried):g}"
    return f"{'≥ ' if case[kind] == max(tried) else ''}{case[kind]:g}"


def _microseconds(times: dict[str, float]) -> list[str]:
    return [f"{1e6 * times['processor_s']:.4g}", f"{1e6 * times['wall_s']:.4g}", f"{100 * times['spread']:.0f} %"]


def _cost(p: html.Page, found: dict[str, Any]) -> None:
    part, value = found["part"], found["part"]["value"]
    p.heading("Cost of a step")
    p.text(
        f"One core for both programs, in turns, {part['rounds']} rounds (load {part['load']:.1f} from other work): medians of processor times, the least wall time, and how far the "
        f"processor times of the rounds are apart. Trp-cage, {value['clusters']} clusters, {value['freedom']} degrees of freedom, steps of {cost.STEP_FS:g} fs, drifts "
        "solved to rounding. The dynamics part is a step of the same state without forces: positions, generalised forces and the drift remain. OpenMM's CPU platform "
        "wakes its threads at every call, also where it has one; as many as it takes by itself share the one core here."
    )
    p.table(["Trp-cage", "processor time, µs", "wall time, µs", "apart by"], [[name, *_microseconds(t)] for name, t in value["times"].items()])
    p.text(
        f"Dynamics part over energy and forces with GBSAOBCForce: {value['ratio']:.3f} of the CPU platform with one thread, {value['ratio_default']:.3f} with its default "
        f"(by least wall times {value['ratio_wall']:.3f} and {value['ratio_default_wall']:.3f})."
    )
    day = found["day"]
    p.text(
        f"Nanoseconds a day of one core's processor time, in a bath of 300 K (load {day['load']:.1f}): torsions at a cautious step and at the largest of the tables above (of "
        f"vacuum, taken with GBSAOBC too), and OpenMM's CPU platform on one thread with steps of {cost.HEAVY_FS:g} fs, hydrogens of 3 Da and bonds to them constrained. Such steps "
        "are not equally accurate: the noise of both is in the tables above. Rates of torsions are not those of the flexible molecule either; what is gained is sampling."
    )
    rows = []
    for d in day["value"]:
        n = d["ns_per_day"]
        rows.append([f"{NAMES[d['name']]}, {d['environment']}", f"{d['step_fs']:g}", *(f"{n[k]:.0f}" for k in n), f"{n['phipsi'] / n['OpenMM']:.1f}"])
    p.table(["", "step of torsions, fs", "torsions, ns a day", "with Fixman's potential", "OpenMM CPU, 4 fs", "ratio"], rows)
    growth = found["growth"]
    p.text(f"Trp-cage side by side again and again, vacuum with a cutoff of {cost.CUTOFF:g} nm, one core, steps of {cost.STEP_FS:g} fs (load {growth['load']:.1f}); processor times:")
    rows, first = [], growth["value"][0]
    for g in growth["value"]:
        each = [1e6 * g["times"][k]["processor_s"] / g["clusters"] for k in ("dynamics part", "whole step")]
        base = [1e6 * first["times"][k]["processor_s"] / first["clusters"] for k in ("dynamics part", "whole step")]
        rows.append([str(g["clusters"]), str(g["atoms"]), *(x for e, b in zip(each, base) for x in (f"{e:.3g}", f"{e / b:.2f}"))])
    p.table(["clusters", "atoms", "dynamics part, µs a cluster", "relative", "whole step, µs a cluster", "relative"], rows)


def _angles(p: html.Page, found: dict[str, Any]) -> None:
    p.heading("φ and ψ of alanine dipeptide")
    p.text(
        "Without forces: the System without NonbondedForce and without the torsion terms about N–CA and CA–C; torsions about the other bonds stay, on which φ and ψ do not depend. "
        "Hybrid Monte Carlo at 300 K, trajectories of 0.5 ps, every k-th picosecond such that neighbours are not correlated. p: χ² of 24 × 24 bins against a flat density. Deviation: "
        "root mean square of density over flat density less one, and what chance gives to it."
    )
    rows = []
    for f in found["flat"]:
        beyond = max(0.0, f["rms"] ** 2 - f["chance"] ** 2) ** 0.5
        label = "with Fixman's potential" if f["fixman"] else "without"
        rows.append([label, str(f["samples"]), str(f["every"]), f"{f['p']:.2g}", *(f"{x:.3f}" for x in (f["rms"], f["chance"], beyond))])
    p.table(["", "samples", "k", "p", "deviation", "by chance", "beyond it"], rows)
    p.text(
        f"With all forces in vacuum, at {found['kelvin']:g} K, because flexible molecules hardly cross to φ > 0 at 300 K: OpenMM's Langevin dynamics of all atoms, with the "
        "constants of bonds, angles and impropers times 1, 10, 100 (hydrogens of 12 Da there, on which averages of flexible molecules do not depend), and hybrid Monte Carlo of "
        "torsions, whose clusters have the geometry of springs at rest (the minimum of bonds, angles and impropers alone) or, where none is named, of the energy's minimum. A "
        "sample each picosecond; those with an amide at cis are left out. Hellinger's distances of 24 × 24 bins; in brackets without what chance adds, by the distances of "
        "halves. All atoms come near to torsions as the springs become stiff, if Fixman's potential is right."
    )
    targets = [label for label in found["runs"] if "all atoms" in label]
    for key, own_halves in (("distances", "halves"), ("distances_beside", "halves_beside")):
        rows = []
        for label, r in found["runs"].items():
            own = [f"{r[key][t][0]:.3f} ({r[key][t][1]:.3f})" if t != label else "–" for t in targets]
            visits = [str(r["samples"]), f"{r['cis']:.4f}", f"{r['positive']:.4f}", str(r["crossings"])] if key == "distances" else []
            rows.append([label, *visits, f"{r[own_halves]:.3f}", *own])
        if key == "distances_beside":
            p.text(
                "The share of φ > 0 is known as well as there are crossings. The same of the samples that are not in 0 … 150°, where all runs begin and go from basin "
                "to basin in picoseconds:"
            )
        visits = ["samples", "share of cis", "share of φ in 0 … 150°", "crossings"] if key == "distances" else []
        p.table(["", *visits, "own halves", *(f"to {t}" for t in targets)], rows)
    p.text(_conclusion(found["runs"], targets))
    for label, r in found["runs"].items():
        p.figure(html.ramachandran(label, np.array(r["density"])))


def _conclusion(runs: dict[str, Any], targets: list[str]) -> str:
    """Distances of the samples beside φ > 0 in words."""
    away = {label: [r["distances_beside"][t][1] for t in targets] for label, r in runs.items()}
    stiff, rigid = (", ".join(f"{x:.3f}" for x in away[label][:3]) for label in runs if label.endswith("springs at rest"))
    kinds = {label: f"{x[0]:.3f}" for label, x in away.items() if "all atoms" not in label}
    ordinary = "; ".join(f"{x} of {label}" for label, x in kinds.items())
    return (
        f"Without what chance adds, torsions with Fixman's potential and springs at rest are {stiff} away from all atoms with springs × 1, 10, 100, and {rigid} without it. "
        f"To the ordinary run (springs × 1) it is {ordinary}."
    )


def _folds(p: html.Page, found: list[dict[str, Any]]) -> None:
    p.heading("Peptides that keep their fold")
    own_steps = ", ".join(f"{s:g} fs for {NAMES[n]}" for n, s in folds.STEPS_FS.items())
    p.text(
        f"Langevin dynamics at {folds.KELVIN:g} K with GBSAOBC and a friction of {folds.FRICTION:g}/ps, {found[0]['ps']:g} ps from the minimum: torsions with Fixman's potential (steps of "
        f"{own_steps}), and OpenMM's CPU platform (4 fs, hydrogens of 3 Da, bonds to them constrained). Root mean square distance of the α carbons from "
        "the file's structure; helical residues by DSSP (mdtraj); of the second half. Angles: Hellinger's distance of the distributions of φ and ψ of all residues in that "
        "half, in brackets without what chance adds."
    )
    rows = []
    for f in found:
        between = f"{f['distance_of_angles'][0]:.3f} ({f['distance_of_angles'][1]:.3f})" if "distance_of_angles" in f else "–"
        helical = [str(f["helical_start"]), f"{f['helical']:.1f}", str(f["helical_least"])]
        rows.append([NAMES[f["name"]], f["program"], f"{f['distance']:.3f}", f"{f['largest']:.3f}", *helical, f"{f['halves']:.3f}", between])
    header = ["", "", "distance, nm", "largest", "helical residues of the file", "mean", "least", "angles: own halves", "between the programs"]
    p.table(header, rows)
