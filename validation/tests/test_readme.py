"""The README's Python runs as it stands there."""

import pathlib
import re

ROOT = pathlib.Path(__file__).resolve().parents[2]


def test_python_of_the_readme(monkeypatch, capsys):
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), re.S)
    assert len(blocks) == 1
    monkeypatch.chdir(ROOT)
    names = {}
    exec(compile(blocks[0], "README.md", "exec"), names)
    assert "bus" in capsys.readouterr().out
    # Ten lines: comments and blank lines do not count.
    assert sum(bool(line.strip()) for line in blocks[0].splitlines()) <= 11
    trajectory = names["t"]
    # No thrusters: the momentum of the whole system stays what it was.
    scale = abs(trajectory.momentum).max()
    assert (abs(trajectory.momentum - trajectory.momentum[0]).max() / scale) < 1e-9
