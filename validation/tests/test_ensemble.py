"""Many runs: threads and a Dask cluster of two worker processes give the same bits; what is lost with a worker; resumption."""

from __future__ import annotations

import os
import pickle
import time
from pathlib import Path

import numpy as np
import pytest
from dask.distributed import Client, LocalCluster

import phipsi

from .common import EXAMPLES, MOLECULE

SYSTEM = phipsi.molecule.System.from_files(*MOLECULE)


@pytest.fixture(scope="module")
def client():
    with LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None) as cluster:
        with Client(cluster) as client:
            yield client


def langevin(seed):
    t = phipsi.molecule.TorsionModel(SYSTEM)
    return t.run(50, dt_fs=4, ensemble="langevin", seed=seed)


def sweep(seed):
    """A Monte Carlo sweep of a robot."""
    m = phipsi.Model.from_urdf(str(EXAMPLES / "satellite_arm.urdf"), base="free")
    q, v = m.random_state(seed)
    return phipsi.simulate(m, q, 0.1 * v, t_end=0.2, rtol=1e-8)


class Counted:
    """Leaves a file at each call; the first run kills its process once, so does the second raise."""

    def __init__(self, folder, kill=False, fail=()):
        self.folder, self.kill, self.fail = Path(folder), kill, fail

    def __call__(self, i):
        calls = len(list(self.folder.glob(f"{i}-*")))
        (self.folder / f"{i}-{calls}-{os.getpid()}").touch()
        if i in self.fail:
            raise ValueError(f"run {i}")
        if self.kill and i == 3 and calls == 0:
            os._exit(1)
        time.sleep(0.01)
        return i * i


def calls(folder):
    return [len(list(folder.glob(f"{i}-*"))) for i in range(8)]


def test_threads_and_workers_give_the_same_bits(client):
    one = [langevin(seed) for seed in range(4)]
    for arguments in ({}, {"threads": 1}, {"threads": 3}, {"client": client}):
        for a, b in zip(phipsi.ensemble(langevin, range(4), **arguments), one):
            assert np.array_equal(a.positions, b.positions) and np.array_equal(a.conserved, b.conserved), arguments
    for a, b in zip(phipsi.ensemble(sweep, range(2), client=client), map(sweep, range(2))):
        assert np.array_equal(a.q, b.q) and a.error.energy_error == b.error.energy_error


def test_scenes(client):
    scene = EXAMPLES / "satellite_arm.toml"
    here = phipsi.ensemble(scene)[0]
    there = phipsi.ensemble([scene, scene], client=client)
    assert all(np.array_equal(r.q, here.q) and r.outputs["reach"][-1] == here.outputs["reach"][-1] for r in there)


def test_a_killed_worker_costs_its_piece_only(client, tmp_path):
    assert phipsi.ensemble(Counted(tmp_path, kill=True), range(8), client=client) == [i * i for i in range(8)]
    made = calls(tmp_path)
    assert made[3] >= 2, "the piece was run again"
    # At most what the worker had finished and not yet delivered.
    assert sum(made) <= 8 + 3


@pytest.mark.parametrize("where", ["threads", "client"])
def test_a_folder_keeps_what_is_done(client, tmp_path, where):
    folder, log = tmp_path / "kept", tmp_path / "log"
    log.mkdir()
    arguments = {"threads": 1} if where == "threads" else {"client": client}
    with pytest.raises(ValueError, match="run 5") as caught:
        phipsi.ensemble(Counted(log, fail=(5,)), range(8), folder=folder, **arguments)
    if hasattr(caught.value, "__notes__"):
        assert "in run 5 of phipsi.ensemble" in caught.value.__notes__
    kept = {int(file.stem[4:]) for file in folder.glob("run-*.pickle")}
    assert 5 not in kept and (where == "client" or kept >= {0, 1, 2, 3, 4})
    before = calls(log)
    assert phipsi.ensemble(Counted(log), range(8), folder=folder, **arguments) == [i * i for i in range(8)]
    again = [b - a for a, b in zip(before, calls(log))]
    missing = [i for i in range(8) if i not in kept]
    assert all(again[i] >= 1 if i in missing else again[i] == 0 for i in range(8))
    # A cluster's two workers may have taken up a run each, late enough to be counted here, before they heard of the failure.
    assert sum(again) <= len(missing) + (2 if where == "client" else 0)
    with pytest.raises(phipsi.ArgumentError, match="other inputs"):
        phipsi.ensemble(Counted(log), range(9), folder=folder)
    with pytest.raises(phipsi.ArgumentError, match="another function"):
        phipsi.ensemble(langevin, range(8), folder=folder)


def test_a_piece_that_was_half_written_is_made_again(tmp_path):
    assert phipsi.ensemble(abs, [-1, -2], folder=tmp_path) == [1, 2]
    (tmp_path / "run-000001.pickle").rename(tmp_path / "run-000001.part")
    assert phipsi.ensemble(abs, [-1, -2], folder=tmp_path) == [1, 2]


