"""Stiff and extreme scenes in phipsi, Pinocchio and MuJoCo: ``python -m validation.stress [--phipsi PATH] [--page]``.

Chains of `phipsi stress`, made again here from the same numbers. The judge is neither of the programs: accelerations from a dense
mass matrix in 60 digits (mpmath). phipsi's errors are those that its command prints; Pinocchio: `aba`; MuJoCo: `mj_forward` without
constraints, and steps of stiff springs by its implicit method. ``--page`` puts the tables into `docs/src/stress.md`.
"""

from __future__ import annotations

import argparse
import json
import math
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path

import mpmath
import mujoco as mj
import numpy as np
import pinocchio as pin

# Warnings are read from the data; MuJoCo would write them into a file of the working directory.
mj.set_mju_user_warning(lambda _: None)

ROOT = Path(__file__).resolve().parent.parent
EPSILON = float(np.finfo(float).eps)
_MARKS = ("<!-- peers: begin -->\n", "<!-- peers: end -->")


class Random:
    """SplitMix64, as `phipsi_model::Random`."""

    def __init__(self, seed: int) -> None:
        self.state = seed

    def signed(self) -> float:
        mask = (1 << 64) - 1
        self.state = (self.state + 0x9E3779B97F4A7C15) & mask
        z = self.state
        z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & mask
        z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & mask
        return 2.0 * ((z ^ (z >> 31)) >> 11) / 2.0**53 - 1.0


@dataclass
class Chain:
    """Rods along x with joints about y and z in turn, link k at the end of link k - 1; gravity along -y."""

    masses: list[float]
    lengths: list[float]
    axes: list[int]
    seed: int
    bend: float = 0.5
    rate: float = 1.0
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    radius: float = 0.05
    q: list[float] = field(init=False)
    v: list[float] = field(init=False)
    tau: list[float] = field(init=False)

    def __post_init__(self) -> None:
        random = Random(self.seed)
        self.q = [self.bend * random.signed() for _ in self.masses]
        self.v = [self.rate * random.signed() for _ in self.masses]
        self.tau = [random.signed() * m * x for m, x in zip(self.masses, self.lengths)]

    def moments(self, k: int) -> tuple[float, float]:
        """About the rod's line, and across it."""
        m, x = self.masses[k], self.lengths[k]
        axial = 0.5 * self.radius * self.radius * m * x * x
        return axial, m * x * x / 12.0 + axial / 2.0


def uniform(n: int, seed: int, **changes) -> Chain:
    given = {"masses": [1.0] * n, "lengths": [1.0] * n, "axes": [1 + k % 2 for k in range(n)], "seed": seed, **changes}
    return Chain(**given)


def scenes() -> dict[str, Chain]:
    """The chains of `phipsi stress` that all programs can be given, by its names."""
    found = {}
    for decade in (-12, -9, -6, -3, 3, 6, 9, 12):
        found[f"tip-mass-1e{decade}"] = uniform(10, 100 + decade, masses=[1.0] * 9 + [float(f"1e{decade}")])
    for decade in (-12, 12):
        found[f"base-mass-1e{decade}"] = uniform(10, 130 + decade, masses=[float(f"1e{decade}")] + [1.0] * 9)
    for name, ratio in (("0.1", 0.1), ("10", 10.0)):
        found[f"mass-x{name}-per-link"] = uniform(20, 200, masses=[ratio**k for k in range(20)])
    for decade in (3, 6, 9, 12, 15):
        masses = [1.0 if k % 2 == 0 else float(f"1e-{decade}") for k in range(20)]
        found[f"alternating-1e-{decade}"] = uniform(20, 300 + decade, masses=masses)
    for name, ratio in (("2", 2.0), ("4", 4.0)):
        powers = {"masses": [(ratio**3) ** k for k in range(20)], "lengths": [ratio**k for k in range(20)]}
        found[f"length-x{name}-per-link"] = uniform(20, 400, **powers)
    for decade in (-6, 6):
        size = float(f"1e{decade}")
        found[f"size-1e{decade}"] = uniform(10, 500, lengths=[size] * 10, masses=[1e3 * size**3] * 10)
    for decade in (4, 8):
        far = float(f"1e{decade}")
        found[f"far-1e{decade}"] = uniform(10, 500, offset=(far, -far, far))
    for name in ("1e-8", "1e4", "1e8", "1e140"):
        found[f"rates-{name}"] = uniform(10, 500, rate=float(name))
    for decade in (2, 5, 8):
        found[f"needles-1e-{decade}"] = uniform(12, 600, axes=[k % 3 for k in range(12)], radius=10.0**-decade)
    return found


