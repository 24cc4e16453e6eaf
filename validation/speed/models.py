"""The models that are timed, their states, and both in the words of each program."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from xml.etree import ElementTree

import mujoco as mj
import numpy as np
import pinocchio as pin

import phipsi

from .. import loops
from ..compare import conditioning
from ..mujoco import compile_text
from ..robots import model_path

#: Number of random states that calls cycle through.
STATES = 64

#: Models that are compared by default.
NAMES = "panda ur5 solo12 anymal_c talos_reduced chain_0007 chain_0064 chain_0256 tree_0063".split()


#: Models with closed loops, of which one operation is timed.
CLOSED_NAMES = loops.NAMES


class LeftOut(Exception):
    """Why a program does not take part with a model."""


@dataclass
class Case:
    """A model of ours and its states: (q, v, tau, a) each."""

    name: str
    path: Path
    m: phipsi.Model
    states: list[tuple[np.ndarray, ...]]
    #: Closed loops.
    closures: list[loops.Loop] = field(default_factory=list)
    #: Accelerations at the states by 80-bit arithmetic, where they are known.
    known: list[np.ndarray] = field(default_factory=list)

    def factor(self, bound: float) -> float:
        """How much more than `bound` accelerations may differ, as a hinge is ill-conditioned (soa.md 2.2)."""
        q, v, tau, _ = self.states[0]
        if self.closures:
            return 1.0
        return conditioning(self.m.forward_dynamics(q, v, tau, info=True)[1], bound)[0]

    @cached_property
    def merged(self) -> pin.Model:
        """The file in Pinocchio, which merges links on fixed joints."""
        return pin.buildModelFromUrdf(str(self.path))

    @cached_property
    def links(self) -> list[str]:
        """The link that each of Pinocchio's joints carries; its frame is the joint's."""
        joints = [j for j in ElementTree.parse(self.path).getroot().iter("joint") if j.find("child") is not None]
        carried = {j.get("name"): j.find("child").get("link") for j in joints}
        return ["world", *(carried.get(name, f"body_{name}") for name in list(self.merged.names)[1:])]

    @cached_property
    def target(self) -> int:
        """Pinocchio's joint with most joints inboard: the Jacobian of its link is taken."""
        return max(range(1, self.merged.njoints), key=lambda i: len(self.merged.supports[i]))


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
    return Case(path.stem, path.resolve(), m, states)


def open_closed_case(name: str, _folder: Path) -> Case:
    """A model with closed loops by name, at the states of its file, at which the loops are closed."""
    case = loops.open_case(name)
    rest = np.zeros_like(case.v)
    states = list(zip(case.q, case.v, case.tau, rest))
    return Case(name, case.path.resolve(), case.m, states, case.loops, list(case.accelerations))


def write_closed(path: Path, case: Case) -> str:
    """Tree and closures as phipsi's timer reads them; the path."""
    lines = [str(case.path), _words(case.m.gravity)]
    for loop in case.closures:
        sides = (f"{side.link} {_words(side.xyz)} {_words(side.rpy)}" for side in (loop.a, loop.b))
        lines.append(" ".join([loop.name, loop.kind, *sides]))
    path.write_text("\n".join(lines) + "\n")
    return str(path)


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


def _axis(joint: pin.JointModel) -> np.ndarray:
    """The axis of a joint with one degree of freedom."""
    kind = joint.shortname()
    if kind[-1] in "XYZ":
        return np.eye(3)["XYZ".index(kind[-1])]
    return np.array(getattr(joint.extract(), "axis", np.zeros(3)))


def _words(numbers: np.ndarray) -> str:
    return " ".join(repr(float(x)) for x in numbers)


def write_pinocchio(path: Path, case: Case) -> tuple[str, phipsi.interop.Pinocchio]:
    """The model joint by joint, as Pinocchio's timer reads it; and the layout of its coordinates."""
    model = case.merged
    lines = [f"gravity {_words(case.m.gravity)}", f"target {case.target}"]
    for i in range(1, model.njoints):
        joint, place, body = model.joints[i], model.jointPlacements[i], model.inertias[i]
        x = body.inertia
        six = [x[0, 0], x[0, 1], x[1, 1], x[0, 2], x[1, 2], x[2, 2]]
        numbers = [place.rotation.ravel(), place.translation, _axis(joint), [body.mass], body.lever, six]
        lines.append(f"{joint.shortname()} {model.parents[i]} {_words(np.concatenate(numbers))}")
    for loop in case.closures:
        sides = (loop.a, loop.b)
        places = [f"{case.links.index(s.link)} {_words(s.pose()[:3, :3].ravel())} {_words(s.xyz)}" for s in sides]
        lines.append(" ".join(["closure", loop.kind, *places]))
    path.write_text("\n".join(lines) + "\n")
    return str(path), phipsi.interop.Pinocchio(case.m, list(model.names))


