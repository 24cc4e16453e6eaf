"""The driver of the speed comparison, with timers that are small scripts: no compiler is needed."""

from __future__ import annotations

import sys
from pathlib import Path
from types import SimpleNamespace
from xml.etree import ElementTree

import mujoco as mj
import numpy as np
import pinocchio as pin
import pytest

import phipsi
from validation.speed import build, models, page, python, report
from validation.speed.__main__ import main
from validation.speed.programs import Dynibo, MuJoCo, Pinocchio, Program, Simbody, difference
from validation.speed.timer import Side, Timer, TimerError, Unsupported, alternate

#: A timer: every question goes to a log; results are state + 1, 10 (state + 1), changed by MODE; a call takes NS.
SCRIPT = """
import sys
log, name, ns, mode = open(sys.argv[1], "a"), sys.argv[2], float(sys.argv[3]), sys.argv[4]
first = None
for line in sys.stdin:
    model, operation, states, repetitions = line.split()
    repetitions = int(repetitions)
    print(name, operation, repetitions, file=log, flush=True)
    state = -repetitions if mode != "stale" or first is None else first
    if repetitions <= 0 and first is None:
        first = state
    if mode == "dies":
        sys.exit(1)
    if operation.startswith("unknown"):
        print("unsupported", flush=True)
    elif mode == "error":
        print("error: the model is odd", flush=True)
    elif mode == "nonsense":
        print("four", flush=True)
    elif repetitions <= 0:
        values = [state + 1.0, 10.0 * (state + 1)]
        values[1] *= {"off": 1 + 1e-6, "close": 1 + 1e-7, "far": 1 + 1e-5, "nan": float("nan")}.get(mode, 1 + 1e-12)
        print("result", *values, flush=True)
    else:
        print(ns, "nan" if mode == "nan" else 0.0, flush=True)
"""


@pytest.fixture
def timer(tmp_path):
    """Makes timers; closes them afterwards."""
    script, running = tmp_path / "timer.py", []
    script.write_text(SCRIPT)

    def make(name: str, ns: float = 1000.0, mode: str = "right") -> Timer:
        running.append(Timer(name, [sys.executable, str(script), str(tmp_path / "log"), name, str(ns), mode]))
        return running[-1]

    yield make
    for each in running:
        each.close()


def test_answers(timer):
    t = timer("one", 1234.5)
    assert t.time("m", "f", "s", 64) == 1234.5
    assert t.result("m", "f", "s", 2).tolist() == [3.0, 30.0 * (1 + 1e-12)]
    with pytest.raises(Unsupported, match="one, unknown, m"):
        t.time("m", "unknown", "s", 1)
    # It is not out of step afterwards.
    assert t.time("m", "f", "s", 64) == 1234.5


@pytest.mark.parametrize("mode, text", [("error", "the model is odd"), ("dies", "has stopped"), ("nonsense", "'four'")])
def test_bad_answers(timer, mode, text):
    with pytest.raises(TimerError, match=text):
        timer("bad", mode=mode).time("m", "f", "s", 1)
    with pytest.raises(TimerError, match=text):
        timer("bad", mode=mode).result("m", "f", "s", 0)


@pytest.mark.parametrize("ns", ["nan", "0", "-3", "inf"])
def test_impossible_times(timer, ns):
    with pytest.raises(TimerError, match="no time of a call"):
        timer("bad", float(ns)).time("m", "f", "s", 1)


def test_results_that_are_not_finite(timer):
    with pytest.raises(TimerError, match="not finite"):
        timer("bad", mode="nan").time("m", "f", "s", 1)


def test_sides_take_turns(timer, tmp_path):
    sides = [Side(timer(name, ns), "m", "f", "s") for name, ns in (("a", 1000.0), ("b", 7.0), ("c", 1e6))]
    times = alternate(sides, 5)
    assert times == [[1000.0] * 5, [7.0] * 5, [1e6] * 5]
    asked = [line.split() for line in (tmp_path / "log").read_text().splitlines()]
    turns = asked[-15:]
    assert [name for name, *_ in turns] == list("abc" "bca" "cab" "abc" "bca")
    for (name, _, repetitions), ns in zip(turns[:3], (1000.0, 7.0, 1e6)):
        repetitions = int(repetitions)
        # Whole cycles through the states, of a quantum or more.
        assert repetitions % 64 == 0 and repetitions * ns >= 300e3, name
        assert repetitions == 64 or (repetitions - 64) * ns < 300e3, name


