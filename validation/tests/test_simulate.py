"""Motion from Python: simulate, control laws, the simulator."""

from __future__ import annotations

import math
import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import phipsi

from .common import ARM, EPSILON, arm


def undamped(base: str = "fixed") -> phipsi.Model:
    return phipsi.Model.from_urdf_text(ARM.read_text().replace('<dynamics damping="0.1"/>', ""), base=base)


SLIDER = (
    "<robot name='slider'><link name='world'/><link name='block'><inertial><mass value='2'/>"
    "<inertia ixx='1' iyy='1' izz='1' ixy='0' ixz='0' iyz='0'/></inertial></link>"
    "<joint name='rail' type='prismatic'><parent link='world'/><child link='block'/><axis xyz='1 0 0'/>"
    "<limit lower='-1' upper='1' effort='1' velocity='1'/></joint></robot>"
)


def slider() -> phipsi.Model:
    """A mass of 2 kg on a horizontal rail."""
    return phipsi.Model.from_urdf_text(SLIDER)


def test_oscillator_has_its_closed_form():
    """m ẍ = −k x: x = cos(ω t), and the stated error is right."""
    r = phipsi.simulate(slider(), q0=[1.0], t_end=10.0, control=lambda t, q, v: -8.0 * q, rtol=1e-10)
    error = np.abs(r.q[:, 0] - np.cos(2.0 * r.t)).max()
    end = abs(r.q[-1, 0] - math.cos(20.0))
    assert end <= 10 * r.error.q and r.error.q < 1e-8
    assert error < 1e-8
    # The spring is a control law: its work accounts for the energy.
    assert np.abs(r.energy - r.energy[0] - r.work).max() <= 1e-8 * r.energy.max()
    assert r.error.energy_error < 1e-9
    assert r.t[0] == 0.0 and r.t[-1] == 10.0 and len(r.t) == 201
    assert r.momentum.shape == (201, 6) and r.error.momentum_error is None


def test_free_arm_conserves_energy_and_momentum():
    m = undamped("free")
    m.gravity = (0, 0, 0)
    q, v = m.random_state(2)
    r = phipsi.simulate(m, q, v, t_end=5.0)
    assert r.error.energy_error < 1e-9
    assert r.error.momentum_error["angular"] < 1e-9 and r.error.momentum_error["linear"] < 1e-9
    assert np.abs(r.momentum - m.momentum(q, v)).max() < 1e-8
    # Columns are what the model's own methods say of q and v.
    assert np.allclose(r.kinetic_energy, m.kinetic_energy(r.q, r.v), rtol=1e-13)
    assert np.array_equal(r.energy, r.kinetic_energy + r.potential_energy)
    assert np.array_equal(r.q[0], q) or np.abs(m.difference(q, r.q[0])).max() < 10 * EPSILON
    # In both directions of time the same motion: the end, turned round, leads back.
    back = phipsi.simulate(m, r.q[-1], -r.v[-1], t_end=5.0)
    assert np.abs(m.difference(q, back.q[-1])).max() < 1e-6


def test_damping_acts_and_does_work():
    m = arm()
    r = phipsi.simulate(m, q0=[0.5, 0.0], t_end=2.0)
    assert r.work[-1] < 0 and r.error.energy_error < 1e-9
    assert r.energy[-1] < r.energy[0]


def test_limits_are_named():
    r = phipsi.simulate(slider(), v0=[1.0], t_end=2.0)
    assert len(r.limits) == 1 and "rail" in r.limits[0]


BALL = """
[model]
gravity = [0, 0, -10]
[[body]]
name = "ball"
inertial = { mass = 1.0, inertia = { ixx = 0.1, iyy = 0.1, izz = 0.1 } }
[[joint]]
name = "height"
type = "prismatic"
parent = "world"
child = "ball"
axis = [0, 0, 1]
limit = { lower = 0 }
[initial]
q.height = 1.25
[integrator]
t_end = 1.2
[joint_stops]
restitution = 0.5
[[event]]
name = "half way"
when = "q.height - 0.625"
"""


