"""Flexible bodies from Python: what they are made of, every call of a tree, loops, simulation."""

from __future__ import annotations

import numpy as np
import pytest

import phipsi

from .common import EPSILON, arm

BEAM = dict(
    bending=[1, 1], torsion=1, torsional_stiffness=2.0, polar_inertia=0.01, axial_stiffness=1e3, damping=1e-3, stiffened=True
)


def flexible_arm():
    """The arm of two links with its last one a beam."""
    m = arm("fixed")
    return m.with_flexible_body(m.body_names[-1], phipsi.FlexibleBody.beam(1.0, 1.0, [3.0, 2.0], **BEAM))


def state(m, seed=1):
    q, v = m.random_state(seed)
    q[m.nq - len(m.mode_names) :] *= 0.1
    return q, v


def test_calls_of_a_tree_agree():
    m = flexible_arm()
    (q, v), n = state(m), len(m.mode_names)
    assert m.nv == 2 + n and n == 7 and m.mode_v_offset(m.body_names[-1]) == 2
    tau = np.linspace(-1, 1, m.nv)
    a = m.forward_dynamics(q, v, tau)
    M = m.mass_matrix(q)
    kappa = np.abs(M).max() * np.abs(m.mass_matrix_inverse(q)).max()
    # n·ε·κ of an elimination and its inverse.
    budget = 100 * m.nv * EPSILON * kappa
    assert np.abs(m.inverse_dynamics(q, v, a) - tau).max() <= budget * (1 + np.abs(tau).max())
    assert np.allclose(M @ m.mass_matrix_inverse(q), np.eye(m.nv), rtol=0, atol=budget)
    assert np.allclose(M, M.T, rtol=0, atol=10 * EPSILON * np.abs(M).max())
    assert np.isclose(v @ M @ v / 2, m.kinetic_energy(q, v), rtol=1e-13)
    assert np.isclose(m.log_determinant(q), np.linalg.slogdet(M)[1], rtol=1e-12)
    # Differences of second order, of functions with third derivatives of size one.
    h = 1e-6
    gradient = m.log_determinant_gradient(q)
    for i in range(m.nv):
        step = np.zeros(m.nv)
        step[i] = h
        slope = (m.log_determinant(m.integrate(q, step)) - m.log_determinant(m.integrate(q, -step))) / (2 * h)
        assert abs(slope - gradient[i]) < 1e-7 * (1 + abs(gradient[i]))
    dq, dv, dtau = m.forward_dynamics_derivatives(q, v, tau)
    assert np.allclose(dtau, m.mass_matrix_inverse(q), rtol=0, atol=budget * np.abs(dtau).max())
    step = np.zeros(m.nv)
    step[-1] = h
    slope = (m.forward_dynamics(m.integrate(q, step), v, tau) - m.forward_dynamics(m.integrate(q, -step), v, tau)) / (2 * h)
    assert np.allclose(slope, dq[:, -1], rtol=1e-6, atol=1e-6 * np.abs(dq).max())
    both = m.forward_dynamics(np.stack([q, 0.5 * q]), v, tau)
    assert both.shape == (2, m.nv) and np.allclose(both[0], a, rtol=1e-12)


def test_frequencies_of_a_beam():
    beam = phipsi.FlexibleBody.beam(2.0, 1.5, [3.0, 12.0], bending=[3, 3])
    roots = np.array([1.87510407, 4.69409113])
    unit = np.sqrt(3.0 / 1.5) / 4
    # Two planes, the second twice as high; a Ritz method has them from above, the second of each plane with few modes beyond it.
    wanted = np.sort(np.concatenate([roots**2 * unit, 2 * roots**2 * unit]))
    assert np.all(beam.frequencies[:4] >= wanted)
    assert np.allclose(beam.frequencies[:2], wanted[:2], rtol=1e-4) and np.allclose(beam.frequencies[2:4], wanted[2:], rtol=1e-3)


def elements(sparse=None):
    """Masses of 1 kg on springs in a row, all at one place, the first held: arrays or scipy's matrices."""
    chain = np.array([[1.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]])
    stiffness, mass = np.kron(chain, np.eye(3)), np.diag([0.0] * 3 + [1.0] * 6)
    positions = np.zeros((3, 3))
    make = sparse or (lambda x: x)
    return make(mass), make(stiffness), positions