class Other(Program):
    """A program whose timer is given, and whose results are in our coordinates."""

    def __init__(self, name: str, *variants: tuple[str, Timer]) -> None:
        self.name, self.given = name, dict(variants)
        self.operations = {"inverse_dynamics": tuple(self.given)}
        self.model = self.states = "theirs"

    def timer(self, operation: str) -> Timer:
        return self.given[operation]

    def alike(self, operation, case, state, ours, theirs):
        return ours, theirs


CASE = SimpleNamespace(name="arm", m=SimpleNamespace(nv=2), known=[])

#: The same where the right results are known.
KNOWN = SimpleNamespace(name="arm", m=CASE.m, known=[np.array([i + 1.0, 10.0 * (i + 1)]) for i in range(64)])


def ours(timer, ns: float, mode: str = "right"):
    return SimpleNamespace(timer=timer("phipsi", ns, mode), model="ours", states="ours")


def test_medians_ratios_and_bars(timer):
    other = Other("Pinocchio", ("inverse_dynamics:x", timer("x", 900.0)), ("inverse_dynamics:y", timer("y", 800.0)))
    run = report.Run(4)
    run.compare(CASE, "inverse_dynamics", ours(timer, 400.0), [other])
    (row,) = run.rows
    assert set(row.times["Pinocchio"]) == {"inverse_dynamics:x", "inverse_dynamics:y"}
    assert row.ratio("Pinocchio") == 0.5 and not run.refused
    assert "Pinocchio y 800 ns ratio 0.500 (OVER 0.45, 0.3)" in run.text()
    found = run.as_json()["rows"][0]["ratios"]["Pinocchio"]
    assert found == {"ratio": 0.5, "bar": (0.45, 0.3)}


@pytest.mark.parametrize("mode", ["off", "nan", "stale", "error", "dies", "nonsense"])
def test_who_computes_something_else_is_not_timed(timer, tmp_path, mode):
    good, bad = Other("good", ("inverse_dynamics", timer("good"))), Other("bad", ("inverse_dynamics", timer("bad", mode=mode)))
    run = report.Run(3)
    run.compare(CASE, "inverse_dynamics", ours(timer, 500.0), [bad, good])
    assert set(run.rows[0].times) == {"phipsi", "good"}
    assert len(run.refused) == 1 and "bad, inverse_dynamics, arm" in run.refused[0]
    asked = [line.split() for line in (tmp_path / "log").read_text().splitlines()]
    assert not [line for line in asked if line[0] == "bad" and int(line[2]) > 0]


def test_who_errs_is_said(timer):
    run = report.Run(3)
    run.compare(KNOWN, "inverse_dynamics", ours(timer, 500.0), [Other("rough", ("inverse_dynamics", timer("rough", mode="close")))])
    (row,) = run.rows
    assert set(row.times) == {"phipsi", "rough"} and not run.refused
    assert row.errors == pytest.approx({"phipsi": 1e-12, "rough": 1e-7}, rel=1e-3)
    assert "rough, inverse_dynamics, arm: differs by 1.0e-07, allowed 1.0e-09: its own error, against known results 1e-07" in run.text()
    assert "errors phipsi 1e-12, rough 1e-07" in run.text()


@pytest.mark.parametrize("mine, theirs", [("close", "right"), ("close", "close"), ("right", "far"), ("right", "stale")])
def test_a_difference_that_is_not_their_error_is_refused(timer, mine, theirs):
    run = report.Run(3)
    other = Other("other", ("inverse_dynamics", timer("other", mode=theirs)))
    run.compare(KNOWN, "inverse_dynamics", ours(timer, 500.0, mine), [other])
    if (mine, theirs) == ("close", "close"):
        # They agree: nothing is refused, and both errors are told.
        assert not run.refused and run.rows[0].errors == pytest.approx({"phipsi": 1e-7, "other": 1e-7}, rel=1e-3)
    else:
        assert len(run.refused) == 1 and set(run.rows[0].times) == {"phipsi"} and not run.explained


def test_goals_of_single_models():
    rows = [{"model": name, "ratios": {"Pinocchio": {"bar": bar}}} for name, bar in (("a", (1, 1)), ("b", (1, 1)), ("c", (0.05, 0.05)), ("d", None))]
    assert page._goals("Pinocchio", rows) == "Pinocchio ≤ 1, Pinocchio ≤ 0.05 on c"
    assert page._goals("MuJoCo", rows) == ""
    assert report.bar("closed_forward_dynamics", "Pinocchio", "ladderL_0128") == (0.05, 0.05)
    assert report.bar("closed_forward_dynamics", "Pinocchio", "stewart") == (1.0, 1.0)


