"""The programs that are compared: how each names its models, states and operations, and what its results are in ours.

Every program has `start(case)`, which makes its side of a model, `variants(operation)`, and `alike`, which brings results
of both sides into the same coordinates.
"""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np

from . import build, models
from .models import Case, LeftOut
from .timer import Timer

#: Relative difference of results that passes; more where a model is ill-conditioned.
BOUND = 1e-9

#: Operations whose results lose digits where heavy bodies hang on light ones.
SOLVING = ("forward_dynamics", "mass_matrix_inverse", "forward_dynamics_derivatives")

#: What is timed, in the order of the tables. Many states of phipsi are compared with one state of the others.
OPERATIONS = (
    "forward_dynamics inverse_dynamics mass_matrix mass_matrix_inverse inverse_dynamics_derivatives "
    "forward_dynamics_derivatives jacobian centroidal forward_dynamics_batch derivatives_batch"
).split()
#: What is timed of models with closed loops.
CLOSED = "closed_forward_dynamics"
SINGLE = {"forward_dynamics_batch": "forward_dynamics", "derivatives_batch": "forward_dynamics_derivatives"}

Pair = tuple[np.ndarray, np.ndarray]


class Program:
    """A program other than phipsi, with no model yet."""

    name = ""
    #: Relative difference of results that passes.
    bound = BOUND
    #: The names of an operation's variants in the timer, of which the fastest counts.
    operations: dict[str, tuple[str, ...]] = {}

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        #: Name, version, compiler, flags of what was built.
        self.built: dict[str, build.Built] = {}
        self._timers: dict[str, Timer] = {}
        self.model = self.states = ""

    def build(self, operations: list[str]) -> None:
        """Builds what the operations need."""
        raise NotImplementedError

    def part(self, operation: str) -> str:
        """Which of the program's timers has an operation."""
        return ""

    def timer(self, operation: str) -> Timer:
        """The running timer of an operation."""
        part = self.part(operation)
        if part not in self._timers:
            self._timers[part] = Timer(self.name, self.built[part].command)
        return self._timers[part]

    def close(self) -> None:
        for timer in self._timers.values():
            timer.close()

    def start(self, case: Case) -> None:
        """Writes the model and its states; LeftOut if the program does not take it."""
        raise NotImplementedError

    def alike(self, operation: str, case: Case, state: int, ours: np.ndarray, theirs: np.ndarray) -> Pair:
        """Both results in the same coordinates."""
        raise NotImplementedError


def _square(flat: np.ndarray, n: int) -> np.ndarray:
    """Square matrices, one after another."""
    return flat.reshape(-1, n, n)


class Pinocchio(Program):
    """Pinocchio 4's headers."""

    name = "Pinocchio"
    operations = {
        "forward_dynamics": ("forward_dynamics:local", "forward_dynamics:world"),
        "inverse_dynamics": ("inverse_dynamics",),
        "mass_matrix": ("mass_matrix:local", "mass_matrix:world"),
        "mass_matrix_inverse": ("mass_matrix_inverse",),
        "inverse_dynamics_derivatives": ("inverse_dynamics_derivatives",),
        "forward_dynamics_derivatives": ("forward_dynamics_derivatives",),
        "jacobian": ("jacobian:all", "jacobian:path"),
        "centroidal": ("centroidal",),
        CLOSED: (f"{CLOSED}:cholesky",),
    }

    def part(self, operation: str) -> str:
        stem = operation.partition(":")[0]
        return next(family for family, members in build.FAMILIES.items() if stem in members)

    def build(self, operations: list[str]) -> None:
        for family in dict.fromkeys(self.part(o) for o in operations):
            self.built[family] = build.pinocchio(self.folder, family)

    def start(self, case: Case) -> None:
        self.model, self.layout = models.write_pinocchio(self.folder / f"{case.name}.pinocchio", case)
        x = self.layout
        states = [(x.q_out(q), x.v_out(v), x.f_out(tau), x.v_out(a)) for q, v, tau, a in case.states]
        self.states = models.write_states(self.folder / f"{case.name}.pinocchio.states", states)

    def alike(self, operation: str, case: Case, state: int, ours: np.ndarray, theirs: np.ndarray) -> Pair:
        n = case.m.nv
        # Their unit velocities in our layout, one a row.
        units = self.layout.v_in(np.eye(n))
        if operation in ("forward_dynamics", CLOSED):
            return ours, self.layout.v_in(theirs)
        if operation == "inverse_dynamics":
            return ours, self.layout.f_in(theirs)
        if operation in ("jacobian", "centroidal"):
            # Linear first.
            return ours.reshape(6, n), np.roll(theirs.reshape(6, n), 3, axis=0) @ units
        return _square(ours, n), units.T @ _square(theirs, n) @ units


class PinocchioLinear(Pinocchio):
    """Pinocchio's recursion for closed loops, of linear cost, whose answers are good to its proximal weight only."""

    name = "Pinocchio lcaba"
    operations = {CLOSED: (f"{CLOSED}:recursion",)}
    bound = 1e-5


class MuJoCo(Program):
    """MuJoCo's library, without constraints."""

    name = "MuJoCo"
    operations = {o: (o,) for o in ("forward_dynamics", "inverse_dynamics", "mass_matrix")}

    def build(self, operations: list[str]) -> None:
        self.built[""] = build.mujoco(self.folder)

    def start(self, case: Case) -> None:
        self.model, self.layout = models.write_mujoco(self.folder / f"{case.name}.mjb", case)
        x = self.layout
        states = []
        for q, v, tau, a in case.states:
            states.append((x.q_out(q), x.v_out(v, q), x.f_out(tau, q), x.a_out(a, q, v)))
        self._at = states
        self.states = models.write_states(self.folder / f"{case.name}.mujoco.states", states)

    def alike(self, operation: str, case: Case, state: int, ours: np.ndarray, theirs: np.ndarray) -> Pair:
        q, v, *_ = self._at[state]
        if operation == "forward_dynamics":
            return ours, self.layout.a_in(theirs, q, v)
        if operation == "inverse_dynamics":
            return ours, self.layout.f_in(theirs, q)
        n = case.m.nv
        units = self.layout.v_in(np.eye(n), np.tile(q, (n, 1)))
        return units @ ours.reshape(n, n) @ units.T, theirs.reshape(n, n)


