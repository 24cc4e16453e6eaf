"""Many runs: over threads of this machine, or over a Dask cluster."""

from __future__ import annotations

import hashlib
import os
import pickle
import sys
import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from pathlib import Path
from typing import Any

from ._native import __instruction_level__, __version__, simulate
from .errors import ArgumentError

__all__ = ["ensemble"]

#: Wall time before progress is shown, and between two lines of it, s.
_PATIENCE, _INTERVAL = 1.0, 0.2


def ensemble(
    function_or_scenes: Callable[[Any], Any] | Sequence[str | os.PathLike[str]],
    inputs: Iterable[Any] | None = None,
    *,
    client: Any = None,
    threads: int | None = None,
    folder: str | os.PathLike[str] | None = None,
    progress: bool | None = None,
) -> list[Any]:
    """Many runs: ``[function(x) for x in inputs]``, or scenes through ``simulate``, in parallel.

    A result depends on the function and its input only: the same bits wherever it ran, as long as all machines have the same
    instruction level (a RuntimeWarning tells if not; the environment variable PHIPSI_SIMD forces one). Random numbers must come
    from a seed that is, or is part of, the input. Phipsi's calls leave the interpreter to other threads while they compute.

    Parameters
    ----------
    function_or_scenes : a function of one argument; or paths of scenes, and the results are Trajectories.
    inputs : one for each run; None with scenes.
    client : a ``dask.distributed.Client``: runs go to its workers, which need phipsi and, of scenes, the same paths. A worker that is
        lost costs the runs that it was at and results that had not come back; another one makes them again.
    threads : at most so many at a time on this machine; None: one for each core.
    folder : where each result is kept as soon as it is there, as a pickle; called again, only the runs that are not there are made.
        A folder of another function or of other inputs is refused. Open only folders that you trust.
    progress : True shows it on standard error; None: after a second, if that is a terminal.

    Returns
    -------
    The results, in the order of the inputs.

    Raises
    ------
    ArgumentError; what a run raises, as it is: of threads after the runs that were at work have ended. Results of before are in
    the folder.

    Example
    -------
    >>> s = phipsi.molecule.System.from_files("ala_dipeptide.pdb", "ala_dipeptide.xml")
    >>> def final_energy(seed):
    ...     t = phipsi.molecule.TorsionModel(s)
    ...     return t.run(20, dt_fs=2, ensemble="langevin", seed=seed).potential_energy[-1]
    >>> phipsi.ensemble(final_energy, range(4)) == [final_energy(seed) for seed in range(4)]
    True
    """
    if callable(function_or_scenes):
        function, items = function_or_scenes, None if inputs is None else list(inputs)
        if items is None:
            message = "`inputs` is missing: a function needs one argument for each run"
            raise ArgumentError(message, argument="inputs", found="None", required="a list of arguments")
    else:
        if inputs is not None:
            message = "`inputs` is given, but scenes have none; give a function that takes them"
            raise ArgumentError(message, argument="inputs", found="inputs", required="None with scenes")
        if isinstance(function_or_scenes, (str, os.PathLike)):
            function_or_scenes = [function_or_scenes]
        function, items = simulate, [os.fspath(path) for path in function_or_scenes]
    if threads is not None and threads < 1:
        message = f"`threads` is {threads}, but at least 1 is required"
        raise ArgumentError(message, argument="threads", found=threads, required="at least 1")
    if threads is not None and client is not None:
        message = "`threads` and `client` are both given, but the client's cluster says how many runs there are at a time"
        raise ArgumentError(message, argument="threads", found=threads, required="None with a client")
    kept = _Folder(folder, function, items) if folder is not None else None
    results: dict[int, Any] = kept.load() if kept else {}
    missing = [i for i in range(len(items)) if i not in results]
    shown = _Progress(len(items), len(results), progress)
    levels = {__instruction_level__} if client is None else set()
    if missing:
        run = _in_threads(function, items, missing, threads) if client is None else _on_cluster(function, items, missing, client)
        for i, level, result in run:
            levels.add(level)
            results[i] = result
            if kept:
                kept.keep(i, result)
            shown.step()
    shown.finish()
    if len(levels) > 1:
        text = "; ".join(sorted(levels))
        warnings.warn(f"the workers differ ({text}): last bits depend on where a run was; set PHIPSI_SIMD on all", RuntimeWarning, 2)
    return [results[i] for i in range(len(items))]


def _call(function: Callable[[Any], Any], item: Any) -> tuple[str, Any]:
    return __instruction_level__, function(item)


