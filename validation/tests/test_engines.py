"""Torsion dynamics on forces from Python and from OpenMM, and what becomes of their exceptions."""

from __future__ import annotations

import threading
import time

import mdtraj
import numpy as np
import openmm
import pytest
from openmm import app

import phipsi

from .common import EPSILON, MOLECULE

System, TorsionModel = phipsi.molecule.System, phipsi.molecule.TorsionModel

ENSEMBLES = ("nve", "langevin", "nose_hoover", "hmc")


@pytest.fixture(scope="module")
def s():
    return System.from_files(*MOLECULE)


def native(s, calls=None):
    """The System's own terms as a function."""

    def forces(positions):
        if calls is not None:
            calls.append(1)
        return s._energy_and_forces(positions)

    return forces


@pytest.mark.parametrize("ensemble", ENSEMBLES)
def test_a_function_gives_the_run_of_the_native_terms(s, ensemble):
    calls = []
    by_function, by_terms = TorsionModel(s, forces=native(s, calls)), TorsionModel(s)
    before = len(calls)
    a, b = (t.run(20, dt_fs=4, ensemble=ensemble, seed=3, trajectory_steps=5) for t in (by_function, by_terms))
    assert np.array_equal(a.positions, b.positions) and np.array_equal(a.conserved, b.conserved)
    # One evaluation a step, and one for the strain of the start.
    assert len(calls) - before <= 21
    assert by_function.energy() == {"forces": a.potential_energy[-1], "total": a.potential_energy[-1]}
    assert by_function.minimize().energy == by_terms.minimize().energy


def test_openmm_gives_the_run_of_the_native_terms(s):
    pdb = app.PDBFile(str(MOLECULE[0]))
    system = openmm.XmlSerializer.deserialize(MOLECULE[1].read_text())
    context = openmm.Context(system, openmm.VerletIntegrator(0.001), openmm.Platform.getPlatform("Reference"))
    a, b = (TorsionModel(s, forces=f).run(50, dt_fs=4, seed=1) for f in (context, None))
    # Forces differ by some ε of their sums; 50 steps do not let it grow beyond a thousandfold.
    assert np.abs(a.positions - b.positions).max() < 1e3 * 50 * EPSILON
    assert pdb.topology.getNumAtoms() == s.n_atoms
    system.addParticle(1.0)
    with pytest.raises(phipsi.ArgumentError, match="23 particles, but 22"):
        TorsionModel(s, forces=openmm.Context(_without_forces(23), openmm.VerletIntegrator(0.001)))


def _without_forces(n):
    system = openmm.System()
    for _ in range(n):
        system.addParticle(1.0)
    return system


class Mine(Exception):
    """An exception of the user's."""


@pytest.mark.parametrize("fixman", [False, True])
@pytest.mark.parametrize("ensemble", ENSEMBLES)
def test_an_exception_comes_out_as_it_is_and_nothing_is_lost(s, ensemble, fixman, tmp_path):
    reference = TorsionModel(s).run(60, dt_fs=2, ensemble=ensemble, fixman=fixman, seed=2, every=1, trajectory_steps=1)
    failing = {"at": 40, "n": 0}

    def forces(positions):
        failing["n"] += 1
        if failing["n"] == failing["at"]:
            raise Mine("no forces")
        return s._energy_and_forces(positions)

    t = TorsionModel(s, forces=forces)
    arguments = {"dt_fs": 2, "ensemble": ensemble, "fixman": fixman, "seed": 2, "every": 1, "trajectory_steps": 1}
    file = tmp_path / "run.dcd"
    with pytest.raises(Mine, match="no forces") as caught:
        t.run(60, trajectory=file, **arguments)
    so_far = caught.value.trajectory
    n = len(so_far.time_ps)
    assert n > 25 and caught.value.time == t.time_ps == pytest.approx(so_far.time_ps[-1])
    assert np.array_equal(so_far.positions, reference.positions[:n])
    assert len(mdtraj.load_dcd(str(file), top=str(MOLECULE[0]))) == n
    # Where the forces come back, the run goes on as if nothing had happened.
    rest = t.run(60 - (n - 1), **arguments)
    assert np.array_equal(rest.positions, reference.positions[n - 1 :])