def test_what_does_not_exist_is_said(timer):
    run = report.Run(3)
    run.compare(CASE, "unknown", ours(timer, 1.0), [])
    assert run.rows == [] and "left out: phipsi, unknown: does not exist yet" in run.text()
    run.compare(CASE, "inverse_dynamics", ours(timer, 1.0, "error"), [])
    assert run.rows == [] and len(run.refused) == 1


def test_difference():
    assert difference(np.array([1.0, 2.0]), np.array([1.0, 4.0])) == 0.5
    assert difference(np.array([1.0, np.nan]), np.array([1.0, 4.0])) == np.inf
    assert difference(np.zeros(3), np.zeros(3)) == 0.0


def test_bars_are_for_models():
    assert report.bar("forward_dynamics_batch", "Pinocchio", "panda") == (0.07, 0.045)
    assert report.bar("forward_dynamics_batch", "Pinocchio", "ur5") is None
    assert report.bar("forward_dynamics", "MuJoCo", "ur5") == (0.5, 0.35)


def test_states_are_written_to_the_last_bit(tmp_path):
    case = models.open_case("solo12", tmp_path, count=3)
    words = Path(models.write_states(tmp_path / "states", case.states)).read_text().split()
    assert words[:3] == ["3", str(case.m.nq), str(case.m.nv)]
    assert [float(word) for word in words[3:]] == [x for state in case.states for row in state for x in row]


def test_made_chains(tmp_path):
    case = models.open_case("chain_0009", tmp_path, count=2)
    assert case.m.nv == 9 and case.links[case.target] == "link8" and not case.m.report.ignored
    assert models.chain(9) == case.path.read_text()


def pinocchio_from(path: str) -> pin.Model:
    """The model that the timer builds from the flat file."""
    lines = [line.split() for line in Path(path).read_text().splitlines()]
    model = pin.Model()
    model.gravity.linear = np.array(lines[0][1:], float)
    for kind, parent, *numbers in lines[2:]:
        x = np.array(numbers, float)
        joint = getattr(pin, kind)
        joint = joint(*x[12:15]) if "Unaligned" in kind else joint()
        i = model.addJoint(int(parent), joint, pin.SE3(x[:9].reshape(3, 3), x[9:12]), f"joint{model.njoints}")
        xx, xy, yy, xz, yz, zz = x[19:]
        inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        model.appendBodyToJoint(i, pin.Inertia(x[15], x[16:19], inertia), pin.SE3.Identity())
    return model


@pytest.mark.parametrize("name", ["panda", "solo12", "tree_0063", "chain_0009"])
def test_pinocchio_flat_file_and_coordinates(tmp_path, name):
    case, program = models.open_case(name, tmp_path, count=2), Pinocchio(tmp_path)
    program.start(case)
    model = pinocchio_from(program.model)
    data = model.createData()
    rows = [np.array(line.split(), float) for line in Path(program.states).read_text().splitlines()[1:]]
    for state, (q, v, tau, a) in enumerate(case.states):
        their_q, their_v, their_tau, their_a = rows[4 * state : 4 * state + 4]
        m = case.m
        pairs = {
            "forward_dynamics": (m.forward_dynamics(q, v, tau), pin.aba(model, data, their_q, their_v, their_tau)),
            "inverse_dynamics": (m.inverse_dynamics(q, v, a), pin.rnea(model, data, their_q, their_v, their_a)),
            "centroidal": (m.centroidal_momentum_matrix(q), pin.computeCentroidalMap(model, data, their_q)),
        }
        target = int(Path(program.model).read_text().splitlines()[1].split()[1])
        pin.computeJointJacobians(model, data, their_q)
        pin.updateGlobalPlacements(model, data)
        aligned = pin.getJointJacobian(model, data, target, pin.LOCAL_WORLD_ALIGNED)
        pairs["jacobian"] = (m.jacobian(q, case.links[case.target]), aligned)
        full = np.triu(pin.crba(model, data, their_q))
        pairs["mass_matrix"] = (m.mass_matrix(q), full + np.triu(full, 1).T)
        for operation, (first, second) in pairs.items():
            first, second = program.alike(operation, case, state, np.ravel(first), np.ravel(second))
            assert difference(first, second) < 1e-11, operation


