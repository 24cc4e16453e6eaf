"""The integrators beside SciPy's: ``python -m validation.integrators``.

The same motions by phipsi's methods and by ``scipy.integrate.solve_ivp``. They share the accelerations ``Model.forward_dynamics``, which
other programs check, and nothing else: SciPy integrates the coordinates as numbers, that of a free base by p' = R v, Q' = ½ Q ∘ (ω, 0), and the
loads are written here once more. SciPy's own error is the difference between two of its tolerances.

Printed for each run: the largest difference of q (rad, m) and v at the end, the run's own estimate of its error, and the difference over
the tolerance.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

import phipsi

#: Loads: t, q, v -> tau.
Load = Callable[[float, np.ndarray, np.ndarray], np.ndarray]


def link(name: str, mass: float, length: float) -> str:
    """A rod along x, thick enough to turn about it."""
    across = mass * length**2 / 12
    return (
        f'<link name="{name}"><inertial><origin xyz="{length / 2} 0 0"/><mass value="{mass}"/>'
        f'<inertia ixx="{across / 10}" iyy="{across}" izz="{across}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    )


def hinge(name: str, parent: str, child: str, x: float, axis: str = "0 1 0") -> str:
    """A joint that turns freely, x along its parent."""
    return (
        f'<joint name="{name}" type="continuous"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{x} 0 0"/><axis xyz="{axis}"/></joint>'
    )


@dataclass
class Case:
    """A scene and the same for SciPy."""

    name: str
    urdf: str
    #: Tables of the scene besides `urdf`, the start and `[integrator]`.
    model: str
    tables: str
    load: Load
    q0: list[float]
    v0: list[float]
    t_end: float
    #: Settings of phipsi's runs.
    methods: list[dict[str, float | str]]
    #: SciPy's method, tolerance.
    method: str = "DOP853"
    rtol: float = 1e-12
    free: bool = False
    loops: list[tuple[str, np.ndarray, str, np.ndarray, str]] = field(default_factory=list)

    def build(self) -> phipsi.Model:
        """The model of SciPy's accelerations."""
        m = phipsi.Model.from_urdf_text(self.urdf, base="free" if self.free else "fixed")
        m.gravity = (0.0, 0.0, 0.0) if self.free else (0.0, 0.0, -9.81)
        for body_a, pose_a, body_b, pose_b, kind in self.loops:
            m.close_loop(body_a, pose_a, body_b, pose_b, kind=kind)
        return m