def test_forces_that_are_none_are_refused(s):
    for result, words in [
        (None, "a pair"),
        ((1.0, np.zeros((3, 3))), "shape"),
        ((1.0, np.zeros((22, 3), complex)), "forces of the function"),
        ((np.zeros(2), np.zeros((22, 3))), "energy of the function"),
    ]:
        with pytest.raises(phipsi.ArgumentError, match=words):
            TorsionModel(s, forces=lambda x, result=result: result)
    with pytest.raises(phipsi.ArgumentError, match="openmm.Context"):
        TorsionModel(s, forces=1.0)
    with pytest.raises(phipsi.NumericalError, match="NaN"):
        TorsionModel(s, forces=lambda x: (np.nan, np.zeros((22, 3))))


def test_monte_carlo_refuses_where_there_is_no_energy(s):
    n = [0]

    def forces(positions):
        n[0] += 1
        energy, forces = s._energy_and_forces(positions)
        return (np.nan if n[0] % 25 == 0 else energy), forces

    r = TorsionModel(s, forces=forces).run(100, dt_fs=4, ensemble="hmc", trajectory_steps=5, seed=1)
    assert 0 < r.refused <= 5 and np.isfinite(r.potential_energy).all()


def test_a_function_that_asks_its_model_is_told_so(s):
    found = []

    def forces(positions):
        for name in ("positions", "velocities", "q", "v", "time_ps", "energy", "minimize", "run"):
            try:
                value = getattr(model[0], name)
                if callable(value):
                    value(*([1, 2.0] if name == "run" else []))
            except phipsi.Error as error:
                found.append((name, str(error)))
        return s._energy_and_forces(positions)

    model = [None]
    model[0] = TorsionModel(s, forces=lambda x: forces(x) if model[0] else s._energy_and_forces(x))
    model[0].run(1, dt_fs=1)
    assert {name for name, _ in found} == {"positions", "velocities", "q", "v", "time_ps", "energy", "minimize", "run"}


def test_other_threads_see_the_state_of_a_running_model(s):
    forces = native(s)

    def slow(positions):
        time.sleep(1e-3)
        return forces(positions)

    t = TorsionModel(s, forces=slow)
    thread = threading.Thread(target=t.run, args=(300, 1.0))
    thread.start()
    seen = []
    while thread.is_alive():
        seen.append(t.time_ps)
    thread.join()
    assert len(set(seen)) > 2 and seen == sorted(seen)


@pytest.mark.parametrize("end", ["xtc", "dcd"])
def test_trajectories_are_read_by_mdtraj(s, tmp_path, end):
    file = tmp_path / f"run.{end}"
    r = TorsionModel(s).run(200, dt_fs=2, every=50, trajectory=file, seed=1)
    read = mdtraj.load(str(file), top=str(MOLECULE[0]))
    rounding = 0.5e-3 if end == "xtc" else 0
    assert np.abs(read.xyz - r.positions).max() < rounding + 1e-6
    if end == "xtc":
        assert np.allclose(read.time, r.time_ps)


def test_xtc_is_about_as_small_as_that_of_mdtraj(s, tmp_path):
    a, b = tmp_path / "a.xtc", tmp_path / "b.xtc"
    r = TorsionModel(s).run(1000, dt_fs=2, every=10, trajectory=a, seed=1)
    mdtraj.Trajectory(r.positions, mdtraj.load(str(MOLECULE[0])).topology).save_xtc(str(b))
    # Some bytes for another choice of levels.
    assert a.stat().st_size < 1.05 * b.stat().st_size
