"""One's own URDF in phipsi and in MuJoCo: ``python -m validation.mujoco MY.urdf [--base free]``.

MuJoCo gets the file without geometry, without fusing links on fixed joints where it can, and with contacts, limits, damping and dry friction
switched off in the dynamics: what remains is the same mechanics.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable
from xml.etree import ElementTree

import mujoco as mj
import numpy as np

import phipsi

from .compare import CannotCompare, Comparison, Names, conditioning, load_ours, main

#: Relative difference that passes: rounding of both programs over some hundred operations.
BOUND = 1e-11


_REFUSALS = (ValueError, RuntimeError, mj.FatalError)


def load(path: str, base: str) -> tuple[mj.MjModel, dict[str, str]]:
    """The file in MuJoCo, for pure mechanics; and what had to be changed so that it loads, with the reason."""
    changed = {}
    try:
        root = ElementTree.parse(path).getroot()
        moments = _take_impossible_moments(root)
        text = ElementTree.tostring(root, encoding="unicode")
        try:
            model = compile_text(text, base, fuse=False)
        except _REFUSALS as error:
            model = compile_text(text, base, fuse=True)
            changed["links on fixed joints"] = f"fused there, as MuJoCo refuses them apart: {_in_one_line(error)}"
    except (ElementTree.ParseError, *_REFUSALS) as error:
        raise CannotCompare(
            f"MuJoCo does not load it: {_in_one_line(error)} (MuJoCo takes no joint types beyond URDF's and "
            "`spherical`, floating joints at the root only, and no moving bodies without mass)"
        ) from error
    put_back = [name for name, given in moments.items() if _put_back(model, name, *given)]
    if put_back:
        changed["MuJoCo's treatment of some inertias"] = (
            "it refuses moments that no mass distribution has (A + B < C, or none positive); "
            f"the file's were put in after loading: {', '.join(put_back)}"
        )
    flags = mj.mjtDisableBit
    model.opt.disableflags |= int(flags.mjDSBL_CONTACT | flags.mjDSBL_LIMIT | flags.mjDSBL_CONSTRAINT)
    model.opt.disableflags |= int(flags.mjDSBL_FRICTIONLOSS)
    model.opt.enableflags |= int(mj.mjtEnableBit.mjENBL_ENERGY)
    return model, changed


def _in_one_line(error: Exception) -> str:
    return " ".join(str(error).split())


def compile_text(text: str, base: str, fuse: bool) -> mj.MjModel:
    """The file's mechanics in MuJoCo, without geometry."""
    return mechanics(text, base, fuse).compile()


def mechanics(text: str, base: str, fuse: bool) -> mj.MjSpec:
    """The same, to which more may be added."""
    spec = mj.MjSpec.from_string(text)
    spec.compiler.fusestatic = fuse
    # Mass comes from <inertial> alone, and no mesh files are needed.
    spec.compiler.inertiafromgeom = mj.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE
    for part in [*spec.geoms, *spec.meshes]:
        spec.delete(part)
    if base == "free":
        spec.worldbody.first_body().add_freejoint()
    return spec


def _take_impossible_moments(root: ElementTree.Element) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Replaces, in links with mass, moments that MuJoCo refuses by a sphere's; {link: (moments, axes in the body)}."""
    taken = {}
    for link in root.iter("link"):
        element, mass = link.find("inertial/inertia"), link.find("inertial/mass")
        if element is None or mass is None or not float(mass.get("value", "0")) > 0:
            continue
        xx, xy, xz, yy, yz, zz = (float(element.get(k, "0")) for k in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"))
        moments, axes = np.linalg.eigh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        # Within rounding of a plate's moments MuJoCo may refuse them too.
        if moments[0] > 0 and moments[0] + moments[1] >= moments[2] * (1 + 1e-12):
            continue
        axes[:, 2] *= np.linalg.det(axes)
        origin = link.find("inertial/origin")
        roll, pitch, yaw = map(float, (origin.get("rpy", "0 0 0") if origin is not None else "0 0 0").split())
        taken[link.get("name", "")] = (moments, _about(2, yaw) @ _about(1, pitch) @ _about(0, roll) @ axes)
        for name, value in zip(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), (1, 0, 0, 1, 0, 1)):
            element.set(name, str(value))
    return taken


