"""Operators of a model from Python: expressions, their evaluation, and the kernels beside them."""

from __future__ import annotations

import numpy as np
import pytest

import phipsi
from validation import robots

from .common import EPSILON, arm


@pytest.fixture(params=["arm", "arm-free", "panda", "solo12"])
def model(request):
    if request.param.startswith("arm"):
        return arm("free" if request.param == "arm-free" else "fixed")
    return phipsi.Model.from_urdf(robots.model_path(request.param))


def close(got, wanted, scale, n):
    """n·ε of the size of the terms; the models here have κ below a hundred."""
    assert np.abs(np.asarray(got) - wanted).max() <= 100 * n * EPSILON * scale


def test_expressions_are_the_kernels(model):
    m = model
    q, v = m.random_state(1)
    tau = np.linspace(-1, 1, m.nv)
    ops = phipsi.operators(m, q)
    assert len(ops.bodies) * 6 == ops.phi.shape[0] and ops.H.shape == (m.nv, ops.phi.shape[0])
    mass = ops.H @ ops.phi @ ops.M @ ops.phi.T @ ops.H.T
    assert str(mass) == "H φ M φ* H*"
    M, inverse = m.mass_matrix(q), m.mass_matrix_inverse(q)
    kappa = np.abs(M).max() * np.abs(inverse).max()
    close(mass.dense(), M, np.abs(M).max(), m.nv)
    close(mass.inv() @ tau, m.solve_mass_matrix(q, tau), np.abs(inverse).max() * kappa, m.nv)
    L = ops.I_joint - ops.H @ ops.psi @ ops.K
    close((L.T @ ops.D_inverse @ L).dense(), inverse, np.abs(inverse).max() * kappa, m.nv)
    assert mass.cost < 1000 * len(ops.bodies) + 1000
    for body in m.body_names[-2:]:
        point = np.array([0.1, -0.2, 0.3])
        J = m.jacobian(q, body, point=point)
        R = m.body_pose(q, body)[:3, :3]
        try:
            B = ops.B(body, point)
        except phipsi.ArgumentError:
            continue
        own = B.T @ ops.phi.T @ ops.H.T @ v
        close(np.concatenate([R @ own[:3], R @ own[3:]]), J @ v, m.nv, m.nv)


def test_algebra(model):
    ops = phipsi.operators(model, model.random_state(2)[0])
    x = np.arange(1.0, 1.0 + ops.phi.shape[1])
    batch = np.stack([x, -x, 2 * x])
    close((ops.phi @ batch)[1], -(ops.phi @ x), np.abs(ops.phi @ x).max(), 1)
    close(x @ ops.phi, ops.phi.T @ x, np.abs(ops.phi.T @ x).max(), 1)
    close(ops.phi.inv() @ (ops.phi @ x), x, np.abs(ops.phi @ x).max(), len(x))
    close((2.0 * ops.phi - ops.phi) @ x, ops.phi @ x, np.abs(ops.phi @ x).max(), len(x))
    close((ops.phi - ops.I - ops.phi_tilde).dense(), 0.0, np.abs(ops.phi.dense()).max(), len(x))
    close((ops.tau + ops.tau_bar).dense(), np.eye(len(x)), np.abs(ops.tau.dense()).max(), len(x))
    omega = ops.psi.T @ ops.H.T @ ops.D_inverse @ ops.H @ ops.psi
    close((omega - ops.omega).dense(), 0.0, np.abs(omega.dense()).max(), len(x))


def test_sensitivities_are_differences(model):
    m = model
    q, _ = m.random_state(3)
    step = 1e-5
    for i in (0, m.nv - 1):
        e = np.zeros(m.nv)
        e[i] = step
        rates = phipsi.operators(m, q).sensitivity(i)
        after, before = phipsi.operators(m, m.integrate(q, e)), phipsi.operators(m, m.integrate(q, -e))
        for name in ("phi", "P", "D", "G", "K", "psi", "upsilon", "R", "S", "omega"):
            wanted = (getattr(after, name).dense() - getattr(before, name).dense()) / (2 * step)
            scale = np.abs(getattr(after, name).dense()).max() + np.abs(wanted).max()
            # Central differences: step² times a third derivative, and rounding over the step.
            assert np.abs(rates[name].dense() - wanted).max() <= 1e-7 * scale * m.nv, name


def test_derivatives_are_those_of_the_kernels(model):
    """Expressions of sections 4.5 against the kernels, which dual numbers check."""
    m = model
    q, v = m.random_state(4)
    tau = np.linspace(-1.0, 1.0, m.nv)
    ops = phipsi.operators(m, q)
    pairs = [
        *zip(ops.inverse_dynamics_derivatives(v, tau), m.inverse_dynamics_derivatives(q, v, tau), strict=True),
        *zip(ops.forward_dynamics_derivatives(v, tau), m.forward_dynamics_derivatives(q, v, tau), strict=True),
        *zip(ops.linearize(v, tau), m.linearize(q, v, tau), strict=True),
    ]
    condition = np.linalg.cond(m.mass_matrix(q)) if m.nv else 1.0
    for ours, wanted in pairs:
        close(ours.dense(), wanted, np.abs(wanted).max(initial=0.0), m.nv * condition)
    gradient = m.log_determinant_gradient(q)
    close(ops.log_determinant_gradient(), gradient, 1.0 + np.abs(gradient).max(initial=0.0), m.nv * condition)
    with pytest.raises(phipsi.ArgumentError, match="one state"):
        ops.linearize([v, v], tau)