def _turn(axis: int, angle) -> mpmath.matrix:
    i, j = (axis + 1) % 3, (axis + 2) % 3
    turn = mpmath.eye(3)
    turn[i, i] = turn[j, j] = mpmath.cos(angle)
    turn[j, i] = mpmath.sin(angle)
    turn[i, j] = -turn[j, i]
    return turn


def _cross(a: list, b: list) -> list:
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def _add(*vectors: list) -> list:
    return [sum(x) for x in zip(*vectors)]


def _inverse_dynamics(chain: Chain, turns: list, v: list, a: list, gravity) -> list:
    """Newton and Euler in the axes of the links."""
    n = len(chain.masses)
    rate, rate_dot, pull = [mpmath.mpf(0)] * 3, [mpmath.mpf(0)] * 3, [mpmath.mpf(0), gravity, mpmath.mpf(0)]
    loads = []
    for k in range(n):
        back = turns[k].T
        place = [mpmath.mpf(chain.lengths[k - 1]) if k else mpmath.mpf(0), mpmath.mpf(0), mpmath.mpf(0)]
        pull = _add(pull, _cross(rate_dot, place), _cross(rate, _cross(rate, place)))
        rate, rate_dot, pull = (list(back * mpmath.matrix(x)) for x in (rate, rate_dot, pull))
        unit = [mpmath.mpf(int(i == chain.axes[k])) for i in range(3)]
        spin, spin_dot = [v[k] * u for u in unit], [a[k] * u for u in unit]
        rate_dot = _add(rate_dot, _cross(rate, spin), spin_dot)
        rate = _add(rate, spin)
        center = [mpmath.mpf(chain.lengths[k]) / 2, mpmath.mpf(0), mpmath.mpf(0)]
        at_center = _add(pull, _cross(rate_dot, center), _cross(rate, _cross(rate, center)))
        force = [mpmath.mpf(chain.masses[k]) * x for x in at_center]
        axial, across = chain.moments(k)
        moments = [mpmath.mpf(axial), mpmath.mpf(across), mpmath.mpf(across)]
        swing = _cross(rate, [m * w for m, w in zip(moments, rate)])
        moment = _add([m * w for m, w in zip(moments, rate_dot)], swing, _cross(center, force))
        loads.append((moment, force))
    tau = [mpmath.mpf(0)] * n
    moment, force = [mpmath.mpf(0)] * 3, [mpmath.mpf(0)] * 3
    for k in reversed(range(n)):
        moment, force = _add(moment, loads[k][0]), _add(force, loads[k][1])
        tau[k] = moment[chain.axes[k]]
        force = list(turns[k] * mpmath.matrix(force))
        place = [mpmath.mpf(chain.lengths[k - 1]) if k else mpmath.mpf(0), mpmath.mpf(0), mpmath.mpf(0)]
        moment = _add(list(turns[k] * mpmath.matrix(moment)), _cross(place, force))
    return tau


def truth(chain: Chain) -> list:
    """Accelerations in 60 digits or more, from the mass matrix; its entries span a hundred decades."""
    with mpmath.workdps(250):
        n = len(chain.masses)
        turns = [_turn(axis, mpmath.mpf(q)) for axis, q in zip(chain.axes, chain.q)]
        v, still = [mpmath.mpf(x) for x in chain.v], [mpmath.mpf(0)] * n
        bias = _inverse_dynamics(chain, turns, v, still, mpmath.mpf(9.81))
        matrix = mpmath.zeros(n)
        for k in range(n):
            unit = [mpmath.mpf(int(i == k)) for i in range(n)]
            column = _inverse_dynamics(chain, turns, still, unit, mpmath.mpf(0))
            for i in range(n):
                matrix[i, k] = column[i]
        right = mpmath.matrix([mpmath.mpf(t) - b for t, b in zip(chain.tau, bias)])
        return list(mpmath.lu_solve(matrix, right))


