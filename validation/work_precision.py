"""Error against run time on published problems: ``python -m validation.work_precision [--phipsi PATH] [--only NAME] [--page]``.

phipsi (`phipsi run`), Simbody (Runge–Kutta–Merson and CPODES' BDF, C++) and MuJoCo (RK4 and implicitfast, steps in C) solve the scenes of
`examples/benchmarks` at several tolerances or steps, one after the other in one run of this script. The judge is each scene's
`[reference]`: closed forms and published values. ``--page`` writes docs/src/work_precision.md and its chart.
"""

from __future__ import annotations

import argparse
import json
import math
import platform
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
from dataclasses import dataclass
from pathlib import Path

import mujoco as mj
import numpy as np

# Warnings are read from the data; MuJoCo would write them into a file of the working directory.
mj.set_mju_user_warning(lambda _: None)

ROOT = Path(__file__).resolve().parent.parent
SCENES = ROOT / "examples" / "benchmarks"
NAMES = (
    "pendulum", "double_pendulum", "chain10", "torque_free", "light_cart_pole", "flyball", "andrews", "car_axis", "bricard", "n_four_bar"
)
TOLERANCES = [10.0**-k for k in (3, 5, 7, 8, 9, 10, 11, 12, 13)]

#: Runs of one point: the shortest counts, which other work on the machine changes least.
REPETITIONS, LONG_S = 5, 0.5

#: Time for all accuracies of one of Simbody's methods on a scene: what is done until then counts.
SIMBODY_S = 25


@dataclass
class Point:
    """One run: what was asked for, largest relative error of the outputs, wall time, steps."""

    asked: str
    error: float
    wall_s: float
    steps: int