def _put_back(model: mj.MjModel, link: str, moments: np.ndarray, axes: np.ndarray) -> bool:
    i = mj.mj_name2id(model, mj.mjtObj.mjOBJ_BODY, link)
    if i <= 0:
        return False
    model.body_inertia[i] = moments
    mj.mju_mat2Quat(model.body_iquat[i], axes.ravel())
    # Otherwise MuJoCo takes the inertial frame's axes for the body's.
    model.body_sameframe[i] = 0
    model.body_simple[i] = 0
    return True


def _about(axis: int, angle: float) -> np.ndarray:
    """Rotation matrix about a coordinate axis."""
    i, j = [k for k in range(3) if k != axis]
    turn = np.eye(3)
    sine = np.sin(angle) * (-1 if axis == 1 else 1)
    turn[i, i] = turn[j, j] = np.cos(angle)
    turn[i, j], turn[j, i] = -sine, sine
    return turn


def compare(path: str, base: str, seeds: Iterable[int], bound: float = BOUND) -> Comparison:
    """Compares every quantity that both have at random states."""
    m = load_ours(path, base)
    model, changed = load(path, base)
    model.opt.gravity[:] = m.gravity
    result = Comparison(bound)
    try:
        layout = phipsi.interop.MuJoCo(m, [model.joint(i).name for i in range(model.njnt)])
    except phipsi.ArgumentError as error:
        raise CannotCompare(f"the joints do not match: {error}") from error
    for what, why in changed.items():
        result.leave_out(what, why)
    if m.report.approximated:
        result.leave_out("mimic", "dropped on both sides: the joints move freely")
    _damping(m, model, layout, result, seeds)
    if np.any(model.dof_armature):
        result.leave_out("armature", "MuJoCo adds it to the mass matrix: set to zero")
        model.dof_armature[:] = 0.0
    for seed in seeds:
        _one_state(m, model, layout, result, seed)
    return result


def _damping(
    m: phipsi.Model, model: mj.MjModel, layout: phipsi.interop.MuJoCo, result: Comparison, seeds: Iterable[int]
) -> None:
    """Compares the joints' damping, then takes it out of MuJoCo's dynamics."""
    if np.any(model.dof_frictionloss):
        result.leave_out("damping and friction", "phipsi regularises dry friction, MuJoCo makes it a constraint")
    elif np.any(model.dof_damping):
        for seed in seeds:
            q, v = m.random_state(seed)
            theirs = layout.f_in(-model.dof_damping * layout.v_out(v, q), layout.q_out(q))
            result.note("damping", m.passive_forces(q, v), theirs, Names(m))
    model.dof_damping[:] = 0.0


def _turning(m: phipsi.Model) -> bool:
    return any(kind in ("floating", "planar") for kind in m.joint_types)


