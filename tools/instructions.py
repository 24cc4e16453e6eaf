"""Instructions that a call of a kernel takes, counted by callgrind: unlike times they do not depend on what else a machine does.

    python3 tools/instructions.py                                    a table
    python3 tools/instructions.py --write tools/instructions.json    store the counts
    python3 tools/instructions.py --check tools/instructions.json    compare; more than 3 % more of any: exit 1

Needs Rust and valgrind on x86-64. Valgrind has no AVX-512, so that the level AVX2 is counted. Every kernel runs twice, with few
and with many calls; the difference leaves out what is done once. Counts change with the compiler: after a new one, store again.
"""

import argparse
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

ROOT = pathlib.Path(__file__).resolve().parent.parent
ENVIRONMENT = {**os.environ, "PHIPSI_SIMD": "avx2"}
LEVEL = "avx2"
GROWTH = 0.03
ROUNDS = 4


def fail(message):
    sys.exit(f"instructions: {message}")


def build():
    command = ["cargo", "build", "--release", "-p", "phipsi-recursion", "--example", "instructions", "--message-format", "json"]
    done = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, text=True)
    if done.returncode != 0:
        fail(f"`{' '.join(command)}` failed")
    messages = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]
    return next(m["executable"] for m in reversed(messages) if m.get("executable"))


def facts(program):
    """What the example says of itself: names, numbers of states, compiler."""
    text = subprocess.run([program], env=ENVIRONMENT, stdout=subprocess.PIPE, text=True, check=True).stdout
    return dict(line.split(" ", 1) for line in text.splitlines())


def instructions(program, *arguments):
    """All instructions of one run."""
    tool = ["valgrind", "--tool=callgrind", "--callgrind-out-file=/dev/null"]
    done = subprocess.run([*tool, program, *arguments], env=ENVIRONMENT, stderr=subprocess.PIPE, text=True)
    found = re.search(r"Collected\s*:\s*(\d+)", done.stderr)
    if done.returncode != 0 or not found:
        fail(f"{' '.join(arguments)} did not run under callgrind:\n{done.stderr}")
    return int(found.group(1))


def per_state(program, about, kernel, model):
    """Instructions of a call, on average over the states; of a batch, for each of its states."""
    batch = kernel.endswith("_batch")
    turn = 1 if batch else int(about["states"])
    few, many = turn, turn * (1 + ROUNDS)
    difference = instructions(program, kernel, model, str(many)) - instructions(program, kernel, model, str(few))
    return round(difference / (many - few) / (int(about["batch"]) if batch else 1))


def count(program, about):
    models = about["models"].split()
    pairs = [(kernel, model) for kernel in about["kernels"].split() for model in models]
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        counts = pool.map(lambda pair: per_state(program, about, *pair), pairs)
    table = {}
    for (kernel, model), number in zip(pairs, counts):
        table.setdefault(kernel, {})[model] = number
    return {"compiler": about["compiler"], "level": about["level"], "instructions": table}


def show(found):
    models = list(next(iter(found["instructions"].values())))
    print(f"instructions a state, {found['level']}, {found['compiler']}\n")
    print(f"{'':32}" + "".join(f"{model:>14}" for model in models))
    for kernel, row in found["instructions"].items():
        print(f"{kernel:32}" + "".join(f"{row[model]:>14,}" for model in models))


def grown(stored, found):
    """Lines on what takes more than before, or is not there any more."""
    if stored["level"] != found["level"]:
        fail(f"stored for the level {stored['level']}, counted at {found['level']}")
    lines = []
    for kernel, row in stored["instructions"].items():
        for model, before in row.items():
            now = found["instructions"].get(kernel, {}).get(model)
            if now is None:
                lines.append(f"{kernel} {model}: not counted any more")
            elif now > before * (1 + GROWTH):
                lines.append(f"{kernel} {model}: {before:,} → {now:,} (+{100 * (now / before - 1):.1f} %)")
    return lines


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--check", metavar="FILE", type=pathlib.Path)
    what.add_argument("--write", metavar="FILE", type=pathlib.Path)
    options = parser.parse_args()
    if not shutil.which("valgrind"):
        fail("valgrind is not installed")
    stored = json.loads(options.check.read_text()) if options.check else None
    program = build()
    about = facts(program)
    if about["level"] != LEVEL:
        fail(f"this processor runs the level {about['level']}, not {LEVEL}")
    found = count(program, about)
    show(found)
    if options.write:
        options.write.write_text(json.dumps(found, indent=1) + "\n")
    if stored:
        if stored["compiler"] != found["compiler"]:
            print(f"\nstored with another compiler: {stored['compiler']}")
        lines = grown(stored, found)
        print("\nno kernel takes more than 3 % more instructions" if not lines else "\nmore than 3 % more:")
        print("\n".join(lines))
        sys.exit(1 if lines else 0)


if __name__ == "__main__":
    main()
