"""Closed loops through ``Model.close_loop`` against extended precision (``validation/data/loops``)."""

from __future__ import annotations

import warnings

import mpmath
import numpy as np
import pytest

import phipsi
from validation import loops
from validation.compare import relative
from validation.loops import open_case

from .common import ARM, EPSILON


@pytest.mark.parametrize("name", loops.NAMES)
def test_loops_agree_with_extended_precision(name: str) -> None:
    case = open_case(name)
    m, q, v, tau = case.m, case.q, case.v, case.tau
    a, info = m.forward_dynamics(q, v, tau, info=True)
    assert relative(a, case.accelerations) <= 1e-12
    force = m.generalized_constraint_force(q, v, tau)
    assert relative(force, case.forces) <= 1e-12
    assert (info.rank == case.rank).all()
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
    case = open_case("ladderL_0001")
    m, q, v = case.m, case.q[0], case.v[0]
    assert m.closure_names == ["c1"]
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
    m = open_case("ladderL_0001").m
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


LINKS = 8


def chain_text(heavy: float, place: int = 4) -> str:
    """Links of 1 m in the x-z plane, all but one of 1 kg."""
    parts, parent = ['<robot name="chain"><link name="world"/>'], "world"
    for k in range(LINKS):
        mass = heavy if k == place else 1.0
        parts.append(
            f'<link name="b{k}"><inertial><origin xyz="0.5 0 0"/><mass value="{mass}"/><inertia ixx="{0.01 * mass}" '
            f'iyy="{mass / 12}" izz="{mass / 12}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
            f'<joint name="j{k}" type="continuous"><parent link="{parent}"/><child link="b{k}"/>'
            f'<origin xyz="{0 if k == 0 else 1} 0 0"/><axis xyz="0 1 0"/></joint>'
        )
        parent = f"b{k}"
    return "".join(parts) + "</robot>"


def pinned_accelerations(heavy: float, q: np.ndarray, v: np.ndarray, tau: np.ndarray, weight: float) -> np.ndarray:
    """Accelerations of the chain with its tip pinned, by Lagrange's equations in absolute angles and 40 digits."""

    def wide(x: np.ndarray) -> np.ndarray:
        return np.array([mpmath.mpf(float(x)) for x in x], dtype=object)

    with mpmath.workdps(40):
        mass = [heavy if k == 4 else 1.0 for k in range(LINKS)]
        angle, rate = np.cumsum(wide(q)), np.cumsum(wide(v))
        sine, cosine = np.vectorize(mpmath.sin)(angle), np.vectorize(mpmath.cos)(angle)
        # Along a link (cos, -sin): x and z; its first and second derivative by the angle.
        turn, bend = np.stack([-sine, -cosine], axis=1), np.stack([-cosine, sine], axis=1)
        matrix = np.diag(wide(np.array([m / 12 for m in mass])))
        # Joint torques do work on differences of angles.
        force = wide(tau) - wide(np.append(tau[1:], 0.0))
        for k in range(LINKS):
            share = wide(np.array([1.0] * k + [0.5] + [0.0] * (LINKS - 1 - k)))
            jacobian, drift = share[:, None] * turn, (share * rate**2) @ bend
            matrix = matrix + mass[k] * (jacobian @ jacobian.T)
            force = force - mass[k] * (jacobian @ drift + weight * jacobian[:, 1])
        system = np.block([[matrix, turn], [turn.T, np.zeros((2, 2), dtype=object)]])
        right = np.concatenate([force, -((rate**2) @ bend)])
        absolute = mpmath.lu_solve(mpmath.matrix(system.tolist()), mpmath.matrix(right.tolist()))
        return np.array([float(absolute[k] - (absolute[k - 1] if k else 0)) for k in range(LINKS)])


@pytest.mark.parametrize(("heavy", "chosen"), [(1.0, "mixed"), (1e8, "square_root")])
def test_a_heavy_body_on_a_light_loop_keeps_its_digits(heavy: float, chosen: str) -> None:
    rng = np.random.default_rng(4)
    q, v, tau = 1.2 * rng.uniform(-1, 1, LINKS), rng.uniform(-1, 1, LINKS), rng.uniform(-1, 1, LINKS)
    m = phipsi.Model.from_urdf_text(chain_text(heavy))
    tip, ground = np.eye(4), np.eye(4)
    tip[0, 3] = 1.0
    ground[:3, 3] = (m.body_pose(q, "b7") @ tip)[:3, 3]
    m.close_loop("world", ground, "b7", tip, kind="spherical", name="pin")
    exact = pinned_accelerations(heavy, q, v, tau, -m.gravity[2])
    scale = np.abs(exact).max()
    # Bodies, freedoms and rows; the root of the mass ratio, twice; κ of such chains is below 10.
    budget = (2 * LINKS + 3) * EPSILON * 10 * 2 * np.sqrt(heavy)
    for form, ran in [("auto", chosen), ("square_root", "square_root")]:
        a, info = m.forward_dynamics(q, v, tau, form=form, info=True)
        assert info.form == ran
        assert np.abs(a - exact).max() <= budget * scale
        batch = m.forward_dynamics(np.stack([q, q]), v, tau, form=form)
        assert (batch == a).all()
    a, info = m.forward_dynamics(q, v, tau, form="plain", info=True)
    assert info.form == "plain"
    if heavy == 1.0:
        # Squares lose 1/σ more.
        assert np.abs(a - exact).max() <= budget / info.smallest_pivot * scale