def error(found: np.ndarray, exact: list) -> float:
    """Largest error over largest component."""
    if not np.all(np.isfinite(found)):
        return math.inf
    scale = max(abs(x) for x in exact)
    return float(max(abs(mpmath.mpf(float(x)) - y) for x, y in zip(found, exact)) / scale)


class Warned(Exception):
    """A result with the program's own warning; its first argument is the result."""


def by_pinocchio(chain: Chain) -> np.ndarray:
    model = pin.Model()
    model.gravity.linear = np.array([0.0, -9.81, 0.0])
    joints = (pin.JointModelRX, pin.JointModelRY, pin.JointModelRZ)
    parent = 0
    for k, mass in enumerate(chain.masses):
        place = np.array(chain.offset if k == 0 else (chain.lengths[k - 1], 0.0, 0.0))
        parent = model.addJoint(parent, joints[chain.axes[k]](), pin.SE3(np.eye(3), place), f"joint{k}")
        axial, across = chain.moments(k)
        inertia = pin.Inertia(mass, np.array([chain.lengths[k] / 2, 0.0, 0.0]), np.diag([axial, across, across]))
        # Not `appendBodyToJoint`: adding to an empty inertia, it loses centres of masses below ε.
        model.inertias[parent] = inertia
    state = (np.array(chain.q), np.array(chain.v), np.array(chain.tau))
    # In the bodies' own frames: the more accurate of its two variants.
    return pin.aba(model, model.createData(), *state, pin.Convention.LOCAL).copy()


def by_mujoco(chain: Chain) -> np.ndarray:
    spec = mj.MjSpec()
    spec.compiler.inertiafromgeom = mj.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE
    spec.option.gravity = [0.0, -9.81, 0.0]
    body = spec.worldbody
    for k, mass in enumerate(chain.masses):
        place = list(chain.offset) if k == 0 else [chain.lengths[k - 1], 0.0, 0.0]
        body = body.add_body(name=f"link{k}", pos=place)
        axial, across = chain.moments(k)
        body.mass, body.ipos, body.inertia, body.explicitinertial = mass, [chain.lengths[k] / 2, 0, 0], [axial, across, across], True
        body.add_joint(name=f"joint{k}", type=mj.mjtJoint.mjJNT_HINGE, axis=[float(i == chain.axes[k]) for i in range(3)])
    model = spec.compile()
    model.opt.disableflags |= int(mj.mjtDisableBit.mjDSBL_CONSTRAINT)
    data = mj.MjData(model)
    data.qpos[:], data.qvel[:], data.qfrc_applied[:] = chain.q, chain.v, chain.tau
    mj.mj_forward(model, data)
    if any(w.number for w in data.warning):
        raise Warned(data.qacc.copy())
    return data.qacc.copy()


def attempt(solve, chain: Chain, exact: list) -> str:
    """The error, or why there is none."""
    try:
        found = error(solve(chain), exact)
    except (ValueError, RuntimeError, mj.FatalError) as refused:
        return f"refused: {str(refused).splitlines()[0][:60]}"
    except Warned as warned:
        return f"{error(warned.args[0], exact):.0e} (warned)"
    return "not finite, not said" if math.isinf(found) else f"{found:.0e}"