def test_elements_from_arrays_and_files(tmp_path):
    golden = (np.sqrt(5) - 1) / 2
    make = phipsi.FlexibleBody.craig_bampton
    mass, stiffness, positions = elements()
    body = make(mass, stiffness, positions, [0], {"tip": 2}, modes=3)
    assert np.allclose(body.frequencies[:3], golden, rtol=1e-14) and body.nodes == ["tip"]
    assert "9 degrees of freedom reduced to 6 modes" in body.report
    paths = []
    for name, matrix in (("m", mass), ("k", stiffness)):
        rows = [f"{i + 1} {j + 1} {matrix[i, j]!r}" for i in range(9) for j in range(9) if matrix[i, j]]
        text = "%%MatrixMarket matrix coordinate real general\n" + f"9 9 {len(rows)}\n" + "\n".join(rows).replace("np.float64(", "").replace(")", "")
        (tmp_path / f"{name}.mtx").write_text(text + "\n")
        paths.append(tmp_path / f"{name}.mtx")
    assert np.array_equal(make(*paths, positions, [0], {"tip": 2}, modes=3).frequencies, body.frequencies)
    with pytest.raises(phipsi.ModelError, match="node 7"):
        make(mass, stiffness, positions, [0], {"tip": 7})
    with pytest.raises(phipsi.ArgumentError, match="symmetric"):
        make(mass, stiffness + np.triu(np.ones((9, 9)), 1), positions, [0], {"tip": 2})
    with pytest.raises(OSError):
        make(tmp_path / "none.mtx", paths[1], positions, [0], {"tip": 2})


def test_integrals_of_a_beam_are_the_beam():
    product = np.zeros((1, 1, 3, 3))
    product[0, 0, 1, 1] = 0.5
    body = phipsi.FlexibleBody.from_integrals(
        2.0, [[8.0]], displacement=[[0, 1.0, 0]], product=product, nodes={"tip": {"position": [1.0, 0, 0], "displacement": [[0, 1.0, 0]]}}
    )
    assert np.allclose(body.frequencies, [4.0], rtol=1e-14) and body.nodes == ["tip"]
    with pytest.raises(phipsi.ArgumentError, match="positon"):
        phipsi.FlexibleBody.from_integrals(2.0, [[8.0]], nodes={"tip": {"positon": [1.0, 0, 0]}})
    with pytest.raises(phipsi.ModelError, match="positive definite"):
        arm("fixed").with_flexible_body("lower", phipsi.FlexibleBody.from_integrals(2.0, [[8.0]]))


def test_a_loop_over_a_beam():
    tree, m = flexible_arm(), flexible_arm()
    q, v = state(m)
    pose = np.eye(4)
    pose[:3, 3] = m.body_pose(q, m.body_names[-1])[:3, 3]
    m.close_loop("world", pose, m.body_names[-1], np.eye(4), kind="spherical", name="pin")
    a, info = m.forward_dynamics(q, np.zeros(m.nv), np.zeros(m.nv), info=True)
    assert info.rank >= 1 and np.max(info.closure_residual) < 1e-14
    force = m.generalized_constraint_force(q, np.zeros(m.nv), np.zeros(m.nv))
    M = tree.mass_matrix(q)
    free = tree.inverse_dynamics(q, np.zeros(m.nv), np.zeros(m.nv))
    assert np.allclose(M @ a, force - free, rtol=0, atol=1e-10 * np.abs(free).max())


def test_simulation_keeps_energy():
    m = arm("fixed")
    m = m.with_flexible_body("lower", phipsi.FlexibleBody.beam(1.0, 1.0, [30.0, 20.0], bending=[1, 1]))
    q, v = state(m, 3)
    t = phipsi.simulate(m, q, 0.1 * v, t_end=0.5, rtol=1e-10)
    # The arm's joints are damped: what they take is counted.
    assert t.error.energy_error < 1e-9
    assert t.q.shape[1] == m.nq


def test_mistakes_are_named():
    m = flexible_arm()
    q, v = state(m)
    with pytest.raises(phipsi.ArgumentError, match="lower"):
        m.jacobian(q, "lower")
    with pytest.raises(phipsi.ModelError, match="end"):
        m.with_flexible_body("upper", phipsi.FlexibleBody.beam(1.0, 1.0, [3.0, 3.0]), nodes={m.joint_names[1]: "end"})
    with pytest.raises(phipsi.NumericalError, match="lower.mode7"):
        m.forward_dynamics(q, v, [0.0] * (m.nv - 1) + [np.nan])
    with pytest.raises(phipsi.ArgumentError, match="rigid"):
        m.mode_q_offset("upper")
    with pytest.raises(phipsi.ArgumentError):
        phipsi.FlexibleBody.beam(-1.0, 1.0, [3.0, 3.0])
