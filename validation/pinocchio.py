"""One's own URDF in phipsi and in Pinocchio: ``python -m validation.pinocchio MY.urdf [--base free]``."""

from __future__ import annotations

import sys
from collections.abc import Iterable

import numpy as np
import pinocchio as pin

import phipsi

from .compare import CannotCompare, Comparison, Names, conditioning, load_ours, main

#: Relative difference that passes: rounding of both programs over some hundred operations.
BOUND = 1e-11


def load(path: str, base: str) -> pin.Model:
    """The file in Pinocchio."""
    try:
        if base == "free":
            return pin.buildModelFromUrdf(path, pin.JointModelFreeFlyer())
        return pin.buildModelFromUrdf(path)
    except (ValueError, RuntimeError) as error:
        raise CannotCompare(f"Pinocchio does not load it: {error}") from error


def compare(path: str, base: str, seeds: Iterable[int], bound: float = BOUND) -> Comparison:
    """Compares every quantity that both have at random states."""
    m, model = load_ours(path, base), load(path, base)
    model.gravity = pin.Motion(np.array(m.gravity), np.zeros(3))
    result = Comparison(bound)
    try:
        layout = phipsi.interop.Pinocchio(m, list(model.names))
    except phipsi.ArgumentError as error:
        raise CannotCompare(f"the joints do not match: {error}") from error
    if "planar" in m.joint_types:
        result.leave_out("planar joints", "Pinocchio ignores their normal: they are the same for normal z only")
    if m.report.approximated:
        result.leave_out("mimic", "dropped on both sides: the joints move freely")
    result.leave_out("damping and friction", "Pinocchio's algorithms do not use them")
    for seed in seeds:
        _one_state(m, model, layout, result, seed)
    return result


