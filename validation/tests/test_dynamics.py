"""The page that sets torsion dynamics beside OpenMM's, and the parts of the whole comparison."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import openmm
import pytest

import phipsi
from validation.dynamics import angles, cost, folds, html, molecules, noise, one_molecule, statistics, steps, study
from validation.dynamics.results import Results

from .common import MOLECULE
from .test_molecule import DATA


@pytest.fixture(scope="module")
def plain():
    return molecules.from_files(*MOLECULE)


def test_the_page():
    noises, samples = one_molecule.compare(*MOLECULE, ps=2, sampled_ps=10, torsion=(1, 2, 4), cartesian=(1, 20))
    text = one_molecule.page("aladi", noises, samples, 2, 10)
    by = {(n.program, n.step_fs): n.noise for n in noises}
    torsion = [by["phipsi, torsions", dt] for dt in (1, 2, 4)]
    # Second order: a factor of four, with the scatter of 40 samples of a chaotic run.
    assert 2 < torsion[1] / torsion[0] < 8 and 2 < torsion[2] / torsion[1] < 8
    # Published noises of the Cartesian programs at 1 fs are 0.41 kJ/mol and below it with constraints.
    assert 0.1 < by["OpenMM, all atoms", 1] < 1 and by["OpenMM, X–H constrained", 1] < by["OpenMM, all atoms", 1]
    assert math.isnan(by["OpenMM, all atoms", 20]) and "failed" in text
    assert len(samples) == 4 and all(len(x) >= 50 and np.abs(x).max() <= math.pi for x in samples.values())
    assert text.count("<figure>") == 4 and "src=" not in text and "NaN" not in text and "nan" not in text


def test_distances_of_distributions():
    random = np.random.default_rng(1)
    x, y = (random.vonmises(0, 4, (20000, 2)) for _ in range(2))
    a, b = statistics.histogram(x), statistics.histogram(y)
    c = statistics.histogram(random.vonmises(math.pi, 30, (20000, 2)))
    assert statistics.hellinger(a, a) == pytest.approx(0, abs=1e-7)
    assert statistics.hellinger(a, b) < 0.1 < 0.9 < statistics.hellinger(a, c) <= 1
    # Chance alone: most of it is taken off; where there is a distance, it stays: von Mises with means apart by d has the squared
    # distance 1 − (I₀(κ cos d/2)/I₀(κ))² in two angles.
    plain, less = statistics.distance(x, y)
    assert less < 0.5 * plain
    far = 1 - (np.i0(4 * math.cos(0.25)) / np.i0(4)) ** 2
    _, less = statistics.distance(x, y + 0.5 - 2 * math.pi * np.round((y + 0.5) / (2 * math.pi)))
    # Bins of 15° take about 1 % off, 20000 samples scatter by as much.
    assert less == pytest.approx(math.sqrt(far), rel=0.03)


def test_flat_and_not_flat():
    random = np.random.default_rng(3)
    x = random.uniform(-math.pi, math.pi, (20000, 2))
    p, rms, chance = statistics.flatness(x)
    # Of 576 bins the root mean square scatters by 1/√1152 of itself.
    assert 1e-3 < p < 0.999 and abs(rms / chance - 1) < 4 / math.sqrt(1152)
    bent = x[random.uniform(0, 1, len(x)) < 0.5 * (1 + 0.3 * np.cos(x[:, 0]))]
    p, rms, chance = statistics.flatness(bent)
    # 0.3 cos φ has the root mean square 0.3/√2.
    assert p < 1e-9 and math.sqrt(rms**2 - chance**2) == pytest.approx(0.3 / math.sqrt(2), rel=0.1)
    # χ² of one degree of freedom more than 100 at its 95th percentile; of 575 at the 50th.
    assert statistics.upper_tail(124.342, 100) == pytest.approx(0.05, abs=2e-4)
    assert statistics.upper_tail(574.33, 575) == pytest.approx(0.5, abs=1e-3)


def test_correlated_samples_are_thinned():
    random = np.random.default_rng(4)
    walk = np.cumsum(random.normal(0, 0.5, (20000, 2)), axis=0)
    walk -= 2 * math.pi * np.round(walk / (2 * math.pi))
    thinned, k = statistics.independent(walk)
    # ⟨cos⟩ is multiplied by e^(−0.125) each sample: e^(−0.125 k) below 4 √(k/20000) from k = 19 on.
    assert statistics.correlation(walk) > 0.8 and k >= 12 and len(thinned) == math.ceil(20000 / k)
    assert statistics.independent(random.uniform(-3, 3, (5000, 2)))[1] == 1


def test_crossings_are_counted():
    phi = np.radians([-80, -60, -10, 20, 60, 70, 20, -40, -150, 170, 100, 60])
    inside, crossed = statistics.crossings(np.column_stack([phi, 0 * phi]))
    assert inside == pytest.approx(6 / 12) and crossed == 3


def test_noise_and_drift_of_known_energies():
    random = np.random.default_rng(2)
    t = np.linspace(0, 10, 2000)
    n = noise.noise_of("x", 1.0, t, 3 + 0.5 * t + 0.01 * random.normal(size=t.size), 10, 5.0)
    assert n.noise == pytest.approx(0.01, rel=0.1) and abs(n.drift - 0.05) < 5 * n.drift_error < 1e-3
    assert n.processor_s_per_ps == pytest.approx(0.5)


def test_largest_steps_and_medians():
    assert noise.largest_step([1, 2, 3, 4], [0.1, 0.2, 0.5, 0.1], 0.3) == 2
    assert noise.largest_step([2, 1], [-0.2, 0.1], 0.3) == 2 and noise.largest_step([1], [math.nan], 1) == 0
    assert noise.order([1, 2, 4], [0.1, 0.4, 1.6]) == pytest.approx(2)
    runs = [noise.Noise("x", 2.0, n, d, 0.1, 1.0, 300.0) for n, d in ((1, -5), (3, 1), (2, 2))]
    assert noise.median(runs)[2:4] == (2, 2)
    # One failure of three is the noisiest, two are a failure.
    lost = noise.failed("x", 2.0)
    assert noise.median([*runs[:2], lost])[2:4] == (3, -5) and math.isnan(noise.median([runs[0], lost, lost]).noise)


def test_heavy_hydrogens_and_constraints(plain):
    heavy = molecules.heavy_hydrogens(plain, 3.0)
    m, old = molecules.masses(heavy.system), molecules.masses(plain.system)
    assert m.sum() == pytest.approx(old.sum()) and np.count_nonzero(m == 3.0) == 12 == np.count_nonzero(old < 1.5)
    # A methyl: its carbon gives to three.
    assert m[0] == pytest.approx(old[0] - 3 * (3.0 - 1.008))
    assert molecules.constrained(heavy).system.getNumConstraints() == 12 and not plain.system.getNumConstraints()
    assert phipsi.molecule.TorsionModel(heavy.phipsi()).degrees_of_freedom == 13


def energies(molecule: molecules.Molecule) -> dict[str, float]:
    return molecule.phipsi().energy()


def test_what_clusters_hold_is_stiffened(plain):
    random = np.random.default_rng(5)
    moved = plain._replace(positions=plain.positions + random.normal(0, 0.003, plain.positions.shape))
    one, ten = energies(moved), energies(molecules.stiffened(moved, 10.0))
    for term in ("HarmonicBondForce", "HarmonicAngleForce"):
        assert ten[term] == pytest.approx(10 * one[term], rel=1e-12)
    assert ten["NonbondedForce"] == pytest.approx(one["NonbondedForce"], rel=1e-12)
    # Impropers alone among the torsions: of torsions that clusters can turn none has changed.
    t = phipsi.molecule.TorsionModel(plain.phipsi())
    q = t.model.integrate(t.q, random.uniform(-1, 1, t.model.nv))
    x = [plain._replace(positions=t.atom_positions(p)) for p in (t.q, q)]
    differences = [energies(molecules.stiffened(m, f))["PeriodicTorsionForce"] for f in (1.0, 10.0) for m in x]
    assert abs(differences[1] - differences[0]) > 1
    assert differences[3] - differences[2] == pytest.approx(differences[1] - differences[0], rel=1e-9)


def test_springs_at_rest(plain):
    """No other geometry nearby has less energy of the springs; pairs do not count."""
    rest = molecules.springs_at_rest(plain)

    def springs(m: molecules.Molecule) -> float:
        one, two = energies(m), energies(molecules.stiffened(m, 2.0))
        return two["total"] - one["total"]

    # Twice the constants less once: bonds, angles, impropers alone.
    least = springs(rest)
    assert least < springs(plain)
    random = np.random.default_rng(6)
    for _ in range(5):
        assert springs(rest._replace(positions=rest.positions + random.normal(0, 1e-4, rest.positions.shape))) > least


def test_without_pairs_nothing_depends_on_phi_and_psi(plain):
    at = angles.backbone(plain)
    names = plain.phipsi().atom_names
    assert [names[at[k]] for k in ("before", "N", "CA", "C", "after")] == ["ACE1:C", "ALA2:N", "ALA2:CA", "ALA2:C", "NME3:N"]
    assert [[names[i] for i in four] for four in angles.amides(plain)] == [
        ["ACE1:CH3", "ACE1:C", "ALA2:N", "ALA2:CA"],
        ["ALA2:CA", "ALA2:C", "NME3:N", names[18]],
    ]
    # Both amides of the file are trans.
    assert angles.with_amides(plain, plain.positions[None]).shape == (1, 4)
    assert len(angles.trans(angles.with_amides(plain, plain.positions[None]))) == 1
    axes = [(at["N"], at["CA"]), (at["CA"], at["C"])]
    bare = molecules.without_pairs(plain, axes)
    t = phipsi.molecule.TorsionModel(bare.phipsi(), hinges=[list(a) for a in axes])
    assert t.degrees_of_freedom == 8
    turned = np.zeros((20, 8))
    turned[:, 6:] = np.random.default_rng(7).uniform(-3, 3, (20, 2))
    x = t.atom_positions(t.model.integrate(t.model.neutral(), turned))
    energy = np.array([bare.phipsi().energy(p)["total"] for p in x])
    everything = np.array([plain.phipsi().energy(p)["total"] for p in x])
    # Rounding of terms of some 100 kJ/mol.
    assert np.ptp(energy) < 1e-9 < 1 < np.ptp(everything)


def test_torsions_sample_flat_angles(plain):
    at = angles.backbone(plain)
    bare = molecules.without_pairs(plain, [(at["N"], at["CA"]), (at["CA"], at["C"])])
    samples, acceptance = angles.torsion_samples(bare, 1500, 20.0, True, 300.0, trajectory_ps=0.5)
    thinned, _ = statistics.independent(samples[:, :2])
    assert samples.shape == (1500, 4) and len(angles.trans(samples)) == np.count_nonzero(np.cos(samples[:, 2:]).max(axis=1) < 0)
    assert acceptance > 0.8 and statistics.flatness(thinned, bins=6)[0] > 1e-3


def test_runs_of_a_case(plain):
    case = steps.Case("torsions, fused", "phipsi", None, {"rigid": ["methyl"]}, (2, 200))
    runs = steps.torsion_runs(plain, case, 2, 2.0)
    assert len(runs) == 2 and all(n.noise < 0.1 and 150 < n.kelvin < 450 for n in runs[0])
    assert all(math.isnan(n.noise) for n in runs[1])


def test_largest_steps_are_summarized():
    run = lambda step, n, d: noise.Noise("x", step, n, d, 1e-6, 1.0, 300.0)._asdict()  # noqa: E731
    found = {"cases": [
        {"label": "Cartesian, all atoms", "program": "OpenMM", "runs": [run(1, 0.4, 0.0), run(2, 1.6, 0.0)]},
        {"label": "torsions", "program": "phipsi", "runs": [run(1, 0.01, 1e-6), run(2, 0.04, 1e-5), run(4, 0.16, 1e-4), run(8, 0.64, 5e-4)]},
    ]}  # fmt: skip
    steps.summarize(found)
    assert found["reference_noise"] == 0.4 and found["cases"][1]["noise_step"] == 4 and found["cases"][1]["drift_step"] == 8
    assert found["cases"][1]["order"] == pytest.approx(2) and found["cases"][0]["noise_step"] == 1
    assert cost.largest_steps([{"name": "aladi", **found}]) == {"aladi": 4}
    table = study.verdicts({"steps": [{"name": "aladi", **found}]})
    assert [(row[1], row[3], row[4]) for row in table] == [(15, 4, False), (15, 8, False)]
    assert found["cases"][1]["kelvin"] == [300, 300]
    assert [study._largest(c, "noise_step") for c in found["cases"]] == ["1", "4"] and study._largest(found["cases"][1], "drift_step") == "≥ 8"
    page = study.page({"steps": [{"name": "aladi", "starts": 1, "ps": 1.0, **found}]}, "command")
    assert "Missed: alanine dipeptide: largest step by noise, fs is 4 where 15 is required" in " ".join("".join(page.markdown).split())


def test_costs_are_taken_in_turns(plain):
    t = cost.warm(plain)
    free = cost.moving_freely(t, plain)
    # The same state, without forces: kinetic energy, and nothing that pushes.
    assert free.model.kinetic_energy(free.q, free.v) == pytest.approx(t.model.kinetic_energy(t.q, t.v), rel=1e-9)
    r = free.run(100, dt_fs=5, every=1)
    # Free motion keeps its energy to second order: with all forces the noise is 0.02 kJ/mol at this step.
    assert not r.potential_energy.any() and np.ptp(r.kinetic_energy) < 0.02
    seen = []
    calls = {name: (lambda count, name=name: seen.append((name, count)), 20) for name in "ab"}
    found = cost.in_turns(calls, 3)
    assert seen == [("a", 2), ("b", 2)] + 3 * [("a", 20), ("b", 20)] and set(found["a"]) == {"processor_s", "spread", "wall_s"}


def test_copies_side_by_side(plain):
    three = molecules.copies(plain, 3, 1.0)
    s = three.phipsi()
    assert s.n_atoms == 66 and len(phipsi.molecule.TorsionModel(s).clusters) == 24
    context = molecules.new_context(three.system, openmm.VerletIntegrator(0.001))
    context.setPositions(three.positions)
    assert s.energy()["total"] == pytest.approx(context.getState(getEnergy=True).getPotentialEnergy()._value, rel=1e-9)


def test_folds_are_measured():
    peptide = molecules.from_folder(DATA, "ace_ala3_nme", "GBSAOBC")
    frames = np.stack([peptide.positions] * 6)
    # A rigid motion is none.
    frames[1:] = frames[1:] @ np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]) + 1.0
    found = folds.fold(peptide, frames)
    assert found["residues"] == 3 and found["largest"] < 1e-4 and found["helical"] == found["helical_start"]
    # Frame by frame: all three residues of the first before those of the second.
    turns = folds.backbone_angles(peptide, frames).reshape(3, 3, 2)
    assert np.abs(turns - turns[0]).max() < 1e-3 < np.ptp(turns[0], axis=0).min()


def test_results_are_kept(tmp_path):
    results, calls = Results(tmp_path / "r"), []
    for _ in range(2):
        assert results.once("a, b×2", lambda: calls.append(1) or {"x": 1}) == {"x": 1}
        assert results.array("c", lambda: calls.append(2) or np.eye(2)).tolist() == [[1, 0], [0, 1]]
    assert calls == [1, 2] and len(list((tmp_path / "r").iterdir())) == 2
    assert Results(None).once("a", lambda: 3) == 3


def test_pages_of_the_other_parts():
    """Numbers that are given are on the page."""
    times = {"processor_s": 1e-4, "wall_s": 2e-4, "spread": 0.1}
    part = {"times": {"phipsi, dynamics part": times}, "clusters": 100, "freedom": 105, "ratio": 0.1, "ratio_default": 0.02, "ratio_wall": 0.1, "ratio_default_wall": 0.02}
    day = {"name": "ala10", "environment": "vacuum", "step_fs": 10, "ns_per_day": {"phipsi": 200.0, "phipsi, Fixman": 180.0, "OpenMM": 50.0}}
    growth = [{"clusters": 100 * k, "atoms": 300 * k, "times": {n: {"processor_s": 1e-4 * k**1.1} for n in ("dynamics part", "whole step")}} for k in (1, 10)]
    loaded = lambda value: {"load": 1.0, "rounds": 3, "value": value}  # noqa: E731
    random, samples = np.random.default_rng(8), {}
    labels = [*(f"all atoms, springs × {k}" for k in (1, 10, 100)), "torsions with Fixman's potential, springs at rest", "torsions, springs at rest"]
    for label in labels:
        samples[label] = random.vonmises(-1.5, 4, (20000, 2))
    samples[labels[0]] += 0.3
    flat = [{"fixman": f, "samples": 100, "every": 2, "p": 0.5, "rms": 0.3, "chance": 0.2} for f in (True, False)]
    found = {
        "cost": {"part": loaded(part), "day": loaded([day]), "growth": loaded(growth)},
        "angles": {"kelvin": 600.0, "flat": flat, "runs": angles.compared(samples, {label: 0.0 for label in labels})},
    }
    text = "\n".join(study.page(found, "command").markdown)
    assert "one thread is 0.1 where 0.08 is required" in " ".join(text.split()) and "| 1000 | 3000 | 1.26 | 1.26 | 1.26 | 1.26 |" in text
    assert "| Ala10, vacuum | 10 | 200 | 180 | 50 | 4.0 |" in text and "| without | 100 | 2 | 0.5 | 0.300 | 0.200 | 0.224 |" in text
    away = found["angles"]["runs"][labels[3]]["distances_beside"]
    # Moved by 0.3 rad, as in the test of distances; to samples of the same distribution it is what is left of chance.
    known = math.sqrt(1 - (np.i0(4 * math.cos(0.15)) / np.i0(4)) ** 2)
    assert away[labels[0]][1] == pytest.approx(known, rel=0.05) and away[labels[1]][1] < 0.2 * known
    assert f"{away[labels[0]][1]:.3f}, {away[labels[1]][1]:.3f}" in " ".join(text.split())


def test_pages_are_html_and_markdown():
    p = html.Page("A & B")
    p.heading("Steps")
    p.text("By `x < 1`.")
    p.table(["", "a|b"], [["c", "1"]])
    p.table([""], [["in HTML alone"]], is_long=True)
    p.figure(html.chart({"torsions": [(1, 0.1), (2, 0.4)], "lost": [(4, math.nan)]}, "step, fs"))
    text, markdown = "\n".join(p.html), "\n".join(p.markdown)
    assert "<title>A &amp; B</title>" in text and "<code>x &lt; 1</code>" in text and "polyline" in text and "lost" not in text and "in HTML alone" in text
    assert markdown.startswith("# A & B\n") and "| c | 1 |" in markdown and "a\\|b" in markdown and "svg" not in markdown and "alone" not in markdown


def test_the_whole_comparison_in_short(tmp_path, monkeypatch):
    """Largest steps of one molecule, and the page of them."""
    monkeypatch.setattr(study, "NAMES", {"aladi": "alanine dipeptide"})
    monkeypatch.setattr(steps, "FREE", (1, 2))
    monkeypatch.setattr(steps, "CONSTRAINED", (2,))
    monkeypatch.setattr(steps, "HEAVY", (4,))
    monkeypatch.setattr(steps, "FINE", {"aladi": (12,)})
    found = study.measure(Path(DATA), ["steps"], Results(tmp_path), starts=1, rounds=1, scale=0.02)
    page = study.page(found, "command")
    torsions = next(c for c in found["steps"][0]["cases"] if c["label"] == "torsions")
    # Second order: within a factor of two over a factor of four of steps, in 2 ps of a chaotic run.
    assert abs(torsions["order"] - 2) < 0.5
    text = "\n".join(page.markdown)
    assert "alanine dipeptide: largest step by noise, fs" in text and "nan" not in text and "inf" not in text
    assert len(list(tmp_path.glob("steps.aladi.*.json"))) == 7 and json.loads(json.dumps(found))
