"""What the comparisons with other programs share: states, differences, the table, the exit status."""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass, field
from typing import Callable

import numpy as np

import phipsi

#: Bound on a relative difference where a program's own documentation or method gives no reason for a larger one.
EPSILON = float(np.finfo(float).eps)


class CannotCompare(Exception):
    """A file that one of the programs does not load, with its reason."""


@dataclass
class Row:
    """The largest difference of one quantity."""

    quantity: str
    difference: float = 0.0
    bound: float = 0.0
    where: str = ""
    why: str = ""
    states: int = 0

    @property
    def agrees(self) -> bool:
        return self.difference <= self.bound


@dataclass
class Comparison:
    """Differences of two programs over several states, by quantity."""

    bound: float
    rows: dict[str, Row] = field(default_factory=dict)
    left_out: dict[str, str] = field(default_factory=dict)

    def note(
        self,
        quantity: str,
        ours: np.ndarray | float,
        theirs: np.ndarray | float,
        where: Callable[[tuple[int, ...]], str] | str,
        scale: float = 0.0,
        factor: float = 1.0,
        why: str = "",
    ) -> None:
        """Compares one quantity at one state: |ours − theirs| over the largest of |theirs| and ``scale``.

        ``scale`` is the size of the terms that the quantity is a sum of, where they may cancel. ``factor`` multiplies the
        bound, for the reason ``why``. ``where`` names an element.
        """
        ours, theirs = np.atleast_1d(ours), np.atleast_1d(theirs)
        row = self.rows.setdefault(quantity, Row(quantity))
        row.states += 1
        if ours.shape != theirs.shape:
            row.difference, row.where = np.inf, f"shapes {ours.shape} and {theirs.shape}"
            return
        if ours.size == 0:
            return
        size = max(float(np.abs(theirs).max()), scale)
        absolute = np.abs(ours - theirs)
        at = tuple(int(i) for i in np.unravel_index(np.argmax(absolute), absolute.shape))
        difference = float(absolute[at]) / size if absolute[at] != 0 else 0.0
        bound = self.bound * factor
        # A NaN differs by more than anything.
        difference = np.inf if np.isnan(difference) else difference
        worse = row.states == 1 or difference / bound > row.difference / row.bound
        if worse:
            row.difference, row.bound = difference, bound
            row.where = where if isinstance(where, str) else where(at)
            row.why = why

    def leave_out(self, quantity: str, why: str) -> None:
        """States why a quantity is not compared, or not as it stands in the file."""
        self.left_out[quantity] = why

    @property
    def agrees(self) -> bool:
        return bool(self.rows) and all(row.agrees for row in self.rows.values())

    def table(self) -> str:
        """For people: quantity, largest relative difference, bound, where, why."""
        lines = [("quantity", "difference", "bound", "", "where", "why, if known")]
        for row in self.rows.values():
            mark = "" if row.agrees else "DIFFERS"
            where = row.where if row.difference else "-"
            lines.append((row.quantity, f"{row.difference:.1e}", f"{row.bound:.1e}", mark, where, row.why))
        widths = [max(len(line[i]) for line in lines) for i in range(5)]
        text = ["  ".join([*(x.ljust(w) for x, w in zip(line, widths)), line[5]]).rstrip() for line in lines]
        text += [f"note: {what}: {why}" for what, why in self.left_out.items()]
        return "\n".join(text)


class Names:
    """Names of the elements of our arrays."""

    def __init__(self, m: phipsi.Model) -> None:
        self.dof = []
        for name in m.joint_names:
            first = m.joint_v_offset(name)
            later = [m.joint_v_offset(n) for n in m.joint_names if m.joint_v_offset(n) > first]
            count = min(later, default=m.nv) - first
            self.dof += [f"joint {name}" + (f"[{i}]" if count > 1 else "") for i in range(count)]

    def __call__(self, at: tuple[int, ...]) -> str:
        return self.dof[at[-1]]

    def pair(self, at: tuple[int, ...]) -> str:
        """Row and column of a matrix."""
        first, second = self.dof[at[-2]], self.dof[at[-1]]
        return first if first == second else f"{first}, {second}"


def conditioning(info: phipsi.ForwardInfo, bound: float) -> tuple[float, str]:
    """Factor on the bound of accelerations: 100 ε over the worst hinge's ratio is what rounding may cost (soa.md 2.2)."""
    hinge = info.worst_hinge
    lost = 100 * EPSILON / hinge.ratio if hinge is not None and hinge.ratio > 0 else 0.0
    if lost <= bound:
        return 1.0, ""
    why = f"heavy beyond light: the inertia at joint {hinge.joint} cancels by {1 / hinge.ratio:.0e}"
    return lost / bound, why


def relative(got: np.ndarray | float, wanted: np.ndarray | float) -> float:
    """Largest difference over the largest wanted number."""
    wanted = np.asarray(wanted, float)
    return float(np.abs(np.asarray(got) - wanted).max() / max(np.abs(wanted).max(), np.finfo(float).tiny))


def _unreadable(path: str) -> CannotCompare | None:
    try:
        with open(path, "rb"):
            return None
    except OSError as error:
        return CannotCompare(f"cannot be read: {error.strerror or error}")


def load_ours(path: str, base: str) -> phipsi.Model:
    """The user's file in phipsi, joints that mimic others set free."""
    if reason := _unreadable(path):
        raise reason
    try:
        return phipsi.Model.from_urdf(path, base=base, mimic="free")
    except phipsi.ModelError as error:
        raise CannotCompare(f"phipsi does not load it:\n{error}") from error


def main(program: str, compare: Callable[..., Comparison], arguments: list[str] | None, bound: float) -> int:
    """Runs one comparison from the command line; the exit status."""
    parser = argparse.ArgumentParser(
        prog=f"python -m validation.{program.lower()}",
        description=f"Compares a URDF file in phipsi and in {program}: every quantity that both have.",
        epilog=f"example: python -m validation.{program.lower()} arm.urdf --base free. Exit 0: all agree, 1: not, 2: usage.",
    )
    parser.add_argument("urdf", help="the file")
    parser.add_argument("--base", choices=["fixed", "free"], default="fixed", help="how the root link hangs on the world")
    parser.add_argument("--states", type=int, default=10, help="random states (default 10)")
    parser.add_argument("--seed", type=int, default=0, help="of the first state (default 0)")
    parser.add_argument("--bound", type=float, default=bound, help=f"relative difference that passes (default {bound:g})")
    given = parser.parse_args(arguments)
    if given.states < 1 or not given.bound > 0 or given.seed < 0:
        parser.error("--states must be at least 1, --seed at least 0, --bound positive")
    try:
        result = compare(given.urdf, given.base, range(given.seed, given.seed + given.states), given.bound)
    except CannotCompare as reason:
        print(f"{given.urdf}: {reason}", file=sys.stderr)
        return 1
    print(f"{given.urdf}: phipsi {phipsi.__version__} and {program}, {given.states} random states")
    print(result.table())
    print("all agree" if result.agrees else "they differ")
    return 0 if result.agrees else 1
