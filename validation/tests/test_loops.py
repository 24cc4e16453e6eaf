"""Closed loops through ``Model.close_loop`` against extended precision (``validation/data/loops``)."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import phipsi

from .common import ARM

DATA = Path(__file__).parents[1] / "data" / "loops"

MODELS = ["ladderL_0001", "ladderL_0004", "ladderL_0016", "ladderL_0064", "ladderL_0128", "stewart", "twoarm"]


def pose(xyz: list[float], rpy: list[float]) -> np.ndarray:
    """A 4×4 pose of URDF's numbers."""
    (sr, sp, sy), (cr, cp, cy) = np.sin(rpy), np.cos(rpy)
    about = [
        [[1, 0, 0], [0, cr, -sr], [0, sr, cr]],
        [[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]],
        [[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]],
    ]
    out = np.eye(4)
    out[:3, :3] = np.array(about[2]) @ np.array(about[1]) @ np.array(about[0])
    out[:3, 3] = xyz
    return out


def load(name: str) -> tuple[phipsi.Model, dict[str, Any], phipsi.interop.Pinocchio]:
    """A model with its loops, its data and the layout of those."""
    data = json.loads((DATA / f"{name}.json").read_text())
    m = phipsi.Model.from_urdf(DATA / f"{name}.urdf", mimic="free")
    m.gravity = (0.0, 0.0, -9.81)
    for c in data["closures"]:
        kind = {"point3": "spherical", "frame6": "weld"}[c["type"]]
        a, b = pose(c["xyz_a"], c["rpy_a"]), pose(c["xyz_b"], c["rpy_b"])
        m.close_loop(c["link_a"], a, c["link_b"], b, kind=kind, name=c["name"])
    return m, data, phipsi.interop.Pinocchio(m, [joint["name"] for joint in data["joints"]])


def error(got: np.ndarray, want: np.ndarray) -> float:
    """Largest error over largest number."""
    return float(np.abs(got - want).max() / np.abs(want).max())


@pytest.mark.parametrize("name", MODELS)
def test_loops_agree_with_extended_precision(name: str) -> None:
    m, data, layout = load(name)
    array = {key: np.array([s[key] for s in data["samples"]]) for key in data["samples"][0]}
    q, v, tau = layout.q_in(array["q"]), layout.v_in(array["v"]), layout.f_in(array["tau"])
    a, info = m.forward_dynamics(q, v, tau, info=True)
    assert error(a, layout.v_in(array["ddq_closed_ext"])) <= 1e-12
    force = m.generalized_constraint_force(q, v, tau)
    assert error(force, layout.f_in(array["generalized_constraint_force_ext"])) <= 1e-12
    assert (info.rank == array["rank"]).all()
    assert (info.closure_residual < 1e-12).all() and (info.backward_error < 1e-13).all()
    # One state gives what it gives in a batch of any shape.
    assert (m.forward_dynamics(q[-1], v[-1], tau[-1]) == a[-1]).all()
    assert m.generalized_constraint_force(q, v[:, None], tau[:, None]).shape == (len(q), len(q), m.nv)
    single = m.closure_forces(q[-1], v[-1], tau[-1])
    for name, batched in m.closure_forces(q, v, tau).items():
        assert (batched[-1] == single[name]).all()
    assert (m.assemble(q)[0][-1] == m.assemble(q[-1])[0]).all()
    assert (m.closure_residual(q)[-1] == m.closure_residual(q[-1])).all()


def test_closures_are_asked_and_assembled() -> None:
    m, data, layout = load("ladderL_0001")
    assert m.closure_names == ["c1"]
    q = layout.q_in(np.array(data["samples"][0]["q"]))
    v = layout.v_in(np.array(data["samples"][0]["v"]))
    assert np.abs(m.closure_residual(q)).max() < 1e-15
    position, velocity = m.closure_residual(np.stack([q, q]), v)
    assert position.shape == velocity.shape == (2, 3) and np.abs(velocity).max() < 1e-15
    found, info = m.assemble(q + np.array([0.1, -0.2, 0.15]))
    assert np.abs(m.closure_residual(found)).max() < 1e-14 and 0 < info.iterations < 20
    a, judged = m.forward_dynamics(q, v, np.zeros(3), info=True)
    assert judged.redundant == ["closure `c1`: translation along z"]
    # The force of the closure is what the closure needs: across the plane nothing.
    force = m.closure_forces(q, v, np.zeros(3))["c1"]
    assert force.shape == (3,) and abs(force[2]) < 1e-12 * np.abs(force).max()