@pytest.mark.parametrize("name", ["panda", "solo12", "tree_0063"])
def test_mujoco_model_and_coordinates(tmp_path, name):
    case, program = models.open_case(name, tmp_path, count=2), MuJoCo(tmp_path)
    program.start(case)
    model = mj.MjModel.from_binary_path(program.model)
    rows = [np.array(line.split(), float) for line in Path(program.states).read_text().splitlines()[1:]]
    for state, (q, v, tau, a) in enumerate(case.states):
        data = mj.MjData(model)
        data.qpos[:], data.qvel[:], data.qfrc_applied[:], their_a = rows[4 * state : 4 * state + 4]
        mj.mj_forward(model, data)
        theirs = {"forward_dynamics": data.qacc.copy()}
        dense = np.zeros((model.nv, model.nv))
        mj.mj_fullM(model, data, dense)
        data.qacc[:] = their_a
        mj.mj_inverse(model, data)
        theirs |= {"inverse_dynamics": data.qfrc_inverse, "mass_matrix": dense.ravel()}
        m = case.m
        mine = {
            "forward_dynamics": m.forward_dynamics(q, v, tau),
            "inverse_dynamics": m.inverse_dynamics(q, v, a),
            "mass_matrix": m.mass_matrix(q).ravel(),
        }
        for operation, result in theirs.items():
            pair = program.alike(operation, case, state, mine[operation], result)
            assert difference(*pair) < 1e-11, operation


@pytest.mark.parametrize("name", ["panda", "solo12", "talos_reduced", "tree_0063"])
def test_merged_models_are_the_same_mechanisms(tmp_path, name):
    case = models.open_case(name, tmp_path, count=2)
    link = case.links[case.target]
    free = case.merged.joints[1].shortname() == "JointModelFreeFlyer"
    path = tmp_path / "d.urdf"
    assert models.write_dynibo(path, case) == f"{'free:' if free else ''}{path}#{link}"
    assert "floating" not in path.read_text() and "fixed" not in path.read_text()
    other = phipsi.Model.from_urdf(str(path), base="free" if free else "fixed")
    assert other.nv == case.m.nv and len(other.body_names) <= case.merged.njoints
    for q, v, tau, _ in case.states:
        # A free base is first in both; the other joints keep their names.
        order = [other.joint_v_offset(n) for n in case.m.joint_names if n in other.joint_names]
        rest = [case.m.joint_v_offset(n) for n in case.m.joint_names if n in other.joint_names]
        first = list(range(6 if free else 0))
        theirs_v, ours_v = first + order, first + rest
        extra = 1 if free else 0
        theirs_q = list(range(7 * extra)) + [i + extra for i in order]
        ours_q = list(range(7 * extra)) + [i + extra for i in rest]
        x, y, z = np.zeros(other.nq), np.zeros(other.nv), np.zeros(other.nv)
        x[theirs_q], y[theirs_v], z[theirs_v] = q[ours_q], v[ours_v], tau[ours_v]
        expected = case.m.forward_dynamics(q, v, tau)[ours_v]
        assert difference(other.forward_dynamics(x, y, z)[theirs_v], expected) < 1e-11
        assert difference(other.body_pose(x, link), case.m.body_pose(q, link)) < 1e-13


@pytest.mark.parametrize("program", [Dynibo, Simbody])
@pytest.mark.parametrize("name", ["solo12", "panda"])
def test_coordinates_in_world_axes(tmp_path, program, name):
    """A base's velocity and acceleration there are those of its link in world axes; power is the same."""
    case, program = models.open_case(name, tmp_path, count=2), program(tmp_path)
    free = name == "solo12"
    program._use(case, list(case.merged.names)[2 if free else 1 :], "theirs")
    rows = [np.array(line.split(), float) for line in Path(program.states).read_text().splitlines()[1:]]
    for state, (q, v, tau, a) in enumerate(case.states):
        their_q, their_v, their_tau, their_a = rows[4 * state : 4 * state + 4]
        assert sorted(their_q) == sorted(q) and abs(their_tau @ their_v - tau @ v) < 1e-14 * case.m.nv
        first, second = program.alike("forward_dynamics", case, state, a, their_a)
        assert difference(first, second) == 0.0
        M = case.m.mass_matrix(q)
        theirs, _ = program.alike("mass_matrix", case, state, M.ravel(), M.ravel())
        assert abs(their_v @ theirs @ their_v - v @ M @ v) < 1e-13 * abs(v @ M @ v)
        if free:
            link = case.links[1]
            assert difference(their_v[:6], case.m.body_velocity(q, v, link)) < 1e-14
            assert difference(their_a[:6], case.m.body_acceleration(q, v, a, link)) < 1e-14
            # The quaternion's w, and the position.
            w, position = (0, 4) if isinstance(program, Simbody) else (6, 0)
            assert their_q[w] == q[6] and list(their_q[position : position + 3]) == list(q[:3])
        J = case.m.jacobian(q, case.links[case.target])
        theirs, _ = program.alike("jacobian", case, state, J.ravel(), J.T.ravel())
        assert difference(theirs @ their_v, J @ v) < 1e-13


