"""The models that are timed, their states, and both in the words of each program."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import mujoco as mj
import numpy as np
import pinocchio as pin

import phipsi

from .. import mujoco as validation_mujoco
from ..robots import model_path

#: Number of random states that calls cycle through.
STATES = 64

#: Models that are compared by default.
NAMES = (
    "panda ur5 solo12 anymal_c talos_reduced chain_0007 chain_0064 chain_0256 tree_0063"
).split()


class LeftOut(Exception):
    """Why a program does not take part with a model."""


@dataclass
class Case:
    """A model of ours and its states: (q, v, tau, a) each."""

    name: str
    path: Path
    m: phipsi.Model
    states: list[tuple[np.ndarray, ...]]
    #: The link at the end of the longest path: its Jacobian is taken.
    target: str = ""

    def factor(self, bound: float) -> float:
        """How much more than `bound` accelerations may differ, as a hinge is ill-conditioned (soa.md 2.2)."""
        from ..compare import conditioning

        q, v, tau, _ = self.states[0]
        return conditioning(self.m.forward_dynamics(q, v, tau, info=True)[1], bound)[0]


def open_case(name: str, folder: Path, count: int = STATES) -> Case:
    """A model by name, or a URDF file; chains that are not in the data are made."""
    path = Path(name) if name.endswith(".urdf") else Path(model_path(name))
    if not path.exists() and path.stem.startswith("chain_"):
        path = folder / f"{path.stem}.urdf"
        path.write_text(chain(int(path.stem.removeprefix("chain_"))))
    m = phipsi.Model.from_urdf(str(path), base="fixed", mimic="free")
    states = []
    for seed in range(count):
        q, v = m.random_state(seed)
        rng = np.random.default_rng(seed)
        states.append((q, v, rng.uniform(-1, 1, m.nv), rng.uniform(-1, 1, m.nv)))
    case = Case(path.stem, path.resolve(), m, states)
    case.target = _end_of_longest_path(path)
    return case


def _end_of_longest_path(path: Path) -> str:
    """The child link of the moving joint that has most moving joints inboard."""
    joints = {}
    for joint in ElementTree.parse(path).getroot().iter("joint"):
        if joint.find("parent") is not None:
            joints[joint.find("child").get("link")] = (joint.find("parent").get("link"), joint.get("type") != "fixed")

    def depth(link: str) -> int:
        count = 0
        while link in joints:
            link, moves = joints[link]
            count += moves
        return count

    return max((link for link, (_, moves) in joints.items() if moves), key=depth)


def child_of(path: Path, joint: str) -> str:
    """The link that a joint carries."""
    for element in ElementTree.parse(path).getroot().iter("joint"):
        if element.get("name") == joint and element.find("child") is not None:
            return element.find("child").get("link")
    raise KeyError(joint)


def chain(n: int) -> str:
    """The URDF of a chain of n links with joints at random poses, axes and inertias: the same ones every time."""
    rng = np.random.default_rng(n)
    parts = ['<link name="world"/>']
    for i in range(n):
        mass, lever = rng.uniform(0.5, 1.5), rng.uniform(-0.05, 0.05, 3)
        root = rng.uniform(-0.04, 0.04, (3, 3))
        moments = root @ root.T + 0.004 * np.eye(3)
        # Moments of a body: the trace less twice the second moments.
        moments = np.trace(moments) * np.eye(3) - moments
        names = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
        inertia = " ".join(f'{key}="{moments[at]:.17g}"' for key, at in names.items())
        axis, angles = rng.normal(size=3), rng.uniform(-np.pi, np.pi, 3)
        axis, place = axis / np.linalg.norm(axis), rng.uniform(-0.2, 0.2, 3)

        def words(x: np.ndarray) -> str:
            return " ".join(f"{number:.17g}" for number in x)

        parts.append(
            f'<link name="link{i}"><inertial><origin xyz="{words(lever)}"/><mass value="{mass:.17g}"/>'
            f"<inertia {inertia}/></inertial></link>"
            f'<joint name="joint{i}" type="revolute"><parent link="{f"link{i - 1}" if i else "world"}"/>'
            f'<child link="link{i}"/><origin xyz="{words(place)}" rpy="{words(angles)}"/><axis xyz="{words(axis)}"/>'
            '<limit lower="-3" upper="3" effort="1" velocity="1"/></joint>'
        )
    return f'<robot name="chain">{"".join(parts)}</robot>'


def write_states(path: Path, states: list[tuple[np.ndarray, ...]]) -> str:
    """States as all timers read them; the path."""
    q, v, *_ = states[0]
    lines = [f"{len(states)} {len(q)} {len(v)}"]
    lines += [" ".join(repr(float(x)) for x in row) for state in states for row in state]
    path.write_text("\n".join(lines) + "\n")
    return str(path)


def write_pinocchio(path: Path, case: Case) -> tuple[str, phipsi.interop.Pinocchio]:
    """The model that Pinocchio's own reader makes, joint by joint; and the layout of its coordinates."""
    model = pin.buildModelFromUrdf(str(case.path))
    target = model.frames[model.getFrameId(case.target, pin.FrameType.BODY)].parentJoint
    lines = ["gravity " + " ".join(map(repr, map(float, case.m.gravity))), f"target {target}"]
    for i in range(1, model.njoints):
        joint, place, body = model.joints[i], model.jointPlacements[i], model.inertias[i]
        axis = getattr(joint.extract(), "axis", np.zeros(3))
        inertia = body.inertia
        six = [inertia[0, 0], inertia[0, 1], inertia[1, 1], inertia[0, 2], inertia[1, 2], inertia[2, 2]]
        numbers = np.concatenate([place.rotation.ravel(), place.translation, axis, [body.mass], body.lever, six])
        lines.append(f"{joint.shortname()} {model.parents[i]} " + " ".join(repr(float(x)) for x in numbers))
    path.write_text("\n".join(lines) + "\n")
    return str(path), phipsi.interop.Pinocchio(case.m, list(model.names))