def test_a_mimic_couples_two_joints() -> None:
    text = """<robot name="gear"><link name="world"/>
    <link name="a"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="2"/></inertial></link>
    <link name="b"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="0.5"/></inertial></link>
    <joint name="ja" type="continuous"><parent link="world"/><child link="a"/><axis xyz="0 0 1"/></joint>
    <joint name="jb" type="continuous"><parent link="world"/><child link="b"/><axis xyz="0 0 1"/>
      <mimic joint="ja" multiplier="-3"/></joint></robot>"""
    m = phipsi.Model.from_urdf_text(text)
    a = m.forward_dynamics([0.1, -0.3], [0.0, 0.0], [1.0, 0.5])
    # (2 + 9 · 0.5) θ̈ = 1 − 3 · 0.5.
    np.testing.assert_allclose(a, np.array([1, -3]) * -0.5 / 6.5, rtol=1e-14)
    with pytest.raises(phipsi.ModelError):
        m.inverse_dynamics([0.0, 0.0], [0.0, 0.0], [0.0, 0.0])


def test_wrong_closures_are_refused() -> None:
    m, _, _ = load("ladderL_0001")
    one = np.eye(4)
    with pytest.raises(phipsi.ArgumentError, match="kind"):
        m.close_loop("rung1", one, "right1", one, kind="glue")
    with pytest.raises(phipsi.ArgumentError, match="body_b"):
        m.close_loop("rung1", one, "nobody", one)
    with pytest.raises(phipsi.ArgumentError, match=r"pose_a.*\(3, 3\)"):
        m.close_loop("rung1", np.eye(3), "right1", one)
    with pytest.raises(phipsi.ArgumentError, match="pose_b"):
        m.close_loop("rung1", one, "right1", 2 * one)
    with pytest.raises(phipsi.ModelError, match="given twice"):
        m.close_loop("rung1", one, "right1", one, name="c1")
    with pytest.raises(phipsi.ModelError, match="distance"):
        m.close_loop("rung1", one, "right1", one, kind="distance")
    far = np.eye(4)
    far[0, 3] = 50.0
    m.close_loop("world", far, "right1", one, kind="spherical", name="far")
    with pytest.raises(phipsi.NumericalError, match="far"):
        m.assemble(m.neutral())
    with pytest.raises(phipsi.ArgumentError, match="form"):
        m.forward_dynamics(m.neutral(), np.zeros(3), np.zeros(3), form="refined")


def test_projections_close_the_loops() -> None:
    m, data, layout = load("stewart")
    sample = data["samples"][0]
    q, v = (np.array(sample[key], float) for key in ("q", "v"))
    q, v = layout.q_in(q), layout.v_in(v)
    rng = np.random.default_rng(1)
    off = m.integrate(q, 1e-4 * rng.normal(size=(3, m.nv)))
    on, info = m.project_position(off)
    assert info.closure_residual.shape == (3,) and info.iterations.max() < 6
    assert np.abs(m.closure_residual(on)).max() < 1e-14
    wild = rng.normal(size=(3, m.nv))
    kept, info = m.project_velocity(on, wild)
    assert np.all(info.rank == data["samples"][0]["rank"]) and np.all(info.energy_removed > 0)
    assert np.abs(m.closure_residual(on, kept)[1]).max() < 1e-13
    # The least kinetic energy of the change: it is orthogonal to what the closures allow.
    for state in range(3):
        change = m.mass_matrix(on[state]) @ (kept[state] - wild[state])
        assert abs(change @ kept[state]) < 1e-12 * abs(change @ wild[state])
        assert abs(info.energy_removed[state] + 0.5 * change @ wild[state]) < 1e-12 * info.energy_removed[state]


