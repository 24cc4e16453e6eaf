"""Reference robots, and the live programs, on every tree robot there is."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from validation import mujoco, pinocchio, robots
from validation.compare import CannotCompare

from .common import joint, link, mixed

ROBOTS = robots.names()


def test_there_are_robots():
    assert len(ROBOTS) >= 19


@pytest.mark.parametrize("name", ROBOTS)
def test_reference_data(name):
    for quantity, error in robots.check(name).items():
        assert error <= robots.bound(name, quantity), (quantity, error)


@pytest.mark.parametrize("program", [pinocchio, mujoco], ids=["pinocchio", "mujoco"])
@pytest.mark.parametrize("name", ROBOTS)
def test_live(program, name):
    result = program.compare(robots.model_path(name), "fixed", range(3))
    assert result.agrees, result.table()


@pytest.mark.parametrize("program", [pinocchio, mujoco], ids=["pinocchio", "mujoco"])
@pytest.mark.parametrize("name", ["chain_0016", "tree_0063"])
def test_live_free_base(tmp_path, program, name):
    """Their root link is the world: a body with mass takes its place."""
    text = Path(robots.model_path(name)).read_text().replace('"world"', '"root"')
    text, replaced = re.subn(r'<link name="root"\s*/>', link("root", 4.0), text)
    assert replaced == 1
    path = tmp_path / "free.urdf"
    path.write_text(text)
    result = program.compare(str(path), "free", range(3))
    assert result.agrees, result.table()


CASES = {
    "pinocchio-fixed": (pinocchio, "fixed", ("continuous", "planar", "prismatic", "floating", "revolute"), ()),
    "pinocchio-free": (pinocchio, "free", ("planar", "continuous", "floating", "prismatic"), ()),
    "mujoco-fixed": (mujoco, "fixed", ("continuous", "planar", "prismatic", "spherical", "revolute"), ()),
    "mujoco-free": (mujoco, "free", ("planar", "continuous", "spherical", "prismatic"), ("1 2 -3", "0 1 0")),
    "mujoco-planar-down": (mujoco, "free", ("planar", "revolute"), ("0 0 -1", "1 1 0")),
}


@pytest.mark.parametrize("case", CASES)
def test_live_joint_types(tmp_path, case):
    program, base, kinds, axes = CASES[case]
    path = tmp_path / "mixed.urdf"
    path.write_text(mixed(*kinds, axes=axes))
    result = program.compare(str(path), base, range(5))
    assert result.agrees, result.table()


def test_mimic_and_fixed_links_and_massless_links(tmp_path):
    text = (
        "<robot name='r'>"
        + link("a")
        + link("b")
        + "<link name='tip'/>"
        + link("c")
        + link("d")
        + joint("first", "revolute", "a", "b", "1 0 0")
        + joint("weld", "fixed", "b", "c")
        + joint("end", "fixed", "c", "tip")
        + joint("second", "revolute", "c", "d", "0 1 0", "<mimic joint='first' multiplier='2'/>")
        + "</robot>"
    )
    path = tmp_path / "mimic.urdf"
    path.write_text(text)
    for program in (pinocchio, mujoco):
        result = program.compare(str(path), "fixed", range(3))
        assert result.agrees, result.table()
        assert "mimic" in result.left_out


def test_a_wrong_model_is_found(tmp_path, monkeypatch):
    """The table must name what differs: here the file changes between the two readers."""
    path, other = tmp_path / "a.urdf", tmp_path / "b.urdf"
    path.write_text(mixed("revolute", "revolute"))
    other.write_text(mixed("revolute", "revolute").replace('mass value="2.0"', 'mass value="2.000001"'))
    for program in (pinocchio, mujoco):
        load = program.load
        monkeypatch.setattr(program, "load", lambda _, base, load=load: load(str(other), base))
        result = program.compare(str(path), "fixed", range(2))
        assert not result.agrees
        bad = {row.quantity for row in result.rows.values() if not row.agrees}
        assert {"mass matrix", "accelerations", "center of mass", "kinetic energy"} <= bad
        assert not {"poses", "Jacobians"} & bad
        assert "DIFFERS" in result.table()


@pytest.mark.parametrize("program", [pinocchio, mujoco], ids=["pinocchio", "mujoco"])
@pytest.mark.parametrize("text", ["", "<robot", "<robot name='r'><link name='a'/><link name='b'/></robot>"])
def test_unusable_files(tmp_path, program, text):
    path = tmp_path / "bad.urdf"
    path.write_text(text)
    with pytest.raises(CannotCompare, match="phipsi does not load it"):
        program.compare(str(path), "fixed", [0])


@pytest.mark.parametrize("name", ["Pinocchio", "MuJoCo"])
def test_exit_status(tmp_path, capsys, name):
    from validation.compare import main

    program = {"Pinocchio": pinocchio, "MuJoCo": mujoco}[name]
    path = tmp_path / "a.urdf"
    path.write_text(mixed("revolute", "continuous"))
    assert main(name, program.compare, [str(path), "--states", "2"], program.BOUND) == 0
    out = capsys.readouterr().out
    assert "mass matrix" in out and "all agree" in out
    # Nothing agrees to less than rounding.
    assert main(name, program.compare, [str(path), "--bound", "1e-18"], program.BOUND) == 1
    assert "DIFFERS" in capsys.readouterr().out
    assert main(name, program.compare, [str(tmp_path / "none.urdf")], program.BOUND) == 1
    assert "No such file" in capsys.readouterr().err
    with pytest.raises(SystemExit) as stop:
        main(name, program.compare, [str(path), "--states", "0"], program.BOUND)
    assert stop.value.code == 2
