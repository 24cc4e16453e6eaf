"""Arguments: batch axes, conversion, and refusals with their fields."""

from __future__ import annotations

import os
import pathlib
import pickle
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

import phipsi
from validation import robots

from .common import arm

SIZES = [1, 2, 3, 63, 64, 65, 200]


@pytest.fixture(scope="module")
def robot():
    return phipsi.Model.from_urdf(robots.model_path("solo12"))


def states(m, n, seed=0):
    rng = np.random.default_rng(seed)
    q = np.array([m.random_state(seed * 1000 + i)[0] for i in range(n)])
    return q, rng.uniform(-1, 1, (n, m.nv)), rng.uniform(-1, 1, (n, m.nv))


def stacked(matrices):
    return np.stack(matrices, axis=-3)


#: Every method with a batch axis, as a function of (m, q, v, x).
METHODS = {
    "integrate": lambda m, q, v, x: m.integrate(q, v),
    "difference": lambda m, q, v, x: m.difference(q, m.integrate(q, v)),
    "forward_dynamics": lambda m, q, v, x: m.forward_dynamics(q, v, x),
    "inverse_dynamics": lambda m, q, v, x: m.inverse_dynamics(q, v, x),
    "forward_dynamics_derivatives": lambda m, q, v, x: stacked(m.forward_dynamics_derivatives(q, v, x)),
    "inverse_dynamics_derivatives": lambda m, q, v, x: stacked(m.inverse_dynamics_derivatives(q, v, x)),
    "mass_matrix": lambda m, q, v, x: m.mass_matrix(q),
    "mass_matrix_inverse": lambda m, q, v, x: m.mass_matrix_inverse(q),
    "multiply_by_mass_matrix": lambda m, q, v, x: m.multiply_by_mass_matrix(q, x),
    "solve_mass_matrix": lambda m, q, v, x: m.solve_mass_matrix(q, x),
    "bias_forces": lambda m, q, v, x: m.bias_forces(q, v),
    "gravity_forces": lambda m, q, v, x: m.gravity_forces(q),
    "passive_forces": lambda m, q, v, x: m.passive_forces(q, v),
    "joint_reactions": lambda m, q, v, x: m.joint_reactions(q, v, x),
    "body_pose": lambda m, q, v, x: m.body_pose(q, "FL_LOWER_LEG"),
    "body_velocity": lambda m, q, v, x: m.body_velocity(q, v, "FL_LOWER_LEG"),
    "body_acceleration": lambda m, q, v, x: m.body_acceleration(q, v, x, "FL_LOWER_LEG"),
    "jacobian": lambda m, q, v, x: m.jacobian(q, "FL_LOWER_LEG", point=x[..., :3]),
    "kinetic_energy": lambda m, q, v, x: m.kinetic_energy(q, v),
    "potential_energy": lambda m, q, v, x: m.potential_energy(q),
    "center_of_mass": lambda m, q, v, x: m.center_of_mass(q),
    "momentum": lambda m, q, v, x: m.momentum(q, v, about=x[..., :3]),
    "centroidal_momentum_matrix": lambda m, q, v, x: m.centroidal_momentum_matrix(q),
    "hybrid_dynamics": lambda m, q, v, x: np.concatenate(
        m.hybrid_dynamics(q, v, [i % 2 == 1 for i in range(m.nv)], x[..., 1::2], x[..., ::2]), axis=-1
    ),
    "log_determinant": lambda m, q, v, x: m.log_determinant(q),
    "log_determinant_gradient": lambda m, q, v, x: m.log_determinant_gradient(q),
    "articulated_inertias": lambda m, q, v, x: m.articulated_inertias(q),
    "space_jacobian": lambda m, q, v, x: m.space_jacobian(q, "FL_LOWER_LEG", point=x[..., :3]),
    "wrenches": lambda m, q, v, x: m.forward_dynamics(q, v, x, wrenches={"FL_LOWER_LEG": x[..., :6]}),
    "diagonal_velocity": lambda m, q, v, x: m.diagonal_velocity(q, v),
    "joint_velocity": lambda m, q, v, x: m.joint_velocity(q, v),
    "diagonal_dynamics": lambda m, q, v, x: m.diagonal_dynamics(q, v, x)[0],
    "diagonal_coriolis": lambda m, q, v, x: m.diagonal_coriolis(q, v),
    "info": lambda m, q, v, x: m.forward_dynamics(q, v, x, info=True)[1].backward_error,
}


