"""Free-flying systems from Python: inertia at every body, motions at zero momentum."""

from __future__ import annotations

import numpy as np
import pytest

import phipsi
from validation import robots

from .common import arm

SEEDS = range(3)


@pytest.fixture(params=["arm", "solo12"])
def model(request):
    if request.param == "arm":
        return arm("free")
    return phipsi.Model.from_urdf(robots.model_path(request.param))


@pytest.mark.parametrize("seed", SEEDS)
def test_inertias_are_those_of_the_mass_matrix(model, seed):
    m = model
    q, _ = m.random_state(seed)
    inverse = m.mass_matrix_inverse(q)
    felt = m.articulated_inertias(np.stack([q, q]))
    assert felt.shape == (2, len(m.body_names) - ("world" in m.body_names), 6, 6)
    for body, inertia in zip([b for b in m.body_names if b != "world"], felt[0]):
        R = m.body_pose(q, body)[:3, :3]
        turn = np.kron(np.eye(2), R.T)
        J = turn @ m.jacobian(q, body)
        mobility = J @ inverse @ J.T
        kappa = np.linalg.cond(mobility)
        assert np.abs(inertia @ mobility - np.eye(6)).max() < 1e-13 * kappa, body


@pytest.mark.parametrize("seed", SEEDS)
def test_space_jacobian(model, seed):
    m = model
    q, v = m.random_state(seed)
    M = m.mass_matrix(q)
    v = v.copy()
    v[:6] = -np.linalg.solve(M[:6, :6], M[:6, 6:] @ v[6:])
    assert np.abs(m.momentum(q, v)).max() < 1e-12 * np.abs(M).max() * np.abs(v).max()
    body = m.body_names[-1]
    point = np.array([0.1, 0.2, -0.1])
    moved = m.space_jacobian(q, body, point=point) @ v[6:]
    wanted = m.jacobian(q, body, point=point) @ v
    assert np.abs(moved - wanted).max() < 1e-12 * (1 + np.abs(wanted).max())


def test_reactionless(model):
    m = model
    q, _ = m.random_state(5)
    basis = m.reactionless_basis(q)
    assert basis.shape[0] == m.nv - 6 and basis.shape[1] >= max(0, m.nv - 12)
    assert np.abs(basis.T @ basis - np.eye(basis.shape[1])).max(initial=0) < 1e-13
    M = m.mass_matrix(q)
    assert np.abs(M[:6, 6:] @ basis).max(initial=0) < 1e-12 * np.abs(M).max()


def test_fixed_bases_are_refused():
    m = arm("fixed")
    for call in (m.articulated_inertias, m.reactionless_basis, lambda q: m.space_jacobian(q, "lower")):
        with pytest.raises(phipsi.ModelError, match="floating|free base"):
            call(m.neutral())
