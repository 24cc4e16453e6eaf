"""The page that sets torsion dynamics beside OpenMM's."""

from __future__ import annotations

import math

import numpy as np
import pytest

from validation import dynamics

from .common import MOLECULE


def test_the_page():
    noises, samples = dynamics.compare(*MOLECULE, ps=2, sampled_ps=10, torsion=(1, 2, 4), cartesian=(1, 20))
    text = dynamics.page("aladi", noises, samples, 2, 10)
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
    a, b = (dynamics.histogram(random.vonmises(0, 4, (20000, 2))) for _ in range(2))
    c = dynamics.histogram(random.vonmises(math.pi, 30, (20000, 2)))
    assert dynamics.hellinger(a, a) == pytest.approx(0, abs=1e-7)
    assert dynamics.hellinger(a, b) < 0.1 < 0.9 < dynamics.hellinger(a, c) <= 1


def test_noise_and_drift_of_known_energies():
    random = np.random.default_rng(2)
    t = np.linspace(0, 10, 2000)
    n = dynamics.noise_of("x", 1.0, t, 3 + 0.5 * t + 0.01 * random.normal(size=t.size), 10, 5.0)
    assert n.noise == pytest.approx(0.01, rel=0.1) and abs(n.drift - 0.05) < 5 * n.drift_error < 1e-3
    assert n.wall_s_per_ps == pytest.approx(0.5)