def write_merged(path: Path, case: Case, base_joint: bool) -> None:
    """A URDF file with the links on fixed joints merged into the moving ones; a free base with its joint or without."""
    model, robot = case.merged, ElementTree.Element("robot", name=case.name)
    if base_joint:
        ElementTree.SubElement(robot, "link", name="world")
    for i in range(1, model.njoints):
        joint, place, body = model.joints[i], model.jointPlacements[i], model.inertias[i]
        inertial = ElementTree.SubElement(ElementTree.SubElement(robot, "link", name=case.links[i]), "inertial")
        ElementTree.SubElement(inertial, "origin", xyz=_words(body.lever), rpy="0 0 0")
        ElementTree.SubElement(inertial, "mass", value=repr(float(body.mass)))
        moments = {f"i{'xyz'[r]}{'xyz'[c]}": repr(float(body.inertia[r, c])) for r in range(3) for c in range(r, 3)}
        ElementTree.SubElement(inertial, "inertia", moments)
        kind = joint.shortname()
        if model.parents[i] == 0 and not base_joint:
            continue
        starts = {"JointModelFreeFlyer": "floating", "JointModelP": "prismatic", "JointModelR": "continuous"}
        word = next((word for start, word in starts.items() if kind.startswith(start)), None)
        if word is None:
            raise LeftOut(f"joint {model.names[i]} is a {kind}, which has no merged form here")
        element = ElementTree.SubElement(robot, "joint", name=model.names[i], type=word)
        ElementTree.SubElement(element, "parent", link=case.links[model.parents[i]])
        ElementTree.SubElement(element, "child", link=case.links[i])
        ElementTree.SubElement(element, "origin", xyz=_words(place.translation), rpy=_words(pin.rpy.matrixToRpy(place.rotation)))
        if word != "floating":
            ElementTree.SubElement(element, "axis", xyz=_words(_axis(joint)))
        if word == "prismatic":
            ElementTree.SubElement(element, "limit", lower="-10", upper="10", effort="1", velocity="1")
    ElementTree.ElementTree(robot).write(path)


def write_mujoco(path: Path, case: Case) -> tuple[str, phipsi.interop.MuJoCo]:
    """The merged model in MuJoCo, mechanics alone; and the layout of its coordinates."""
    merged = path.with_suffix(".urdf")
    write_merged(merged, case, base_joint=True)
    try:
        model = compile_text(merged.read_text(), "fixed", fuse=True)
    except (ValueError, RuntimeError, mj.FatalError) as error:
        raise LeftOut(f"MuJoCo does not load it: {' '.join(str(error).split())}") from error
    for name in ("CONTACT", "LIMIT", "CONSTRAINT", "FRICTIONLOSS", "EQUALITY", "SPRING", "DAMPER", "SENSOR", "ACTUATION"):
        model.opt.disableflags |= int(getattr(mj.mjtDisableBit, f"mjDSBL_{name}"))
    model.opt.gravity[:] = case.m.gravity
    mj.mj_saveModel(model, str(path))
    return str(path), phipsi.interop.MuJoCo(case.m, [model.joint(i).name for i in range(model.njnt)])


def write_dynibo(path: Path, case: Case) -> str:
    """dynibo's name of the merged model; a floating joint at the root becomes its floating base."""
    kinds = [joint.shortname() for joint in case.merged.joints][1:]
    free = kinds[0] == "JointModelFreeFlyer"
    if "JointModelFreeFlyer" in kinds[1:] or (free and list(case.merged.parents)[1:].count(0) > 1):
        raise LeftOut("dynibo has floating joints at the root only")
    write_merged(path, case, base_joint=not free)
    return f"{'free:' if free else ''}{path}#{case.links[case.target]}"
