"""Replica exchange in temperature."""

from __future__ import annotations

import os
import pickle
from collections.abc import Mapping, Sequence
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from . import _ensemble
from ._native import System, TorsionModel
from .errors import ArgumentError

__all__ = ["BOLTZMANN", "ReplicaExchange", "exchange_probability", "replica_exchange"]

#: kJ/mol/K (CODATA 2018).
BOLTZMANN = 0.00831446261815324


class ReplicaExchange(NamedTuple):
    """Replica exchange at n_T temperatures over n rounds.

    ``temperatures_K``: (n_T,). ``positions``: (n_T, n, n_atoms, 3), nm, and ``potential_energy``, ``fixman_energy``: (n_T, n),
    kJ/mol, at the end of each round, before exchange; of a temperature, not of a replica. ``replica``: (n_T, n), which replica was
    there. ``exchange``: (n_T − 1,), fraction of accepted exchanges with the next temperature, NaN where none was tried.
    ``distribution``: "rigid", or "stiff limit" with Fixman's potential.
    """

    temperatures_K: NDArray[np.float64]
    positions: NDArray[np.float64]
    potential_energy: NDArray[np.float64]
    fixman_energy: NDArray[np.float64]
    replica: NDArray[np.int64]
    exchange: NDArray[np.float64]
    distribution: str


def exchange_probability(temperatures_K: Sequence[float], potential: Sequence[float], fixman: Sequence[float] = (0.0, 0.0)) -> float:
    """Probability that two replicas exchange their temperatures: min(1, exp(−Δ)).

    Δ = Σ [U(x) + U_F(x; T')]/kT' − Σ [U(x) + U_F(x; T)]/kT with T' the other temperature of each. U_F = ½ kT ln det M is
    proportional to the temperature, so that U_F/kT keeps its value and Δ = (1/kT₁ − 1/kT₀)(U₀ − U₁): Fixman's potential must be
    taken at the temperature where it acts, and then drops out.

    ``potential``: U of both, kJ/mol. ``fixman``: U_F of both, each at its present temperature.

    >>> round(phipsi.molecule.exchange_probability((300, 400), (-50.0, -45.0)), 4)
    0.6058
    >>> phipsi.molecule.exchange_probability((300, 400), (-45.0, -50.0), (7.0, 3.0))
    1.0
    """
    t = np.asarray(temperatures_K, float)
    kt, other = BOLTZMANN * t, BOLTZMANN * t[::-1]
    u, u_f = np.asarray(potential, float), np.asarray(fixman, float)
    delta = np.sum((u + u_f * (other / kt)) / other - (u + u_f) / kt)
    return float(np.exp(-max(delta, 0.0)))


class _Segment:
    """A round of one replica; a class, so that other processes can be given it."""

    def __init__(self, system: System, model: Mapping[str, Any], run: Mapping[str, Any]) -> None:
        self.system, self.model, self.run = system, dict(model), dict(run)

    def __call__(self, item: tuple[float, int, Any, Any]) -> tuple[Any, ...]:
        temperature, seed, q, v = item
        t = TorsionModel(self.system, **self.model)
        if q is None:
            t.draw_velocities(temperature, seed)
        else:
            t.q = q
            t.v = v
        r = t.run(temperature_K=temperature, seed=seed, **self.run)
        return t.q, t.v, t.positions, r.potential_energy[-1], r.fixman_energy[-1], r.distribution


