"""Reference dynamics of the tree robots in ``validation/data/robots``, as ``python -m validation.robots``.

The reference files are in Pinocchio's conventions; ``phipsi.interop.Pinocchio`` is part of what is checked.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

import phipsi

from .compare import EPSILON, relative

DATA = Path(__file__).parent / "data" / "robots"

#: Gravity of the reference data.
GRAVITY = (0.0, 0.0, -9.81)


def names() -> list[str]:
    """The robots that have reference data."""
    return sorted(path.stem for path in (DATA / "reference").glob("*.json"))


def model_path(name: str) -> str:
    """The URDF of a robot."""
    return str(DATA / "models" / f"{name}.urdf")


def load(name: str) -> tuple[phipsi.Model, dict]:
    """A robot and its reference data; a free base is a floating joint of the file itself, or ours."""
    reference = json.loads((DATA / "reference" / f"{name}.json").read_text())
    path = model_path(name)
    free = any("FreeFlyer" in joint["type"] for joint in reference["joints"])
    own = 'type="floating"' in Path(path).read_text()
    m = phipsi.Model.from_urdf(path, base="free" if free and not own else "fixed")
    m.gravity = GRAVITY
    return m, reference


def bound(name: str, quantity: str) -> float:
    """1e-11; for accelerations of a heavy tip on a light chain 100 ε × mass ratio (soa.md 2.2)."""
    if quantity == "forward dynamics" and name.startswith("mr_"):
        return max(1e-11, 100 * EPSILON * float(name.split("_")[2]))
    return 1e-11


def check(name: str) -> dict[str, float]:
    """Largest relative error per quantity."""
    m, reference = load(name)
    layout = phipsi.interop.Pinocchio(m, [joint["name"] for joint in reference["joints"]])
    worst: dict[str, float] = {}
    link = _child(model_path(name), reference["last_joint"])

    def note(quantity: str, error: float) -> None:
        worst[quantity] = max(worst.get(quantity, 0.0), np.inf if np.isnan(error) else error)

    # Columns: our unit velocities in their layout.
    to_theirs = layout.v_out(np.eye(m.nv))
    for s in reference["samples"]:
        q, v, tau, a = (f(np.array(s[k])) for f, k in zip((layout.q_in, layout.v_in, layout.f_in, layout.v_in), ("q", "v", "tau", "a")))
        note("layout", relative(layout.q_out(q), s["q"]))
        note("forward dynamics", relative(layout.v_out(m.forward_dynamics(q, v, tau)), s.get("ddq_mp", s["ddq"])))
        note("inverse dynamics", relative(layout.f_out(m.inverse_dynamics(q, v, a)), s.get("tau_rnea_mp", s["tau_rnea"])))
        note("bias forces", relative(layout.f_out(m.bias_forces(q, v)), s["nle"]))
        note("kinetic energy", relative(m.kinetic_energy(q, v), s["kinetic"]))
        scale = max(abs(s["potential"]), s["kinetic"])
        note("potential energy", abs(m.potential_energy(q) - s["potential"]) / scale)
        note("center of mass", relative(m.center_of_mass(q), s["com"]))
        note("momentum", relative(np.roll(m.momentum(q, v), 3), s["h_centroidal"]))
        if "M" in s:
            theirs = np.array(s["M"]).reshape(m.nv, m.nv)
            note("mass matrix", relative(to_theirs.T @ m.mass_matrix(q) @ to_theirs, theirs))
        placement, pose = s["placement_last"], m.body_pose(q, link)
        note("pose", relative(pose[:3, 3], placement["xyz"]))
        note("pose", relative(pose[:3, :3].ravel(), placement["R"]))
        if "J_last" in s:
            theirs = np.array(s["J_last"]).reshape(6, m.nv)
            note("jacobian", relative(np.roll(m.jacobian(q, link), 3, axis=0) @ to_theirs, theirs))
    return worst


def _child(path: str, joint: str) -> str:
    """The link that a joint carries."""
    for element in ElementTree.parse(path).getroot().iter("joint"):
        if element.get("name") == joint:
            return element.find("child").get("link")
    raise KeyError(joint)


def main() -> int:
    """Prints the errors; 1 if one is over its bound."""
    bad = 0
    for name in names():
        for quantity, error in check(name).items():
            over = not error <= bound(name, quantity)
            bad += over
            print(f"{name:18s} {quantity:18s} {error:.1e}{'  OVER ITS BOUND' if over else ''}")
    print(f"{bad} over their bound")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
