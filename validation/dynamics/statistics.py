"""Distributions of two angles: histograms, their distances, and whether one is flat."""

from __future__ import annotations

import math

import numpy as np

#: Bins of each angle.
BINS = 24


def histogram(samples: np.ndarray, bins: int = BINS) -> np.ndarray:
    """Frequencies of φ and ψ."""
    edges = np.linspace(-np.pi, np.pi, bins + 1)
    counts, _, _ = np.histogram2d(samples[:, 0], samples[:, 1], bins=(edges, edges))
    return counts / max(1.0, counts.sum())


def hellinger(a: np.ndarray, b: np.ndarray) -> float:
    """Hellinger's distance of two distributions: 0 for equal ones, 1 for such without overlap."""
    return float(np.sqrt(max(0.0, 1 - np.sum(np.sqrt(a * b)))))


def halves(samples: np.ndarray) -> float:
    """The distance of the two halves of one run: what chance alone gives to half of it."""
    middle = len(samples) // 2
    return hellinger(histogram(samples[:middle]), histogram(samples[middle:]))


def distance(a: np.ndarray, b: np.ndarray) -> tuple[float, float]:
    """Hellinger's distance of two runs, and without what chance adds to it.

    Of two runs of m and n independent samples, chance gives (B − 1)/8 · (1/m + 1/n) to the square of the distance, of halves of one
    run (B − 1)/2n: a quarter of the squares of the halves' distances is taken off.
    """
    plain = hellinger(histogram(a), histogram(b))
    chance = (halves(a) ** 2 + halves(b) ** 2) / 4
    return plain, math.sqrt(max(0.0, plain**2 - chance))


def modes(samples: np.ndarray) -> np.ndarray:
    """Cosines and sines of φ, ψ, φ + ψ, φ − ψ and of their doubles: (n, 16)."""
    phi, psi = samples.T
    found = [f(k * x) for x in (phi, psi, phi + psi, phi - psi) for k in (1, 2) for f in (np.cos, np.sin)]
    return np.column_stack(found)


def correlation(samples: np.ndarray) -> float:
    """Largest correlation of a mode with itself one sample later."""
    x = modes(samples)
    x = (x - x.mean(axis=0)) / x.std(axis=0)
    return float(np.abs((x[1:] * x[:-1]).mean(axis=0)).max())


def independent(samples: np.ndarray) -> tuple[np.ndarray, int]:
    """Every k-th sample, k the least such that neighbours are not correlated beyond four standard errors; and k."""
    for k in (1, 2, 3, 5, 8, 12, 20, 30):
        thinned = samples[::k]
        if correlation(thinned) < 4 / math.sqrt(len(thinned)):
            break
    return thinned, k


def flatness(samples: np.ndarray, bins: int = BINS) -> tuple[float, float, float]:
    """Of independent samples of a flat density: p-value of χ²; root mean square of (density/flat − 1) over the bins; and what chance
    gives to it, √(B/n)."""
    n, cells = len(samples), bins * bins
    expected = n / cells
    counts = histogram(samples, bins) * n
    chi2 = float(((counts - expected) ** 2 / expected).sum())
    rms = math.sqrt(chi2 / expected / cells)
    return upper_tail(chi2, cells - 1), rms, math.sqrt(cells / n)


def upper_tail(chi2: float, freedom: int) -> float:
    """Probability of a larger χ²: Wilson and Hilferty 1931, whose cube root of χ²/k is normal to O(1/k)."""
    variance = 2 / (9 * freedom)
    z = ((chi2 / freedom) ** (1 / 3) - (1 - variance)) / math.sqrt(variance)
    return 0.5 * math.erfc(z / math.sqrt(2))


def crossings(samples: np.ndarray) -> tuple[float, int]:
    """Fraction of samples with 0 < φ < 150°, and how often a run comes there or leaves: from below −30° to above 30° or back, on the
    side of φ = 0 or over 150°…−150°."""
    phi = np.degrees(samples[:, 0])
    inside = (phi > 0) & (phi < 150)
    where = np.where((phi > 30) & (phi < 120), 1, np.where((phi < -30) & (phi > -180), -1, 0))
    certain = where[where != 0]
    return float(inside.mean()), int(np.count_nonzero(np.diff(certain)))


def beside(samples: np.ndarray) -> np.ndarray:
    """Those that are not in 0 < φ < 150°."""
    phi = np.degrees(samples[:, 0])
    return samples[(phi <= 0) | (phi >= 150)]
