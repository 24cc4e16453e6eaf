"""The documentation's page of a run, and its chart: a line per operation and program, a dot per model."""

from __future__ import annotations

import math
from html import escape
from pathlib import Path

from .python import show
from .timer import duration, median

_HEAD = """# {title}

phipsi beside other programs on the same models and states, taking turns on one machine. Written by `python -m validation.speed --page`;
to repeat it, `pip install -r validation/requirements.txt ./crates/python`, then run that command.

![Time of phipsi over time of the others](images/{name}.svg)

{other}

- Every call starts from (q, v, …) with nothing cached; kinematics are included on all sides. 64 random states are cycled; a measurement is
  at least 300 µs of thread CPU time; the sides take turns, and the medians of both are compared.
- Before anything is timed, results are compared: a program that differs by more than 1e-9 (relative to the largest number; more on models where the inertia
  at a joint cancels) is refused.
- Joints' friction, damping, armature, limits, contacts are off everywhere; links on fixed joints are merged; gravity is the same.
- Of Pinocchio's variants (forward dynamics and mass matrix in local or world frames, Jacobian of all joints or along the path) the faster counts, by model.
  MuJoCo: `mj_forward` without constraints, `mj_inverse`, and for the mass matrix `mj_kinematics`, `mj_comPos`, `mj_makeM`. Simbody: `realize(Acceleration)`,
  `calcResidualForceIgnoringConstraints`, `calcM`; Debian's library has its internal checks compiled in.
- phipsi is built as it is published: no processor-specific flags; the instruction level is chosen at run time. Operations on a batch: CPU time of
  all threads together, per state, against one state of the others.
- Ratio: time(phipsi) / time(other); below 1 phipsi is faster.
- Times of phipsi alone: `cargo bench -p phipsi-recursion` (`--bench forward_dynamics` for one file; `--features parallel` for threads), which prints processor,
  lanes, compiler and flags first. Instructions instead of times, for regressions: `python3 tools/instructions.py --check tools/instructions.json` (valgrind).
"""

#: A page for processors with AVX-512, and one for all others: ratios are other ones there.
_WIDE, _NARROW = "speed", "speed_without_avx512"
_TITLES = {_WIDE: "Speed", _NARROW: "Speed without AVX-512"}
_OTHERS = {
    _WIDE: f"Measured on a processor with AVX-512, which takes eight numbers at once. Others: [{_TITLES[_NARROW]}]({_NARROW}.md).",
    _NARROW: f"Measured on a processor without AVX-512: registers hold four numbers (AVX2) or fewer. With it: [{_TITLES[_WIDE]}]({_WIDE}.md).",
}

_LONG = """## Long chains

Forward dynamics of one state of a chain, phipsi alone, on one thread. Beyond some ten thousand bodies the sweeps wait for memory: three
passes read and write about 1.4 kB a body.

A chain stays on one thread. Its filter is a recursion from tip to base, each body needing the one before. It can be cut into segments, each
with its compliance at both ends, joined by 6×6 systems (Featherstone's divide and conquer, or the Riccati equation as a scan), but a body then
costs three to four times as much (a 6×6 transfer and a compliance are carried along), which two cores do not pay back without lanes over
segments besides, and eliminating across segments may lose digits where the sweep does not. That is an estimate; it was not built. Branches
of a tree do run on several threads, with the bits of one ([Algorithms](algorithms.md#one-state-and-many)).
"""


def _table(header: list[str], rows: list[list[str]]) -> str:
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)


def _cell(row: dict, program: str) -> str:
    variants = row["ns"].get(program)
    if not variants:
        return "–"
    best = min(median(times) for times in variants.values())
    ratio, bars = row["ratios"][program]["ratio"], row["ratios"][program]["bar"]
    over = " †" if bars and ratio > bars[0] else ""
    return f"{duration(best)} · **{ratio:.3g}**{over}"


def _goals(program: str, rows: list[dict]) -> str:
    """The goals of a program; where models have their own, which ones."""
    models: dict[tuple[float, float], list[str]] = {}
    for row in rows:
        if bar := row["ratios"].get(program, {}).get("bar"):
            models.setdefault(tuple(bar), []).append(row["model"])
    common = max(models, key=lambda bar: len(models[bar]), default=None)
    parts = []
    for bar, names in models.items():
        stretch = f" (stretch {bar[1]:g})" if bar[1] != bar[0] else ""
        which = f" on {', '.join(names)}" if bar != common else ""
        parts.append(f"{program} ≤ {bar[0]:g}{stretch}{which}")
    return ", ".join(parts)


def _error(error: float | None) -> str:
    return "–" if error is None else f"{error:.0e}"


def name(run: dict) -> str:
    """The page's name: that of its file and of its chart's."""
    return _WIDE if run["avx512"] else _NARROW


