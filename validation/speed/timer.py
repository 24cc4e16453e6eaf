"""A timer is a process that answers one line per question (see ``protocol.h``); several of them take turns."""

from __future__ import annotations

import os
import select
import statistics
import subprocess
from collections.abc import Sequence

import numpy as np

#: Least thread CPU time of one measurement, ns.
QUANTUM = 300e3

#: A call may take this long at most, s.
PATIENCE = 300.0


class TimerError(Exception):
    """A timer that answers with an error, with nonsense, or not at all."""


class Unsupported(TimerError):
    """An operation that a timer does not have."""


class Timer:
    """A running timer."""

    def __init__(self, name: str, command: Sequence[str], threads: int = 1) -> None:
        self.name = name
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
        environment = {**os.environ, "RAYON_NUM_THREADS": str(threads)}
        self._process = subprocess.Popen(list(command), env=environment, text=True, bufsize=1, **pipes)

    def close(self) -> None:
        """Ends the process."""
        self._process.stdin.close()
        self._process.wait(10)

    def _ask(self, model: str, operation: str, states: str, repetitions: int) -> str:
        where = f"{self.name}, {operation}, {model}"
        try:
            self._process.stdin.write(f"{model} {operation} {states} {repetitions}\n")
            self._process.stdin.flush()
        except OSError as error:
            raise TimerError(f"{where}: the timer has stopped") from error
        if not select.select([self._process.stdout], [], [], PATIENCE)[0]:
            self._process.kill()
            raise TimerError(f"{where}: no answer within {PATIENCE:g} s")
        answer = self._process.stdout.readline().strip()
        if answer == "unsupported":
            raise Unsupported(f"{where}: unsupported")
        if not answer or answer.startswith("error:"):
            raise TimerError(f"{where}: {answer.removeprefix('error:').strip() or 'the timer has stopped'}")
        return answer

    def result(self, model: str, operation: str, states: str, state: int) -> np.ndarray:
        """The numbers that the operation yields at one state."""
        words = self._ask(model, operation, states, -state).split()
        try:
            if words[0] != "result":
                raise ValueError
            return np.array([float(word) for word in words[1:]])
        except ValueError:
            raise TimerError(f"{self.name}, {operation}, {model}: not a result: {' '.join(words)[:60]!r}") from None

    def time(self, model: str, operation: str, states: str, repetitions: int) -> float:
        """Thread CPU time of a call, ns."""
        answer = self._ask(model, operation, states, repetitions)
        try:
            ns, checksum = map(float, answer.split())
        except ValueError:
            raise TimerError(f"{self.name}, {operation}, {model}: not a time: {answer[:60]!r}") from None
        if not (np.isfinite(ns) and ns > 0):
            raise TimerError(f"{self.name}, {operation}, {model}: {ns:g} ns is no time of a call")
        if not np.isfinite(checksum):
            raise TimerError(f"{self.name}, {operation}, {model}: the results are not finite")
        return ns


class Side:
    """A timer, a model, an operation, states: what is timed against other sides."""

    def __init__(self, timer: Timer, model: str, operation: str, states: str, count: int = 64) -> None:
        self.timer, self.model, self.operation, self.states, self.count = timer, model, operation, states, count

    def time(self, repetitions: int) -> float:
        return self.timer.time(self.model, self.operation, self.states, repetitions)

    def result(self, state: int) -> np.ndarray:
        return self.timer.result(self.model, self.operation, self.states, state)

    def repetitions(self, quantum: float = QUANTUM) -> int:
        """Calls that take the quantum, in whole cycles through the states. Warms up, too."""
        repetitions = self.count
        while True:
            ns = self.time(repetitions)
            wanted = -(-int(quantum / ns) // self.count) * self.count
            if ns * repetitions >= quantum:
                return max(wanted, self.count)
            repetitions = max(2 * repetitions, wanted)


def alternate(sides: Sequence[Side], rounds: int, quantum: float = QUANTUM) -> list[list[float]]:
    """Times of each side, ns: every round measures each side once, beginning with another one."""
    repetitions = [side.repetitions(quantum) for side in sides]
    times: list[list[float]] = [[] for _ in sides]
    for turn in range(rounds):
        for i in range(len(sides)):
            k = (i + turn) % len(sides)
            times[k].append(sides[k].time(repetitions[k]))
    return times


def median(times: Sequence[float]) -> float:
    """The middle of the measurements."""
    return float(statistics.median(times))


def duration(ns: float) -> str:
    """A time for people."""
    for unit, size in (("ns", 1.0), ("µs", 1e3), ("ms", 1e6)):
        if ns < 1e3 * size:
            return f"{ns / size:.3g} {unit}" if ns < 999.5 * size else f"{ns / size:.0f} {unit}"
    return f"{ns / 1e9:.3g} s"
