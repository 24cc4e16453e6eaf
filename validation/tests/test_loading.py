"""Loading: reports, errors with fields, options."""

from __future__ import annotations

import numpy as np
import pytest

import phipsi

from .common import ARM, joint, link


def test_report():
    m = phipsi.Model.from_urdf(str(ARM))
    report = m.report
    assert report.source == str(ARM) and not report.errors and not report.warnings
    assert any("visual" in note.what and note.place == "link `upper`" for note in report.ignored)
    assert any("links: 3" in note.what for note in report.used)
    assert "ignored" in str(report)
    with pytest.raises(AttributeError):
        report.source = "other"


def test_all_errors_at_once():
    text = ARM.read_text().replace('mass value="2"', 'mass value="-2"').replace('parent link="upper"', 'parent link="x"')
    with pytest.raises(phipsi.ModelError) as caught:
        phipsi.Model.from_urdf_text(text, source="arm.urdf")
    error = caught.value
    assert isinstance(error, ValueError) and isinstance(error, phipsi.Error)
    places = [problem.place for problem in error.errors]
    assert "link `upper`" in places and "joint `elbow`" in places
    for problem in error.errors:
        assert problem.found and problem.required and problem.remedy and problem.line
    assert len(error.report.errors) == len(error.errors)
    assert "arm.urdf:" in str(error)


def test_strict_refuses_warnings():
    text = ARM.read_text().replace("<visual>", "<visul/><visual>")
    assert phipsi.Model.from_urdf_text(text).report.warnings
    with pytest.raises(phipsi.ModelError, match="strict") as caught:
        phipsi.Model.from_urdf_text(text, strict=True)
    assert not caught.value.errors and caught.value.warnings[0].line == 5


@pytest.mark.parametrize(("name", "value"), [("base", "floating"), ("mimic", "yes")])
def test_options(name, value):
    with pytest.raises(phipsi.ArgumentError, match=f'`{name}` is "{value}"') as caught:
        phipsi.Model.from_urdf(ARM, **{name: value})
    assert caught.value.argument == name


def test_files_that_cannot_be_opened(tmp_path):
    with pytest.raises(FileNotFoundError) as caught:
        phipsi.Model.from_urdf(tmp_path / "none.urdf")
    assert caught.value.filename == str(tmp_path / "none.urdf")
    with pytest.raises(phipsi.ModelError):
        phipsi.Model.from_urdf(tmp_path)
    (tmp_path / "binary.urdf").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(phipsi.ModelError, match="UTF-8"):
        phipsi.Model.from_urdf(tmp_path / "binary.urdf")


FOLLOW = (
    "<robot name='r'>" + link("a") + link("b") + link("c")
    + joint("lead", "revolute", "a", "b") + joint("follow", "revolute", "b", "c", "0 0 1", "<mimic joint='lead'/>")
    + "</robot>"
)  # fmt: skip


def test_mimic():
    closed = phipsi.Model.from_urdf_text(FOLLOW)
    assert closed.nv == 2
    a = closed.forward_dynamics([0, 0], [0, 0], [1, 0])
    assert a[0] == pytest.approx(a[1], rel=1e-14)
    with pytest.raises(phipsi.ModelError, match='mimic = "free"') as caught:
        closed.inverse_dynamics([0, 0], [0, 0], [0, 0])
    assert caught.value.errors[0].place == "joint `follow`"
    moved = phipsi.simulate(closed, v0=[0.3, 0.3], t_end=0.5)
    assert np.abs(moved.q[:, 0] - moved.q[:, 1]).max() < 1e-12 and abs(moved.q[-1, 0]) > 0.01
    free = phipsi.Model.from_urdf_text(FOLLOW, mimic="free")
    assert free.forward_dynamics([0, 0], [0, 0], [0, 0]).shape == (2,)
    assert free.report.approximated


def test_joint_without_inertia():
    text = ARM.read_text()
    start = text.index('<link name="lower">')
    text = text[:start] + '<link name="lower"/>' + text[text.index("</link>", start) + len("</link>") :]
    m = phipsi.Model.from_urdf_text(text)
    assert any(problem.place == "joint `elbow`" for problem in m.report.warnings)
    with pytest.raises(phipsi.NumericalError, match="elbow") as caught:
        m.forward_dynamics([[0, 0], [1, 1]], [0, 0], [0, 0])
    error = caught.value
    assert error.quantity == "articulated inertia" and error.joint == "elbow" and error.component == 0
    assert error.found == 0.0 and error.state == (0,) and error.required and error.remedy
    # What needs no inverse still works.
    assert m.mass_matrix([0, 0])[1, 1] == 0.0


def test_fixed_joints_have_no_coordinates():
    text = "<robot name='r'>" + link("a") + link("b") + joint("weld", "fixed", "a", "b") + "</robot>"
    m = phipsi.Model.from_urdf_text(text)
    assert m.joint_names == [] and m.body_names == ["a", "b"]
    with pytest.raises(phipsi.ArgumentError, match="fixed"):
        m.joint_v_offset("weld")
