"""Methods of Model: the identities between them, loading, and gravity."""

from __future__ import annotations

import subprocess
import sys
import threading

import numpy as np
import pytest

import phipsi
from validation import robots

from .common import ARM, EPSILON, arm, mixed

@pytest.fixture(params=["arm", "arm-free", "panda", "talos_reduced"])
def model(request):
    if request.param.startswith("arm"):
        return arm("free" if request.param == "arm-free" else "fixed")
    return phipsi.Model.from_urdf(robots.model_path(request.param))


def close(got, wanted, scale, n):
    """n·ε of the size of the terms; the models here have κ below a hundred."""
    assert np.abs(np.asarray(got) - wanted).max() <= 100 * n * EPSILON * scale


@pytest.mark.parametrize("seed", range(3))
def test_identities(model, seed):
    m = model
    q, v = m.random_state(seed)
    rng = np.random.default_rng(seed)
    a, tau, x = rng.uniform(-1, 1, (3, m.nv))
    M, inverse = m.mass_matrix(q), m.mass_matrix_inverse(q)
    kappa = np.abs(M).max() * np.abs(inverse).max()
    assert np.array_equal(M, M.T) and np.array_equal(inverse, inverse.T)
    close(M @ inverse, np.eye(m.nv), kappa, m.nv)
    close(m.multiply_by_mass_matrix(q, x), M @ x, np.abs(M).max(), m.nv)
    close(m.solve_mass_matrix(q, M @ x), x, kappa, m.nv)
    force = np.abs(M).max() + np.abs(m.bias_forces(q, v)).max()
    close(m.inverse_dynamics(q, v, a), M @ a + m.bias_forces(q, v), force, m.nv)
    close(m.inverse_dynamics(q, v, m.forward_dynamics(q, v, tau)), tau, force * kappa, m.nv)
    close(m.bias_forces(q, 0 * v), m.gravity_forces(q), force, m.nv)
    close(m.kinetic_energy(q, v), 0.5 * v @ M @ v, np.abs(M).max() * m.nv, m.nv)
    A = m.centroidal_momentum_matrix(q)
    close(m.momentum(q, v), A @ v, np.abs(A).max() * m.nv, m.nv)
    close(m.difference(q, m.integrate(q, 0.1 * v)), 0.1 * v, 2.0, m.nv)
    for body in m.body_names:
        point = rng.uniform(-1, 1, 3)
        J, here = m.jacobian(q, body), m.jacobian(q, body, point=point)
        close(J @ v, m.body_velocity(q, v, body), m.nv, m.nv)
        offset = m.body_pose(q, body)[:3, :3] @ point
        close(here[3:], J[3:] + np.cross(J[:3].T, offset).T, 10.0, m.nv)


@pytest.mark.parametrize("seed", range(2))
def test_wrenches_are_jacobian_transposed_forces(model, seed):
    m = model
    q, v = m.random_state(seed)
    rng = np.random.default_rng(seed)
    wrenches = {body: rng.uniform(-1, 1, 6) for body in m.body_names}
    tau, force = np.zeros(m.nv), 0.0
    for body, wrench in wrenches.items():
        R, J = m.body_pose(q, body)[:3, :3], m.jacobian(q, body)
        tau += J.T @ np.concatenate([R @ wrench[:3], R @ wrench[3:]])
        force += np.abs(J).max() * 6
    zero = np.zeros(m.nv)
    bias = m.inverse_dynamics(q, v, zero)
    close(bias - m.inverse_dynamics(q, v, zero, wrenches=wrenches), tau, force + np.abs(bias).max(), m.nv)
    with_tau = m.forward_dynamics(q, v, tau)
    size = np.abs(m.mass_matrix_inverse(q)).max() * m.nv * (force + np.abs(bias).max())
    close(m.forward_dynamics(q, v, zero, wrenches=wrenches), with_tau, size, m.nv)


@pytest.mark.parametrize("seed", range(2))
def test_reactions_balance_every_free_body(seed):
    """At the root of a free tree nothing is held: the reaction is the force of the free joint itself."""
    m = arm("free")
    q, v = m.random_state(seed)
    a = m.forward_dynamics(q, v, np.zeros(m.nv))
    reactions = m.joint_reactions(q, v, a)
    assert reactions.shape == (3, 6)
    close(reactions[0], np.zeros(6), 100.0, m.nv)
    # Across the shoulder, about its axis, no torque acts.
    close(reactions[1, 1], 0.0, 100.0, m.nv)


def test_body_acceleration_is_the_rate_of_body_velocity():
    m = arm("free")
    q, v = m.random_state(4)
    a = np.random.default_rng(4).uniform(-1, 1, m.nv)
    h = 1e-4

    def velocity(t):
        # v(t) = v + a t; the increment over t to third order.
        return m.body_velocity(m.integrate(q, v * t + 0.5 * a * t * t), v + a * t, "lower")

    rate = (velocity(h) - velocity(-h)) / (2 * h)
    # Central differences: h² times third derivatives of order 10, and ε/h.
    assert np.abs(rate - m.body_acceleration(q, v, a, "lower")).max() <= 100 * (h * h + EPSILON / h)