def test_events_are_listed(tmp_path: Path):
    """Half a second of fall, half way at t = √(0.125), a rebound of half a second that stays below half way."""
    scene = tmp_path / "ball.toml"
    scene.write_text(BALL)
    r = phipsi.simulate(scene)
    assert [(name, kind) for _, name, kind in r.events] == [
        ("half way", "event"),
        ("height", "impact"),
        ("height", "impact"),
    ]
    assert np.allclose([t for t, _, _ in r.events], [math.sqrt(0.125), 0.5, 1.0], rtol=0, atol=1e-13)
    assert pickle.loads(pickle.dumps(r)).events == r.events
    assert phipsi.simulate(slider(), v0=[1.0], t_end=2.0).events == []


@pytest.mark.parametrize(("method", "order"), [("rk4", 4)])
def test_order_of_the_fixed_step(method, order):
    ends = []
    for step in (0.02, 0.01):
        r = phipsi.simulate(
            slider(), q0=[1.0], t_end=1.0, control=lambda t, q, v: -8.0 * q, method=method, step=step, estimate=False
        )
        assert r.method == method and r.error.q is None
        ends.append(abs(r.q[-1, 0] - math.cos(2.0)))
    assert abs(math.log2(ends[0] / ends[1]) - order) < 0.1


@pytest.mark.parametrize("method", ["auto", "dop853", "tsit5"])
def test_methods_agree_within_their_stated_errors(method):
    m = undamped()
    fine = phipsi.simulate(m, q0=[0.3, 0.2], t_end=1.0, rtol=1e-12)
    r = phipsi.simulate(m, q0=[0.3, 0.2], t_end=1.0, method=method, rtol=1e-6, every=0.25)
    assert len(r.t) == 5
    assert np.abs(r.q[-1] - fine.q[-1]).max() <= 10 * r.error.q


class Own(Exception):
    """An exception of the user's."""


def test_exceptions_of_the_control_law_come_out_as_they_were():
    raised = Own("here")
    calls = []

    def control(t, q, v):
        if t > 0.3:
            calls.append(t)
            raise raised
        return [0.0]

    with pytest.raises(Own) as caught:
        phipsi.simulate(slider(), q0=[0.5], t_end=1.0, control=control)
    assert caught.value is raised and len(calls) == 1
    assert any(entry.name == "control" for entry in caught.traceback)


@pytest.mark.parametrize(
    ("result", "error", "text"),
    [
        ([0.0, 1.0], phipsi.ArgumentError, "the result of control"),
        ("no", phipsi.ArgumentTypeError, "the result of control"),
        (None, phipsi.ArgumentTypeError, "the result of control"),
        ([np.nan], phipsi.NumericalError, "the result of control.*rail"),
        ([[0.0], [0.0]], phipsi.ArgumentError, "one state"),
    ],
)
def test_what_the_control_law_returns_is_checked(result, error, text):
    with pytest.raises(error, match=text):
        phipsi.simulate(slider(), t_end=1.0, control=lambda t, q, v: result)


def test_control_gets_copies():
    def control(t, q, v):
        assert isinstance(t, float) and q.shape == (1,) and v.shape == (1,)
        q[:] = 1e9
        return [0.0]

    r = phipsi.simulate(slider(), q0=[0.5], t_end=1.0, control=control)
    assert np.all(r.q == 0.5)


def test_a_run_that_cannot_go_on_keeps_what_it_has():
    """v' = v² blows up at a finite time; the trajectory so far is kept."""
    with pytest.raises(phipsi.NumericalError) as caught:
        phipsi.simulate(slider(), v0=[1.0], t_end=5.0, control=lambda t, q, v: 2.0 * v * v, every=0.1)
    error = caught.value
    # v = 1/(1 − t).
    assert 0.9 < error.time <= 1.01
    kept = error.trajectory
    assert len(kept.t) >= 10 and np.isfinite(kept.v).all() and kept.error.q is None
    assert np.allclose(kept.v[:10, 0], 1 / (1 - kept.t[:10]), rtol=1e-6)