def _one_state(
    m: phipsi.Model, model: mj.MjModel, layout: phipsi.interop.MuJoCo, result: Comparison, seed: int
) -> None:
    names, data = Names(m), mj.MjData(model)
    q, v = m.random_state(seed)
    rng = np.random.default_rng(seed)
    a, tau = rng.uniform(-1, 1, m.nv), rng.uniform(-1, 1, m.nv)
    their_q = layout.q_out(q)
    data.qpos[:], data.qvel[:] = their_q, layout.v_out(v, q)
    data.qfrc_applied[:] = layout.f_out(tau, q)
    mj.mj_forward(model, data)
    mj.mj_subtreeVel(model, data)
    # Their unit velocities in our layout, one a row.
    units = layout.v_in(np.eye(model.nv), their_q)
    # Bodies on the world only through fixed joints: MuJoCo counts their mass, phipsi does not.
    moving = [i for i in range(1, model.nbody) if model.body_weldid[i] != 0]
    bodies = {b: model.body(b).id for b in m.body_names if _has_body(model, b)}
    length = max(1.0, float(np.abs(data.xpos).max()))

    speed = length * float(np.abs(v).sum())
    for body, i in bodies.items():
        where = f"body {body}"
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = data.xmat[i].reshape(3, 3), data.xpos[i]
        result.note("poses", m.body_pose(q, body), pose, where, scale=length)
        theirs = np.zeros(6)
        mj.mj_objectVelocity(model, data, mj.mjtObj.mjOBJ_XBODY, i, theirs, 0)
        result.note("body velocities", m.body_velocity(q, v, body), theirs, where, scale=speed)
        linear, angular = np.zeros((3, model.nv)), np.zeros((3, model.nv))
        mj.mj_jacBody(model, data, linear, angular, i)
        theirs = np.vstack([angular, linear])
        result.note("Jacobians", m.jacobian(q, body) @ units.T, theirs, where, scale=length)

    dense = np.zeros((model.nv, model.nv))
    mj.mj_fullM(model, data, dense)
    M = m.mass_matrix(q)
    result.note("mass matrix", units @ M @ units.T, dense, names.pair)
    acceleration, info = m.forward_dynamics(q, v, tau, info=True)
    factor, why = conditioning(info, result.bound)
    theirs = layout.a_in(data.qacc, their_q, data.qvel)
    result.note("accelerations", acceleration, theirs, names, factor=factor, why=why)
    identity, inverse = np.eye(model.nv), np.zeros((model.nv, model.nv))
    mj.mj_solveM(model, data, inverse, identity)
    back = np.linalg.inv(units)
    theirs, ours = inverse, back.T @ m.mass_matrix_inverse(q) @ back
    result.note("inverse mass matrix", ours, theirs, names.pair, factor=factor, why=why)

    # Their bias is at zero accelerations in their coordinates.
    resting = layout.a_in(np.zeros(model.nv), their_q, data.qvel)
    force = float(np.abs(M).max() * max(np.abs(a).max(), np.abs(resting).max()) + np.abs(m.bias_forces(q, v)).max())
    theirs = layout.f_in(data.qfrc_bias, their_q)
    result.note("bias forces", m.inverse_dynamics(q, v, resting), theirs, names, scale=force)
    _energies(m, model, data, result, (q, v), moving, length)
    _inverse(m, model, layout, result, (q, v, a), (names, bodies, length, force))
    _with_wrenches(m, model, layout, result, (q, v, tau), (rng, bodies), (names, factor, why))
    if _turning(m):
        result.leave_out("integrate", "MuJoCo moves a free body along a straight line, phipsi along a screw")
    else:
        moved = np.array(their_q)
        mj.mj_integratePos(model, moved, data.qvel, 0.3)
        ours = layout.q_out(m.integrate(q, 0.3 * v))
        flips = m.difference(layout.q_in(ours), layout.q_in(moved))
        result.note("integrate", flips, np.zeros(m.nv), names, scale=length)


def _has_body(model: mj.MjModel, name: str) -> bool:
    return mj.mj_name2id(model, mj.mjtObj.mjOBJ_BODY, name) > 0


def _energies(
    m: phipsi.Model,
    model: mj.MjModel,
    data: mj.MjData,
    result: Comparison,
    at: tuple,
    moving: list[int],
    length: float,
) -> None:
    q, v = at
    mass = model.body_mass[moving]
    total = float(mass.sum())
    result.note("kinetic energy", m.kinetic_energy(q, v), data.energy[1], "the whole")
    fixed = [i for i in range(1, model.nbody) if i not in moving]
    weight = -sum(float(model.body_mass[i] * model.opt.gravity @ data.xipos[i]) for i in fixed)
    scale = float(model.body_mass.sum() * np.abs(model.opt.gravity).max()) * length
    theirs = data.energy[0] - weight
    result.note("potential energy", m.potential_energy(q), theirs, "the whole", scale=scale)
    if total == 0.0:
        result.leave_out("center of mass, momentum", "the moving bodies have no mass")
        return
    center = mass @ data.xipos[moving] / total
    result.note("center of mass", m.center_of_mass(q), center, "x, y, z", scale=length)
    # Their point: the centre of mass of everything, bodies on the world included.
    theirs = np.concatenate([data.subtree_angmom[0], data.subtree_linvel[0] * model.body_subtreemass[0]])
    scale = float((np.abs(m.centroidal_momentum_matrix(q)) @ np.abs(v)).max())
    ours = m.momentum(q, v, about=data.subtree_com[0])
    result.note("momentum", ours, theirs, "angular, linear", scale=scale)


