"""Noise and drift of the energy of a run at constant energy, and the largest step that keeps them small."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

#: kJ/mol/K (CODATA 2018).
BOLTZMANN = 0.00831446261815324

#: Interval of recorded energies, fs.
RECORD_FS = 50.0


class Noise(NamedTuple):
    """Energy of a run at constant energy: RMS about a straight line, kJ/mol; its slope and the error of it, kJ/mol/ps per degree of
    freedom; processor time of a picosecond, s; mean temperature, K. NaN where the run failed."""

    program: str
    step_fs: float
    noise: float
    drift: float
    drift_error: float
    processor_s_per_ps: float
    kelvin: float = float("nan")


def noise_of(
    program: str, step_fs: float, time_ps: np.ndarray, energy: np.ndarray, freedom: int, processor_s: float, kelvin: float = float("nan")
) -> Noise:
    """Fits a line; the error of its slope is that of a line through the means of ten blocks, which are nearly independent."""
    line = np.polynomial.Polynomial.fit(time_ps, energy, 1)
    blocks = [b.mean() for b in np.array_split(energy, 10)]
    times = np.array([b.mean() for b in np.array_split(time_ps, 10)])
    through, covariance = np.polyfit(times, blocks, 1, cov=True)
    noise = float(np.sqrt(np.mean((energy - line(time_ps)) ** 2)))
    error = float(np.sqrt(covariance[0, 0])) / freedom
    return Noise(program, step_fs, noise, float(through[0]) / freedom, error, processor_s / float(np.ptp(time_ps)), kelvin)


def failed(program: str, step_fs: float) -> Noise:
    """A run that did not reach its end."""
    return Noise(program, step_fs, *[float("nan")] * 5)


def median(runs: list[Noise]) -> Noise:
    """Of runs with one step: medians; a failed run counts as the noisiest, and most of them failed is failed. The drift is that of the run
    whose size of drift is the median."""
    order = sorted(runs, key=lambda n: abs(n.drift) if np.isfinite(n.drift) else np.inf)
    middle = order[len(order) // 2]
    if not np.isfinite(middle.drift):
        return failed(middle.program, middle.step_fs)
    high = [n.noise if np.isfinite(n.noise) else np.inf for n in runs]
    noise = float(np.sort(high)[len(high) // 2])
    good = [n for n in runs if np.isfinite(n.noise)]
    wall, kelvin = (float(np.median([getattr(n, k) for n in good])) for k in ("processor_s_per_ps", "kelvin"))
    return Noise(middle.program, middle.step_fs, noise, middle.drift, middle.drift_error, wall, kelvin)


def largest_step(steps_fs: list[float], values: list[float], bound: float) -> float:
    """The largest step such that it and all smaller ones have a value of at most ``bound``; 0 where none has."""
    largest = 0.0
    for step, value in sorted(zip(steps_fs, values)):
        if not abs(value) <= bound:
            break
        largest = step
    return largest


def order(steps_fs: list[float], noises: list[float]) -> float:
    """Slope of log noise against log step."""
    return float(np.polyfit(np.log(steps_fs), np.log(noises), 1)[0])
