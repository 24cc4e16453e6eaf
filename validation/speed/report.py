"""One run: agreement first, then turns of all sides; medians, ratios, bars."""

from __future__ import annotations

import datetime
import platform
import sys
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from .models import Case
from .programs import CLOSED, SINGLE, SOLVING, Phipsi, Program, difference
from .python import Figure, as_json
from .timer import Side, TimerError, Unsupported, alternate, duration, median

#: time(phipsi) / time(other): (bar, stretch) by operation and program, on the models named (empty: all).
BARS: dict[tuple[str, str], tuple[float, float, tuple[str, ...]]] = {
    ("forward_dynamics", "Pinocchio"): (0.35, 0.2, ()),
    ("inverse_dynamics", "Pinocchio"): (0.45, 0.3, ()),
    ("mass_matrix", "Pinocchio"): (0.45, 0.3, ()),
    ("forward_dynamics_derivatives", "Pinocchio"): (0.4, 0.15, ()),
    ("forward_dynamics_batch", "Pinocchio"): (0.07, 0.045, ("panda",)),
    ("derivatives_batch", "Pinocchio"): (0.1, 0.07, ("panda",)),
    ("forward_dynamics", "MuJoCo"): (0.5, 0.35, ()),
    ("inverse_dynamics", "MuJoCo"): (0.5, 0.35, ()),
    ("mass_matrix", "MuJoCo"): (0.5, 0.35, ()),
    ("forward_dynamics", "Simbody"): (0.05, 0.03, ()),
    ("inverse_dynamics", "Simbody"): (0.05, 0.03, ()),
    ("mass_matrix", "Simbody"): (0.05, 0.03, ()),
    (CLOSED, "Pinocchio"): (1.0, 1.0, ()),
    (CLOSED, "Pinocchio lcaba"): (0.5, 0.5, ("ladderL_0128",)),
} | {(o, "dynibo"): (0.6, 0.6, ()) for o in ("forward_dynamics", "inverse_dynamics", "mass_matrix", "jacobian")}

#: The same on one model, in place of that of all.
BARS_OF_MODEL = {(CLOSED, "Pinocchio", "ladderL_0128"): (0.05, 0.05)}

#: Error against known results of a program that computes the same but loses digits; one that computes something else is off by more.
LARGEST_ERROR = 1e-6

#: Long chains: bodies, states, and the bar on ns per body over that of the first.
CHAINS = ((64, 64, None), (10_000, 4, 1.3), (1_000_000, 1, 1.6))

#: States at which results are compared before timing, in this order: a stale cache would show, and the end of a batch.
COMPARED = (0, 1, 63, 0)


def single(operation: str) -> str:
    """The others' operation: one state."""
    return SINGLE.get(operation, operation)


def bar(operation: str, program: str, model: str) -> tuple[float, float] | None:
    """The bar and the stretch of a ratio, if it has them."""
    if of_model := BARS_OF_MODEL.get((operation, program, model)):
        return of_model
    found = BARS.get((operation, program))
    return found[:2] if found and (not found[2] or model in found[2]) else None


@dataclass
class Row:
    """Times of one operation on one model."""

    model: str
    dof: int
    operation: str
    #: Program → variant → ns per call, turn by turn.
    times: dict[str, dict[str, list[float]]] = field(default_factory=dict)
    #: Program → largest relative difference of its results from ours.
    differences: dict[str, float] = field(default_factory=dict)
    #: Program → largest relative error of its results, ours too, where the right ones are known.
    errors: dict[str, float] = field(default_factory=dict)

    def best(self, program: str) -> float:
        """The median of the program's faster variant, ns."""
        return min(median(times) for times in self.times[program].values())

    def ratio(self, program: str) -> float:
        return self.best("phipsi") / self.best(program)


