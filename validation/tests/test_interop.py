"""Layouts of other programs: round trips, order, refusals; and by accelerations against hand-built models there."""

from __future__ import annotations

import mujoco as mj
import numpy as np
import pinocchio as pin
import pytest

import phipsi

from .common import EPSILON, arm, mixed

PINOCCHIO, MUJOCO = phipsi.interop.Pinocchio, phipsi.interop.MuJoCo

KINDS = ("planar", "continuous", "spherical", "prismatic", "revolute")


def free_tree() -> phipsi.Model:
    return phipsi.Model.from_urdf_text(mixed(*KINDS, axes=("1 2 -3",)), base="free")


def layouts():
    m = free_tree()
    names = m.joint_names
    order = [names[0], *sorted(names[1:])]
    split = [n for name in order for n in ([name + s for s in ("_TX", "_TY", "_RZ")] if name == "z9" else [name])]
    return m, {"pinocchio": PINOCCHIO(m, ["universe", "root_joint", *order[1:]]), "mujoco": MUJOCO(m, ["", *split[1:]])}


@pytest.mark.parametrize("which", ["pinocchio", "mujoco"])
def test_round_trips(which):
    m, both = layouts()
    x = both[which]
    q, v = (np.array(s) for s in zip(*(m.random_state(i) for i in range(6))))
    a = np.random.default_rng(0).uniform(-1, 1, v.shape)
    theirs = x.q_out(q)
    assert theirs.shape == (6, x.nq)
    assert np.abs(x.q_in(theirs) - q).max() <= 4 * EPSILON
    their_v, their_a = x.v_out(v, q), x.a_out(a, q, v)
    assert np.abs(x.v_in(their_v, theirs) - v).max() <= 20 * EPSILON
    assert np.abs(x.a_in(their_a, theirs, their_v) - a).max() <= 50 * EPSILON
    their_f = x.f_out(a, q)
    assert np.abs(x.f_in(their_f, theirs) - a).max() <= 20 * EPSILON
    # Power is the same there.
    assert np.abs((their_f * their_v).sum(-1) - (a * v).sum(-1)).max() <= 50 * m.nv * EPSILON
    # Batch axes: two, none, and those of the configuration alone.
    assert np.array_equal(x.v_out(v.reshape(2, 3, -1), q.reshape(2, 3, -1)).reshape(6, -1), their_v)
    assert np.array_equal(x.a_out(a[2], q[2], v[2]), their_a[2])
    assert np.array_equal(x.v_out(v[0], q)[3], x.v_out(v[0], q[3]))


@pytest.mark.parametrize("which", ["pinocchio", "mujoco"])
def test_acceleration_is_the_rate_of_velocity(which):
    """d/dt v_out(v(t), q(t)) = a_out(v̇): central differences, error h² and ε/h."""
    m, both = layouts()
    x = both[which]
    q, v = m.random_state(1)
    a = np.random.default_rng(1).uniform(-1, 1, m.nv)
    h = 1e-5

    def velocity(t):
        return x.v_out(v + a * t, m.integrate(q, v * t + 0.5 * a * t * t))

    rate = (velocity(h) - velocity(-h)) / (2 * h)
    assert np.abs(rate - x.a_out(a, q, v)).max() <= 100 * (h * h + EPSILON / h)


def inertia() -> pin.Inertia:
    return pin.Inertia(2.0, np.array([0.1, 0.2, -0.3]), np.diag([0.5, 0.6, 0.7]))