def test_mistakes_are_named(model):
    ops = phipsi.operators(model, model.neutral() if model.nv else [])
    with pytest.raises(phipsi.ArgumentError, match="do not fit"):
        ops.phi @ ops.H
    with pytest.raises(phipsi.ArgumentError, match="no identity"):
        (ops.phi + ops.phi.T).inv()
    with pytest.raises(phipsi.ArgumentError, match="`x` has shape"):
        ops.phi @ [1.0, 2.0]
    with pytest.raises(phipsi.ArgumentError, match="one configuration"):
        phipsi.operators(model, [model.neutral()] * 2)
    with pytest.raises(phipsi.ArgumentError, match="world"):
        ops.B("world")
    with pytest.raises(phipsi.ArgumentError, match="99"):
        ops.sensitivity(99)


def test_estimation_is_dynamics(model):
    """Paper 1 from Python: the filter whitens, the smoother solves, the batch estimate is the smoothed force."""
    q, tau = model.random_state(4)[0], np.linspace(-1, 1, model.nv)
    ops = phipsi.operators(model, q)
    inverse = model.mass_matrix_inverse(q)
    kappa = np.abs(model.mass_matrix(q)).max() * np.abs(inverse).max()
    smoothed = ops.smooth(np.stack([tau, 2 * tau]))
    filtered = ops.filter(tau)
    L = ops.I_joint - ops.H @ ops.psi @ ops.K
    close(filtered.innovation, L @ tau, np.abs(L @ tau).max(), model.nv)
    close(smoothed.filtered.residual[1], 2 * filtered.residual, np.abs(filtered.residual).max(), 1)
    close(smoothed.acceleration[0], model.solve_mass_matrix(q, tau), np.abs(inverse).max() * kappa, model.nv)
    close(ops.H @ smoothed.force[0], tau, kappa, model.nv)
    close(ops.batch_gain @ tau, smoothed.force[0], np.abs(smoothed.force[0]).max() * kappa, model.nv)
    S = np.abs(ops.S.dense()).max()
    close((ops.H @ ops.smoothed_error_covariance).dense(), 0.0, S * kappa, model.nv)
    with pytest.raises(phipsi.ArgumentError, match="tau"):
        ops.filter([1.0])


def test_the_random_field_gives_the_mass_matrix(model):
    """The error is within four of its expected size: one in a thousand of seeds is farther off, and these are fixed."""
    q = model.random_state(5)[0]
    ops = phipsi.operators(model, q)
    M = model.mass_matrix(q)
    for count in (1000, 4000):
        estimate, error = ops.estimate_mass_matrix(count, seed=1)
        samples = ops.sample_field(count, seed=1)
        assert np.allclose(samples.T.T @ samples.T / count, estimate, rtol=0, atol=1e-12 * np.abs(M).max())
        assert np.linalg.norm(estimate - M) < 4 * error
        assert np.isclose(error, np.sqrt((np.linalg.norm(M) ** 2 + np.trace(M) ** 2) / count))
    assert np.allclose(samples.X, ops.phi @ samples.W) and np.allclose(samples.T, ops.H @ samples.X)
    with pytest.raises(phipsi.ArgumentError, match="count"):
        ops.sample_field(0, seed=1)


def test_diagonal_velocities(model):
    q, v = model.random_state(6)
    nu, eta = model.diagonal_velocity(q, v), model.diagonal_velocity(q, v, normalized=False)
    energy = model.kinetic_energy(q, v)
    assert np.isclose(nu @ nu / 2, energy, rtol=1e-12)
    if len(model.joint_names) == model.nv:
        # The components of a joint are eliminated one after the other, where D of the operators is a block.
        assert np.isclose(eta @ (phipsi.operators(model, q).D @ eta) / 2, energy, rtol=1e-12)
    assert np.allclose(model.joint_velocity(q, nu), v, rtol=0, atol=1e-11 * np.abs(v).max())
    assert abs(nu @ model.diagonal_coriolis(q, nu)) < 1e-11 * (nu @ nu) ** 1.5
    tau = np.linspace(-1, 1, model.nv)
    same, rate = model.diagonal_dynamics(q, nu, tau)
    assert np.allclose(same, v, rtol=0, atol=1e-11 * np.abs(v).max())
    # Power: d/dt of the kinetic energy is what forces and weight give.
    power = v @ (tau - model.gravity_forces(q))
    assert np.isclose(nu @ rate, power, rtol=0, atol=1e-9 * (np.abs(nu) @ np.abs(rate) + abs(power)))
