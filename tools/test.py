"""The one test command: Rust and Python tests in a virtual environment of their own.

    python3 tools/test.py           everything
    python3 tools/test.py rust      formatting, lints, Rust tests, documentation
    python3 tools/test.py python    the Python package and its tests

Needs Rust (rustup.rs) and Python 3.10 or newer with venv; everything else is installed into .venv.
"""

import os
import pathlib
import subprocess
import sys
import time

ROOT = pathlib.Path(__file__).resolve().parent.parent
VENV = ROOT / ".venv"
BIN = VENV / ("Scripts" if os.name == "nt" else "bin")


def run(*command, env=None):
    print("\n$", " ".join(str(c) for c in command), flush=True)
    begun = time.monotonic()
    status = subprocess.run([str(c) for c in command], cwd=ROOT, env=env).returncode
    print(f"[{time.monotonic() - begun:.0f} s]", flush=True)
    if status != 0:
        sys.exit(status)


def rust():
    # On a fresh clone nothing is built twice: what incremental builds write would only cost time.
    if os.environ.get("CI"):
        os.environ["CARGO_INCREMENTAL"] = "0"
    run("cargo", "fmt", "--all", "--check")
    run("cargo", "clippy", "--workspace", "--all-targets", "--", "-D", "warnings")
    # Examples are checked above; compiled, they would hold every kernel once more.
    run("cargo", "test", "--workspace", "--tests")
    run("cargo", "test", "--workspace", "--doc")
    run("cargo", "doc", "--workspace", "--no-deps", env={**os.environ, "RUSTDOCFLAGS": "-D warnings"})
    # Tree dynamics alone must build: a user of the kernels pulls in nothing else.
    run("cargo", "check", "-p", "phipsi", "--no-default-features")


def python():
    if not (BIN / "python").exists() and not (BIN / "python.exe").exists():
        run(sys.executable, "-m", "venv", VENV)
    pip = [BIN / "python", "-m", "pip", "--disable-pip-version-check", "install", "--quiet"]
    run(*pip, "-r", "validation/requirements.txt")
    # With CI set, from what the Rust tests have compiled, overflow checks included, instead of ten minutes more for a release build.
    profile = ["--config-settings=build-args=--profile dev"] if os.environ.get("CI") else []
    run(*pip, *profile, "./crates/python")
    run(BIN / "python", "-m", "pytest", "validation")


def main(arguments):
    parts = {"rust": rust, "python": python}
    unknown = [a for a in arguments if a not in parts]
    if unknown:
        sys.exit(f"unknown part {unknown[0]!r}; there are: {', '.join(parts)}")
    for part in arguments or parts:
        parts[part]()


if __name__ == "__main__":
    main(sys.argv[1:])