class Scene:
    """A benchmark's file, in the parts that other programs can be given."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.path = SCENES / f"{name}.toml"
        self.data = tomllib.loads(self.path.read_text())
        known = self.data["reference"]
        self.outputs = {k: o for k, o in self.data["outputs"].items() if k in known and "energy" not in o}
        self.known = [float(known[k]) for k in self.outputs]
        self.child = {j["name"]: j["child"] for j in self.data["joint"]}

    def error(self, found: list[float]) -> float:
        """As `reference_error` of phipsi: the largest relative error."""
        if not all(map(math.isfinite, found)):
            return math.inf
        return max(abs(x - y) / (abs(y) or 1.0) for x, y in zip(found, self.known))

    def joints(self, output: dict) -> list[str]:
        return output.get("joints") or [output["joint"]]


def rotation(rpy: list[float]) -> np.ndarray:
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy), np.sin(rpy)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def _numbers(*values) -> str:
    return " ".join(repr(float(x)) for value in values for x in np.asarray(value, dtype=float).ravel())


def _pose(given: dict | None) -> tuple[np.ndarray, np.ndarray]:
    given = given or {}
    return rotation(given.get("rpy", [0, 0, 0])), np.array(given.get("xyz", [0, 0, 0]), dtype=float)


def _inertia(inertial: dict) -> tuple[float, np.ndarray, list[float]]:
    """Mass, centre, moments xx yy zz xy xz yz about it."""
    given = inertial.get("inertia", {})
    return (
        float(inertial["mass"]),
        _pose(inertial.get("origin"))[1],
        [float(given.get(k, 0.0)) for k in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")],
    )


def _start(scene: Scene):
    """Given coordinates and rates: (letter, joint, index, value)."""
    for letter in "qv":
        for joint, value in scene.data.get("initial", {}).get(letter, {}).items():
            for i, x in enumerate(value if isinstance(value, list) else [value]):
                yield letter, joint, i, float(x)


def flat(scene: Scene) -> str:
    """The scene for work_precision.cpp."""
    lines = [f"gravity {_numbers(scene.data['model']['gravity'])}"]
    inertials = {b["name"]: b["inertial"] for b in scene.data["body"]}
    for joint in scene.data["joint"]:
        mass, center, moments = _inertia(inertials[joint["child"]])
        place = _numbers(joint.get("axis", [1, 0, 0]), *_pose(joint.get("origin")))
        lines.append(f"body {joint['child']} {joint['parent']} {joint['type']} {place} {_numbers(mass, center, moments)}")
    for c in scene.data.get("closure", []):
        poses = [f"{c[f'body_{x}']} {_numbers(*_pose(c.get(f'pose_{x}')))}" for x in "ab"]
        lines.append(f"closure {c['kind']} {poses[0]} {poses[1]} {c.get('length', 0)}")
    for f in scene.data.get("force", []):
        if f["kind"] == "torque":
            lines.append(f"torque {scene.child[f['joint']]} {f['value']}")
            continue
        ends = " ".join(f"{f[f'body_{x}']} {_numbers(f.get(f'point_{x}', [0, 0, 0]))}" for x in "ab")
        strength = f["stiffness"] if f["kind"] == "spring" else f["damping"]
        lines.append(f"{f['kind']} {ends} {strength} {f.get('rest_length', 0)}")
    lines += [f"road {scene.child[m['joint']]}" for m in scene.data.get("motion", [])]
    lines += [f"{letter} {scene.child[joint]} {i} {x!r}" for letter, joint, i, x in _start(scene) if i < 3]
    lines.append(f"end {scene.data['integrator']['t_end']}")
    for output in scene.outputs.values():
        if "body" in output:
            point = _numbers(output.get("point", [0, 0, 0]))
            lines.append(f"point {output['body']} {point} {'xyz'.index(output['axis'])}")
        elif "component" in output:
            lines.append(f"rate {scene.child[output['joint']]} {output['component']}")
        else:
            children = [scene.child[j] for j in scene.joints(output)]
            lines.append(f"coordinates {output.get('of', 'q')} {len(children)} {' '.join(children)}")
    return "\n".join(lines) + "\n"


def by_simbody(scene: Scene, program: Path, method: str) -> list[Point]:
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "scene.txt"
        file.write_text(flat(scene))
        command = [str(program), str(file), method, *(f"{t:g}" for t in TOLERANCES if t > 5e-13)]
        try:
            done = subprocess.run(command, capture_output=True, text=True, timeout=SIMBODY_S, check=False)
            text = done.stdout
        except subprocess.TimeoutExpired as late:
            text = (late.stdout or b"").decode()
    points = []
    for line in text.splitlines():
        asked, wall, steps, *found = line.split()
        if len(found) == len(scene.known):
            points.append(Point(asked, scene.error([float(x) for x in found]), float(wall), int(steps)))
    return points


def mujoco_model(scene: Scene, integrator: str) -> mj.MjModel:
    """The scene in MuJoCo, its closures as its equality constraints."""
    spec = mj.MjSpec()
    spec.compiler.inertiafromgeom = mj.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE
    spec.option.gravity = scene.data["model"]["gravity"]
    spec.option.integrator = getattr(mj.mjtIntegrator, f"mjINT_{integrator}")
    bodies = {"world": spec.worldbody}
    inertials = {b["name"]: b["inertial"] for b in scene.data["body"]}
    for joint in scene.data["joint"]:
        turn, place = _pose(joint.get("origin"))
        quaternion = np.zeros(4)
        mj.mju_mat2Quat(quaternion, turn.ravel())
        body = bodies[joint["parent"]].add_body(name=joint["child"], pos=place, quat=quaternion)
        bodies[joint["child"]] = body
        mass, center, moments = _inertia(inertials[joint["child"]])
        body.mass, body.ipos, body.explicitinertial = mass, center, True
        # MuJoCo refuses points: the least moments that it takes.
        body.inertia = [max(x, 1e-14) for x in moments[:3]]
        axis = joint.get("axis", [1, 0, 0])
        kinds = {"prismatic": mj.mjtJoint.mjJNT_SLIDE, "floating": mj.mjtJoint.mjJNT_BALL}
        if joint["type"] == "translation":
            raise ValueError("translations in three directions are left out")
        body.add_joint(name=joint["name"], type=kinds.get(joint["type"], mj.mjtJoint.mjJNT_HINGE), axis=axis)
    for c in scene.data.get("closure", []):
        if c["kind"] not in ("revolute", "spherical"):
            raise ValueError(f"MuJoCo has no closure {c['kind']} between points of bodies")
        turn, place = _pose(c.get("pose_a"))
        # A hinge: two points of its axis.
        for at in [place, place + turn[:, 2]] if c["kind"] == "revolute" else [place]:
            connect = spec.add_equality(type=mj.mjtEq.mjEQ_CONNECT, objtype=mj.mjtObj.mjOBJ_BODY)
            connect.name1, connect.name2 = c["body_a"], c["body_b"]
            connect.data[:3] = at
            connect.solref[0] = 0.0
    for i, f in enumerate(scene.data.get("force", [])):
        if f["kind"] == "torque":
            continue
        tendon = spec.add_tendon(name=f"line{i}")
        for x in "ab":
            site = bodies[f[f"body_{x}"]].add_site(name=f"site{i}{x}", pos=f.get(f"point_{x}", [0, 0, 0]))
            tendon.wrap_site(site.name)
        tendon.stiffness = [f.get("stiffness", 0.0), 0, 0]
        tendon.damping = [f.get("damping", 0.0), 0, 0]
        tendon.springlength = [f.get("rest_length", 0.0)] * 2
    return spec.compile()


def by_mujoco(scene: Scene, integrator: str) -> list[Point]:
    if scene.data.get("motion") or scene.data.get("initial", {}).get("assemble"):
        raise ValueError("the start or a motion cannot be given to MuJoCo as the scene has it")
    t_end, points = float(scene.data["integrator"]["t_end"]), []
    for count in [round(100 * 2**k) for k in range(0, 14)]:
        model = mujoco_model(scene, integrator)
        model.opt.timestep = t_end / count
        for i in range(model.neq):
            # The stiffest closure that MuJoCo holds stable: two steps.
            model.eq_solref[i] = [2 * model.opt.timestep, 1.0]
            model.eq_solimp[i] = [0.9999, 0.9999, 1e-6, 0.5, 2]
        times: list[float] = []
        while len(times) < REPETITIONS and (not times or times[0] < LONG_S):
            data = _started(scene, model)
            begun = time.perf_counter()
            mj.mj_step(model, data, nstep=count)
            times.append(time.perf_counter() - begun)
        wall = min(times)
        mj.mj_forward(model, data)
        found = [_measured(scene, model, data, o) for o in scene.outputs.values()]
        error = math.inf if any(w.number for w in data.warning) else scene.error(found)
        points.append(Point(f"step {t_end / count:.2g} s", error, wall, count))
        if wall > 2:
            break
    return points


def _started(scene: Scene, model: mj.MjModel) -> mj.MjData:
    data = mj.MjData(model)
    for letter, joint, i, x in _start(scene):
        at = model.joint(joint)
        if letter == "q":
            data.qpos[at.qposadr[0] + i] = x
        elif i < 3:
            data.qvel[at.dofadr[0] + i] = x
    for f in scene.data.get("force", []):
        if f["kind"] == "torque":
            data.qfrc_applied[model.joint(f["joint"]).dofadr[0]] = f["value"]
    return data


def _measured(scene: Scene, model: mj.MjModel, data: mj.MjData, output: dict) -> float:
    if "body" in output:
        body = data.body(output["body"])
        point = body.xpos + body.xmat.reshape(3, 3) @ np.array(output.get("point", [0, 0, 0]), dtype=float)
        return float(point["xyz".index(output["axis"])])
    if "component" in output:
        return float(data.qvel[model.joint(output["joint"]).dofadr[0] + output["component"]])
    joints = [model.joint(j) for j in scene.joints(output)]
    return float(sum(data.qvel[j.dofadr[0]] if output.get("of") == "v" else data.qpos[j.qposadr[0]] for j in joints))


def by_phipsi(scene: Scene, command: str, method: str) -> list[Point]:
    points = []
    for tolerance in TOLERANCES:
        with tempfile.TemporaryDirectory() as folder:
            changes = [f"integrator.method={method}", f"integrator.rtol={tolerance:g}", f"integrator.atol={tolerance:g}"]
            changes += ["integrator.estimate=false", f"record.every={scene.data['integrator']['t_end']}"]
            arguments = [command, "run", str(scene.path), "--out", f"{folder}/run", "--json", "--quiet"]
            times, value = [], None
            while len(times) < REPETITIONS and (not times or times[0] < LONG_S):
                shutil.rmtree(f"{folder}/run", ignore_errors=True)
                done = subprocess.run(
                    arguments + [x for c in changes for x in ("--set", c)], capture_output=True, text=True, timeout=300, check=False
                )
                value = json.loads(done.stdout) if done.returncode == 0 else None
                if value is None:
                    break
                times.append(value["wall_s"])
        if value is not None:
            found = [float(value["outputs"][k]) for k in scene.outputs]
            points.append(Point(f"{tolerance:g}", scene.error(found), min(times), value["steps"]))
    return points


def front(points: list[Point]) -> list[Point]:
    """Runs that no other beats in both error and time, from large errors to small ones."""
    best: list[Point] = []
    for p in sorted((p for p in points if math.isfinite(p.error)), key=lambda p: (p.wall_s, p.error)):
        if not best or p.error < best[-1].error:
            best.append(p)
    return best


def time_at(points: list[Point], error: float) -> float | None:
    """Wall time of the cheapest run of at most that error."""
    good = [p.wall_s for p in points if p.error <= error]
    return min(good) if good else None


def factor(ours: list[Point], theirs: list[Point]) -> tuple[float, float, float] | None:
    """Median, least and largest of their time over ours at their errors below 0.1, on their front."""
    ratios = []
    for p in front(theirs):
        own = time_at(ours, p.error)
        if p.error < 0.1 and own:
            ratios.append(p.wall_s / own)
    return (float(np.median(ratios)), min(ratios), max(ratios)) if ratios else None


def build_simbody() -> Path | None:
    compiler = shutil.which("clang++-19") or shutil.which("g++")
    source, target = ROOT / "validation" / "work_precision.cpp", ROOT / "target" / "validation" / "work_precision"
    if not compiler or not Path("/usr/include/simbody").exists():
        return None
    if not target.exists() or target.stat().st_mtime < source.stat().st_mtime:
        target.parent.mkdir(parents=True, exist_ok=True)
        libraries = ["-lSimTKsimbody", "-lSimTKmath", "-lSimTKcommon"]
        command = [compiler, "-O2", "-std=c++17", "-w", "-I/usr/include/simbody", str(source), "-o", str(target), *libraries]
        subprocess.run(command, check=True)
    return target


def measure(names: list[str], command: str) -> dict[str, dict[str, list[Point]]]:
    simbody, result = build_simbody(), {}
    for name in names:
        scene, found = Scene(name), {}
        methods = ["dop853", "rodas5p"] if name == "flyball" else ["dop853"]
        for method in methods:
            found[f"phipsi {method}"] = by_phipsi(scene, command, method)
        if simbody:
            for method in ("Merson", "BDF"):
                found[f"Simbody {method}"] = by_simbody(scene, simbody, method)
        for integrator in ("RK4", "IMPLICITFAST"):
            try:
                found[f"MuJoCo {integrator}"] = by_mujoco(scene, integrator)
            except ValueError as why:
                print(f"{name}, MuJoCo: {why}")
                break
        result[name] = {program: points for program, points in found.items() if points}
        for program, points in result[name].items():
            print(name, program, [(p.asked, f"{p.error:.1e}", f"{1e3 * p.wall_s:.2f} ms") for p in points], flush=True)
    return result


def _of(found: dict[str, list[Point]], program: str) -> list[Point]:
    return [p for name, points in found.items() if name.startswith(program) for p in points]


def table(result: dict[str, dict[str, list[Point]]]) -> str:
    lines = [
        "| scene | smallest error: phipsi | Simbody | MuJoCo | phipsi faster than Simbody by | than MuJoCo by |",
        "|---|---|---|---|---|---|",
    ]
    slower = []
    for name, found in result.items():
        cells = []
        for program in ("phipsi", "Simbody", "MuJoCo"):
            errors = [p.error for p in _of(found, program) if math.isfinite(p.error)]
            cells.append(f"{min(errors):.0e}" if errors else "–")
        for program in ("Simbody", "MuJoCo"):
            ratio = factor(_of(found, "phipsi"), _of(found, program))
            cells.append("–" if ratio is None else f"{ratio[0]:.2g} ({ratio[1]:.2g} … {ratio[2]:.2g})")
            if ratio and ratio[1] < 2:
                slower.append(f"{name} ({program}: {ratio[1]:.2g} at the least)")
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    text = "\n".join(lines) + "\n"
    if slower:
        text += "\nLess than twice as fast at some errors: " + ", ".join(slower) + ".\n"
    return text


def chart(result: dict[str, dict[str, list[Point]]], target: Path) -> None:
    import matplotlib

    matplotlib.use("svg")
    matplotlib.rcParams["svg.hashsalt"] = "work-precision"
    from matplotlib import pyplot

    columns = 3
    rows = math.ceil(len(result) / columns)
    figure, axes = pyplot.subplots(rows, columns, figsize=(11, 2.9 * rows), squeeze=False)
    colors = {"phipsi": "#1d6fb8", "Simbody": "#c2410c", "MuJoCo": "#5b7f2b"}
    for at, (name, found) in zip(axes.ravel(), result.items()):
        for program, points in found.items():
            style = "-o" if program.split()[1] in ("dop853", "Merson", "RK4") else "--s"
            some = [p for p in points if math.isfinite(p.error) and p.error > 0]
            at.loglog([p.error for p in some], [p.wall_s for p in some], style, ms=3, lw=1, color=colors[program.split()[0]], label=program)
        at.set_title(name, fontsize=9)
        at.invert_xaxis()
        at.tick_params(labelsize=7)
        at.grid(alpha=0.3)
        at.legend(fontsize=6)
    for at in axes.ravel()[len(result) :]:
        at.set_axis_off()
    figure.supxlabel("largest relative error of the outputs", fontsize=9)
    figure.supylabel("wall time, s", fontsize=9)
    figure.tight_layout()
    figure.savefig(target, metadata={"Date": None})


_HEAD = """# Work and precision

