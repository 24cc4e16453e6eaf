"""ASE: its own checks of calculators, and torsion dynamics as one of its dynamics."""

from __future__ import annotations

import subprocess
import sys

import ase.io
import numpy as np
import pytest
from ase import Atoms, units
from ase.build import molecule
from ase.calculators.calculator import Calculator as AseCalculator
from ase.calculators.fd import calculate_numerical_forces
from ase.calculators.lj import LennardJones
from ase.constraints import FixAtoms
from ase.md.velocitydistribution import thermalize_momenta

import phipsi
import phipsi.ase

from .common import MOLECULE

TorsionDynamics = phipsi.ase.TorsionDynamics


@pytest.fixture(scope="module")
def s():
    return phipsi.molecule.System.from_files(*MOLECULE)


@pytest.fixture
def atoms(s):
    return phipsi.ase.atoms(s)


def test_forces_are_the_gradient_of_the_energy(atoms):
    atoms.rattle(0.01, seed=1)
    forces = atoms.get_forces()
    numerical = calculate_numerical_forces(atoms, eps=1e-4)
    # Third derivatives of bonds, about 1e4 eV/Å³, times eps²/6; rounding of 1e-15 × 100 eV over 2 eps.
    assert np.abs(numerical - forces).max() < 1e-4
    assert np.abs(numerical - forces).max() < 1e-4 * np.abs(forces).max()


def test_the_calculator_follows_ases_rules(s, atoms):
    calculator = atoms.calc
    assert isinstance(calculator, AseCalculator)
    energy = atoms.get_potential_energy()
    assert atoms.get_potential_energy(force_consistent=True) == energy
    assert abs(energy - s.energy()["total"] * units.kJ / units.mol) < 1e-12 * abs(energy)
    assert not calculator.calculation_required(atoms, ["energy", "forces"])
    atoms.positions[3] += 0.1
    assert calculator.calculation_required(atoms, ["energy"])
    assert atoms.get_potential_energy() != energy
    with pytest.raises(phipsi.ArgumentError, match="atom 4 of `atoms` is N, but C is required"):
        atoms.numbers[4] = 7
        atoms.get_potential_energy()
    with pytest.raises(phipsi.ArgumentError, match="1, but 22"):
        Atoms("H", calculator=calculator).get_forces()


def test_the_native_run_in_ases_units(s, atoms):
    dynamics = TorsionDynamics(atoms, 2 * units.fs, bonds=s.bonds)
    dynamics.draw_velocities(300, seed=5)
    t = phipsi.molecule.TorsionModel(s)
    t.draw_velocities(300, seed=5)
    assert abs(atoms.get_kinetic_energy() / (t.model.kinetic_energy(t.q, t.v) * units.kJ / units.mol) - 1) < 1e-8
    dynamics.run(50)
    # ASE's constants differ by 3e-10, and a hundred femtoseconds do not let it grow beyond a hundredfold.
    assert np.abs(atoms.positions / 10 - t.run(50, dt_fs=2).positions[-1]).max() < 1e-7


def test_observers_loggers_trajectories_and_restart(s, atoms, tmp_path):
    file, log = tmp_path / "run.traj", tmp_path / "run.log"
    dynamics = TorsionDynamics(atoms, 4 * units.fs, str(file), str(log), 5, bonds=s.bonds)
    dynamics.draw_velocities(300, seed=1)
    energies = []
    dynamics.attach(lambda: energies.append(atoms.get_total_energy()), interval=1)
    assert dynamics.run(50) and len(energies) == 51 and dynamics.get_number_of_steps() == 50
    assert np.ptp(energies) < 5e-3
    assert len(log.read_text().splitlines()) == 12
    frames = ase.io.read(file, ":")
    assert len(frames) == 11
    assert frames[-1].get_total_energy() == energies[-1]
    assert dynamics.get_time() == pytest.approx(200 * units.fs)
    again = frames[-1]
    again.calc = phipsi.ase.Calculator(s)
    other = TorsionDynamics(again, 4 * units.fs, str(file), append_trajectory=True, bonds=s.bonds)
    # Rounding of momenta that are gathered and spread again.
    assert np.abs(again.get_momenta() - atoms.get_momenta()).max() < 1e-13
    other.run(10)
    dynamics.run(10)
    assert np.abs(again.positions - atoms.positions).max() < 1e-11
    assert sum(1 for _ in other.irun(3)) == 4