class Run:
    """Everything of one run."""

    def __init__(self, rounds: int) -> None:
        self.rounds = rounds
        self.programs: dict[str, dict[str, str]] = {}
        self.rows: list[Row] = []
        self.chains: list[dict[str, float]] = []
        #: What Python adds to the kernels.
        self.python: list[Figure] = []
        self.remarks: list[str] = []
        self.left_out: list[str] = []
        #: Differences above the bound that are a program's own errors.
        self.explained: list[str] = []
        #: Timers that compute something else, or fail.
        self.refused: list[str] = []
        self.date = datetime.datetime.now(datetime.timezone.utc).strftime("%Y-%m-%d %H:%M UTC")

    def describe(self, program: str, built) -> None:
        self.programs[program] = {"version": built.version, "compiler": built.compiler, "flags": built.flags}
        self.remarks += [remark for remark in built.remarks if remark not in self.remarks]

    def leave_out(self, program: str, what: str, why: str) -> None:
        line = f"{program}, {what}: {why}"
        self.left_out.append(line)
        print(f"left out: {line}", file=sys.stderr, flush=True)

    def _refuse(self, line: str) -> None:
        self.refused.append(line)
        print(f"REFUSED: {line}", file=sys.stderr, flush=True)

    def compare(self, case: Case, operation: str, ours: Phipsi, others: list[Program]) -> None:
        """Compares results, then times whoever agrees."""
        row = Row(case.name, case.m.nv, operation)
        mine = Side(ours.timer, ours.model, operation, ours.states)
        try:
            results = {i: mine.result(i) for i in set(COMPARED)}
        except Unsupported:
            line = f"phipsi, {operation}: does not exist yet"
            if line not in self.left_out:
                self.left_out.append(line)
            return
        except TimerError as reason:
            self._refuse(str(reason))
            return
        sides, places = [mine], [("phipsi", operation)]

        def error(i: int, result: np.ndarray) -> float:
            return difference(result, case.known[i % len(case.known)]) if case.known else 0.0

        own = max(error(i, result) for i, result in results.items())
        if case.known:
            row.errors["phipsi"] = own
        for program in others:
            allowed = program.bound * (case.factor(program.bound) if single(operation) in SOLVING else 1.0)
            for variant in program.operations.get(single(operation), ()):
                side = Side(program.timer(variant), program.model, variant, program.states)
                try:
                    worst = theirs = 0.0
                    for i in COMPARED:
                        pair = program.alike(single(operation), case, i, results[i], side.result(i))
                        worst, theirs = max(worst, difference(*pair)), max(theirs, error(i, pair[1]))
                except Unsupported:
                    self.leave_out(program.name, f"{operation}, {case.name}", "its timer does not have it")
                    continue
                except (TimerError, ValueError) as reason:
                    self._refuse(f"{program.name}, {variant}, {case.name}: {reason}")
                    continue
                if worst > allowed:
                    what = f"{program.name}, {variant}, {case.name}: differs by {worst:.1e}, allowed {allowed:.1e}"
                    if not (case.known and own <= allowed and theirs <= LARGEST_ERROR):
                        self._refuse(what)
                        continue
                    self.explained.append(f"{what}: its own error, against known results {theirs:.0e}; phipsi's is {own:.0e}")
                sides.append(side)
                row.differences[program.name] = worst
                if case.known:
                    row.errors[program.name] = theirs
                places.append((program.name, variant))
        for (program, variant), times in zip(places, alternate(sides, self.rounds)):
            row.times.setdefault(program, {})[variant] = times
        self.rows.append(row)
        print(f"timed {case.name}, {operation}", file=sys.stderr, flush=True)

    def long_chains(self, ours: Phipsi) -> None:
        """Forward dynamics of chains, ns per body; each in a process of its own, since it keeps its model open."""
        timers = [ours.another_timer() for _ in CHAINS]
        try:
            sides = [
                Side(t, f"chain:{n}", "forward_dynamics", f"random:{count}", count)
                for t, (n, count, _) in zip(timers, CHAINS)
            ]
            for (n, _, most), times in zip(CHAINS, alternate(sides, self.rounds)):
                per_body = median(times) / n
                first = self.chains[0]["ns_per_body"] if self.chains else per_body
                chain = {"bodies": n, "ns_per_body": per_body, "ratio": per_body / first, "bar": most}
                self.chains.append(chain)
        finally:
            for timer in timers:
                timer.close()

    @staticmethod
    def line(row: Row) -> str:
        """One row for people."""
        parts = [f"{row.model:14s} {row.operation:29s} {duration(row.best('phipsi'))}"]
        for program, variants in row.times.items():
            if program == "phipsi":
                continue
            bars = bar(row.operation, program, row.model)
            ratio = row.ratio(program)
            mark = "" if bars is None else f" ({'ok' if ratio <= bars[0] else 'OVER'} {bars[0]:g}, {bars[1]:g})"
            fastest = min(variants, key=lambda v: median(variants[v])).partition(":")[2]
            name = f"{program} {fastest}".strip()
            parts.append(f"{name} {duration(row.best(program))} ratio {ratio:.3f}{mark}")
        if row.errors:
            parts.append("errors " + ", ".join(f"{program} {error:.0e}" for program, error in row.errors.items()))
        return " | ".join(parts)

    @staticmethod
    def chain_line(chain: dict) -> str:
        most = chain["bar"]
        mark = "" if most is None else f" ({'ok' if chain['ratio'] <= most else 'OVER'} {most:g})"
        return f"chain of {chain['bodies']}: {chain['ns_per_body']:.1f} ns per body, ratio {chain['ratio']:.2f}{mark}"

    def text(self) -> str:
        """The whole run for people."""
        lines = [f"{self.date}, {machine()}, {self.rounds} rounds, medians of thread CPU time"]
        lines += [f"{name} {p['version']}: {p['compiler']}, {p['flags']}" for name, p in self.programs.items()]
        lines += [f"note: {remark}" for remark in self.remarks]
        lines += ["ratio: time(phipsi) / time(other); in brackets: bar, stretch", ""]
        lines += [self.line(row) for row in self.rows]
        lines += [self.chain_line(chain) for chain in self.chains]
        lines += [str(figure) for figure in self.python]
        lines += [f"timed though it differs: {line}" for line in self.explained]
        lines += [f"left out: {line}" for line in self.left_out]
        lines += [f"REFUSED: {line}" for line in self.refused]
        return "\n".join(lines)

    def as_json(self) -> dict:
        """Everything, with every measurement."""
        rows = []
        for row in self.rows:
            ratios = {
                p: {"ratio": row.ratio(p), "bar": bar(row.operation, p, row.model)} for p in row.times if p != "phipsi"
            }
            rows.append({"model": row.model, "dof": row.dof, "operation": row.operation, "ns": row.times, "ratios": ratios, "differences": row.differences, "errors": row.errors})
        keys = ("date", "rounds", "programs", "remarks", "chains", "explained", "left_out", "refused")
        python = as_json(self.python)
        return {"machine": machine(), "avx512": has_avx512(), "python": python, **{key: getattr(self, key) for key in keys}, "rows": rows}


def machine() -> str:
    """Processor and system."""
    name = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.exists():
        names = [line.partition(":")[2].strip() for line in info.read_text().splitlines() if line.startswith("model name")]
        name = names[0] if names else name
    return f"{name}, {platform.system()}"


def has_avx512() -> bool:
    """True if phipsi takes eight numbers at once on this processor."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
    flags = next((line.split() for line in lines if line.startswith("flags")), [])
    return {"avx2", "fma", "avx512f"} <= set(flags)