def _inverse(
    m: phipsi.Model,
    model: mj.MjModel,
    layout: phipsi.interop.MuJoCo,
    result: Comparison,
    at: tuple,
    known: tuple,
) -> None:
    """Inverse dynamics, body accelerations, joint reactions."""
    (q, v, a), (names, bodies, length, force) = at, known
    data = mj.MjData(model)
    data.qpos[:], data.qvel[:] = layout.q_out(q), layout.v_out(v, q)
    data.qacc[:] = layout.a_out(a, q, v)
    mj.mj_inverse(model, data)
    theirs = layout.f_in(data.qfrc_inverse, layout.q_out(q))
    result.note("generalized forces", m.inverse_dynamics(q, v, a), theirs, names, scale=force)
    mj.mj_rnePostConstraint(model, data)
    ours = m.joint_reactions(q, v, a)
    speed = float(np.abs(v).sum())
    for body, i in bodies.items():
        theirs = np.zeros(6)
        mj.mj_objectAcceleration(model, data, mj.mjtObj.mjOBJ_XBODY, i, theirs, 0)
        # Theirs is against free fall.
        theirs[3:] += model.opt.gravity
        scale = length * (float(np.abs(a).sum()) + speed * speed) + float(np.abs(model.opt.gravity).max())
        accelerations = m.body_acceleration(q, v, a, body)
        result.note("body accelerations", accelerations, theirs, f"body {body}", scale=scale)
        # Theirs is about the centre of mass of the body's tree, in world axes.
        torque, push = data.cfrc_int[i][:3], data.cfrc_int[i][3:]
        torque = torque + np.cross(data.subtree_com[model.body_rootid[i]] - data.xpos[i], push)
        back = data.xmat[i].reshape(3, 3).T
        theirs = np.concatenate([back @ torque, back @ push])
        row = ours[m.body_names.index(body)]
        result.note("joint reactions", row, theirs, f"body {body}", scale=force * length)


def _with_wrenches(
    m: phipsi.Model,
    model: mj.MjModel,
    layout: phipsi.interop.MuJoCo,
    result: Comparison,
    at: tuple,
    loaded: tuple,
    known: tuple,
) -> None:
    """Forward dynamics under a random wrench on every moving body."""
    (q, v, tau), (rng, bodies), (names, factor, why) = at, loaded, known
    data = mj.MjData(model)
    data.qpos[:], data.qvel[:] = layout.q_out(q), layout.v_out(v, q)
    data.qfrc_applied[:] = layout.f_out(tau, q)
    mj.mj_kinematics(model, data)
    wrenches = {}
    for body, i in bodies.items():
        wrench = wrenches[body] = rng.uniform(-1, 1, 6)
        turn = data.xmat[i].reshape(3, 3)
        moment, push = turn @ wrench[:3], turn @ wrench[3:]
        # Theirs acts at the body's centre of mass, world axes, force first.
        data.xfrc_applied[i] = np.concatenate([push, moment + np.cross(data.xpos[i] - data.xipos[i], push)])
    mj.mj_forward(model, data)
    theirs = layout.a_in(data.qacc, layout.q_out(q), data.qvel)
    ours = m.forward_dynamics(q, v, tau, wrenches=wrenches)
    result.note("accelerations under wrenches", ours, theirs, names, factor=factor, why=why)


if __name__ == "__main__":
    sys.exit(main("MuJoCo", compare, None, BOUND))