def test_timers_are_rebuilt_when_their_sources_change(tmp_path):
    source, target = tmp_path / "a.c", tmp_path / "cache" / "a"
    command = [sys.executable, "-c", "import shutil, sys; shutil.copy(*sys.argv[1:])", str(source), str(target)]
    source.write_text("1")
    build.cached(target, [source], command, "a")
    target.write_text("kept")
    build.cached(target, [source], command, "a")
    assert target.read_text() == "kept"
    source.write_text("2")
    build.cached(target, [source], command, "a")
    assert target.read_text() == "2"
    with pytest.raises(build.CannotBuild, match="b does not compile: .*SystemExit|b does not compile: error here"):
        build.cached(target, [source], [sys.executable, "-c", "raise SystemExit('error here')"], "b")


@pytest.mark.parametrize(
    "there, version, expected",
    [
        (["clang++-19", "g++"], "Debian clang version 19.1.7", ("clang++-19", True)),
        (["clang++", "g++"], "clang version 20.1.0", ("clang++", True)),
        (["clang++", "g++"], "Debian clang version 14.0.6", ("clang++", False)),
        (["g++"], "g++ (Debian 12.2.0-14) 12.2.0", ("g++", False)),
    ],
)
def test_only_a_new_clang_counts(monkeypatch, there, version, expected):
    monkeypatch.setattr(build.shutil, "which", lambda name: name if name in there else None)
    monkeypatch.setattr(build, "_version_of", lambda name: version)
    assert build.compiler() == expected


def test_no_compiler(monkeypatch):
    monkeypatch.setattr(build.shutil, "which", lambda name: None)
    with pytest.raises(build.CannotBuild, match="no C\\+\\+ compiler"):
        build.compiler()


def test_page_and_chart(timer, tmp_path):
    run = report.Run(3)
    run.describe("phipsi", build.Built([], "0.1", "rustc", "release"))
    run.describe("Pinocchio", build.Built([], "4", "g++", "-O3", ["does not count"]))
    other = Other("Pinocchio", ("inverse_dynamics", timer("x", 1000.0)))
    run.compare(CASE, "inverse_dynamics", ours(timer, 460.0), [other])
    run.chains.append({"bodies": 64, "ns_per_body": 50.0, "ratio": 1.0, "bar": None})
    run.python.append(python.Figure("one call", 2100.0, "ns", 2000.0))
    (tmp_path / "images").mkdir()
    page.write(run.as_json() | {"avx512": False}, tmp_path)
    assert "[Speed](speed.md)" in (tmp_path / "speed_without_avx512.md").read_text()
    page.write(run.as_json() | {"avx512": True}, tmp_path)
    text = (tmp_path / "speed.md").read_text()
    assert text.startswith("# Speed\n") and "[Speed without AVX-512](speed_without_avx512.md)" in text
    assert "| arm (2) | 460 ns | 1 µs · **0.46** † |" in text and "does not count" in text and "| 64 | 50.0 |" in text
    assert "| one call | 2.1 µs | ≤ 2 µs |" in text and "one call: 2.1 µs (OVER 2 µs)" in run.text()
    root = ElementTree.parse(tmp_path / "images" / "speed.svg").getroot()
    dots = root.findall(".//{*}circle")
    assert len(dots) == 1 and dots[0].find("{*}title").text == "arm: 0.46"


@pytest.mark.parametrize("arguments", [["--only", "flying"], ["--against", "Newton"], ["--rounds", "0"], ["--cache", "a b"]])
def test_wrong_usage(arguments, capsys):
    with pytest.raises(SystemExit) as stop:
        main(arguments)
    assert stop.value.code == 2
    assert arguments[0] in capsys.readouterr().err
