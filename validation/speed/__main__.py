"""Times phipsi and other programs on the same models, taking turns: ``python -m validation.speed``.

Results are compared before anything is timed: a timer that computes something else is refused.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from . import build, page, python, report
from .models import CLOSED_NAMES, NAMES, LeftOut, open_case, open_closed_case
from .programs import CLOSED, OPERATIONS, OTHERS, Phipsi
from .timer import TimerError

_EPILOG = """
example: python -m validation.speed --models panda,ur5 --only forward_dynamics --against Pinocchio
Exit 0: all that was compared agrees, 1: a program disagrees or failed, 2: usage. Bars that are missed do not change it.
"""


def _words(text: str) -> list[str]:
    return [word for word in text.split(",") if word]


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m validation.speed", description=__doc__.splitlines()[0], epilog=_EPILOG)
    parser.add_argument("--models", type=_words, default=NAMES, help=f"names or URDF files (default {','.join(NAMES)})")
    parser.add_argument(
        "--closed", type=_words, default=CLOSED_NAMES, help=f"models with loops (default {','.join(CLOSED_NAMES)}; \"\": none)"
    )
    parser.add_argument("--only", type=_words, default=[*OPERATIONS, CLOSED], help=f"operations (default {','.join([*OPERATIONS, CLOSED])})")
    others = [program.name for program in OTHERS]
    parser.add_argument("--against", type=_words, default=others, help=f"programs (default {','.join(others)})")
    parser.add_argument("--rounds", type=int, default=15, help="turns of each side (default 15)")
    parser.add_argument("--quick", action="store_true", help="three rounds of the comparison alone: a look, not a result")
    parser.add_argument("--comparison", action="store_true", help="leave out phipsi's long chains and its Python package")
    parser.add_argument("--cache", type=Path, default=build.ROOT / "target" / "speed", help="folder of the built timers")
    parser.add_argument("--json", type=Path, help="write all figures to this file")
    parser.add_argument("--page", action="store_true", help="write docs/src/speed.md and its chart (speed_without_avx512.md on a processor without)")
    return parser


def _check(parser: argparse.ArgumentParser, given: argparse.Namespace) -> None:
    for what, allowed in (("only", [*OPERATIONS, CLOSED]), ("against", [program.name for program in OTHERS])):
        for word in getattr(given, what):
            if word not in allowed:
                parser.error(f"--{what}: there is no {word!r}; there are: {', '.join(allowed)}")
    if given.rounds < 1:
        parser.error("--rounds must be at least 1")
    if any(c.isspace() for c in str(given.cache.resolve())):
        parser.error(f"--cache: the path {given.cache} contains a space, which the timers' protocol does not allow")


def main(arguments: list[str] | None = None) -> int:
    """Runs the comparison; the exit status."""
    parser = _parser()
    given = parser.parse_args(arguments)
    _check(parser, given)
    rounds = 3 if given.quick else given.rounds
    folder = given.cache.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    try:
        ours = Phipsi(folder)
        ours.build()
    except build.CannotBuild as reason:
        print(f"phipsi: {reason}", file=sys.stderr)
        return 1
    run = report.Run(rounds)
    run.describe(ours.name, ours.built)
    others = []
    for kind in OTHERS:
        if kind.name not in given.against:
            continue
        program = kind(folder)
        needed = [o for o in dict.fromkeys(report.single(o) for o in given.only) if o in program.operations]
        if not needed:
            continue
        try:
            program.build(needed)
        except build.CannotBuild as reason:
            run.leave_out(kind.name, "every model", str(reason))
            continue
        others.append(program)
        for built in program.built.values():
            run.describe(program.name, built)
    try:
        tree_operations = [operation for operation in given.only if operation != CLOSED]
        cases = [(open_case, name, tree_operations) for name in given.models if tree_operations]
        if CLOSED in given.only:
            cases += [(open_closed_case, name, [CLOSED]) for name in given.closed]
        for opened, name, operations in cases:
            case = opened(name, folder)
            ours.start(case)
            present = []
            for program in others:
                if not any(report.single(operation) in program.operations for operation in operations):
                    continue
                try:
                    program.start(case)
                    present.append(program)
                except LeftOut as reason:
                    run.leave_out(program.name, case.name, str(reason))
            for operation in operations:
                run.compare(case, operation, ours, present)
        if not (given.quick or given.comparison):
            run.long_chains(ours)
            case = open_case("panda", folder)
            ours.start(case)
            run.python = python.figures(case, ours, rounds)
    except TimerError as reason:
        print(f"stopped: {reason}", file=sys.stderr)
        return 1
    finally:
        for program in (ours, *others):
            program.close()
    print(run.text())
    if given.json:
        given.json.write_text(json.dumps(run.as_json(), indent=1) + "\n")
    if given.page:
        page.write(run.as_json(), build.ROOT / "docs" / "src")
    return 1 if run.refused else 0


if __name__ == "__main__":
    sys.exit(main())