def test_temperature_counts_the_degrees_of_freedom_of_the_clusters(s, atoms):
    dynamics = TorsionDynamics(atoms, units.fs, bonds=s.bonds)
    assert atoms.get_number_of_degrees_of_freedom() == dynamics.model.degrees_of_freedom == 13
    random = np.random.default_rng(3)
    temperatures = []
    for _ in range(400):
        thermalize_momenta(atoms, 300, rng=random)
        temperatures.append(atoms.get_temperature())
    # Five standard errors of a mean of 400 χ² of 13 degrees of freedom.
    assert abs(np.mean(temperatures) - 300) < 5 * 300 * np.sqrt(2 / 13 / 400)
    assert abs(np.std(temperatures) - 300 * np.sqrt(2 / 13)) < 5 * 300 * np.sqrt(2 / 13) / np.sqrt(2 * 400)


@pytest.mark.parametrize("ensemble", ["langevin", "hmc", "nose_hoover"])
def test_baths(s, atoms, ensemble):
    dynamics = TorsionDynamics(atoms, 5 * units.fs, bonds=s.bonds, ensemble=ensemble, temperature_K=300, fixman=True, seed=1)
    dynamics.run(20)
    t = phipsi.molecule.TorsionModel(s)
    t.velocities = np.zeros_like(s.positions)
    steps = 200 if ensemble == "hmc" else 20
    r = t.run(steps, dt_fs=5, ensemble=ensemble, temperature_K=300, fixman=True, seed=1)
    assert np.abs(atoms.positions / 10 - r.positions[-1]).max() < 1e-6
    assert dynamics.get_time() == pytest.approx(5 * steps * units.fs)


def test_changes_between_steps_are_taken_over(s, atoms):
    dynamics = TorsionDynamics(atoms, 2 * units.fs, bonds=s.bonds)
    dynamics.run(5)
    atoms.positions += [1.0, 2.0, 3.0]
    atoms.set_momenta(np.zeros((22, 3)))
    before = atoms.positions.copy()
    dynamics.run(1)
    assert 0 < np.abs(atoms.positions - before).max() < 0.01
    atoms.positions[0, 0] += 0.5
    with pytest.raises(phipsi.ArgumentError, match="not those of these rigid clusters"):
        dynamics.run(1)


class Counting(phipsi.ase.Calculator):
    """Counts evaluations."""

    calls = 0

    def calculate(self, *arguments, **keywords):
        self.calls += 1
        super().calculate(*arguments, **keywords)


@pytest.mark.parametrize("arguments", [{}, {"fixman": True}, {"ensemble": "langevin"}])
def test_one_evaluation_of_forces_a_step(s, atoms, arguments):
    atoms.calc = Counting(s)
    dynamics = TorsionDynamics(atoms, 2 * units.fs, bonds=s.bonds, logfile=None, **arguments)
    dynamics.draw_velocities(300, seed=1)
    before = atoms.calc.calls
    dynamics.attach(atoms.get_total_energy)
    dynamics.run(20)
    assert atoms.calc.calls == before + 20


class Failing(LennardJones):
    """Lennard-Jones energies that fail at one call."""

    calls = 0

    def calculate(self, *arguments, **keywords):
        self.calls += 1
        if self.calls == 12:
            raise RuntimeError("the cluster is down")
        super().calculate(*arguments, **keywords)


def test_any_calculator_and_its_exceptions():
    ethanol = molecule("CH3CH2OH")
    ethanol.calc = Failing(sigma=1.0, epsilon=0.001)
    dynamics = TorsionDynamics(ethanol, 2 * units.fs)
    assert dynamics.model.degrees_of_freedom == 6 + 2
    dynamics.draw_velocities(300, seed=1)
    seen = []
    dynamics.attach(lambda: seen.append(ethanol.positions.copy()))
    with pytest.raises(RuntimeError, match="the cluster is down"):
        dynamics.run(50)
    assert 2 < len(seen) < 50 and np.array_equal(ethanol.positions, seen[-1])
    energy = ethanol.get_total_energy()
    dynamics.run(50)
    assert abs(ethanol.get_total_energy() - energy) < 1e-3


def test_mistakes(s, atoms):
    with pytest.raises(phipsi.ArgumentError, match="below 22"):
        TorsionDynamics(atoms, 1.0, bonds=[(0, 22)])
    with pytest.raises(phipsi.ArgumentError, match="timestep"):
        TorsionDynamics(atoms, -1.0)
    with pytest.raises(phipsi.ArgumentError, match="FixAtoms"):
        fixed = atoms.copy()
        fixed.calc = atoms.calc
        fixed.set_constraint(FixAtoms([0]))
        TorsionDynamics(fixed, 1.0)
    with pytest.raises(phipsi.ArgumentError, match="calculator"):
        TorsionDynamics(Atoms("H"), 1.0)


def test_ase_is_imported_when_it_is_asked_for():
    program = (
        "import sys, phipsi; assert 'ase' not in sys.modules; sys.modules['ase'] = None\n"
        "try: phipsi.ase\n"
        "except ImportError as e: assert 'pip install ase' in str(e), e\n"
        "else: raise SystemExit('no error')"
    )
    subprocess.run([sys.executable, "-c", program], check=True)
