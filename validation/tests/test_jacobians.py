"""Inertias of tips, generalised inverses, inverse kinematics, linearisation, ln det M, velocities of equipartition."""

from __future__ import annotations

import numpy as np
import pytest

import phipsi
from validation import robots

from .common import EPSILON, arm, mixed

KINDS = ("floating", "revolute", "prismatic", "planar", "continuous")


def every_kind() -> phipsi.Model:
    """A tree with every joint of URDF."""
    return phipsi.Model.from_urdf_text(mixed(*KINDS))


@pytest.fixture(params=["arm", "panda", "talos_reduced", "mixed"])
def model(request):
    if request.param == "arm":
        return arm("free")
    if request.param == "mixed":
        return every_kind()
    return phipsi.Model.from_urdf(robots.model_path(request.param))


@pytest.mark.parametrize("seed", range(2))
def test_operational_space_inertia_is_the_inverse(model, seed):
    q, _ = model.random_state(seed)
    body = model.body_names[-1]
    inertia, info = model.operational_space_inertia(q, body, point=[0.1, -0.2, 0.3], info=True)
    J = model.jacobian(q, body, point=[0.1, -0.2, 0.3])
    mobility = J @ model.mass_matrix_inverse(q) @ J.T
    assert np.abs(inertia - inertia.T).max() <= 1e-14 * np.abs(inertia).max()
    bound = 1000 * model.nv * EPSILON * info.condition**2
    assert info.rank == np.linalg.matrix_rank(J, tol=1e-9)
    product = inertia @ mobility @ inertia
    assert np.abs(product - inertia).max() <= bound * np.abs(inertia).max() ** 2 * np.abs(mobility).max()
    assert np.array_equal(inertia, model.operational_space_inertia(q, body, point=[0.1, -0.2, 0.3]))


def test_a_body_that_cannot_move_everywhere_says_so():
    m = arm()
    q = np.array([[0.3, 0.8], [0.3, 0.0]])
    inertia, info = m.operational_space_inertia(q, "lower", info=True)
    assert inertia.shape == (2, 6, 6) and info.singular_values.shape == (2, 6)
    assert info.rank.tolist() == [2, 2] and (info.singular_values[:, 2:] < 1e-12).all()
    none, info = m.operational_space_inertia(q[0], "world", info=True)
    assert not none.any() and info.rank == 0