def _in_threads(function: Any, items: list[Any], missing: list[int], threads: int | None) -> Iterator[tuple[int, str, Any]]:
    count = min(threads or os.cpu_count() or 1, len(missing))
    rest = iter(missing)
    failure: BaseException | None = None
    with ThreadPoolExecutor(count, thread_name_prefix="phipsi") as pool:
        at_work = {pool.submit(_call, function, items[i]): i for _, i in zip(range(count), rest)}
        while at_work:
            done, _ = wait(at_work, return_when=FIRST_COMPLETED)
            for future in sorted(done, key=at_work.__getitem__):
                i = at_work.pop(future)
                error = future.exception()
                if error is None:
                    yield (i, *future.result())
                    following = next(rest, None) if failure is None else None
                    if following is not None:
                        at_work[pool.submit(_call, function, items[following])] = following
                elif failure is None:
                    failure = _named(error, i)
    if failure is not None:
        raise failure


def _on_cluster(function: Any, items: list[Any], missing: list[int], client: Any) -> Iterator[tuple[int, str, Any]]:
    from dask.distributed import as_completed

    # The scheduler runs again what a lost worker had, up to its own limit of lost workers (allowed-failures).
    futures = {client.submit(_call, function, items[i], pure=False): i for i in missing}
    try:
        for future in as_completed(list(futures)):
            i = futures.pop(future)
            if future.status == "error":
                raise _named(future.exception(), i)
            yield (i, *future.result())
            future.release()
    finally:
        client.cancel(list(futures))


def _named(error: BaseException, i: int) -> BaseException:
    """The exception itself, with the number of the run as a note where this Python has notes."""
    if hasattr(error, "add_note"):
        error.add_note(f"in run {i} of phipsi.ensemble")
    return error


class _Folder:
    """Results in files of their own, each written at once."""

    def __init__(self, folder: str | os.PathLike[str], function: Any, items: list[Any]) -> None:
        self.path = Path(folder)
        self.path.mkdir(parents=True, exist_ok=True)
        name = f"{getattr(function, '__module__', '')}.{getattr(function, '__qualname__', type(function).__qualname__)}"
        try:
            digest = hashlib.sha256(pickle.dumps(items, protocol=4)).hexdigest()
        except Exception as error:
            message = f"`inputs` cannot be kept in a folder: {error}"
            raise ArgumentError(message, argument="inputs", found=str(error), required="objects that can be pickled") from error
        described = f"{name}\n{len(items)} runs\n{digest}\nphipsi {__version__}\n"
        head = self.path / "ensemble.txt"
        if head.exists() and head.read_text(encoding="utf-8") != described:
            message = f"`folder` {self.path} has results of another function, of other inputs or of another version"
            remedy = "give another folder, or remove it"
            raise ArgumentError(message, argument="folder", found=str(self.path), required="results of this call", remedy=remedy)
        if not head.exists():
            self._write(head, described.encode())

    def _file(self, i: int) -> Path:
        return self.path / f"run-{i:06}.pickle"

    def load(self) -> dict[int, Any]:
        results = {}
        for file in sorted(self.path.glob("run-*.pickle")):
            with file.open("rb") as stream:
                results[int(file.stem[4:])] = pickle.load(stream)
        return results

    def keep(self, i: int, result: Any) -> None:
        try:
            data = pickle.dumps(result, protocol=4)
        except Exception as error:
            message = f"the result of run {i} cannot be kept in a folder: {error}"
            remedy = "return numbers and arrays"
            raise ArgumentError(message, argument="folder", found=str(error), required="results that can be pickled", remedy=remedy) from error
        self._write(self._file(i), data)

    def _write(self, file: Path, data: bytes) -> None:
        # A file is there as a whole or not at all.
        part = file.with_suffix(".part")
        with part.open("wb") as stream:
            stream.write(data)
            stream.flush()
            os.fsync(stream.fileno())
        os.replace(part, file)


class _Progress:
    """A line on standard error."""

    def __init__(self, total: int, done: int, wanted: bool | None) -> None:
        self.total, self.done, self.first = total, done, done
        self.wanted = sys.stderr.isatty() if wanted is None else wanted
        self.begun = self.looked = time.monotonic()
        self.patience = 0.0 if wanted else _PATIENCE
        self.shown = False

    def step(self) -> None:
        self.done += 1
        now = time.monotonic()
        if not self.wanted or now - self.begun < self.patience:
            return
        if now - self.looked < _INTERVAL and self.done < self.total:
            return
        self.looked, self.shown = now, True
        left = (now - self.begun) / (self.done - self.first) * (self.total - self.done)
        print(f"\r{self.done} of {self.total} runs, {now - self.begun:.0f} s (about {left:.0f} s left) ", end="", file=sys.stderr, flush=True)

    def finish(self) -> None:
        if self.shown:
            print(file=sys.stderr)
