"""The example scripts run; they assert what they show."""

import pathlib
import subprocess
import sys

import pytest

EXAMPLES = pathlib.Path(__file__).resolve().parents[2] / "examples"


def test_random_field_on_an_arm(tmp_path):
    pytest.importorskip("matplotlib")
    command = [sys.executable, str(EXAMPLES / "random_field.py"), str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    assert "agree with ψ M ψ* and ψ M ψ* − P Ω P" in done.stdout
    pictures = sorted(path.stem for path in tmp_path.glob("*.svg"))
    assert pictures == ["random_field_covariance", "random_field_filter", "random_field_rate", "random_field_smoother"]