def test_spherical_joint_of_pinocchio():
    """Pinocchio reads none from URDF: built by hand."""
    model = pin.Model()
    model.gravity.linear = np.array([0, 0, -9.81])
    place = pin.SE3(pin.rpy.rpyToMatrix(0.1, 0.2, 0.3), np.array([0.5, 0, 0]))
    ball = model.addJoint(0, pin.JointModelSpherical(), pin.SE3.Identity(), "ball")
    model.appendBodyToJoint(ball, inertia(), pin.SE3.Identity())
    hinge = model.addJoint(ball, pin.JointModelRZ(), place, "hinge")
    model.appendBodyToJoint(hinge, inertia(), pin.SE3.Identity())
    body = (
        '<link name="{}"><inertial><origin xyz="0.1 0.2 -0.3"/><mass value="2"/>'
        '<inertia ixx="0.5" iyy="0.6" izz="0.7" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    )
    m = phipsi.Model.from_urdf_text(
        '<robot name="r"><link name="world"/>' + body.format("a") + body.format("b")
        + '<joint name="ball" type="spherical"><parent link="world"/><child link="a"/></joint>'
        + '<joint name="hinge" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>'
        + '<origin xyz="0.5 0 0" rpy="0.1 0.2 0.3"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>'
    )  # fmt: skip
    m.gravity = (0, 0, -9.81)
    x = PINOCCHIO(m, list(model.names))
    for seed in range(5):
        q, v = m.random_state(seed)
        tau = np.random.default_rng(seed).uniform(-1, 1, m.nv)
        theirs = pin.aba(model, model.createData(), x.q_out(q), x.v_out(v), x.f_out(tau))
        ours = x.v_out(m.forward_dynamics(q, v, tau))
        # n = 4, κ of two links below a thousand.
        assert np.abs(ours - theirs).max() <= 4 * 1000 * EPSILON * np.abs(theirs).max()


@pytest.mark.parametrize("seed", range(5))
def test_free_body_of_mujoco_by_accelerations(seed):
    """A body on a free joint, built by hand, under gravity, a force and its own spin."""
    model = mj.MjModel.from_xml_string(
        "<mujoco><option gravity='0 0 -9.81'/><worldbody><body name='b'><freejoint name='any'/>"
        "<inertial mass='2' pos='0.1 0.2 -0.3' diaginertia='0.5 0.6 0.7'/></body></worldbody></mujoco>"
    )
    m = phipsi.Model.from_urdf_text(
        "<robot name='r'><link name='b'><inertial><origin xyz='0.1 0.2 -0.3'/><mass value='2'/>"
        "<inertia ixx='0.5' iyy='0.6' izz='0.7' ixy='0' ixz='0' iyz='0'/></inertial></link></robot>",
        base="free",
    )
    m.gravity = (0, 0, -9.81)
    x = MUJOCO(m, ["any"])
    data = mj.MjData(model)
    rng = np.random.default_rng(seed)
    q, v = m.random_state(seed)
    tau = rng.uniform(-5, 5, 6)
    data.qpos[:], data.qvel[:], data.qfrc_applied[:] = x.q_out(q), x.v_out(v, q), x.f_out(tau, q)
    mj.mj_forward(model, data)
    a = m.forward_dynamics(q, v, tau)
    scale = np.abs(a).max()
    assert np.abs(x.a_in(data.qacc, data.qpos, data.qvel) - a).max() <= 1000 * EPSILON * scale
    assert np.abs(x.a_out(a, q, v) - data.qacc).max() <= 1000 * EPSILON * scale
    # The terms differ: without the state's own turning the two would not agree.
    assert np.abs(x.v_in(data.qacc, data.qpos) - a).max() > 1e-3


def test_quaternions_of_any_length_and_sign():
    m = arm("free")
    x = MUJOCO(m, ["base", "shoulder", "elbow"])
    q, v = m.random_state(0)
    scaled = q.copy()
    scaled[3:7] *= -3.0
    assert np.abs(x.v_out(v, scaled) - x.v_out(v, q)).max() <= 10 * EPSILON


def test_order_is_by_name():
    m = arm()
    x = MUJOCO(m, ["elbow", "shoulder"])
    assert np.array_equal(x.q_in([1, 2]), [2, 1]) and np.array_equal(x.v_out([1, 2]), [2, 1])
    y = PINOCCHIO(m, ["universe", "elbow", "shoulder"])
    assert (y.nq, y.nv) == (3, 2) and (x.nq, x.nv) == (2, 2)
    angle = np.array([3.0, -3.0, 0.5])
    assert np.abs(y.q_in(y.q_out(np.stack([angle, angle], -1)))[:, 0] - angle).max() <= 4 * EPSILON


@pytest.mark.parametrize(
    ("names", "text"),
    [
        (["shoulder"], "missing: 'elbow'"),
        (["shoulder", "elbow", "wrist"], "unknown: 'wrist'"),
        (["shoulder", "elbow", "elbow"], "repeated: 'elbow'"),
        (["shoulder", "wrist"], "unknown: 'wrist'; missing: 'elbow'"),
        ([], "missing"),
    ],
)
@pytest.mark.parametrize("layout", [PINOCCHIO, MUJOCO])
def test_names_must_match(layout, names, text):
    with pytest.raises(phipsi.ArgumentError, match=text) as caught:
        layout(arm(), names)
    assert caught.value.argument == "joint_names" and caught.value.required == ["shoulder", "elbow"]


def test_a_free_base_must_be_there():
    with pytest.raises(phipsi.ArgumentError, match="root_joint") as caught:
        PINOCCHIO(arm(), ["root_joint", "shoulder", "elbow"])
    assert "base=" in caught.value.remedy


def test_missing_configuration_is_named():
    m = arm("free")
    x = MUJOCO(m, ["", "shoulder", "elbow"])
    v = np.zeros(8)
    with pytest.raises(phipsi.ArgumentError, match="`q` is missing.*`foot`"):
        x.v_in(v)
    with pytest.raises(phipsi.ArgumentError, match="`v` is missing"):
        x.a_out(v, m.neutral())
    # Without a free base nothing is needed.
    assert MUJOCO(arm(), ["shoulder", "elbow"]).a_in([1, 2]).tolist() == [1, 2]


@pytest.mark.parametrize("bad", [[0], [[0, 0, 0]], 1.0])
def test_shapes(bad):
    with pytest.raises(phipsi.ArgumentError, match=r"`v` has shape .*\(…, 2\)") as caught:
        MUJOCO(arm(), ["shoulder", "elbow"]).v_in(bad)
    assert caught.value.argument == "v"
    with pytest.raises(phipsi.ArgumentError, match="broadcast"):
        x = MUJOCO(arm("free"), ["", "shoulder", "elbow"])
        x.v_out(np.zeros((2, 8)), np.tile(arm("free").neutral(), (3, 1)))


def test_values():
    x = MUJOCO(arm(), ["shoulder", "elbow"])
    with pytest.raises(phipsi.ArgumentTypeError, match="complex"):
        x.q_in([0, 1j])
    with pytest.raises(phipsi.NumericalError, match="`q`: component 1") as caught:
        x.q_in([[0, 0], [0, np.nan]])
    assert caught.value.state == (1,) and caught.value.component == 1
    assert x.q_in(np.zeros((0, 2))).shape == (0, 2)
    f = arm("free")
    q = f.neutral()
    q[3:7] = 0
    with pytest.raises(phipsi.NumericalError, match="quaternion"):
        MUJOCO(f, ["", "shoulder", "elbow"]).v_out(np.zeros(8), q)


def test_joints_that_mujoco_does_not_have():
    m = phipsi.Model.from_urdf_text(mixed("cylindrical"))
    with pytest.raises(phipsi.ArgumentError, match="cylindrical"):
        MUJOCO(m, m.joint_names)
    assert PINOCCHIO(m, m.joint_names).nq == 2