def text(run: dict) -> str:
    """The page in Markdown."""
    own = name(run)
    head = _HEAD.format(title=_TITLES[own], name=own, other=_OTHERS[own])
    parts = [head, f"## The run\n\n{run['date']}; {run['machine']}; {run['rounds']} rounds.\n"]
    programs = [[name, p["version"], p["compiler"], f"`{p['flags']}`"] for name, p in run["programs"].items()]
    parts.append(_table(["program", "version", "compiler", "flags"], programs) + "\n")
    parts += [f"**{remark}.**\n" for remark in run["remarks"]]
    others = [name for name in run["programs"] if name != "phipsi"]
    for operation in dict.fromkeys(row["operation"] for row in run["rows"]):
        rows = [row for row in run["rows"] if row["operation"] == operation]
        have = [name for name in others if any(name in row["ns"] for row in rows)]
        goals = [_goals(name, rows) for name in have]
        lines = []
        for row in rows:
            ours = min(median(times) for times in row["ns"]["phipsi"].values())
            lines.append([f"{row['model']} ({row['dof']})", duration(ours), *(_cell(row, name) for name in have)])
        parts.append(f"## {operation.replace('_', ' ').capitalize()}\n")
        parts.append(_table(["model (dof)", "phipsi", *(f"{name} · ratio" for name in have)], lines) + "\n")
        if any(goals):
            parts.append("Goals: " + ", ".join(filter(None, goals)) + "; † missed.\n")
        if any(row["errors"] for row in rows):
            programs = ["phipsi", *have]
            cells = [[row["model"], *(_error(row["errors"].get(name)) for name in programs)] for row in rows]
            parts.append("Errors against known results, relative to the largest component:\n")
            parts.append(_table(["model", *programs], cells) + "\n")
    if run["chains"]:
        rows = [
            [str(c["bodies"]), f"{c['ns_per_body']:.1f}", f"{c['ratio']:.2f}", "" if c["bar"] is None else f"≤ {c['bar']:g}"]
            for c in run["chains"]
        ]
        parts.append(_LONG)
        parts.append(_table(["bodies", "ns per body", "over the first", "goal"], rows) + "\n")
    if run["python"]:
        rows = [
            [f["what"], show(f["value"], f["unit"]), "" if f["bar"] is None else f"≤ {show(f['bar'], f['unit'])}"]
            for f in run["python"]
        ]
        parts.append("## From Python\n\nWhat the package adds to the kernels. Wall times contain whatever else the machine does.\n")
        parts.append(_table(["what", "measured", "goal"], rows) + "\n")
    if run["explained"]:
        parts.append("## Timed though they differ\n\n" + "\n".join(f"- {line}" for line in run["explained"]) + "\n")
    if run["left_out"] or run["refused"]:
        parts.append("## Left out\n\n" + "\n".join(f"- {line}" for line in [*run["left_out"], *run["refused"]]) + "\n")
    return "\n".join(parts)


_WIDTH, _LEFT, _RIGHT, _TOP, _LINE = 900, 300, 30, 34, 24
_STYLE = (
    "text{font:13px sans-serif;fill:#1c2126}.g{stroke:#d5dbe1}.one{stroke:#7f97b0}.bar{stroke:#c2410c;stroke-width:2}"
    ".d{fill:#1d6fb8;fill-opacity:.75}@media(prefers-color-scheme:dark){text{fill:#e4e8ec}.g{stroke:#39424c}"
    ".bar{stroke:#fb923c}.d{fill:#6cb6ff}}"
)


def chart(run: dict) -> str:
    """The chart in SVG: ratios on a logarithmic axis, goals as ticks."""
    groups: dict[tuple[str, str], list[tuple[str, float]]] = {}
    goals: dict[tuple[str, str], float] = {}
    for row in run["rows"]:
        for program, found in row["ratios"].items():
            key = (row["operation"], program)
            groups.setdefault(key, []).append((row["model"], found["ratio"]))
            if found["bar"]:
                goals[key] = found["bar"][0]
    values = [1.0, *goals.values(), *(r for dots in groups.values() for _, r in dots)]
    low, high = math.floor(3 * math.log10(min(values))) / 3, math.ceil(3 * math.log10(max(values) * 1.05)) / 3

    def x(ratio: float) -> float:
        return _LEFT + (math.log10(ratio) - low) / (high - low) * (_WIDTH - _LEFT - _RIGHT)

    height = _TOP + _LINE * len(groups) + 30
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH} {height}" width="{_WIDTH}" height="{height}" role="img" '
        f'aria-label="Time of phipsi over time of other programs"><style>{_STYLE}</style>',
        f'<text x="{_LEFT}" y="16">time(phipsi) / time(other), a dot per model; ticks: goals</text>',
    ]
    bottom = _TOP + _LINE * len(groups)
    for tick in (k * 10.0**e for e in range(-3, 3) for k in (1, 2, 5)):
        if low <= math.log10(tick) <= high:
            kind = "one" if tick == 1 else "g"
            parts.append(f'<path class="{kind}" d="M{x(tick):.1f} {_TOP - 8}V{bottom}"/>')
            parts.append(f'<text x="{x(tick):.1f}" y="{bottom + 18}" text-anchor="middle">{tick:g}</text>')
    for i, ((operation, program), dots) in enumerate(groups.items()):
        y = _TOP + _LINE * i + _LINE / 2
        label = f"{operation.replace('_', ' ')} · {program}"
        parts.append(f'<text x="{_LEFT - 12}" y="{y + 4:.1f}" text-anchor="end">{escape(label)}</text>')
        if (operation, program) in goals:
            parts.append(f'<path class="bar" d="M{x(goals[operation, program]):.1f} {y - 9:.1f}v18"/>')
        for model, ratio in dots:
            title = f"<title>{escape(model)}: {ratio:.3g}</title>"
            parts.append(f'<circle class="d" cx="{x(ratio):.1f}" cy="{y:.1f}" r="4.5">{title}</circle>')
    return "".join(parts) + "</svg>\n"


def write(run: dict, docs: Path) -> None:
    """Writes both into the documentation's source folder."""
    (docs / f"{name(run)}.md").write_text(text(run))
    (docs / "images" / f"{name(run)}.svg").write_text(chart(run))
