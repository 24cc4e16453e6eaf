"""What each feature of the crate `phipsi` costs to build: processor seconds of a clean debug build.

    python3 tools/build_times.py                  prints the table
    python3 tools/build_times.py --write          puts it into docs/src/left_out.md
    python3 tools/build_times.py none motion      these features only

Processor time of cargo and all its compilers, not wall time: other work on the machine changes it less. Built as in a project that
depends on phipsi, without optimisation: that of this workspace's own debug builds does not reach it. The build without features is
made once, in a folder of its own; each feature is then built on top of a copy of it.
"""

import os
import pathlib
import resource
import shutil
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parent.parent
PAGE = ROOT / "docs" / "src" / "left_out.md"
BEGIN, END = "<!-- build times: begin -->\n", "<!-- build times: end -->"
FEATURES = ["none", "closure", "hybrid", "freeflight", "formats", "motion", "molecule", "simulate"]


def build(target: pathlib.Path, feature: str) -> float:
    """Processor seconds of a build into `target`."""
    command = ["cargo", "build", "-q", "-p", "phipsi", "--no-default-features", "--config", "profile.dev.opt-level=0"]
    if feature != "none":
        command += ["--features", feature]
    environment = {**os.environ, "CARGO_TARGET_DIR": str(target), "CARGO_INCREMENTAL": "0"}

    def spent() -> float:
        usage = resource.getrusage(resource.RUSAGE_CHILDREN)
        return usage.ru_utime + usage.ru_stime

    begun = spent()
    subprocess.run(command, cwd=ROOT, env=environment, check=True)
    return spent() - begun


def machine() -> str:
    names = [line.split(":")[1].strip() for line in open("/proc/cpuinfo") if line.startswith("model name")]
    rustc = subprocess.run(["rustc", "--version"], capture_output=True, text=True, check=True).stdout.split()[1]
    load = os.getloadavg()[0]
    return f"{names[0] if names else 'unknown processor'}, {len(names)} cores, rustc {rustc}, load {load:.0f}"


def main() -> None:
    asked = [a for a in sys.argv[1:] if not a.startswith("-")]
    if unknown := [a for a in asked if a not in FEATURES]:
        sys.exit(f"unknown feature {unknown[0]}; known: {', '.join(FEATURES)}")
    lines = ["| feature | processor s of a clean debug build | of these on top of `none` |", "|---|---|---|"]
    with tempfile.TemporaryDirectory() as scratch:
        base = pathlib.Path(scratch) / "none"
        alone = build(base, "none")
        for feature in asked or FEATURES:
            more = 0.0
            if feature != "none":
                copy = pathlib.Path(scratch) / feature
                shutil.copytree(base, copy)
                more = build(copy, feature)
                shutil.rmtree(copy)
            lines.append(f"| {feature} | {alone + more:.0f} | {more:.0f} |")
            print(lines[-1], flush=True)
    text = "\n".join([f"On {machine()}:", "", *lines])
    print(f"\n{text}")
    if "--write" in sys.argv:
        page = PAGE.read_text()
        before, rest = page.split(BEGIN)
        PAGE.write_text(before + BEGIN + "\n" + text + "\n\n" + END + rest.split(END)[1])


if __name__ == "__main__":
    main()
