"""What Python adds to the kernels: one call, a batch, a step of a simulator."""

from __future__ import annotations

import os
import time
from dataclasses import asdict, dataclass

#: Threads of a batch, in Python and in Rust.
THREADS = min(2, os.cpu_count() or 1)
# Read at the first batch.
os.environ["RAYON_NUM_THREADS"] = str(THREADS)

import numpy as np

import phipsi

from .models import Case
from .programs import Phipsi
from .timer import Side, duration, median

#: A call on one state may cost so much above its kernel, ns.
CALL = 2000.0

#: A batch may cost so many times the Rust batch, and how many states it has.
BATCH, STATES = 1.3, 100_000

#: Batches of one measurement in Rust, so that the question itself does not count.
AT_ONCE = 20

#: Steps of a simulator.
STEPS = 20_000


@dataclass
class Figure:
    """A measured number, ns or a ratio; its bar."""

    what: str
    value: float
    unit: str
    bar: float | None = None

    def __str__(self) -> str:
        mark = "" if self.bar is None else f" ({'ok' if self.value <= self.bar else 'OVER'} {show(self.bar, self.unit)})"
        return f"{self.what}: {show(self.value, self.unit)}{mark}"


def show(value: float, unit: str) -> str:
    """A figure for people."""
    return duration(value) if unit == "ns" else f"{value:.3g} {unit}".strip()


def figures(case: Case, ours: Phipsi, rounds: int) -> list[Figure]:
    """All of them on one model."""
    return [*_one_call(case, ours, rounds), *_batch(case, ours, rounds), *_steps(case)]


def _one_call(case: Case, ours: Phipsi, rounds: int) -> list[Figure]:
    side = Side(ours.timer, ours.model, "forward_dynamics", ours.states)
    repetitions, forward = side.repetitions(), case.m.forward_dynamics
    calls, kernels = [], []
    for _ in range(rounds):
        begun = time.thread_time_ns()
        for q, v, tau, _ in case.states:
            forward(q, v, tau)
        calls.append((time.thread_time_ns() - begun) / len(case.states))
        kernels.append(side.time(repetitions))
    above = median(calls) - median(kernels)
    return [Figure(f"{case.name}: forward dynamics of one state above its kernel", above, "ns", CALL)]


def _batch(case: Case, ours: Phipsi, rounds: int) -> list[Figure]:
    """Wall time on as many threads as in Rust, taking turns."""
    repeat = -(-STATES // len(case.states))
    q, v, tau = (np.tile(np.array([s[i] for s in case.states]), (repeat, 1))[:STATES] for i in range(3))
    timer = ours.another_timer(THREADS)
    side = Side(timer, ours.model, "forward_dynamics_batch", f"random:{STATES}", STATES)
    batches, kernels = [], []
    try:
        side.time(STATES)
        case.m.forward_dynamics(q, v, tau)
        for _ in range(rounds):
            begun = time.perf_counter_ns()
            case.m.forward_dynamics(q, v, tau)
            batches.append((time.perf_counter_ns() - begun) / STATES)
            begun = time.perf_counter_ns()
            side.time(AT_ONCE * STATES)
            kernels.append((time.perf_counter_ns() - begun) / (AT_ONCE * STATES))
    finally:
        timer.close()
    what = f"{case.name}: forward dynamics of {STATES} states on {THREADS} threads, wall time per state"
    ratio = median(batches) / median(kernels)
    return [Figure(what, median(batches), "ns"), Figure(f"{case.name}: the same over the batch in Rust", ratio, "", BATCH)]


def _steps(case: Case) -> list[Figure]:
    q, v, *_ = case.states[0]
    simulator, dt, tau = phipsi.Simulator(case.m, q, 0.1 * v), 1e-3, np.zeros(case.m.nv)
    for _ in range(100):
        simulator.step(dt, tau)
    taken = np.empty(STEPS)
    for i in range(STEPS):
        begun = time.perf_counter_ns()
        simulator.step(dt, tau)
        taken[i] = time.perf_counter_ns() - begun
    middle, tail = np.percentile(taken, [50, 99.99])
    what = f"{case.name}: Simulator.step of 1 ms, wall time"
    return [Figure(f"{what}, median", float(middle), "ns"), Figure(f"{what}, 99.99th percentile", float(tail), "ns")]


def as_json(found: list[Figure]) -> list[dict]:
    """For the report."""
    return [asdict(figure) for figure in found]