@pytest.mark.parametrize(("place", "warned"), [(LINKS - 1, True), (0, False)])
def test_a_heavy_body_next_to_the_cut_is_warned_of(place: int, warned: bool) -> None:
    """What no form saves is said, once, with the body and the closure; the same body at the ground needs no warning."""
    m = phipsi.Model.from_urdf_text(chain_text(1e8, place))
    q = np.linspace(-0.5, 0.6, LINKS)
    tip, ground = np.eye(4), np.eye(4)
    tip[0, 3] = 1.0
    ground[:3, 3] = (m.body_pose(q, "b7") @ tip)[:3, 3]
    m.close_loop("world", ground, "b7", tip, kind="spherical", name="pin")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        for _ in range(2):
            m.forward_dynamics(q, np.zeros(LINKS), np.zeros(LINKS))
    texts = [str(w.message) for w in caught]
    assert len(texts) == warned
    assert all("`b7`" in t and "`pin`" in t and "cut that loop farther from it" in t for t in texts)


def test_projections_close_the_loops() -> None:
    case = open_case("stewart")
    m, q = case.m, case.q[0]
    rng = np.random.default_rng(1)
    off = m.integrate(q, 1e-4 * rng.normal(size=(3, m.nv)))
    on, info = m.project_position(off)
    assert info.closure_residual.shape == (3,) and info.iterations.max() < 6
    assert np.abs(m.closure_residual(on)).max() < 1e-14
    wild = rng.normal(size=(3, m.nv))
    kept, info = m.project_velocity(on, wild)
    assert np.all(info.rank == case.rank[0]) and np.all(info.energy_removed > 0)
    assert np.abs(m.closure_residual(on, kept)[1]).max() < 1e-13
    # The least kinetic energy of the change: it is orthogonal to what the closures allow.
    for state in range(3):
        change = m.mass_matrix(on[state]) @ (kept[state] - wild[state])
        assert abs(change @ kept[state]) < 1e-12 * abs(change @ wild[state])
        assert abs(info.energy_removed[state] + 0.5 * change @ wild[state]) < 1e-12 * info.energy_removed[state]


def test_the_projection_of_closed_chains() -> None:
    case = open_case("twoarm")
    m, q = case.m, case.q[0]
    P = m.closure_projection(q)
    assert P.rank == case.rank[0]
    dense = P.apply(np.eye(m.nv))
    # Symmetric, idempotent, of the trace that its rank leaves.
    assert np.abs(dense - dense.T).max() < 1e-13 and np.abs(dense @ dense - dense).max() < 1e-13
    assert abs(np.trace(dense) - (m.nv - P.rank)) < 1e-12
    m.gravity = (0.0, 0.0, 0.0)
    tau = np.linspace(-1, 1, m.nv)
    a = m.forward_dynamics(q, np.zeros(m.nv), tau)
    assert relative(P.solve(tau), a) < 1e-13


def test_prescribed_joints_of_closed_chains() -> None:
    case = open_case("twoarm")
    m, q, v, tau = case.m, case.q[0], case.v[0], case.tau[0]
    a = m.forward_dynamics(q, v, tau)
    active = np.zeros(m.nv, bool)
    active[:4] = True
    # The accelerations that these forces make need these forces.
    needed, others = m.hybrid_dynamics(q, v, active, a[active], tau[~active])
    assert relative(others, a[~active]) < 1e-12 and relative(needed, tau[active]) < 1e-11
    # Other ones: what comes out is dynamics with loops again.
    given = a[active] + [0.3, -0.2, 0.1, 0.4]
    needed, others = m.hybrid_dynamics(q, v, active, given, tau[~active])
    forces = tau.copy()
    forces[active] = needed
    assert relative(m.forward_dynamics(q, v, forces), np.concatenate([given, others])) < 1e-11


def test_what_contradicts_the_loops_is_said() -> None:
    m = open_case("ladderL_0001").m
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
    m = open_case("ladderL_0004").m
    before = m.joint_names
    assert m.choose_tree(keep=m.closure_names).startswith("the given tree") and m.joint_names == before
    with pytest.raises(phipsi.ArgumentError, match="keep"):
        m.choose_tree(keep=["nothing"])


@pytest.mark.parametrize("name", ["ladderL_0001", "ladderL_0004", "ladderL_0016", "stewart", "twoarm"])
def test_other_programs_err_as_their_methods_say(name: str) -> None:
    case = open_case(name)
    found, kappa = loops.errors(case), loops.condition(case)
    assert max(found["phipsi"]) <= 1e-12
    # A Cholesky factor of J M⁻¹ Jᵀ: n ε κ, ten times for the products that it is made of.
    assert max(found["Pinocchio"]) <= 10 * case.m.nv * EPSILON * kappa
    # A diagonal of 1e-4 of its own (as MuJoCo estimates it, hence ten times) is added to it; it is there, so it is seen.
    softness = (1 - loops.IMPEDANCE) / loops.IMPEDANCE
    assert 1e-3 * softness < max(found["MuJoCo"]) <= 10 * softness * kappa
