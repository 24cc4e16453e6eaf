"""Builds the timers from public packages into a folder that is kept: a timer is rebuilt when its sources or its command change."""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
import sysconfig
from dataclasses import dataclass, field
from importlib import metadata
from pathlib import Path

HERE = Path(__file__).parent
ROOT = HERE.parents[1]

#: The compiler that Pinocchio's times count with; others may be slower by a factor of two.
COUNTS = "clang++-19"

_PINOCCHIO = (
    "-O3 -march=native -DNDEBUG -std=c++17 -DBOOST_MPL_LIMIT_LIST_SIZE=30 -DBOOST_MPL_LIMIT_VECTOR_SIZE=30 "
    "-DBOOST_MPL_CFG_NO_PREPROCESSED_HEADERS -DBOOST_FUSION_INVOKE_MAX_ARITY=12"
).split()

#: Pinocchio's timers: one translation unit a family, since each takes a minute to compile.
FAMILIES = {
    "forward": ("forward_dynamics",),
    "inverse": ("inverse_dynamics", "mass_matrix", "mass_matrix_inverse", "jacobian", "centroidal"),
    "loops": ("closed_forward_dynamics",),
    "derivatives": ("inverse_dynamics_derivatives", "forward_dynamics_derivatives"),
}


class CannotBuild(Exception):
    """Why a program is left out."""


@dataclass
class Built:
    """A timer: its command, and what the report says about it."""

    command: list[str]
    version: str
    compiler: str
    flags: str
    remarks: list[str] = field(default_factory=list)


def _site(*parts: str) -> Path | None:
    """A path below one of the folders that packages are installed in."""
    folders = [*sys.path, sysconfig.get_path("purelib")]
    return next((p for f in folders if f and (p := Path(f).joinpath(*parts)).exists()), None)


def _version_of(program: str) -> str:
    return subprocess.run([program, "--version"], capture_output=True, text=True, check=True).stdout.splitlines()[0]


def compiler() -> tuple[str, bool]:
    """The C++ compiler, and whether Pinocchio's times count with it."""
    for name in (COUNTS, "clang++", "g++", "c++"):
        if shutil.which(name):
            newer = name == "clang++" and int(_version_of(name).split("version ")[-1].split(".")[0]) >= 19
            return name, name == COUNTS or newer
    raise CannotBuild(f"there is no C++ compiler (wanted: {COUNTS})")


def _run(command: list[str], what: str) -> None:
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, preexec_fn=lambda: os.nice(5))
    if done.returncode:
        lines = done.stderr.strip().splitlines()
        first = next((line for line in lines if "error" in line), lines[0] if lines else "no message")
        raise CannotBuild(f"{what} does not compile: {first}")


def cached(target: Path, sources: list[Path], command: list[str], what: str) -> None:
    """Runs a compilation unless its result is there, from the same sources by the same command."""
    key = hashlib.sha256("\0".join(command).encode())
    for source in sources:
        key.update(source.read_bytes())
    stamp = target.with_suffix(".key")
    if target.exists() and stamp.exists() and stamp.read_text() == key.hexdigest():
        return
    print(f"building {what}", file=sys.stderr, flush=True)
    target.parent.mkdir(parents=True, exist_ok=True)
    _run(command, what)
    stamp.write_text(key.hexdigest())


def pinocchio(cache: Path, family: str) -> Built:
    """Pinocchio from the headers of the wheels `pin` and `cmeel-eigen`."""
    headers = _site("cmeel.prefix", "include", "pinocchio", "algorithm")
    eigen = _site("cmeel.prefix", "include", "eigen3")
    if not headers or not eigen:
        missing = "pin" if not headers else "cmeel-eigen"
        raise CannotBuild(f"the headers of the package {missing} are not there (pip install {missing})")
    name, counts = compiler()
    target, source = cache / f"pinocchio_{family}", HERE / f"pinocchio_{family}.cpp"
    include = ["-isystem", str(headers.parents[1]), "-isystem", str(eigen)]
    command = [name, *_PINOCCHIO, *include, str(source), "-o", str(target)]
    version = metadata.version("pin")
    cached(target, [source, HERE / "pinocchio.hpp", HERE / "protocol.h"], command, f"Pinocchio {version}, {family}")
    remarks = [] if counts else [f"Pinocchio compiled by {name}, not by clang 19: its times do not count"]
    return Built([str(target)], version, _version_of(name), " ".join(_PINOCCHIO[:3]), remarks)