def test_names_and_offsets():
    m = arm("free")
    assert (m.nq, m.nv) == (9, 8)
    assert m.joint_names == ["foot", "shoulder", "elbow"]
    assert m.joint_types == ["floating", "continuous", "revolute"]
    assert m.body_names == ["foot", "upper", "lower"]
    assert [m.joint_q_offset(n) for n in m.joint_names] == [0, 7, 8]
    assert [m.joint_v_offset(n) for n in m.joint_names] == [0, 6, 7]
    assert m.name == "arm"
    assert np.array_equal(m.neutral(), [0, 0, 0, 0, 0, 0, 1, 0, 0])
    assert np.array_equal(m.body_pose(m.neutral(), "world"), np.eye(4))
    assert np.array_equal(m.jacobian(m.neutral(), "world"), np.zeros((6, 8)))


def test_gravity_is_settable_and_refuses_what_is_none():
    m = arm()
    assert m.gravity == (0.0, 0.0, -9.80665)
    m.gravity = [0, 0, -1]
    assert m.gravity == (0.0, 0.0, -1.0)
    with pytest.raises(phipsi.ArgumentError, match="gravity"):
        m.gravity = (0, 0)
    with pytest.raises(phipsi.ArgumentError, match="gravity"):
        m.gravity = [[0, 0, 1]]
    with pytest.raises(phipsi.NumericalError, match="gravity"):
        m.gravity = (0, 0, np.inf)
    assert m.gravity == (0.0, 0.0, -1.0)


def test_a_running_call_keeps_its_gravity():
    m = phipsi.Model.from_urdf(robots.model_path("talos_reduced"))
    states = [m.random_state(i) for i in range(2000)]
    q, v = (np.array(x) for x in zip(*states))
    down = m.bias_forces(q, v)
    m.gravity = (0, 0, 9.80665)
    up = m.bias_forces(q, v)
    results, stop = [], threading.Event()

    def switch():
        while not stop.is_set():
            m.gravity = (0, 0, -9.80665)
            m.gravity = (0, 0, 9.80665)

    thread = threading.Thread(target=switch)
    thread.start()
    try:
        results = [m.bias_forces(q, v) for _ in range(20)]
    finally:
        stop.set()
        thread.join()
    for result in results:
        assert np.array_equal(result, down) or np.array_equal(result, up)


def test_free_fall():
    m = arm("free")
    q, _ = m.random_state(1)
    a = m.forward_dynamics(q, np.zeros(m.nv), np.zeros(m.nv))
    R = m.body_pose(q, "foot")[:3, :3]
    close(R @ a[3:6], m.gravity, 10.0, m.nv)
    close(a[:3], 0.0, 10.0, m.nv)
    close(a[6:], 0.0, 10.0, m.nv)


def test_info():
    m = phipsi.Model.from_urdf(robots.model_path("mr_tip_1e6_0064"))
    q, v = m.random_state(0)
    tau = np.ones(m.nv)
    a, info = m.forward_dynamics(q, v, tau, info=True)
    assert np.array_equal(a, m.forward_dynamics(q, v, tau))
    assert isinstance(info.backward_error, float) and 0 <= info.backward_error < 1e-12
    assert info.worst_hinge.joint in m.joint_names and info.worst_hinge.component == 0
    assert 0 < info.worst_hinge.ratio < 1e-5 and info.worst_hinge.state is None
    _, batch = m.forward_dynamics([q, m.neutral(), q], v, tau, info=True)
    assert batch.backward_error.shape == (3,) and batch.backward_error[0] == info.backward_error
    assert len(batch.worst_hinge.state) == 1


@pytest.mark.parametrize("name", ["mr_tip_1e3_0064", "mr_tip_1e6_0064", "mr_tip_1e9_0064", "mr_alt_1e9_0064"])
def test_forms_against_a_hundred_digits(name):
    m, reference = robots.load(name)
    layout = phipsi.interop.Pinocchio(m, [joint["name"] for joint in reference["joints"]])
    samples = [s for s in reference["samples"] if "ddq_mp" in s]
    assert samples
    for s in samples:
        q, v, tau = layout.q_in(np.array(s["q"])), layout.v_in(np.array(s["v"])), layout.f_in(np.array(s["tau"]))
        truth = layout.v_in(np.array(s["ddq_mp"]))
        for form, limit in [("square_root", 1e-13), ("double_double", 1e-14), ("refined", 1e-13), ("auto", 1e-12)]:
            a, info = m.forward_dynamics(q, v, tau, form=form, info=True)
            assert np.max(np.abs(a - truth)) <= limit * np.max(np.abs(truth)), form
            assert info.backward_error <= 100 * m.nv * np.finfo(float).eps
            chosen = {"mr_tip_1e6_0064": "refined", "mr_tip_1e9_0064": "square_root"}.get(name, "plain")
            assert info.form == (chosen if form == "auto" else form)


