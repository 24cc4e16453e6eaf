"""Closed loops in phipsi, Pinocchio and MuJoCo: ``python -m validation.loops``.

The models and states of ``validation/data/loops``, at which the loops are closed and their accelerations are known in 80-bit arithmetic.
Printed are errors against those, each relative to the largest component: whose error a difference is shows there.

Pinocchio: ``constraintDynamics``, accelerations, and generalized forces Jᵀλ from its own multipliers and Jacobian. MuJoCo: equality
constraints `connect` and `weld` between sites, with the impedance d at its limit 0.9999: a row gives way by (1 − d)/d = 1e-4 of about what its
force does to it alone, so that softness adds up along rows of loops.
"""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path

import mujoco as mj
import numpy as np
import pinocchio as pin

import phipsi

from .compare import relative
from .mujoco import mechanics

DATA = Path(__file__).parent / "data" / "loops"

#: Models with loops.
NAMES = [*(f"ladderL_{n:04d}" for n in (1, 4, 16, 64, 128)), "stewart", "twoarm"]

#: The largest impedance that MuJoCo takes.
IMPEDANCE = 0.9999


@dataclass
class Side:
    """A frame on a link."""

    link: str
    xyz: list[float]
    rpy: list[float]

    def pose(self) -> np.ndarray:
        """4×4, in the link."""
        return pin.SE3(pin.rpy.rpyToMatrix(*self.rpy), np.array(self.xyz, float)).homogeneous


@dataclass
class Loop:
    """A closure: a name, phipsi's kind, the frames A and B."""

    name: str
    kind: str
    a: Side
    b: Side


@dataclass
class Case:
    """A model with its loops; arrays over the samples, in phipsi's layout."""

    name: str
    m: phipsi.Model
    loops: list[Loop]
    q: np.ndarray
    v: np.ndarray
    tau: np.ndarray
    #: Of 80-bit arithmetic.
    accelerations: np.ndarray
    forces: np.ndarray
    rank: np.ndarray

    @property
    def path(self) -> Path:
        return DATA / f"{self.name}.urdf"


def open_case(name: str) -> Case:
    """A model of the data folder with its loops closed."""
    data = json.loads((DATA / f"{name}.json").read_text())
    m = phipsi.Model.from_urdf(DATA / f"{name}.urdf", mimic="free")
    m.gravity = (0.0, 0.0, -9.81)
    loops = []
    for c in data["closures"]:
        a, b = (Side(c[f"link_{s}"], c[f"xyz_{s}"], c[f"rpy_{s}"]) for s in "ab")
        loops.append(Loop(c["name"], {"point3": "spherical", "frame6": "weld"}[c["type"]], a, b))
        m.close_loop(a.link, a.pose(), b.link, b.pose(), kind=loops[-1].kind, name=loops[-1].name)
    layout = phipsi.interop.Pinocchio(m, ["universe", *(joint["name"] for joint in data["joints"])])
    array = {key: np.array([s[key] for s in data["samples"]], float) for key in data["samples"][0]}
    q, v, tau = layout.q_in(array["q"]), layout.v_in(array["v"]), layout.f_in(array["tau"])
    accelerations = layout.v_in(array["ddq_closed_ext"])
    forces = layout.f_in(array["generalized_constraint_force_ext"])
    return Case(name, m, loops, q, v, tau, accelerations, forces, array["rank"])


def in_phipsi(case: Case) -> tuple[np.ndarray, np.ndarray]:
    """Accelerations and generalized constraint forces of all samples."""
    at = case.q, case.v, case.tau
    return case.m.forward_dynamics(*at), case.m.generalized_constraint_force(*at)