@pytest.mark.parametrize(
    ("arguments", "name"),
    [
        ({}, "t_end"),
        ({"t_end": 0.0}, "t_end"),
        ({"t_end": -1.0}, "t_end"),
        ({"t_end": math.inf}, "t_end"),
        ({"t_end": math.nan}, "t_end"),
        ({"t_end": 1.0, "rtol": 0.0}, "rtol"),
        ({"t_end": 1.0, "atol": -1.0}, "atol"),
        ({"t_end": 1.0, "every": 0.0}, "every"),
        ({"t_end": 1.0, "every": 1e-12}, "every"),
        ({"t_end": 1.0, "max_step": 0.0}, "max_step"),
        ({"t_end": 1.0, "method": "euler"}, "method"),
        ({"t_end": 1.0, "method": "rk4"}, "step"),
        ({"t_end": 1.0, "step": 0.1}, "step"),
        ({"t_end": 1.0, "control": 3}, "control"),
        ({"t_end": 1.0, "q0": [0.0, 0.0]}, "q0"),
        ({"t_end": 1.0, "v0": [[0.0]]}, "v0"),
    ],
)
def test_arguments(arguments, name):
    with pytest.raises(phipsi.ArgumentError, match=f"`{name}`") as caught:
        phipsi.simulate(slider(), **arguments)
    assert caught.value.argument == name and caught.value.required is not None


def test_start_that_is_not_finite():
    with pytest.raises(phipsi.NumericalError, match="`q0`"):
        phipsi.simulate(slider(), q0=[math.nan], t_end=1.0)


def test_nothing_that_moves():
    m = phipsi.Model.from_urdf_text("<robot name='r'><link name='a'/></robot>")
    r = phipsi.simulate(m, t_end=1.0)
    assert r.q.shape == (201, 0) and r.energy[-1] == 0.0


FLYBALL = Path(__file__).parents[2] / "examples" / "benchmarks" / "flyball.toml"


def test_a_stiff_scene_keeps_its_implicit_method(tmp_path: Path):
    """What `auto` of a scene has found, or the scene asks for, stays unless a method is given; tolerances do not change it."""
    found = phipsi.simulate(FLYBALL, t_end=1.0)
    assert found.method.startswith("rodas")
    assert phipsi.simulate(FLYBALL, t_end=1.0, rtol=1e-6).method.startswith("rodas")
    scene = tmp_path / "flyball.toml"
    scene.write_text(FLYBALL.read_text().replace("[integrator]", '[integrator]\nmethod = "rodas4"'))
    asked = phipsi.simulate(scene, t_end=1.0)
    assert asked.method == "rodas4"
    # The explicit method comes to the same by many more steps: stability sets them.
    explicit = phipsi.simulate(FLYBALL, t_end=1.0, method="dop853")
    assert explicit.method == "dop853" and explicit.steps > 5 * found.steps
    for r in (found, asked):
        assert np.abs(r.q[-1] - explicit.q[-1]).max() < 1e-4


SCENE = """
[model]
urdf = "arm.urdf"
gravity = [0, 0, -9.81]
[initial]
q.shoulder = 0.5
[integrator]
t_end = 1.0
rtol = 1e-10
atol = 1e-10
[outputs]
angle = { joint = "elbow" }
"""


def test_scene(tmp_path: Path):
    (tmp_path / "arm.urdf").write_text(ARM.read_text())
    scene = tmp_path / "scene.toml"
    scene.write_text(SCENE)
    r = phipsi.simulate(scene)
    m = arm()
    m.gravity = (0, 0, -9.81)
    own = phipsi.simulate(m, q0=[0.5, 0.0], t_end=1.0, rtol=1e-10)
    assert np.array_equal(r.q, own.q) and np.array_equal(r.outputs["angle"], r.q[:, 1])
    assert np.array_equal(phipsi.simulate(str(scene), t_end=0.5).t[-1:], [0.5])
    assert phipsi.simulate(scene, q0=[0.1, 0.0]).q[0, 0] == 0.1
    with pytest.raises(phipsi.ArgumentError, match="control"):
        phipsi.simulate(scene, control=lambda t, q, v: q)
    with pytest.raises(FileNotFoundError):
        phipsi.simulate(tmp_path / "none.toml")
    with pytest.raises(phipsi.ArgumentError, match="model_or_scene"):
        phipsi.simulate(3, t_end=1.0)
    scene.write_text(SCENE.replace("t_end", "t_ende"))
    with pytest.raises(phipsi.ModelError) as caught:
        phipsi.simulate(scene)
    assert any("t_end" in problem.remedy for problem in caught.value.errors)