def test_progress_and_mistakes(capsys, tmp_path):
    phipsi.ensemble(abs, range(3), progress=True)
    assert "3 of 3 runs" in capsys.readouterr().err
    assert phipsi.ensemble(abs, []) == []
    for arguments, words in [
        ((abs,), "inputs"),
        (([], [1]), "scenes have none"),
    ]:
        with pytest.raises(phipsi.ArgumentError, match=words):
            phipsi.ensemble(*arguments)
    with pytest.raises(phipsi.ArgumentError, match="at least 1"):
        phipsi.ensemble(abs, [1], threads=0)
    with pytest.raises(phipsi.ArgumentError, match="cluster says"):
        phipsi.ensemble(abs, [1], threads=1, client=object())
    with pytest.raises(phipsi.ArgumentError, match="kept in a folder"):
        phipsi.ensemble(lambda x: (lambda: x), [1], folder=tmp_path)


EXCHANGE = {"rounds": 6, "steps": 20, "dt_fs": 8, "ensemble": "hmc", "seed": 7, "fixman": True, "rigid": ["omega", "methyl"]}


def test_replica_exchange_is_the_same_everywhere_and_goes_on(client, tmp_path):
    exchange = phipsi.molecule.replica_exchange
    here = exchange(SYSTEM, [300, 400, 520], **EXCHANGE)
    assert here.positions.shape == (3, 6, 22, 3) and here.distribution == "stiff limit"
    assert sorted(here.replica[:, -1]) == [0, 1, 2]
    there = exchange(SYSTEM, [300, 400, 520], client=client, **EXCHANGE)
    exchange(SYSTEM, [300, 400, 520], folder=tmp_path, **{**EXCHANGE, "rounds": 3})
    rest = exchange(SYSTEM, [300, 400, 520], folder=tmp_path, **EXCHANGE)
    assert len(list(tmp_path.glob("run-*.pickle"))) == 6
    for other in (there, rest):
        for a, b in zip(other, here):
            assert np.array_equal(a, b)
    with pytest.raises(phipsi.ArgumentError, match="folder"):
        exchange(SYSTEM, [300, 400, 530], folder=tmp_path, **EXCHANGE)


def test_exchange_keeps_the_product_of_both_distributions():
    """Detailed balance, with Fixman's potential at both temperatures from the determinant itself."""
    k = 0.00831446261815324
    random = np.random.default_rng(1)
    for _ in range(100):
        t0, t1 = sorted(random.uniform(200, 600, 2))
        u, half_log_det = random.normal(0, 10, 2), random.normal(0, 5, 2)

        def weight(a, b):
            return -(u[a] + k * t0 * half_log_det[a]) / (k * t0) - (u[b] + k * t1 * half_log_det[b]) / (k * t1)

        forward = phipsi.molecule.exchange_probability((t0, t1), u, k * np.array([t0, t1]) * half_log_det)
        assert forward == pytest.approx(min(1.0, np.exp(weight(1, 0) - weight(0, 1))), rel=1e-10)


def test_exchange_samples_what_a_plain_run_does():
    """⟨U⟩ at the lower of two temperatures, with exchanges after every trajectory."""
    hmc = {"dt_fs": 10, "ensemble": "hmc", "seed": 5, "rigid": ["omega", "methyl"]}
    n = 300
    r = phipsi.molecule.replica_exchange(SYSTEM, [300, 330], rounds=n, steps=5, threads=1, **hmc)
    t = phipsi.molecule.TorsionModel(SYSTEM, rigid=["omega", "methyl"])
    plain = t.run(5 * 4000, dt_fs=10, ensemble="hmc", seed=11, every=5).potential_energy[200:]
    exchanged = r.potential_energy[0, 30:]
    assert 0.3 < r.exchange[0] < 1

    def error(x):
        blocks = np.array_split(x, 12)
        return np.std([b.mean() for b in blocks]) / np.sqrt(len(blocks) - 1)

    difference = exchanged.mean() - plain.mean()
    # Five standard errors, from blocks.
    assert abs(difference) < 5 * np.hypot(error(exchanged), error(plain))


def test_arguments_of_replica_exchange():
    exchange = phipsi.molecule.replica_exchange
    for temperatures in ([300], [400, 300], [0, 300], [300, np.inf]):
        with pytest.raises(phipsi.ArgumentError, match="rising"):
            exchange(SYSTEM, temperatures, 1, 1, 1.0)
    with pytest.raises(phipsi.ArgumentError, match="rounds"):
        exchange(SYSTEM, [300, 310], 0, 1, 1.0)
    with pytest.raises(phipsi.ArgumentError, match="hmc"):
        exchange(SYSTEM, [300, 310], 1, 1, 1.0, ensemble="nose_hoover")


def test_pickled_trajectories():
    r = sweep(1)
    again = pickle.loads(pickle.dumps(r))
    for name in dir(r):
        if not name.startswith("_") and name != "error":
            assert np.all(getattr(again, name) == getattr(r, name)), name
    assert again.error.momentum_error == r.error.momentum_error