def _one_state(m: phipsi.Model, model: pin.Model, layout: phipsi.interop.Pinocchio, result: Comparison, seed: int) -> None:
    data, names = model.createData(), Names(m)
    q, v = m.random_state(seed)
    rng = np.random.default_rng(seed)
    a, tau = rng.uniform(-1, 1, m.nv), rng.uniform(-1, 1, m.nv)
    their_q, their_v, their_a, their_tau = layout.q_out(q), layout.v_out(v), layout.v_out(a), layout.f_out(tau)
    bodies = [b for b in m.body_names if model.existFrame(b, pin.FrameType.BODY)]
    frames = {b: model.getFrameId(b, pin.FrameType.BODY) for b in bodies}
    # Their unit velocities in our layout, one a row.
    units = layout.v_in(np.eye(model.nv))

    def rows(x: np.ndarray) -> np.ndarray:
        return np.roll(x, 3, axis=0)

    pin.forwardKinematics(model, data, their_q, their_v, their_a)
    pin.computeJointJacobians(model, data, their_q)
    pin.updateFramePlacements(model, data)
    aligned = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    length = 1.0
    for body, frame in frames.items():
        where, pose = f"body {body}", data.oMf[frame]
        ours = m.body_pose(q, body)
        length = max(length, float(np.abs(pose.translation).max()))
        result.note("poses", ours, pose.homogeneous, where, scale=length)
        theirs = rows(pin.getFrameJacobian(model, data, frame, aligned)) @ units
        result.note("Jacobians", m.jacobian(q, body), theirs, where, scale=length)
        speed = length * float(np.abs(v).sum())
        theirs = pin.getFrameVelocity(model, data, frame, aligned).vector
        result.note("body velocities", m.body_velocity(q, v, body), rows(theirs), where, scale=speed)
        theirs = pin.getFrameClassicalAcceleration(model, data, frame, aligned).vector
        scale = length * float(np.abs(a).sum()) + speed * float(np.abs(v).sum())
        result.note("body accelerations", m.body_acceleration(q, v, a, body), rows(theirs), where, scale=scale)

    M = units.T @ _full(pin.crba(model, data, their_q)) @ units
    result.note("mass matrix", m.mass_matrix(q), M, names.pair)
    bias = m.bias_forces(q, v)
    force = float(np.abs(M).max() * np.abs(a).max() + np.abs(bias).max())
    acceleration, info = m.forward_dynamics(q, v, tau, info=True)
    factor, why = conditioning(info, result.bound)
    inverse = units.T @ _full(pin.computeMinverse(model, data, their_q)) @ units
    result.note("inverse mass matrix", m.mass_matrix_inverse(q), inverse, names.pair, factor=factor, why=why)
    theirs = layout.v_in(pin.aba(model, data, their_q, their_v, their_tau))
    result.note("accelerations", acceleration, theirs, names, factor=factor, why=why)
    theirs = layout.f_in(pin.rnea(model, data, their_q, their_v, their_a))
    result.note("generalized forces", m.inverse_dynamics(q, v, a), theirs, names, scale=force)
    _reactions(m, model, data, result, (q, v, a), force)
    theirs = layout.f_in(pin.nonLinearEffects(model, data, their_q, their_v))
    result.note("bias forces", bias, theirs, names, scale=force)
    theirs = layout.f_in(pin.computeGeneralizedGravity(model, data, their_q))
    result.note("gravity forces", m.gravity_forces(q), theirs, names, scale=force)
    conditioned = (factor, why)
    _with_wrenches(m, model, layout, units, result, (q, v, tau, a), (rng, frames), force, conditioned)

    # Copies: the second call writes into what the first one gave.
    theirs = [
        [x.copy() for x in pin.computeRNEADerivatives(model, data, their_q, their_v, their_a)],
        [x.copy() for x in pin.computeABADerivatives(model, data, their_q, their_v, their_tau)],
    ]
    ours = m.inverse_dynamics_derivatives(q, v, a), m.forward_dynamics_derivatives(q, v, tau)
    scales = (force, float(np.abs(acceleration).max()))
    _derivatives(result, "", ours, theirs, units, scales, names, conditioned)

    if sum(inertia.mass for inertia in model.inertias[1:]) > 0:
        center = pin.centerOfMass(model, data, their_q)
        result.note("center of mass", m.center_of_mass(q), center, "x, y, z", scale=length)
        pin.computeCentroidalMap(model, data, their_q)
        A = rows(np.array(data.Ag)) @ units
        result.note("centroidal momentum matrix", m.centroidal_momentum_matrix(q), A, names)
        pin.ccrba(model, data, their_q, their_v)
        scale = float((np.abs(A) @ np.abs(v)).max())
        result.note("momentum", m.momentum(q, v), rows(data.hg.vector), "angular, linear", scale=scale)
    else:
        result.leave_out("center of mass, momentum", "the moving bodies have no mass")
    energy = pin.computeKineticEnergy(model, data, their_q, their_v)
    result.note("kinetic energy", m.kinetic_energy(q, v), energy, "the whole")
    weight = sum(i.mass for i in model.inertias[1:]) * float(np.abs(model.gravity.linear).max()) * length
    energy = pin.computePotentialEnergy(model, data, their_q)
    result.note("potential energy", m.potential_energy(q), energy, "the whole", scale=weight)

    step = 0.3 * v
    theirs = layout.q_in(pin.integrate(model, their_q, layout.v_out(step)))
    moved = m.integrate(q, step)
    # As a difference, since quaternions have two signs and angles there no turns.
    result.note("integrate", m.difference(moved, _near(m, theirs, moved)), np.zeros(m.nv), names, scale=length)
    theirs = layout.v_in(pin.difference(model, their_q, layout.q_out(moved)))
    result.note("difference", m.difference(q, moved), theirs, names, scale=length)


def _near(m: phipsi.Model, q: np.ndarray, other: np.ndarray) -> np.ndarray:
    """q with the angles of continuous and planar joints in the same turn as those of ``other``."""
    q = np.array(q)
    for name, kind in zip(m.joint_names, m.joint_types):
        if kind in ("continuous", "planar"):
            i = m.joint_q_offset(name) + (2 if kind == "planar" else 0)
            q[i] += 2 * np.pi * np.round((other[i] - q[i]) / (2 * np.pi))
    return q