def test_the_projection_of_closed_chains() -> None:
    m, data, layout = load("twoarm")
    q = layout.q_in(np.array(data["samples"][0]["q"], float))
    P = m.closure_projection(q)
    assert P.rank == data["samples"][0]["rank"]
    dense = P.apply(np.eye(m.nv))
    # Symmetric, idempotent, of the trace that its rank leaves.
    assert np.abs(dense - dense.T).max() < 1e-13 and np.abs(dense @ dense - dense).max() < 1e-13
    assert abs(np.trace(dense) - (m.nv - P.rank)) < 1e-12
    m.gravity = (0.0, 0.0, 0.0)
    tau = np.linspace(-1, 1, m.nv)
    a = m.forward_dynamics(q, np.zeros(m.nv), tau)
    assert error(P.solve(tau), a) < 1e-13


def test_prescribed_joints_of_closed_chains() -> None:
    m, data, layout = load("twoarm")
    sample = data["samples"][0]
    q, v, tau = (np.array(sample[key], float) for key in ("q", "v", "tau"))
    q, v, tau = layout.q_in(q), layout.v_in(v), layout.f_in(tau)
    a = m.forward_dynamics(q, v, tau)
    active = np.zeros(m.nv, bool)
    active[:4] = True
    # The accelerations that these forces make need these forces.
    needed, others = m.hybrid_dynamics(q, v, active, a[active], tau[~active])
    assert error(others, a[~active]) < 1e-12 and error(needed, tau[active]) < 1e-11
    # Other ones: what comes out is dynamics with loops again.
    given = a[active] + [0.3, -0.2, 0.1, 0.4]
    needed, others = m.hybrid_dynamics(q, v, active, given, tau[~active])
    forces = tau.copy()
    forces[active] = needed
    assert error(m.forward_dynamics(q, v, forces), np.concatenate([given, others])) < 1e-11


def test_what_contradicts_the_loops_is_said() -> None:
    m, _, _ = load("ladderL_0001")
    q = m.assemble([0.7, -0.7, 0.7])[0]
    _, info = m.forward_dynamics(q, np.zeros(3), np.zeros(3), info=True)
    assert info.inconsistency is None and info.rank == 2 and len(info.redundant) == 1
    name = m.closure_names[0]
    # Across the plane nothing can move: a closure that is told to does not agree with its other rows.
    motion = np.zeros((3, 3))
    motion[2] = 1.0
    _, info = m.forward_dynamics(q, np.zeros(3), np.zeros(3), info=True, closure_motion={name: motion})
    assert info.inconsistency.startswith(f"closure `{name}`: translation along"), info.inconsistency
    with pytest.raises(phipsi.ArgumentError, match="closure_motion"):
        m.forward_dynamics(q, np.zeros(3), np.zeros(3), closure_motion={"pine": motion})


def test_a_moving_closure_pulls_its_bodies() -> None:
    """A closure that moves the tip of an arm: its rows have the acceleration that is given."""
    m = phipsi.Model.from_urdf(ARM)
    m.close_loop("world", np.eye(4), m.body_names[-1], np.eye(4), kind="point_on_plane", name="floor")
    q, _ = m.assemble([0.3, 0.2])
    v = np.zeros(m.nv)
    a, info = m.forward_dynamics(q, v, v, info=True, closure_motion={"floor": [[0.0], [0.0], [0.25]]})
    h = 1e-4
    moved = m.closure_residual(m.integrate(q, 0.5 * h * h * a))[0]
    # Second derivative by its Taylor polynomial: the next term is h times the rate of the acceleration.
    assert abs(2 * moved / h**2 - 0.25) < 1e-4


def test_the_tree_is_chosen_for_the_loops() -> None:
    m, _, _ = load("ladderL_0004")
    before = m.joint_names
    assert m.choose_tree(keep=m.closure_names).startswith("the given tree") and m.joint_names == before
    with pytest.raises(phipsi.ArgumentError, match="keep"):
        m.choose_tree(keep=["nothing"])