def test_every_method_is_here():
    configuration = {"from_urdf", "from_urdf_text", "joint_q_offset", "joint_v_offset", "neutral", "random_state"}
    configuration |= {"with_flexible_body", "mode_q_offset", "mode_v_offset"}
    methods = {n for n, f in vars(phipsi.Model).items() if callable(f) or isinstance(f, staticmethod)}
    methods = {n for n in methods if not n.startswith("_")}
    # Of models with loops, in test_loops.
    loops = {"close_loop", "assemble", "closure_residual", "closure_forces", "generalized_constraint_force"}
    loops |= {"choose_tree", "closure_projection", "project_position", "project_velocity"}
    # Of arms, in test_jacobians; of one configuration, in test_freeflight.
    arms = {"inverse_kinematics", "jacobian_pseudo_inverse", "linearize", "operational_space_inertia", "sample_velocities"}
    single = {"reactionless_basis"}
    assert methods - configuration - loops - arms - single == METHODS.keys() - {"wrenches", "info"}


@pytest.mark.parametrize("name", METHODS)
def test_batch_is_the_same_as_single_calls(robot, name):
    call = METHODS[name]
    q, v, x = states(robot, max(SIZES))
    single = np.array([call(robot, q[i], v[i], x[i]) for i in range(len(q))])
    for n in SIZES:
        assert np.array_equal(call(robot, q[:n], v[:n], x[:n]), single[:n]), n
    # Two axes, and none at all.
    shaped = call(robot, q.reshape(4, 50, -1), v.reshape(4, 50, -1), x.reshape(4, 50, -1))
    assert np.array_equal(shaped.reshape(single.shape), single) and shaped.shape[:2] == (4, 50)
    assert call(robot, q[:0], v[:0], x[:0]).shape == (0, *single.shape[1:])


def test_broadcasting(robot):
    q, v, tau = states(robot, 6)
    one = robot.forward_dynamics(q[0], v, tau)
    assert np.array_equal(one[3], robot.forward_dynamics(q[0], v[3], tau[3]))
    grid = robot.forward_dynamics(q[:2, None], v[None, :3], tau[0])
    assert grid.shape == (2, 3, robot.nv)
    assert np.array_equal(grid[1, 2], robot.forward_dynamics(q[1], v[2], tau[0]))
    # Axes that the first argument lacks come from the others.
    late = robot.inverse_dynamics(q[:1], v[:3].reshape(3, 1, -1), tau[:4])
    assert np.array_equal(late[2, 3], robot.inverse_dynamics(q[0], v[2], tau[3]))


def test_the_number_of_threads_does_not_matter():
    code = (
        "import sys, numpy as np, phipsi\n"
        "m = phipsi.Model.from_urdf(sys.argv[1])\n"
        "s = [m.random_state(i) for i in range(500)]\n"
        "q, v = (np.array(x) for x in zip(*s))\n"
        "a = m.forward_dynamics(q, v, v)\n"
        "sys.stdout.write(a.tobytes().hex())\n"
        "v[400] = v[77] = 1e200\n"
        "try: m.forward_dynamics(q, v, v)\n"
        "except phipsi.NumericalError as e: sys.stdout.write(str(e.state))\n"
    )
    outputs = set()
    for threads in ("1", "2", "5"):
        command = [sys.executable, "-c", code, robots.model_path("solo12")]
        environment = {**os.environ, "RAYON_NUM_THREADS": threads}
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
        outputs.add(done.stdout)
    assert len(outputs) == 1
    assert outputs.pop().endswith("(77,)")