def mujoco_spring(stiffness: float, damping: float, t_end: float, step: float) -> str:
    """Error of 1 kg on a spring and damper released at 1 m, by MuJoCo's implicit steps."""
    text = f"""<mujoco><option gravity="0 0 0" integrator="implicitfast" timestep="{step!r}"/><worldbody>
      <body><inertial mass="1" pos="0 0 0" diaginertia=".1 .1 .1"/><joint type="slide" axis="1 0 0" stiffness="{stiffness!r}"
      damping="{damping!r}"/></body></worldbody></mujoco>"""
    model = mj.MjModel.from_xml_string(text)
    data = mj.MjData(model)
    data.qpos[0] = 1.0
    for _ in range(round(t_end / step)):
        mj.mj_step(model, data)
    off = abs(data.qpos[0] - oscillation(stiffness, damping, t_end))
    bad = sum(int(w.number) for w in data.warning)
    return f"{off:.0e}" + (f" ({bad} warnings, state reset)" if bad else "")


def oscillation(k: float, c: float, t: float) -> float:
    """x'' + c x' + k x = 0 from x = 1 at rest."""
    square = c * c / 4 - k
    if square < 0:
        w = math.sqrt(-square)
        return math.exp(-c / 2 * t) * (math.cos(w * t) + c / (2 * w) * math.sin(w * t))
    fast = c / 2 + math.sqrt(square)
    slow = k / fast
    return (fast * math.exp(-slow * t) - slow * math.exp(-fast * t)) / (fast - slow)


SPRINGS = {
    "spring-1e0": (1.0, 0.0, 1000.0),
    "spring-1e4": (1e4, 0.0, 10.0),
    "spring-1e8": (1e8, 0.0, 0.1),
    "spring-1e12": (1e12, 0.0, 1e-3),
    "damped-1e6": (1e6, 1e6, 1.0),
    "damped-1e12": (1e12, 1e12, 1.0),
    "damper-1e12": (1.0, 1e12, 1.0),
}


def phipsi_findings(command: str) -> dict[str, dict]:
    """What `phipsi stress --json` says, by name."""
    done = subprocess.run([command, "stress", "--quick", "--json", "--quiet"], capture_output=True, text=True, check=False)
    return {f["name"]: f for f in json.loads(done.stdout)}


def ours(finding: dict | None) -> str:
    if finding is None:
        return "–"
    if finding["forward_error"] is None:
        return finding["outcome"]
    size = finding["forward_error"] * finding["kappa"] * EPSILON
    return f"{size:.0e}" + ("" if finding["outcome"] == "right" else f" ({finding['outcome']})")


def tables(findings: dict[str, dict]) -> str:
    lines = ["| scene | phipsi | Pinocchio `aba` | MuJoCo `mj_forward` |", "|---|---|---|---|"]
    for name, chain in scenes().items():
        exact = truth(chain)
        cells = [ours(findings.get(name)), attempt(by_pinocchio, chain, exact), attempt(by_mujoco, chain, exact)]
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
        print(lines[-1], flush=True)
    lines += ["", "| run | phipsi: error, steps | MuJoCo: step 2 ms | a hundredth of the time constant, at most 1e5 steps |", "|---|---|---|---|"]
    for name, (stiffness, damping, t_end) in SPRINGS.items():
        fine = max(0.01 / math.sqrt(stiffness), t_end / 1e5)
        coarse = mujoco_spring(stiffness, damping, t_end, min(2e-3, t_end / 2))
        f = findings.get(name)
        steps = f", {f['steps']}" if f else ""
        lines.append(f"| {name} | {ours(f)}{steps} | {coarse} | {mujoco_spring(stiffness, damping, t_end, fine)} |")
        print(lines[-1], flush=True)
    return "\n".join(lines) + "\n"


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--phipsi", default=str(ROOT / "target" / "release" / "phipsi"), help="the command")
    parser.add_argument("--page", action="store_true", help="put the tables into docs/src/stress.md")
    given = parser.parse_args(arguments)
    text = f"Pinocchio {pin.__version__}, MuJoCo {mj.__version__}.\n\n" + tables(phipsi_findings(given.phipsi))
    if given.page:
        page = ROOT / "docs" / "src" / "stress.md"
        before, rest = page.read_text().split(_MARKS[0])
        page.write_text(f"{before}{_MARKS[0]}\n{text}\n{_MARKS[1]}{rest.split(_MARKS[1])[1]}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