The published problems of `examples/benchmarks` in phipsi, Simbody (Debian's library, its internal checks compiled in) and MuJoCo, one after the other on one machine. Written by
`python -m validation.work_precision --page`.

![Wall time against error](images/work_precision.svg)

- The error is the largest relative error of the scene's outputs at its end, against closed forms and published values.
- phipsi: DOP853 at tolerances of 1e-3 to 1e-13, for the stiff flyball governor Rodas5P too; `phipsi run` with two records and without its estimate of the error; wall time of the integration.
- Simbody: `RungeKuttaMersonIntegrator` and CPODES (BDF) at accuracies of 1e-3 to 1e-12, C++, `-O2`; closures as its constraints, projected at every step.
- MuJoCo: RK4 and implicitfast at fixed steps, `mj_step` of all steps in one call; closures as equality constraints, which are springs there: as stiff as two steps allow. Point masses have moments of 1e-14 kg·m². Scenes whose closures,
  motions or starts it has not are left out.
- Times: the shortest of five runs below half a second. MuJoCo's steps are halved until a run takes two seconds; Simbody has 25 s for all accuracies of a method. *Faster by*: time of the other program over the shortest time of phipsi at no larger error, at every run on the other's front whose error is below 0.1: median (least … largest).

"""


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--phipsi", default=str(ROOT / "target" / "release" / "phipsi"), help="the command")
    parser.add_argument("--only", choices=NAMES, help="one scene")
    parser.add_argument("--page", action="store_true", help="write the documentation's page and chart")
    given = parser.parse_args(arguments)
    result = measure([given.only] if given.only else list(NAMES), given.phipsi)
    text = table(result)
    print(text)
    if given.page:
        docs = ROOT / "docs" / "src"
        machine = f"{time.strftime('%Y-%m-%d')}; {platform.machine()}, {platform.processor() or platform.system()}; MuJoCo {mj.__version__}.\n\n"
        (docs / "work_precision.md").write_text(_HEAD + machine + text)
        chart(result, docs / "images" / "work_precision.svg")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