#: Not computed in lanes of states: each state may have its limbs in lanes, and other sums where there are none.
STATE_BY_STATE = {"space_jacobian"}


@pytest.mark.parametrize(("level", "threads"), [("scalar", 1), ("avx2", 2), ("avx512", 5), ("", 3)])
def test_the_width_of_the_lanes_does_not_matter(robot, level, threads, tmp_path):
    """One process computes in one width; a processor without it takes the next narrower one."""
    q, v, x = states(robot, 41)
    code = (
        "import sys, numpy as np, phipsi\n"
        "from validation.tests.test_batch import METHODS, states\n"
        "m = phipsi.Model.from_urdf(sys.argv[1])\n"
        "q, v, x = states(m, 41)\n"
        "np.savez(sys.argv[2], **{name: call(m, q, v, x) for name, call in METHODS.items()})\n"
    )
    environment = {**os.environ, "PHIPSI_SIMD": level, "RAYON_NUM_THREADS": str(threads)}
    path = tmp_path / "results.npz"
    command = [sys.executable, "-c", code, robots.model_path("solo12"), path]
    root = pathlib.Path(__file__).parents[2]
    subprocess.run(command, cwd=root, env=environment, capture_output=True, text=True, check=True)
    found = np.load(path)
    assert set(found.files) == METHODS.keys()
    for name, call in METHODS.items():
        wanted = call(robot, q, v, x)
        if name in STATE_BY_STATE:
            # n·ε·κ, where κ = 170 is that of the base's locked inertia.
            assert np.abs(found[name] - wanted).max() < 170 * robot.nv * np.finfo(float).eps * np.abs(wanted).max()
        else:
            assert found[name].tobytes() == wanted.tobytes(), name