def test_simulator_converges_to_simulate_with_order_four():
    m = arm()
    tau = [0.3, -0.1]
    r = phipsi.simulate(
        m, [0.5, 0.1], [0.0, 0.2], t_end=1.0, control=lambda t, q, v: tau, rtol=1e-12, estimate=False
    )
    errors = []
    for steps in (250, 500):
        sim = phipsi.Simulator(m, [0.5, 0.1], [0.0, 0.2])
        for _ in range(steps):
            sim.step(1.0 / steps, tau)
        t, q, v = sim.state
        # A rounding of t every step.
        assert abs(t - 1.0) < steps * EPSILON
        errors.append(max(np.abs(q - r.q[-1]).max(), np.abs(v - r.v[-1]).max()))
    assert abs(math.log2(errors[0] / errors[1]) - 4) < 0.1, errors


def test_simulator_substeps_are_steps():
    m = arm("free")
    q, v = m.random_state(3)
    one, many = phipsi.Simulator(m, q, v, substeps=10), phipsi.Simulator(m, q, v)
    for _ in range(5):
        one.step(0.01)
    for _ in range(50):
        many.step(0.001)
    a, b = one.state, many.state
    assert np.abs(m.difference(a.q, b.q)).max() < 1000 * EPSILON and np.abs(a.v - b.v).max() < 1e4 * EPSILON


def test_simulator_state_can_be_set():
    m = arm()
    sim = phipsi.Simulator(m, t0=2.0)
    assert sim.state.t == 2.0 and np.array_equal(sim.state.q, [0, 0])
    start = sim.state
    sim.step(0.01, [1.0, 0.0])
    first = sim.state
    sim.state = start
    sim.step(0.01, [1.0, 0.0])
    assert np.array_equal(sim.state.q, first.q) and np.array_equal(sim.state.v, first.v) and sim.state.t == first.t
    with pytest.raises(phipsi.ArgumentError):
        sim.state = (0.0, [0.0], [0.0, 0.0])
    with pytest.raises(phipsi.ArgumentError, match="three"):
        sim.state = (0.0, [0.0, 0.0])


@pytest.mark.parametrize("bad", [0.0, -0.1, math.inf, math.nan])
def test_simulator_refuses_bad_steps(bad):
    sim = phipsi.Simulator(arm())
    with pytest.raises(phipsi.ArgumentError, match="`dt`"):
        sim.step(bad)
    with pytest.raises(phipsi.ArgumentError, match="`tau`"):
        sim.step(0.1, [1.0])
    with pytest.raises(phipsi.NumericalError, match="`tau`"):
        sim.step(0.1, [bad if not math.isfinite(bad) else math.nan, 0.0])
    assert sim.state.t == 0.0


def test_simulator_keeps_the_last_good_state():
    sim = phipsi.Simulator(arm(), substeps=3)
    sim.step(0.01, [1.0, 0.0])
    before = sim.state
    with pytest.raises(phipsi.NumericalError) as caught:
        sim.step(0.01, [1e300, 1e300])
    assert caught.value.time is not None
    after = sim.state
    assert after.t == before.t and np.array_equal(after.q, before.q) and np.array_equal(after.v, before.v)
    sim.step(0.01)


def test_simulator_arguments():
    with pytest.raises(phipsi.ArgumentError, match="substeps"):
        phipsi.Simulator(arm(), substeps=0)
    with pytest.raises(phipsi.ArgumentError, match="`t0`"):
        phipsi.Simulator(arm(), t0=math.nan)
    with pytest.raises(phipsi.ArgumentError, match="`q0`"):
        phipsi.Simulator(arm(), [0.0])
    with pytest.raises(TypeError):
        phipsi.Simulator("arm.urdf")


def test_ctrl_c_stops_a_run():
    """A run without Python in its loop: it would take days."""
    code = (
        "import os, signal, sys, threading, phipsi\n"
        "m = phipsi.Model.from_urdf(sys.argv[1], base='free')\n"
        "q, v = m.random_state(0)\n"
        "timer = threading.Timer(0.5, lambda: os.kill(os.getpid(), signal.SIGINT))\n"
        "try:\n"
        "    timer.start()\n"
        "    phipsi.simulate(m, q, 10 * v, t_end=1e7, every=1e5, rtol=1e-13)\n"
        "except KeyboardInterrupt:\n"
        "    print('stopped')\n"
    )
    command = [sys.executable, "-c", code, str(ARM)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
    assert done.stdout == "stopped\n"