def _full(matrix: np.ndarray) -> np.ndarray:
    """From the upper triangle, which is all that older versions fill."""
    upper = np.triu(matrix)
    return upper + np.triu(matrix, 1).T


def _reactions(m: phipsi.Model, model: pin.Model, data: pin.Data, result: Comparison, at: tuple, force: float) -> None:
    """The wrench across every moving joint: theirs is linear first, in the joint's frame, which is the child link's."""
    ours = m.joint_reactions(*at)
    for joint in range(1, model.njoints):
        # The link that a joint carries: the body frame that coincides with the joint's.
        children = [
            f.name
            for f in model.frames
            if f.type == pin.FrameType.BODY and f.parentJoint == joint and f.placement.isIdentity(0.0)
        ]
        if children and children[0] in m.body_names:
            row = ours[m.body_names.index(children[0])]
            theirs = np.roll(data.f[joint].vector, 3)
            result.note("joint reactions", row, theirs, f"joint {model.names[joint]}", scale=force)


def _derivatives(
    result: Comparison,
    under: str,
    ours: tuple,
    theirs: list,
    units: np.ndarray,
    scales: tuple[float, float],
    names: Names,
    conditioned: tuple[float, str],
) -> None:
    """Derivatives along the increments of ``integrate``, which are the same ones in both programs."""
    for what, last, own, other, scale in zip(("forces", "accelerations"), ("a", "tau"), ours, theirs, scales):
        factor, why = conditioned if what == "accelerations" else (1.0, "")
        other = (other[0], other[1], _full(other[2]))
        for by, x, y in zip(("q", "v", last), own, other):
            # The mass matrix and its inverse do not cancel.
            size = 0.0 if by == last else scale
            quantity = f"derivatives of {what} by {by}{under}"
            result.note(quantity, x, units.T @ y @ units, names.pair, scale=size, factor=factor, why=why)


def _with_wrenches(
    m: phipsi.Model,
    model: pin.Model,
    layout: phipsi.interop.Pinocchio,
    units: np.ndarray,
    result: Comparison,
    at: tuple,
    bodies: tuple,
    force: float,
    conditioned: tuple[float, str],
) -> None:
    """Dynamics under a random wrench on every body."""
    (q, v, tau, a), (rng, frames), (factor, why) = at, bodies, conditioned
    data, names = model.createData(), Names(m)
    wrenches = {body: rng.uniform(-1, 1, 6) for body in frames}
    external = pin.StdVec_Force()
    for _ in range(model.njoints):
        external.append(pin.Force.Zero())
    for body, frame in frames.items():
        f = model.frames[frame]
        external[f.parentJoint] += f.placement.act(pin.Force(np.roll(wrenches[body], 3)))
    their_q, their_v = layout.q_out(q), layout.v_out(v)
    their_tau, their_a = layout.f_out(tau), layout.v_out(a)
    theirs = layout.v_in(pin.aba(model, data, their_q, their_v, their_tau, external))
    acceleration = m.forward_dynamics(q, v, tau, wrenches=wrenches)
    result.note("accelerations under wrenches", acceleration, theirs, names, factor=factor, why=why)
    theirs = layout.f_in(pin.rnea(model, data, their_q, their_v, their_a, external))
    ours = m.inverse_dynamics(q, v, a, wrenches=wrenches)
    result.note("generalized forces under wrenches", ours, theirs, names, scale=force)
    # Copies: the second call writes into what the first one gave.
    theirs = [
        [x.copy() for x in pin.computeRNEADerivatives(model, data, their_q, their_v, their_a, external)],
        [x.copy() for x in pin.computeABADerivatives(model, data, their_q, their_v, their_tau, external)],
    ]
    ours = (
        m.inverse_dynamics_derivatives(q, v, a, wrenches=wrenches),
        m.forward_dynamics_derivatives(q, v, tau, wrenches=wrenches),
    )
    scales = (force, float(np.abs(acceleration).max()))
    _derivatives(result, " under wrenches", ours, theirs, units, scales, names, conditioned)


if __name__ == "__main__":
    sys.exit(main("Pinocchio", compare, None, BOUND))