def test_memory_of_large_arguments_is_used_again():
    """The memory keeps nothing of an earlier batch, and from the second call on only a result takes new pages."""
    m, n = arm(), 50_000
    q, v, tau = (np.tile(x, (n // 100, 1)) for x in states(m, 100))
    expected = m.forward_dynamics(q, v, tau)
    m.forward_dynamics(-2 * q, 3 * v, -tau)
    for count in [n, n // 3, n // 2, n]:
        assert np.array_equal(m.forward_dynamics(q[:count], v[:count], tau[:count]), expected[:count])
    m.forward_dynamics(q[:, ::-1], v.astype(np.float32), np.asfortranarray(tau))
    assert np.array_equal(m.forward_dynamics(q, v, tau), expected)
    resource = pytest.importorskip("resource", reason="page faults are counted on Unix only")
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    m.forward_dynamics(q, v, tau)
    taken = resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before
    assert taken < 2 * expected.nbytes // resource.getpagesize(), taken


def test_the_first_of_several_failures_is_reported():
    m = phipsi.Model.from_urdf(robots.model_path("solo12"))
    q, v, tau = states(m, 60)
    # In one pack of lanes, and in two.
    for early, late in [(17, 18), (3, 41), (41, 59)]:
        fast = v.copy()
        fast[early] = fast[late] = 1e200
        for method, quantity in [(m.inverse_dynamics, "generalized force"), (m.forward_dynamics, "acceleration")]:
            with pytest.raises(phipsi.NumericalError) as caught:
                method(q, fast, tau)
            assert caught.value.state == (early,) and caught.value.quantity == quantity
            with pytest.raises(phipsi.NumericalError) as alone:
                method(q[early], fast[early], tau[early])
            assert alone.value.joint == caught.value.joint and alone.value.component == caught.value.component


def test_the_interpreter_is_released():
    """While no switch is forced, another thread of Python runs during a call only if the call lets it."""
    m = phipsi.Model.from_urdf(robots.model_path("tree_0063"))
    q = np.zeros((2000, m.nq))
    counted, running = [0], threading.Event()

    def count():
        running.set()
        while running.is_set():
            counted[0] += 1
            time.sleep(0)

    interval = sys.getswitchinterval()
    thread = threading.Thread(target=count)
    thread.start()
    running.wait()
    try:
        sys.setswitchinterval(1000.0)
        before = counted[0]
        m.mass_matrix_inverse(q)
        during = counted[0] - before
    finally:
        sys.setswitchinterval(interval)
        running.clear()
        thread.join()
    assert during > 0


def test_arguments_are_array_likes(robot):
    m = arm()
    wanted = m.forward_dynamics(np.array([1.0, 2.0]), np.array([3.0, 4.0]), np.array([5.0, 6.0]))
    kinds = [
        ([1, 2], [3, 4], [5, 6]),
        ((1.0, 2), (3, 4), (5, 6)),
        tuple(np.array(x, np.float32) for x in ([1, 2], [3, 4], [5, 6])),
        tuple(np.array(x, np.int8) for x in ([1, 2], [3, 4], [5, 6])),
        tuple(np.array(x, np.uint64) for x in ([1, 2], [3, 4], [5, 6])),
        tuple(np.array(x, ">f8") for x in ([1, 2], [3, 4], [5, 6])),
        tuple(np.array([x, x], float).T[:, 0] for x in ([1, 2], [3, 4], [5, 6])),
        tuple(np.array(x[::-1], float)[::-1] for x in ([1, 2], [3, 4], [5, 6])),
        tuple(np.asfortranarray(np.array(x, float)) for x in ([1, 2], [3, 4], [5, 6])),
    ]
    for q, v, tau in kinds:
        assert np.array_equal(m.forward_dynamics(q, v, tau), wanted)
    q, v, tau = states(robot, 5)
    fortran = robot.forward_dynamics(np.asfortranarray(q), v[:, ::1], np.asfortranarray(tau))
    assert np.array_equal(fortran, robot.forward_dynamics(q, v, tau))
    read_only = q.copy()
    read_only.setflags(write=False)
    assert np.array_equal(robot.mass_matrix(read_only), robot.mass_matrix(q))


@pytest.mark.parametrize(
    "bad", [[0, 1j], np.zeros(2, complex), ["a", "b"], [[1, 2], [3]], [True, False], None, [None, 1], [10**400, 1]]
)
def test_what_holds_no_real_numbers_is_refused(bad):
    m = arm()
    with pytest.raises(phipsi.ArgumentTypeError, match="`v`") as caught:
        m.forward_dynamics([0, 0], bad, [0, 0])
    assert caught.value.argument == "v" and isinstance(caught.value, (TypeError, ValueError, phipsi.Error))
    assert "real numbers" in str(caught.value)


@pytest.mark.parametrize("shape", [(), (1,), (3,), (2, 3), (2, 0)])
def test_wrong_shapes_are_refused_with_both_shapes(shape):
    m = arm()
    with pytest.raises(phipsi.ArgumentError) as caught:
        m.inverse_dynamics(np.zeros(2), np.zeros(2), np.zeros(shape))
    error = caught.value
    assert error.argument == "a" and error.found == shape and error.required == "(…, 2)"
    assert "`a`" in str(error) and str(shape) in str(error) and "(…, 2)" in str(error)


def test_batch_axes_that_do_not_fit_are_refused():
    m = arm()
    with pytest.raises(phipsi.ArgumentError, match=r"`q`.*\(3,\).*`tau`.*\(4,\)") as caught:
        m.forward_dynamics(np.zeros((3, 2)), [0, 0], np.zeros((4, 2)))
    assert caught.value.argument == "tau" and caught.value.found == (4,) and caught.value.required == (3,)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("name", METHODS)
def test_what_is_not_finite_is_named(robot, name, bad):
    q, v, x = states(robot, 4)
    q[2, 8] = bad
    with pytest.raises(phipsi.NumericalError, match="`q`|`q0`") as caught:
        METHODS[name](robot, q, v, x)
    error = caught.value
    assert error.state == (2,) and error.joint == robot.joint_names[2] and error.component == 0
    assert np.array_equal(error.found, bad, equal_nan=True)
    with pytest.raises(phipsi.NumericalError) as caught:
        METHODS[name](robot, q[2], v[2], x[2])
    assert caught.value.state is None


def test_overflow_is_no_silent_nan():
    m = arm()
    with pytest.raises(phipsi.NumericalError) as caught:
        m.forward_dynamics([[0, 0], [0, 1]], [0, 1e200], [0, 0])
    assert caught.value.quantity == "acceleration" and caught.value.state == (0,)
    with pytest.raises(phipsi.NumericalError, match="kinetic energy"):
        m.kinetic_energy([0, 0], [1e200, 0])


def test_a_quaternion_needs_a_length(robot):
    q = robot.neutral()
    q[3:7] = 0
    with pytest.raises(phipsi.NumericalError, match="quaternion") as caught:
        robot.mass_matrix(q)
    assert caught.value.joint == "root_joint" and caught.value.component == 3
    q[6] = -2.0  # Any other length and sign is the same orientation.
    assert np.array_equal(robot.mass_matrix(q), robot.mass_matrix(robot.neutral()))


def test_wrenches_are_refused_with_reasons():
    m = arm()
    zero = np.zeros(2)
    with pytest.raises(phipsi.ArgumentError, match="dict"):
        m.forward_dynamics(zero, zero, zero, wrenches=[1, 2, 3, 4, 5, 6])
    with pytest.raises(phipsi.ArgumentError, match="`wrenches`.*`hand`.*upper") as caught:
        m.forward_dynamics(zero, zero, zero, wrenches={"hand": np.zeros(6)})
    assert caught.value.found == "hand"
    with pytest.raises(phipsi.ArgumentError, match="world"):
        m.forward_dynamics(zero, zero, zero, wrenches={"world": np.zeros(6)})
    with pytest.raises(phipsi.ArgumentError, match=r"wrenches\[\"lower\"\].*\(5,\)"):
        m.inverse_dynamics(zero, zero, zero, wrenches={"lower": np.zeros(5)})
    with pytest.raises(phipsi.NumericalError, match=r"wrenches\[\"lower\"\].*force x"):
        m.inverse_dynamics(zero, zero, zero, wrenches={"lower": [0, 0, 0, np.nan, 0, 0]})
    with pytest.raises(TypeError):
        m.forward_dynamics(zero, zero, zero, wrenches={1: np.zeros(6)})


@pytest.mark.parametrize("form", ["square", "sqrt", "Plain", ""])
def test_forms_that_there_are_not_are_refused(form):
    with pytest.raises(phipsi.ArgumentError, match='"auto", "plain", "refined", "square_root", "double_double"') as caught:
        arm().forward_dynamics([0, 0], [0, 0], [0, 0], form=form)
    assert caught.value.argument == "form" and caught.value.found == form


def test_unknown_names():
    m = arm()
    with pytest.raises(phipsi.ArgumentError, match="`hand`.*foot, upper, lower"):
        m.body_pose([0, 0], "hand")
    with pytest.raises(phipsi.ArgumentError, match="`wrist`.*shoulder, elbow"):
        m.joint_q_offset("wrist")


def test_errors_survive_a_process_boundary():
    m = arm()
    for cause in (lambda: m.mass_matrix([0]), lambda: m.mass_matrix([0, np.nan])):
        with pytest.raises(phipsi.Error) as caught:
            cause()
        error = caught.value
        copy = pickle.loads(pickle.dumps(error))
        assert type(copy) is type(error) and str(copy) == str(error)
        assert repr(vars(copy)) == repr(vars(error))