def test_every_form_runs_batches():
    m = phipsi.Model.from_urdf(robots.model_path("solo12"))
    states = [m.random_state(seed) for seed in range(5)]
    q, v = np.array([s[0] for s in states]), np.array([s[1] for s in states])
    tau = np.ones(m.nv)
    truth = m.forward_dynamics(q, v, tau, form="double_double")
    for form in ("auto", "plain", "refined", "square_root"):
        a = m.forward_dynamics(q, v, tau, form=form)
        close(a, truth, np.abs(truth).max(), m.nv)
        assert np.array_equal(a[2], m.forward_dynamics(q[2], v[2], tau, form=form))


def test_nothing_that_moves():
    m = phipsi.Model.from_urdf_text("<robot name='r'><link name='a'/></robot>")
    assert (m.nq, m.nv) == (0, 0)
    assert m.forward_dynamics([], [], []).shape == (0,)
    assert m.mass_matrix(np.zeros((4, 0))).shape == (4, 0, 0)
    assert m.kinetic_energy([], []) == 0.0
    _, info = m.forward_dynamics([], [], [], info=True)
    assert info.worst_hinge is None
    with pytest.raises(phipsi.NumericalError, match="center of mass"):
        m.center_of_mass([])


def test_damping_and_friction_are_not_part_of_pure_mechanics():
    m = arm()
    q, v = np.array([0.1, 0.2]), np.array([1.0, 2.0])
    assert np.array_equal(m.passive_forces(q, v), [-0.1, 0.0])
    other = phipsi.Model.from_urdf_text(ARM.read_text().replace('<dynamics damping="0.1"/>', ""))
    assert np.array_equal(m.forward_dynamics(q, v, v), other.forward_dynamics(q, v, v))
    dry = phipsi.Model.from_urdf_text(ARM.read_text().replace('damping="0.1"', 'friction="3"'))
    assert dry.passive_forces(q, v)[0] == -3.0  # tanh(100) is 1 in double precision


def test_every_joint_type_round_trips():
    kinds = ["spherical", "planar", "cylindrical", "universal", "translation", "continuous"]
    text = mixed(*kinds)
    before = '<child link="body4"/>'
    m = phipsi.Model.from_urdf_text(text.replace(before, before + '<axis2 xyz="0 1 0"/>'), base="free")
    assert sorted(m.joint_types) == sorted(["floating", *kinds])
    q, v = m.random_state(3)
    close(m.difference(q, m.integrate(q, v)), v, 3.0, m.nv)
    tau = np.linspace(-1, 1, m.nv)
    M = m.mass_matrix(q)
    force = np.abs(M).max() + np.abs(m.bias_forces(q, v)).max()
    close(m.inverse_dynamics(q, v, m.forward_dynamics(q, v, tau)), tau, np.linalg.cond(M) * force, m.nv)


def test_import_needs_numpy_only():
    code = "import sys, phipsi; assert not {'pinocchio', 'mujoco', 'scipy'} & set(sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize("seed", range(3))
def test_hybrid_dynamics(model, seed):
    """Any pattern gives an acceleration and a force that belong together; batches are single calls."""
    m = model
    rng = np.random.default_rng(seed)
    q, v = m.random_state(seed)
    active = rng.random(m.nv) < 0.5
    a_active, tau_passive = rng.uniform(-1, 1, active.sum()), rng.uniform(-1, 1, (~active).sum())
    tau_active, a_passive = m.hybrid_dynamics(q, v, active, a_active, tau_passive)
    a, tau = np.empty(m.nv), np.empty(m.nv)
    a[active], a[~active] = a_active, a_passive
    tau[active], tau[~active] = tau_active, tau_passive
    M, inverse = m.mass_matrix(q), m.mass_matrix_inverse(q)
    force = np.abs(M).max() * (1 + np.abs(a).max()) + np.abs(m.bias_forces(q, v)).max()
    close(m.inverse_dynamics(q, v, a), tau, force, m.nv * max(1.0, np.abs(M).max() * np.abs(inverse).max()))
    two = m.hybrid_dynamics(q, v, active, np.stack([a_active, 2 * a_active]), tau_passive)
    assert np.array_equal(two[0][0], tau_active) and np.array_equal(two[1][0], a_passive)
    with pytest.raises(phipsi.ArgumentError, match="active"):
        m.hybrid_dynamics(q, v, [True], a_active, tau_passive)
    with pytest.raises(phipsi.ArgumentError, match="tau_passive"):
        m.hybrid_dynamics(q, v, active, a_active, np.zeros(m.nv + 1))