def replica_exchange(
    s: System,
    temperatures_K: Sequence[float],
    rounds: int,
    steps: int,
    dt_fs: float,
    ensemble: Literal["langevin", "hmc"] = "langevin",
    friction_per_ps: float = 1.0,
    seed: int = 0,
    fixman: bool = False,
    *,
    positions: Any = None,
    clusters: Any = None,
    rigid: Any = None,
    hinges: Any = None,
    client: Any = None,
    threads: int | None = None,
    folder: str | os.PathLike[str] | None = None,
) -> ReplicaExchange:
    """Replica exchange in temperature, in torsions: over threads, or over a Dask cluster.

    Every replica makes ``steps`` steps at its temperature; then neighbours exchange their temperatures with the probability of
    ``exchange_probability``, pairs (0, 1), (2, 3), … after even rounds and (1, 2), (3, 4), … after odd ones. Velocities are scaled
    with the root of the temperature. Random numbers depend on the seed, the round and the temperature only, so that the result is
    the same to the last bit wherever the replicas ran, and after a resumption.

    Parameters
    ----------
    s : a System. temperatures_K : rising. rounds, steps : how many; steps of each round.
    dt_fs, ensemble, friction_per_ps, fixman : as in ``TorsionModel.run``; trajectories of "hmc" are whole parts of ``steps``, of about
        50 fs.
    positions, clusters, rigid, hinges : as in ``TorsionModel``.
    client, threads : as in ``phipsi.ensemble``.
    folder : where each round is kept; called again, it goes on behind the last one.

    Returns
    -------
    ReplicaExchange.

    Raises
    ------
    ArgumentError; what a run raises.

    Example
    -------
    >>> s = phipsi.molecule.System.from_files("ala_dipeptide.pdb", "ala_dipeptide.xml")
    >>> r = phipsi.molecule.replica_exchange(s, [300, 360], rounds=4, steps=10, dt_fs=4, seed=1)
    >>> r.positions.shape, r.exchange.shape
    ((2, 4, 22, 3), (1,))
    """
    t_K = np.asarray(temperatures_K, float)
    if t_K.ndim != 1 or len(t_K) < 2 or not np.all(np.isfinite(t_K)) or t_K[0] <= 0 or np.any(np.diff(t_K) <= 0):
        message = f"`temperatures_K` is {temperatures_K}, but at least two rising temperatures above 0 are required"
        raise ArgumentError(message, argument="temperatures_K", found=str(temperatures_K), required="rising temperatures")
    for name, value in (("rounds", rounds), ("steps", steps)):
        if value < 1:
            raise ArgumentError(f"`{name}` is {value}, but at least 1 is required", argument=name, found=value, required="at least 1")
    if ensemble not in ("langevin", "hmc"):
        message = f'`ensemble` is "{ensemble}", but "langevin" or "hmc" is required: chains of thermostats belong to one temperature'
        raise ArgumentError(message, argument="ensemble", found=ensemble, required='"langevin" or "hmc"')
    model = {"positions": positions, "clusters": clusters, "rigid": rigid, "hinges": hinges}
    run = {"steps": steps, "dt_fs": dt_fs, "ensemble": ensemble, "friction_per_ps": friction_per_ps, "fixman": fixman, "every": steps}
    if ensemble == "hmc":
        # Whole trajectories, of about 50 fs.
        wanted = 50 / dt_fs if dt_fs > 0 else 1.0
        run["trajectory_steps"] = min((d for d in range(1, steps + 1) if steps % d == 0), key=lambda d: abs(np.log(d / wanted)))
    segment = _Segment(s, model, run)
    kept = _ensemble._Folder(folder, replica_exchange, [pickle.dumps((segment, t_K, seed), protocol=4)]) if folder is not None else None
    n = len(t_K)
    done = list(kept.load().items()) if kept else []
    done = [value for k, (i, value) in enumerate(sorted(done)) if i == k][:rounds]
    states: list[tuple[Any, Any]] = [(None, None)] * n
    replica = np.arange(n)
    tried, accepted = np.zeros(n - 1), np.zeros(n - 1)
    history = []
    for k in range(rounds):
        if k < len(done):
            results = done[k]
        else:
            items = [(float(t_K[i]), _seed(seed, k, i), *states[i]) for i in range(n)]
            results = _run(segment, items, client, threads)
            if kept:
                kept.keep(k, results)
        history.append((replica.copy(), results))
        states = [(q, v) for q, v, *_ in results]
        random = np.random.default_rng([seed, k])
        for i in range(k % 2, n - 1, 2):
            tried[i] += 1
            u, u_f = (results[i][3], results[i + 1][3]), (results[i][4], results[i + 1][4])
            if random.random() < exchange_probability(t_K[i : i + 2], u, u_f):
                accepted[i] += 1
                scale = np.sqrt(t_K[i + 1] / t_K[i])
                (q0, v0), (q1, v1) = states[i], states[i + 1]
                states[i], states[i + 1] = (q1, v1 / scale), (q0, v0 * scale)
                replica[[i, i + 1]] = replica[[i + 1, i]]
    with np.errstate(invalid="ignore"):
        exchange = accepted / tried
    column = lambda field: np.array([[results[i][field] for _, results in history] for i in range(n)])  # noqa: E731
    return ReplicaExchange(
        t_K, column(2), column(3), column(4), np.array([r for r, _ in history]).T, exchange, history[-1][1][0][5]
    )


def _run(segment: _Segment, items: list[Any], client: Any, threads: int | None) -> list[Any]:
    return _ensemble.ensemble(segment, items, client=client, threads=threads, progress=False)


def _seed(seed: int, round_: int, temperature: int) -> int:
    """A seed of its own for each round and temperature."""
    return int(np.random.SeedSequence([seed, round_, temperature]).generate_state(1, np.uint64)[0])