def mujoco(cache: Path) -> Built:
    """MuJoCo from its wheel's library."""
    folder = _site("mujoco", "include")
    libraries = sorted(folder.parent.glob("libmujoco.so.*")) if folder else []
    if not libraries:
        raise CannotBuild("the library of the package mujoco is not there (pip install mujoco)")
    name, _ = compiler()
    target, source, library = cache / "mujoco", HERE / "mujoco.c", str(libraries[0])
    flags = ["-O3", "-march=native", "-DNDEBUG"]
    command = [name, "-x", "c", *flags, "-I", str(folder), str(source), "-x", "none", library]
    command += [f"-Wl,-rpath,{folder.parent}", "-lm", "-o", str(target)]
    cached(target, [source, HERE / "protocol.h"], command, "MuJoCo's timer")
    return Built([str(target)], metadata.version("mujoco"), "the wheel's library", "as published")


def _cargo(arguments: list[str], what: str) -> None:
    if not shutil.which("cargo"):
        raise CannotBuild("cargo is not installed")
    print(f"building {what}", file=sys.stderr, flush=True)
    _run(["cargo", *arguments], what)


def dynibo(cache: Path) -> Built:
    """dynibo from crates.io."""
    manifest = HERE / "dynibo" / "Cargo.toml"
    folder = cache / "dynibo"
    _cargo(
        ["build", "--release", "--locked", "--manifest-path", str(manifest), "--target-dir", str(folder)], "dynibo's timer"
    )
    version = next(line for line in manifest.read_text().splitlines() if line.startswith("dynibo =")).split('"')[1]
    flags = "release, lto=fat, codegen-units=1"
    return Built([str(folder / "release" / "dynibo-speed")], version.lstrip("="), _version_of("rustc"), flags)


def simbody(cache: Path) -> Built:
    """Simbody from the system's package. Its headers and library must be compiled alike: not with NDEBUG on Debian."""
    folder = next((p for p in (Path("/usr/include/simbody"), Path("/usr/local/include/simbody")) if p.exists()), None)
    if not folder:
        raise CannotBuild("it is not installed (Debian: libsimbody-dev)")
    name, _ = compiler()
    target, source = cache / "simbody", HERE / "simbody.cpp"
    libraries = ["-lSimTKsimbody", "-lSimTKmath", "-lSimTKcommon"]
    command = [name, "-O3", "-std=c++17", "-w", "-I", str(folder), str(source), "-o", str(target), *libraries]
    cached(target, [source, HERE / "protocol.h"], command, "Simbody's timer")
    version = "of the system"
    if shutil.which("dpkg-query"):
        ask = ["dpkg-query", "-Wf", "${Version}", "libsimbody-dev"]
        version = subprocess.run(ask, capture_output=True, text=True).stdout or version
    return Built([str(target)], version, "the system's library", "as published")


def phipsi(cache: Path) -> Built:
    """This workspace's example, as a published build would be: the instruction level is chosen at run time."""
    target = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
    features = ["--no-default-features", "--features", "formats,closure,parallel"]
    _cargo(["build", "--release", "-p", "phipsi", "--example", "speed", *features, "--target-dir", str(target)], "phipsi")
    commit = subprocess.run(["git", "describe", "--always", "--dirty"], cwd=ROOT, capture_output=True, text=True).stdout
    version = f"0.1.0 {commit.strip()}".strip()
    return Built([str(target / "release" / "examples" / "speed")], version, _version_of("rustc"), "release")