@pytest.mark.parametrize("seed", range(2))
def test_pseudo_inverse_is_numpys(model, seed):
    q, _ = model.random_state(seed)
    bodies = [model.body_names[-1], model.body_names[len(model.body_names) // 2]]
    for chosen in (bodies[0], bodies):
        names = [chosen] if isinstance(chosen, str) else chosen
        J = np.vstack([model.jacobian(q, b) for b in names])
        ours, theirs = model.jacobian_pseudo_inverse(q, chosen), np.linalg.pinv(J, rcond=1e-11)
        sigma = np.linalg.svd(J, compute_uv=False)
        smallest = sigma[sigma > 1e-11 * sigma[0]][-1]
        assert ours.shape == theirs.shape
        assert np.abs(ours - theirs).max() <= 1e3 * EPSILON * sigma[0] / smallest**2
    damped = model.jacobian_pseudo_inverse(q, bodies[0], damping=0.5)
    J = model.jacobian(q, bodies[0])
    assert np.allclose(damped, J.T @ np.linalg.inv(J @ J.T + 0.25 * np.eye(6)), atol=1e-13)


@pytest.mark.parametrize("name", ["panda", "talos_reduced"])
def test_poses_are_found_in_batches(name):
    m = phipsi.Model.from_urdf(robots.model_path(name))
    states = [m.random_state(seed)[0] for seed in range(12)]
    body = m.body_names[-1]
    poses = m.body_pose(states, body)
    q, info = m.inverse_kinematics(body, poses, m.neutral(), restarts=40)
    assert q.shape == (12, m.nq) and info.reached.dtype == bool and info.iterations.dtype.kind == "i"
    assert info.reached.all()
    assert np.abs(m.body_pose(q, body) - poses).max() < 1e-8
    again, _ = m.inverse_kinematics(body, poses[7], m.neutral(), restarts=40)
    assert np.array_equal(again, q[7])


def test_limits_hold_and_what_is_out_of_reach_is_told():
    m = phipsi.Model.from_urdf(robots.model_path("panda"))
    pose = np.eye(4)
    pose[:3, 3] = [3.0, 0.0, 0.5]
    # The fingers of this file slide up to three metres: the hand does not.
    q, info = m.inverse_kinematics("panda_hand", pose, m.neutral(), orientation=False)
    assert info.reached is False and info.position_error > 1.0 and info.gradient < 1e-7
    # Nothing comes nearer: in a thousand random configurations the hand is farther away.
    others = np.array([m.random_state(seed)[0] for seed in range(1000)])
    distances = np.linalg.norm(m.body_pose(others, "panda_hand")[:, :3, 3] - pose[:3, 3], axis=1)
    assert distances.min() > info.position_error
    assert (np.abs(q) <= 3.2).all()
    assert np.isclose(np.linalg.norm(m.body_pose(q, "panda_hand")[:3, 3] - pose[:3, 3]), info.position_error)


def test_arguments_of_inverse_kinematics_are_checked():
    m = arm()
    with pytest.raises(phipsi.ArgumentError, match="pose"):
        m.inverse_kinematics("lower", 2 * np.eye(4), [0.0, 0.0])
    with pytest.raises(phipsi.ArgumentError, match=r"\(3, 3\)"):
        m.inverse_kinematics("lower", np.eye(3), [0.0, 0.0])
    with pytest.raises(phipsi.ArgumentError, match="world"):
        m.inverse_kinematics("world", np.eye(4), [0.0, 0.0])
    with pytest.raises(phipsi.ArgumentError, match="tolerance"):
        m.inverse_kinematics("lower", np.eye(4), [0.0, 0.0], tolerance=0.0)
    with pytest.raises(phipsi.ArgumentError, match="damping"):
        m.jacobian_pseudo_inverse([0.0, 0.0], "lower", damping=-1.0)
    with pytest.raises(phipsi.ArgumentError, match="kT"):
        m.sample_velocities([0.0, 0.0], -1.0, seed=0)


@pytest.mark.parametrize("seed", range(2))
def test_linearization_is_that_of_the_motion(model, seed):
    """Differences of motions: Runge–Kutta steps of perturbed states against the nominal one."""
    m = model
    q, v = m.random_state(seed)
    tau = np.random.default_rng(seed).uniform(-1, 1, m.nv)
    A, B = m.linearize(q, v, tau)
    assert A.shape == (2 * m.nv, 2 * m.nv) and B.shape == (2 * m.nv, m.nv)
    d_dq, d_dv, d_dtau = m.forward_dynamics_derivatives(q, v, tau)
    assert np.array_equal(A[m.nv :], np.hstack([d_dq, d_dv])) and np.array_equal(B[m.nv :], d_dtau)
    assert not B[: m.nv].any() and np.array_equal(A[: m.nv, m.nv :], np.eye(m.nv))
    # q moves with v for a time t on both sides; the deviation grows by A's upper rows.
    t, h = 1e-4, 1e-5
    for j in range(m.nv):
        step = np.zeros(m.nv)
        step[j] = h
        rate = [
            (m.difference(m.integrate(q, s * v), m.integrate(m.integrate(q, step), s * v)) - step) / s for s in (t, -t)
        ]
        assert np.abs((rate[0] + rate[1]) / (2 * h) - A[: m.nv, j]).max() < 1e-4


def test_linearization_in_pinocchio():
    pin = pytest.importorskip("pinocchio")
    path = robots.model_path("panda")
    m, model = phipsi.Model.from_urdf(path), pin.buildModelFromUrdf(path)
    model.gravity = pin.Motion(np.array(m.gravity), np.zeros(3))
    layout = phipsi.interop.Pinocchio(m, list(model.names))
    q, v = m.random_state(3)
    tau = np.linspace(-1.0, 1.0, m.nv)
    A, B = m.linearize(q, v, tau)
    data = model.createData()
    theirs = pin.computeABADerivatives(model, data, layout.q_out(q), layout.v_out(v), layout.f_out(tau))
    order = layout.v_in(np.arange(float(m.nv))).astype(int)
    for ours, block in zip((A[m.nv :, : m.nv], A[m.nv :, m.nv :], B[m.nv :]), theirs):
        block = np.asarray(block)[np.ix_(order, order)]
        if ours is not A[m.nv :, m.nv :] and np.allclose(block, np.triu(block)):
            block = block + np.triu(block, 1).T
        assert np.abs(ours - block).max() <= 1e-11 * np.abs(block).max()


@pytest.mark.parametrize("seed", range(2))
def test_log_determinants(model, seed):
    m = model
    q, x = m.random_state(seed)
    M = m.mass_matrix(q)
    assert abs(m.log_determinant(q) - np.linalg.slogdet(M)[1]) < 1e-10
    h = 1e-5
    slope = (m.log_determinant(m.integrate(q, h * x)) - m.log_determinant(m.integrate(q, -h * x))) / (2 * h)
    assert abs(m.log_determinant_gradient(q) @ x - slope) < 1e-7
    states = np.array([m.random_state(s)[0] for s in range(5)])
    assert m.log_determinant(states).shape == (5,)
    rows = m.log_determinant_gradient(states)
    assert all(np.array_equal(row, m.log_determinant_gradient(s)) for row, s in zip(rows, states))


def test_velocities_have_the_covariance_of_equipartition():
    """Every entry within five of its own deviations √((c_ii c_jj + c_ij²)/n)."""
    m = every_kind()
    q, _ = m.random_state(2)
    n, kT = 40000, 0.7
    v = m.sample_velocities(np.tile(q, (n, 1)), kT, seed=5)
    assert np.array_equal(v[:3], m.sample_velocities(np.tile(q, (3, 1)), kT, seed=5))
    assert not np.array_equal(v[0], v[1])
    covariance = kT * m.mass_matrix_inverse(q)
    diagonal = np.diag(covariance)
    deviation = np.sqrt((np.outer(diagonal, diagonal) + covariance**2) / n)
    assert (np.abs(v.T @ v / n - covariance) < 5 * deviation).all()
    assert (np.abs(v.mean(axis=0)) < 5 * np.sqrt(diagonal / n)).all()
    assert abs(m.kinetic_energy(np.tile(q, (n, 1)), v).mean() / (0.5 * kT * m.nv) - 1.0) < 5 * np.sqrt(2 / (n * m.nv))
    assert not m.sample_velocities(q, 0.0, seed=1).any()