class Pinocchio:
    """A case in Pinocchio."""

    def __init__(self, case: Case) -> None:
        self.model = model = pin.buildModelFromUrdf(str(case.path))
        model.gravity = pin.Motion(np.array(case.m.gravity), np.zeros(3))
        self.layout = phipsi.interop.Pinocchio(case.m, list(model.names))
        self.data, self.constraints = model.createData(), pin.StdVec_RigidConstraintModel()
        for loop in case.loops:
            places = []
            for side in (loop.a, loop.b):
                frame = model.frames[model.getFrameId(side.link, pin.FrameType.BODY)]
                places += [frame.parentJoint, frame.placement * pin.SE3(side.pose())]
            kind = pin.ContactType.CONTACT_6D if loop.kind == "weld" else pin.ContactType.CONTACT_3D
            self.constraints.append(pin.RigidConstraintModel(kind, model, *places, pin.ReferenceFrame.LOCAL))
        self.constraint_data = pin.StdVec_RigidConstraintData()
        for constraint in self.constraints:
            self.constraint_data.append(constraint.createData())
        pin.initConstraintDynamics(model, self.data, self.constraints, self.constraint_data)

    def accelerations(self, q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> np.ndarray:
        """Of ``constraintDynamics`` at one state, in phipsi's layout."""
        x, settings = self.layout, pin.ProximalSettings(1e-12, 1e-8, 10)
        at = x.q_out(q), x.v_out(v), x.f_out(tau)
        return x.v_in(pin.constraintDynamics(self.model, self.data, *at, self.constraints, self.constraint_data, settings))

    def jacobian(self) -> np.ndarray:
        """J of all rows at the state of the last call, in Pinocchio's layout."""
        return pin.getConstraintsJacobian(self.model, self.data, self.constraints, self.constraint_data)


def in_pinocchio(case: Case) -> tuple[np.ndarray, np.ndarray]:
    """The same of ``constraintDynamics``."""
    program = Pinocchio(case)
    accelerations, forces = [], []
    for state in zip(case.q, case.v, case.tau):
        accelerations.append(program.accelerations(*state))
        forces.append(program.layout.f_in(program.jacobian().T @ program.data.lambda_c))
    return np.array(accelerations), np.array(forces)


def condition(case: Case) -> float:
    """The largest condition number of J M⁻¹ Jᵀ on its independent rows."""
    program, worst = Pinocchio(case), 1.0
    for q, v, tau, rank in zip(case.q, case.v, case.tau, case.rank):
        program.accelerations(q, v, tau)
        M = pin.crba(program.model, program.data, program.layout.q_out(q))
        factor = np.linalg.cholesky(np.triu(M) + np.triu(M, 1).T)
        values = np.linalg.svd(np.linalg.solve(factor, program.jacobian().T), compute_uv=False)
        worst = max(worst, float(values[0] / values[int(rank) - 1]) ** 2)
    return worst


def in_mujoco(case: Case) -> tuple[np.ndarray, np.ndarray]:
    """The same of MuJoCo's forward dynamics."""
    spec = mechanics(case.path.read_text(), "fixed", fuse=False)
    for loop in case.loops:
        sites = [f"{loop.name} {which}" for which in "AB"]
        for site, side in zip(sites, (loop.a, loop.b)):
            quaternion = np.zeros(4)
            mj.mju_mat2Quat(quaternion, side.pose()[:3, :3].ravel())
            body = spec.worldbody if side.link == "world" else spec.body(side.link)
            body.add_site(name=site, pos=side.xyz, quat=quaternion)
        kind = mj.mjtEq.mjEQ_WELD if loop.kind == "weld" else mj.mjtEq.mjEQ_CONNECT
        spec.add_equality(name=loop.name, type=kind, objtype=mj.mjtObj.mjOBJ_SITE, name1=sites[0], name2=sites[1])
    model = spec.compile()
    flags = mj.mjtDisableBit
    model.opt.disableflags |= int(flags.mjDSBL_CONTACT | flags.mjDSBL_LIMIT | flags.mjDSBL_FRICTIONLOSS)
    model.opt.gravity[:] = case.m.gravity
    model.opt.solver, model.opt.iterations, model.opt.tolerance = mj.mjtSolver.mjSOL_NEWTON, 100, 0.0
    model.opt.jacobian = mj.mjtJacobian.mjJAC_DENSE
    model.eq_solimp[:, :2] = IMPEDANCE
    model.dof_armature[:] = model.dof_damping[:] = 0.0
    layout = phipsi.interop.MuJoCo(case.m, [model.joint(i).name for i in range(model.njnt)])
    accelerations, forces = [], []
    for q, v, tau in zip(case.q, case.v, case.tau):
        data = mj.MjData(model)
        data.qpos[:], data.qvel[:] = layout.q_out(q), layout.v_out(v, q)
        data.qfrc_applied[:] = layout.f_out(tau, q)
        mj.mj_forward(model, data)
        accelerations.append(layout.a_in(data.qacc, data.qpos, data.qvel))
        forces.append(layout.f_in(data.qfrc_constraint, data.qpos))
    return np.array(accelerations), np.array(forces)


PROGRAMS = {"phipsi": in_phipsi, "Pinocchio": in_pinocchio, "MuJoCo": in_mujoco}


def errors(case: Case) -> dict[str, tuple[float, float]]:
    """Errors of accelerations and of generalized constraint forces, by program."""
    found = {}
    for name, solve in PROGRAMS.items():
        accelerations, forces = solve(case)
        found[name] = relative(accelerations, case.accelerations), relative(forces, case.forces)
    return found


def main() -> int:
    """Prints the errors."""
    print("relative errors against 80-bit arithmetic: accelerations, generalized constraint forces")
    print(f"{'':14}" + "".join(f"{name:>22}" for name in PROGRAMS) + f"{'κ(J M⁻¹ Jᵀ)':>22}")
    for name in NAMES:
        case = open_case(name)
        row = "".join(f"{f'{a:.0e}, {f:.0e}':>22}" for a, f in errors(case).values())
        print(f"{name:14}{row}{condition(case):22.0e}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
