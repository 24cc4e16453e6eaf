"""Closures that move with time: a driven four-bar against its closed form, and what cannot be."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import phipsi

from .common import ARM, EXAMPLES

CRANK, COUPLER, ROCKER, GROUND = 0.3, 0.7, 0.6, 0.8

#: The crank's angle.
LAW = "0.4 + 0.6*sin(3*t)"


def law(t: float) -> tuple[float, float, float]:
    """The same with its rates."""
    return 0.4 + 0.6 * np.sin(3 * t), 1.8 * np.cos(3 * t), -5.4 * np.sin(3 * t)


def drive(t: float) -> np.ndarray:
    """Position, velocity and acceleration of the six rows of a weld that turns about z."""
    rows = np.zeros((3, 6))
    rows[:, 2] = law(t)
    return rows


def at(x: float, y: float = 0.0) -> np.ndarray:
    pose = np.eye(4)
    pose[:2, 3] = x, y
    return pose


def four_bar() -> phipsi.Model:
    """Rods in the x-y plane, weight along −y; the crank is held at the ground by a weld that can be told to turn."""
    parts = ['<link name="world"/>']
    for name, joint, parent, length, x in (
        ("crank", "a", "world", CRANK, 0.0),
        ("coupler", "b", "crank", COUPLER, CRANK),
        ("rocker", "c", "world", ROCKER, GROUND),
    ):
        moment = length**3 / 6
        parts.append(
            f'<link name="{name}"><inertial><origin xyz="{length / 2} 0 0"/><mass value="{2 * length}"/>'
            f'<inertia ixx="1e-3" iyy="{moment}" izz="{moment}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
            f'<joint name="{joint}" type="continuous"><parent link="{parent}"/><child link="{name}"/>'
            f'<origin xyz="{x} 0 0"/><axis xyz="0 0 1"/></joint>'
        )
    m = phipsi.Model.from_urdf_text(f'<robot name="four_bar">{"".join(parts)}</robot>')
    m.gravity = (0.0, -9.81, 0.0)
    m.close_loop("coupler", at(COUPLER), "rocker", at(ROCKER), kind="revolute", name="pin")
    m.close_loop("world", np.eye(4), "crank", np.eye(4), kind="weld", name="drive")
    return m


def closed_form(m: phipsi.Model, t: float) -> tuple[np.ndarray, np.ndarray]:
    """Angles and rates of all joints at a time: the triangle of coupler, rocker and the line between their other ends."""
    theta, rate, _ = law(t)
    end = CRANK * np.array([np.cos(theta), np.sin(theta)])
    line = end - [GROUND, 0.0]
    distance = np.hypot(*line)
    inner = np.arccos((distance**2 + ROCKER**2 - COUPLER**2) / (2 * distance * ROCKER))
    psi = np.arctan2(line[1], line[0]) - inner
    joint = ROCKER * np.array([np.cos(psi), np.sin(psi)]) + [GROUND, 0.0]
    phi = np.arctan2(*(joint - end)[::-1])
    # Both ways to the joint have one velocity.
    matrix = [[-COUPLER * np.sin(phi), ROCKER * np.sin(psi)], [COUPLER * np.cos(phi), -ROCKER * np.cos(psi)]]
    phi_rate, psi_rate = np.linalg.solve(matrix, CRANK * rate * np.array([np.sin(theta), -np.cos(theta)]))
    order = [m.joint_q_offset(name) for name in "abc"]
    q, v = np.zeros(3), np.zeros(3)
    q[order], v[order] = (theta, phi - theta, psi), (rate, phi_rate - rate, psi_rate)
    return q, v


def off(q: np.ndarray, want: np.ndarray) -> float:
    """The largest difference of angles, whole turns apart."""
    return float(np.abs((q - want + np.pi) % (2 * np.pi) - np.pi).max())


#: Rounding of angles of about 3 rad through transmissions of up to 5, a few steps of it.
EXACT = 1e-12


@pytest.mark.parametrize("motion", [{"rz": LAW}, drive])
@pytest.mark.parametrize("method", [{"rtol": 1e-10}, {"method": "rk4", "step": 0.01}])
def test_a_driven_four_bar_moves_as_its_closed_form(motion: Any, method: dict[str, Any]) -> None:
    m = four_bar()
    q0, info = m.assemble(closed_form(m, 0.0)[0] + [0.05, -0.05, 0.1], closure_motion={"drive": drive(0.0)})
    r = phipsi.simulate(m, q0, t_end=2.0, every=0.02, closure_motion={"drive": motion}, **method)
    assert len(r.t) == 101
    for t, q, v in zip(r.t, r.q, r.v):
        want_q, want_v = closed_form(m, t)
        assert off(q, want_q) < EXACT and np.abs(v - want_v).max() < 10 * EXACT, t
    # The drive's work is all of the energy's change; rk4 integrates it with its own error, step⁴.
    assert np.abs(r.work).max() > 0.5
    assert r.error.energy_error < (1e-9 if "rtol" in method else 1e-7)
    assert r.error.closure_residual["position"] < 1e-13


def test_one_step_at_a_time() -> None:
    m = four_bar()
    for motion in ({"rz": LAW}, drive):
        q0, _ = closed_form(m, 0.5)
        # Rates are made consistent: from rest to what the drive says.
        sim = phipsi.Simulator(m, q0, t0=0.5, substeps=2, closure_motion={"drive": motion})
        assert np.abs(sim.state.v - closed_form(m, 0.5)[1]).max() < 10 * EXACT
        for _ in range(50):
            sim.step(0.01)
            t, q, v = sim.state
            want_q, want_v = closed_form(m, t)
            assert off(q, want_q) < EXACT and np.abs(v - want_v).max() < 10 * EXACT, t
        with pytest.raises(phipsi.Error, match="open by"):
            sim.state = (1.0, q0, np.zeros(3))


def test_the_force_of_the_drive() -> None:
    m = four_bar()
    q, v = closed_form(m, 0.3)
    given = {"drive": drive(0.3)}
    tau = np.zeros(3)
    position, velocity = m.closure_residual(q, v, closure_motion=given)
    assert np.abs(position).max() < EXACT and np.abs(velocity).max() < 10 * EXACT
    assert abs(m.closure_residual(q)[m.closure_names.index("pin") + 5 + 2]) > 0.1
    # Accelerations against the difference of the closed form's rates: 1e-5 of a second leaves 1e-9.
    a = m.forward_dynamics(q, v, tau, closure_motion=given)
    step = 1e-5
    want = (closed_form(m, 0.3 + step)[1] - closed_form(m, 0.3 - step)[1]) / (2 * step)
    assert np.abs(a - want).max() < 1e-7
    # The power of all closures is that of the drive's moment.
    moment = m.closure_forces(q, v, tau, closure_motion=given)["drive"][2]
    power = m.generalized_constraint_force(q, v, tau, closure_motion=given) @ v
    assert abs(moment * law(0.3)[1] - power) < 1e-12 * abs(power) and abs(power) > 0.1
    # Without the drive's acceleration the moment is another.
    assert abs(m.closure_forces(q, v, tau)["drive"][2] - moment) > 0.1
    on, _ = m.project_position(q + 1e-4, closure_motion=given)
    assert off(on, q) < EXACT
    kept, _ = m.project_velocity(q, np.zeros(3), closure_motion=given)
    assert np.abs(kept - v).max() < 10 * EXACT


def test_a_rod_of_changing_length() -> None:
    """A cylinder between the world and the tip of an arm."""
    m = phipsi.Model.from_urdf(ARM)
    m.gravity = (0.0, 0.0, 0.0)
    anchor = np.eye(4)
    anchor[:3, 3] = 0.4, -0.3, 0.2
    tip = m.body_names[-1]
    q0, _ = m.random_state(3)
    length = float(np.linalg.norm(m.body_pose(q0, tip)[:3, 3] - anchor[:3, 3]))
    m.close_loop("world", anchor, tip, np.eye(4), kind="distance", name="cylinder", length=length)
    r = phipsi.simulate(m, q0, t_end=1.0, every=0.05, rtol=1e-12, closure_motion={"cylinder": {"distance": "0.1*t^2*exp(-t)"}})
    for t, q in zip(r.t, r.q):
        found = np.linalg.norm(m.body_pose(q, tip)[:3, 3] - anchor[:3, 3])
        assert abs(found - length - 0.1 * t**2 * np.exp(-t)) < 1e-13
    assert r.error.energy_error < 1e-9 and abs(r.work[-1]) > 1e-6


def test_motions_that_cannot_be_are_refused() -> None:
    m = four_bar()
    q0, _ = closed_form(m, 0.0)

    def run(motion: Any, model: Any = m, **more: Any) -> None:
        phipsi.simulate(model, q0, t_end=1.0, closure_motion=motion, **more)

    for motion, match in (
        ({"pine": {"rz": LAW}}, "pine"),
        ({"pin": {"rz": LAW}}, '"rx", "ry"'),
        ({"drive": {"rz": "abs(t - 0.5)"}}, "rate that jumps at t = 0.5"),
        ({"drive": {"rz": "sin(q)"}}, "sin"),
        ({"drive": {"rz": float("inf")}}, "finite"),
        ({"drive": {"rz": None}}, "None"),
        ({"drive": 0.4}, "a function of t"),
        ({"drive": lambda t: drive(t)[:2]}, r"drive.*\(2, 6\)"),
    ):
        with pytest.raises(phipsi.ArgumentError, match=match):
            run(motion)
        if "jumps" not in match:
            # A simulator does not know how far it goes: it looks for no kinks.
            with pytest.raises(phipsi.ArgumentError, match=match):
                phipsi.Simulator(m, q0, closure_motion=motion)
    with pytest.raises(phipsi.ArgumentError, match="closure_motion"):
        run({"drive": {"rz": LAW}}, model=EXAMPLES / "satellite_arm.toml")
    # Not at the angle that the drive begins with.
    with pytest.raises(phipsi.Error, match="open by"):
        phipsi.simulate(m, m.assemble(q0)[0], t_end=1.0, closure_motion={"drive": {"rz": LAW}})


def test_what_a_motion_raises_comes_out() -> None:
    m = four_bar()
    q0, _ = closed_form(m, 0.0)

    def fails(t: float) -> np.ndarray:
        if t > 0.35:
            raise KeyError("no more data")
        return drive(t)

    with pytest.raises(KeyError, match="no more data"):
        phipsi.simulate(m, q0, t_end=1.0, closure_motion={"drive": fails})
    sim = phipsi.Simulator(m, q0, closure_motion={"drive": fails})
    sim.step(0.2)
    for _ in range(2):
        with pytest.raises(KeyError, match="no more data"):
            sim.step(0.2)
        # The state is the last good one.
        assert sim.state.t == 0.2 and off(sim.state.q, closed_form(m, 0.2)[0]) < EXACT
    sim.step(0.1)
    assert abs(sim.state.t - 0.3) < 1e-15