def none(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """No load."""
    return np.zeros(len(v))


def adaptive(*methods: str, rtols: tuple[float, ...] = (1e-5, 1e-8, 1e-11)) -> list[dict[str, float | str]]:
    """Runs of adaptive methods."""
    return [{"method": method, "rtol": rtol} for method in methods for rtol in rtols]


def fixed(method: str, *steps: float) -> list[dict[str, float | str]]:
    """Runs of a method with fixed steps."""
    return [{"method": method, "step": step} for step in steps]


def two_links() -> Case:
    """Under gravity, with a torque that swings and a damper."""
    urdf = f"""<robot name="two_links"><link name="world"/>{link("upper", 2.0, 1.0)}{link("lower", 1.0, 0.7)}
    {hinge("shoulder", "world", "upper", 0)}{hinge("elbow", "upper", "lower", 1.0)}</robot>"""
    tables = """
[[force]]
kind = "torque"
joint = "shoulder"
value = "0.5*sin(2*t)"
[[force]]
kind = "damper"
joint = "elbow"
damping = 0.3
"""

    def load(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return np.array([0.5 * np.sin(2 * t), -0.3 * v[1]])

    methods = adaptive("dop853", "tsit5", "rodas4", "rodas5p") + fixed("rk4", 4e-3, 1e-3)
    return Case("two links, driven and damped", urdf, "", tables, load, [0.3, -0.4], [0.0, 1.0], 2.0, methods)


def pendulum() -> Case:
    """The same without loads: energy is conserved."""
    case = two_links()
    case.name, case.tables, case.load = "two links, free to swing", "", none
    case.methods = adaptive("dop853") + fixed("midpoint", 1e-3, 2.5e-4) + fixed("rk4", 1e-3)
    return case


def stiff_chain() -> Case:
    """Four rods with springs and dampers at the hinges: an explicit method is held by its stability."""
    names = ["one", "two", "three", "four"]
    parts = ['<link name="world"/>'] + [link(name, 0.5, 0.25) for name in names]
    parts += [hinge(f"h{i}", (["world"] + names)[i], name, 0.25 if i else 0.0) for i, name in enumerate(names)]
    stiffness, damping = 200.0, 50.0
    spring = '[[force]]\nkind = "spring"\njoint = "{}"\nstiffness = {}\ndamping = {}\n'
    tables = "".join(spring.format(f"h{i}", stiffness, damping) for i in range(4))

    def load(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return -stiffness * q - damping * v

    methods = adaptive("rodas4", "rodas5p", rtols=(1e-4, 1e-6, 1e-8)) + adaptive("dop853", rtols=(1e-8,))
    urdf = f'<robot name="stiff">{"".join(parts)}</robot>'
    return Case("four stiff hinges", urdf, "", tables, load, [0.4, -0.3, 0.5, -0.2], [0.0] * 4, 0.5, methods, "Radau", 1e-10)


def four_bar() -> Case:
    """A crank, a coupler and a rocker, closed by a hinge; a torque on the crank, a spring on the rocker."""
    crank, coupler, rocker, ground = 0.3, 0.7, 0.6, 0.8
    urdf = f"""<robot name="four_bar"><link name="world"/>
    {link("crank", 0.6, crank)}{link("coupler", 1.4, coupler)}{link("rocker", 1.2, rocker)}
    {hinge("a", "world", "crank", 0)}{hinge("b", "crank", "coupler", crank)}{hinge("c", "world", "rocker", ground)}</robot>"""
    turned = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])  # z of the frames along y: turned by -90° about x
    pose_a, pose_b = np.eye(4), np.eye(4)
    pose_a[:3, :3] = pose_b[:3, :3] = turned
    pose_a[0, 3], pose_b[0, 3] = coupler, rocker
    tables = f"""
[[closure]]
name = "pin"
kind = "revolute"
body_a = "coupler"
pose_a = {{ xyz = [{coupler}, 0, 0], rpy = [-1.5707963267948966, 0, 0] }}
body_b = "rocker"
pose_b = {{ xyz = [{rocker}, 0, 0], rpy = [-1.5707963267948966, 0, 0] }}
[[force]]
kind = "torque"
joint = "a"
value = "1.5*cos(3*t)"
[[force]]
kind = "spring"
joint = "c"
stiffness = 2
rest = -2
"""
    # The triangle of the coupler, the rocker and the line between their other ends, in x and −z.
    theta = 0.4
    line = crank * np.array([np.cos(theta), np.sin(theta)]) - [ground, 0.0]
    distance = np.hypot(*line)
    psi = np.arctan2(line[1], line[0]) - np.arccos((distance**2 + rocker**2 - coupler**2) / (2 * distance * rocker))
    pin = rocker * np.array([np.cos(psi), np.sin(psi)]) - line
    phi = np.arctan2(pin[1], pin[0])
    case = Case("four-bar, a closed loop", urdf, "", tables, none, [], [0.0] * 3, 1.0, [])
    case.loops = [("coupler", pose_a, "rocker", pose_b, "revolute")]
    m = case.build()
    a, b, c = (m.joint_q_offset(name) for name in "abc")
    q0 = np.zeros(3)
    q0[[a, b, c]] = theta, phi - theta, psi
    case.q0 = list(m.assemble(q0)[0])

    def load(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        tau = np.zeros(3)
        tau[a], tau[c] = 1.5 * np.cos(3 * t), -2.0 * (q[c] + 2.0)
        return tau

    case.load, case.methods = load, adaptive("dop853", "tsit5", "rodas4", "rodas5p") + fixed("rk4", 4e-3, 1e-3)
    return case


def floating() -> Case:
    """Three bodies in space, hinges with a spring each about different axes."""
    urdf = f"""<robot name="floating">{link("hull", 5.0, 1.0)}{link("arm", 1.0, 0.8)}{link("hand", 0.5, 0.4)}
    {hinge("shoulder", "hull", "arm", 1.0)}{hinge("wrist", "arm", "hand", 0.8, "0 0 1")}</robot>"""
    tables = "".join(
        f'[[force]]\nkind = "spring"\njoint = "{name}"\nstiffness = 3\ndamping = 0.1\n' for name in ("shoulder", "wrist")
    )

    def load(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return np.concatenate([np.zeros(6), -3.0 * q[7:] - 0.1 * v[6:]])

    q0 = [0.1, -0.2, 0.3, 0.5, -0.5, 0.5, 0.5, 0.4, -0.3]
    v0 = [0.8, -0.5, 0.3, 0.1, 0.2, -0.1, -0.5, 0.7]
    methods = adaptive("dop853", "tsit5", "rodas4", "rodas5p") + fixed("rk4", 4e-3, 1e-3)
    return Case("three bodies afloat", urdf, 'base = "free"', tables, load, q0, v0, 2.0, methods, free=True)


CASES = [two_links, pendulum, stiff_chain, four_bar, floating]


def rates(case: Case, m: phipsi.Model) -> Callable[[float, np.ndarray], np.ndarray]:
    """y' of y = (q, v)."""
    nq = m.nq

    def of(t: float, y: np.ndarray) -> np.ndarray:
        q, v = y[:nq].copy(), y[nq:]
        if not case.free:
            return np.concatenate([v, m.forward_dynamics(q, v, case.load(t, q, v))])
        x, w = q[3:6], q[6]
        omega, speed = v[:3], v[3:6]
        # The quaternion's length drifts by SciPy's error; rotations do not depend on it, nor do the rates of the direction.
        size = x @ x + w * w
        across = np.cross(x, speed)
        moved = speed + 2.0 * (w * across + np.cross(x, across)) / size
        turned = 0.5 * np.concatenate([w * omega + np.cross(x, omega), [-x @ omega]])
        q[3:7] /= np.sqrt(size)
        a = m.forward_dynamics(q, v, case.load(t, q, v))
        return np.concatenate([moved, turned, v[6:], a])

    return of


def by_scipy(case: Case, m: phipsi.Model, rtol: float, start: np.ndarray | None = None) -> np.ndarray:
    """(q, v) at the end."""
    y0 = np.concatenate([case.q0, case.v0]) if start is None else start
    span, end = (0.0, case.t_end), [case.t_end]
    solved = solve_ivp(rates(case, m), span, y0, method=case.method, rtol=rtol, atol=rtol, t_eval=end)
    if not solved.success:
        raise RuntimeError(f"{case.name}: SciPy's {case.method}: {solved.message}")
    return solved.y[:, -1]


def apart(m: phipsi.Model, one: np.ndarray, other: np.ndarray) -> tuple[float, float]:
    """The largest differences of q, along increments, and of v."""
    nq = m.nq
    return float(np.abs(m.difference(one[:nq], other[:nq])).max()), float(np.abs(one[nq:] - other[nq:]).max())


def initial(case: Case, m: phipsi.Model) -> str:
    """The table of the start."""
    lines = ["[initial]"]
    for key, values, offset in (("q", case.q0, m.joint_q_offset), ("v", case.v0, m.joint_v_offset)):
        starts = [offset(name) for name in m.joint_names] + [len(values)]
        for name, a, b in zip(m.joint_names, starts, starts[1:]):
            numbers = [repr(float(x)) for x in values[a:b]]
            lines.append(f"{key}.{name} = {numbers[0] if b - a == 1 else '[' + ', '.join(numbers) + ']'}")
    return "\n".join(lines)


def by_phipsi(case: Case, m: phipsi.Model, folder: Path, settings: dict[str, float | str]) -> phipsi.Trajectory:
    """A run of the scene."""
    (folder / "case.urdf").write_text(case.urdf)
    lines = [f"{key} = {value!r}".replace("'", '"') for key, value in settings.items()]
    gravity = "gravity = [0, 0, 0]" if case.free else "gravity = [0, 0, -9.81]"
    scene = folder / "case.toml"
    parts = ['[model]\nurdf = "case.urdf"', case.model, gravity, case.tables, initial(case, m)]
    scene.write_text("\n".join([*parts, "[integrator]", f"t_end = {case.t_end}", *lines, ""]))
    return phipsi.simulate(scene)


def grown(case: Case, m: phipsi.Model, end: np.ndarray) -> float:
    """What a difference of the start grows to, 1 at least: of all speeds, or of the time where loops tie them."""
    start, small = np.concatenate([case.q0, case.v0]), 1e-5
    if case.loops:
        early = solve_ivp(rates(case, m), (0.0, small), start, method=case.method, rtol=1e-9, atol=1e-12)
        moved = early.y[:, -1]
    else:
        moved = start.copy()
        moved[m.nq :] += small * np.cos(np.arange(m.nv))
    return max(1.0, max(apart(m, end, by_scipy(case, m, 1e-9, moved))) / max(apart(m, start, moved)))


@dataclass
class Result:
    """A run beside SciPy's."""

    settings: dict[str, float | str]
    method: str
    steps: int
    #: The largest component of v on the way.
    largest_v: float
    #: Differences of q and v at the end.
    q: float
    v: float
    #: Estimates of the run.
    estimated_q: float | None
    estimated_v: float | None


@dataclass
class Comparison:
    """All runs of a case."""

    case: Case
    #: Between two tolerances of SciPy: its own error.
    own_q: float
    own_v: float
    #: What a difference of the start grows to.
    growth: float
    results: list[Result]


def compare(case: Case) -> Comparison:
    """SciPy twice, and every run of phipsi."""
    m = case.build()
    end = by_scipy(case, m, case.rtol)
    coarse = by_scipy(case, m, 10 * case.rtol)
    own_q, own_v = apart(m, end, coarse)
    growth = grown(case, m, end)
    results = []
    with tempfile.TemporaryDirectory() as folder:
        for settings in case.methods:
            r = by_phipsi(case, m, Path(folder), settings)
            q, v = apart(m, end, np.concatenate([r.q[-1], r.v[-1]]))
            largest = float(np.abs(r.v).max())
            results.append(Result(settings, r.method, r.steps, largest, q, v, r.error.q, r.error.v))
    return Comparison(case, own_q, own_v, growth, results)


def main() -> int:
    """All cases."""
    for make in CASES:
        found = compare(make())
        case = found.case
        print(f"\n{case.name}: to t = {case.t_end} s, where a difference of the start is {found.growth:.1f} times as large; SciPy's")
        print(f"{case.method} at {case.rtol:g}, own error {found.own_q:.1e} of q, {found.own_v:.1e} of v")
        columns = ["steps", "Δq", "estimate", "Δv", "estimate", "Δ/rtol"]
        print(f"{'method':10} {'rtol, step':>10} {columns[0]:>7} " + " ".join(f"{name:>9}" for name in columns[1:]))
        for r in found.results:
            setting = r.settings.get("rtol", r.settings.get("step"))
            estimates = ["" if e is None else f"{e:.1e}" for e in (r.estimated_q, r.estimated_v)]
            over = f"{max(r.q, r.v) / float(r.settings['rtol']):.1e}" if "rtol" in r.settings else ""
            values = f"{r.q:9.1e} {estimates[0]:>9} {r.v:9.1e} {estimates[1]:>9} {over:>9}"
            print(f"{r.method:10} {setting:10g} {r.steps:7} {values}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