class WorldAxes(Program):
    """Programs with a free base's velocity, acceleration and force in world axes, angular first."""

    #: Order of the components of a free base's q, in ours.
    base_q: tuple[int, ...] = tuple(range(7))

    def _use(self, case: Case, names: list[str], kind: str) -> None:
        """Writes the states in the order of their joints; a free base is first and not among the names."""
        self._free = case.merged.joints[1].shortname() == "JointModelFreeFlyer"
        first = 6 if self._free else 0
        if len(names) + first != case.m.nv:
            raise LeftOut(f"{self.name} counts {len(names)} joints in it, of {case.m.nv} degrees of freedom")
        self._v = [*range(first), *(case.m.joint_v_offset(name) for name in names)]
        self._q = [*(self.base_q if first else ()), *(case.m.joint_q_offset(name) for name in names)]
        states = []
        for q, v, tau, a in case.states:
            turn = self._turn(case, q)
            states.append((q[self._q], turn @ v[self._v], turn @ tau[self._v], turn @ self._classical(a, v)[self._v]))
        self.states = models.write_states(self.folder / f"{case.name}.{kind}.states", states)

    def _turn(self, case: Case, q: np.ndarray) -> np.ndarray:
        """Their velocity from ours in their order: the base's in world axes."""
        turn = np.eye(case.m.nv)
        if self._free:
            turn[:3, :3] = turn[3:6, 3:6] = case.m.body_pose(q, case.links[1])[:3, :3]
        return turn

    def _classical(self, a: np.ndarray, v: np.ndarray) -> np.ndarray:
        """The base's acceleration: the rate of the velocity of its origin, not of its components in body axes."""
        a = a.copy()
        if self._free:
            a[3:6] += np.cross(v[:3], v[3:6])
        return a

    def alike(self, operation: str, case: Case, state: int, ours: np.ndarray, theirs: np.ndarray) -> Pair:
        q, v, *_ = case.states[state]
        turn, n = self._turn(case, q), case.m.nv
        if operation == "forward_dynamics":
            return turn @ self._classical(ours, v)[self._v], theirs
        if operation == "inverse_dynamics":
            return turn @ ours[self._v], theirs
        if operation == "jacobian":
            return ours.reshape(6, n)[:, self._v] @ turn.T, theirs.reshape(n, 6).T
        return turn @ ours.reshape(n, n)[np.ix_(self._v, self._v)] @ turn.T, theirs.reshape(n, n)


class Dynibo(WorldAxes):
    """dynibo of crates.io."""

    name = "dynibo"
    operations = {o: (o,) for o in ("forward_dynamics", "inverse_dynamics", "mass_matrix")} | {
        "jacobian": ("jacobian:columns",)
    }

    def build(self, operations: list[str]) -> None:
        self.built[""] = build.dynibo(self.folder)

    def start(self, case: Case) -> None:
        self.model = models.write_dynibo(self.folder / f"{case.name}.dynibo.urdf", case)
        done = subprocess.run([*self.built[""].command, self.model], capture_output=True, text=True)
        if done.returncode:
            raise LeftOut(f"dynibo does not load it: {done.stderr.strip()}")
        self._use(case, done.stdout.split(), "dynibo")


class Simbody(WorldAxes):
    """Simbody of Debian, with its internal checks."""

    name = "Simbody"
    operations = {o: (o,) for o in ("forward_dynamics", "inverse_dynamics", "mass_matrix")}
    base_q = (6, 3, 4, 5, 0, 1, 2)

    def build(self, operations: list[str]) -> None:
        self.built[""] = build.simbody(self.folder)

    def start(self, case: Case) -> None:
        self.model, _ = models.write_pinocchio(self.folder / f"{case.name}.simbody", case)
        names = list(case.merged.names)[1:]
        self._use(case, names[1:] if case.merged.joints[1].shortname() == "JointModelFreeFlyer" else names, "simbody")


class Phipsi:
    """This program."""

    name = "phipsi"

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def build(self) -> None:
        self.built = build.phipsi(self.folder)
        self.timer = Timer(self.name, self.built.command)

    def another_timer(self, threads: int = 1) -> Timer:
        """One more process: for a model that is expensive to open, or for batches on several threads."""
        return Timer(self.name, self.built.command, threads)

    def start(self, case: Case) -> None:
        if case.closures:
            self.model = models.write_closed(self.folder / f"{case.name}.loops", case)
        else:
            self.model = f"{case.path}#{case.links[case.target]}"
        self.states = models.write_states(self.folder / f"{case.name}.states", case.states)

    def close(self) -> None:
        self.timer.close()


#: The others, in the order of the tables.
OTHERS = (Pinocchio, PinocchioLinear, MuJoCo, Dynibo, Simbody)


def difference(first: np.ndarray, second: np.ndarray) -> float:
    """Largest difference over the largest number; infinite where one is not a number."""
    scale = max(float(np.abs(first).max(initial=0)), float(np.abs(second).max(initial=0)), np.finfo(float).tiny)
    worst = float(np.abs(first - second).max(initial=0)) / scale
    return worst if np.isfinite(worst) else np.inf