def write_mujoco(path: Path, case: Case) -> tuple[str, phipsi.interop.MuJoCo]:
    """The model as MuJoCo's own reader makes it, links on fixed joints merged, mechanics alone."""
    try:
        model = validation_mujoco.compile_text(case.path.read_text(), "fixed", fuse=True)
    except (ValueError, RuntimeError, mj.FatalError) as error:
        raise LeftOut(f"MuJoCo does not load it: {' '.join(str(error).split())}") from error
    off = mj.mjtDisableBit
    for name in ("CONTACT", "LIMIT", "CONSTRAINT", "FRICTIONLOSS", "EQUALITY", "SPRING", "DAMPER", "SENSOR", "ACTUATION"):
        model.opt.disableflags |= int(getattr(off, f"mjDSBL_{name}"))
    model.opt.gravity[:] = case.m.gravity
    model.dof_armature[:] = 0.0
    model.dof_damping[:] = 0.0
    mj.mj_saveModel(model, str(path))
    return str(path), phipsi.interop.MuJoCo(case.m, [model.joint(i).name for i in range(model.njnt)])


def write_dynibo(path: Path, case: Case) -> str:
    """dynibo's name of the model; a floating joint of the file becomes its floating base."""
    root = ElementTree.parse(case.path).getroot()
    floating = [j for j in root.findall("joint") if j.get("type") == "floating"]
    if not floating:
        return f"{case.path}#{case.target}"
    if len(floating) > 1 or case.m.joint_v_offset(floating[0].get("name")) != 0:
        raise LeftOut("dynibo has floating joints at the root only")
    world = floating[0].find("parent").get("link")
    root.remove(floating[0])
    for link in root.findall("link"):
        if link.get("name") == world:
            root.remove(link)
    ElementTree.ElementTree(root).write(path)
    return f"free:{path}#{case.target}"
