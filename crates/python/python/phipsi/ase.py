"""ASE: the native force field as a calculator, and dynamics in torsions on any calculator.

ASE's units: Å, eV, amu, and Å √(amu/eV) for times. ASE is imported only here.

>>> import ase.units, phipsi.ase
>>> s = phipsi.molecule.System.from_files("ala_dipeptide.pdb", "ala_dipeptide.xml")
>>> atoms = phipsi.ase.atoms(s)
>>> dynamics = phipsi.ase.TorsionDynamics(atoms, 4 * ase.units.fs, bonds=s.bonds)
>>> dynamics.run(10)
True
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

try:
    from ase import Atoms, units
    from ase.calculators.calculator import Calculator as _Calculator
    from ase.calculators.calculator import all_changes
    from ase.data import chemical_symbols
    from ase.md.md import MolecularDynamics
    from ase.neighborlist import build_neighbor_list, natural_cutoffs
except ImportError as error:
    raise ImportError("phipsi.ase needs ASE: pip install ase") from error

from ._native import System, TorsionModel
from .errors import ArgumentError

__all__ = ["Calculator", "TorsionDynamics", "atoms", "bonds_by_distance"]

#: nm in Å.
_LENGTH = 10.0

#: kJ/mol in eV, of ASE's constants.
_ENERGY = units.kJ / units.mol

#: nm/ps in Å √(eV/amu).
_VELOCITY = _LENGTH / (1000 * units.fs)

#: Da nm²/ps² in eV: kJ/mol up to 3e-10, by which ASE's constants differ from each other. Energies of dynamics are in it, so that
#: ASE's kinetic energies belong to the potential energies.
_DYNAMIC_ENERGY = _VELOCITY**2


def atoms(system: System) -> Atoms:
    """The atoms of a System with its masses, at the positions of its file and with the native force field as calculator.

    >>> s = phipsi.molecule.System.from_files("ala_dipeptide.pdb", "ala_dipeptide.xml")
    >>> phipsi.ase.atoms(s).get_chemical_formula()
    'C6H12N2O2'
    """
    made = Atoms(numbers=system.atomic_numbers, positions=_LENGTH * system.positions, masses=system.masses)
    made.calc = Calculator(system)
    return made


class Calculator(_Calculator):
    """The force field of a System as an ASE calculator: energies in eV, forces in eV/Å, in double precision.

    ``system``: of the same atoms in the same order. There is no cell and no cutoff.

    >>> s = phipsi.molecule.System.from_files("ala_dipeptide.pdb", "ala_dipeptide.xml")
    >>> atoms = phipsi.ase.atoms(s)
    >>> atoms.calc = phipsi.ase.Calculator(s)
    >>> bool(np.isclose(atoms.get_potential_energy() * 96.4853, s.energy()["total"], rtol=1e-6))
    True
    """

    implemented_properties = ["energy", "free_energy", "forces"]

    def __init__(self, system: System, **keywords: Any) -> None:
        super().__init__(**keywords)
        self.system = system

    def calculate(self, atoms: Atoms | None = None, properties: Any = ("energy",), system_changes: Any = all_changes) -> None:
        """Energy and forces of the atoms' positions; called by ASE.

        >>> s = phipsi.molecule.System.from_files("ala_dipeptide.pdb", "ala_dipeptide.xml")
        >>> calculator = phipsi.ase.Calculator(s)
        >>> calculator.calculate(phipsi.ase.atoms(s))
        >>> sorted(calculator.results)
        ['energy', 'forces', 'free_energy']
        """
        super().calculate(atoms, properties, system_changes)
        _same(self.atoms, self.system)
        energy, forces = self.system._energy_and_forces(self.atoms.positions / _LENGTH)
        energy *= _ENERGY
        self.results = {"energy": energy, "free_energy": energy, "forces": forces * (_ENERGY / _LENGTH)}


def _same(atoms: Atoms, system: System) -> None:
    """Refuses atoms of another system."""
    elements = np.asarray(system.atomic_numbers)
    if len(atoms) != len(elements):
        message = f"`atoms` are {len(atoms)}, but {len(elements)} are required, those of the System"
        raise ArgumentError(message, argument="atoms", found=(len(atoms),), required=(len(elements),))
    # A particle that is no atom has no number.
    wrong = np.flatnonzero((atoms.numbers != elements) & (elements > 0))
    if len(wrong):
        i = wrong[0]
        found, required = chemical_symbols[atoms.numbers[i]], chemical_symbols[elements[i]]
        message = f"atom {i} of `atoms` is {found}, but {required} is required: {system.atom_names[i]} of the System"
        raise ArgumentError(message, argument="atoms", found=found, required=required, remedy="give the same atoms in the same order")


def bonds_by_distance(atoms: Atoms, factor: float = 1.2) -> list[tuple[int, int]]:
    """Pairs of atoms nearer than ``factor`` times the sum of their covalent radii, without regard to a cell.

    >>> s = phipsi.molecule.System.from_files("ala_dipeptide.pdb", "ala_dipeptide.xml")
    >>> phipsi.ase.bonds_by_distance(phipsi.ase.atoms(s)) == sorted(s.bonds)
    True
    """
    cutoffs = natural_cutoffs(atoms, mult=factor)
    open_atoms = atoms.copy()
    open_atoms.pbc = False
    neighbors = build_neighbor_list(open_atoms, cutoffs=cutoffs, self_interaction=False, bothways=True)
    pairs = {(i, int(j)) for i in range(len(atoms)) for j in neighbors.get_neighbors(i)[0]}
    return sorted((i, j) for i, j in pairs if i < j)


def _system(atoms: Atoms, bonds: Sequence[Sequence[int]]) -> System:
    """Atoms and bonds without a force field."""
    n = len(atoms)
    for bond in bonds:
        if len(bond) != 2 or not all(0 <= int(i) < n for i in bond) or bond[0] == bond[1]:
            required = f"pairs of two different atoms below {n}"
            message = f"`bonds` has {tuple(bond)}, but {required} are required"
            raise ArgumentError(message, argument="bonds", found=tuple(bond), required=required)
    # Names of their own, so that joints can be told apart: C0, H1, …
    table = [(f"{symbol}{i}", "MOL", "", 1, 0, symbol) for i, symbol in enumerate(atoms.get_chemical_symbols())]
    ordered = sorted({(min(int(i), int(j)), max(int(i), int(j))) for i, j in bonds})
    return System._from_atoms(list(atoms.get_masses()), table, [list(bond) for bond in ordered], atoms.positions / _LENGTH)


class RigidClusters:
    """What a TorsionDynamics adds to ``atoms.constraints``: ASE's temperature then counts the degrees of freedom of the clusters,
    and momenta that are set lose what the clusters cannot do.

    Velocities of a Maxwell–Boltzmann distribution of all atoms become one of the clusters: generalized momenta are kept.
    """

    def __init__(self, model: TorsionModel) -> None:
        self.model = model

    def get_removed_dof(self, atoms: Atoms) -> int:
        """3 n_atoms less the degrees of freedom of the clusters."""
        return 3 * len(atoms) - self.model.degrees_of_freedom

    def adjust_positions(self, atoms: Atoms, new: np.ndarray) -> None:
        """Nothing: dynamics refuses positions of other clusters, and names the distance."""

    def adjust_forces(self, atoms: Atoms, forces: np.ndarray) -> None:
        """Nothing: forces are those of the calculator."""

    def adjust_momenta(self, atoms: Atoms, momenta: np.ndarray) -> None:
        """Momenta of the clusters with the same generalized momenta."""
        _place(self.model, atoms)
        masses = atoms.get_masses()[:, None]
        self.model.velocities = momenta / masses / _VELOCITY
        momenta[:] = self.model.velocities * _VELOCITY * masses

    def __deepcopy__(self, memo: Any) -> "RigidClusters":
        # Copies of the atoms have the same clusters.
        return self


def _place(model: TorsionModel, atoms: Atoms) -> bool:
    """Takes over positions that are not those of the model; True if there are any."""
    if np.array_equal(atoms.positions, _LENGTH * model.positions):
        return False
    model.positions = atoms.positions / _LENGTH
    return True


class TorsionDynamics(MolecularDynamics):
    """Dynamics of rigid clusters joined by torsions, as an ASE dynamics, with the forces of ``atoms.calc``: any calculator.

    Observers, loggers and trajectories are attached as to every class of ``ase.md``. One evaluation of forces a step. Momenta of
    ``atoms`` are taken over, and positions and momenta that are changed between steps too; what the atoms do beside the clusters
    is lost. To start at a temperature, give ``ase.md.velocitydistribution.MaxwellBoltzmannDistribution(atoms, …)`` after this
    object is made, or call ``draw_velocities``.

    Parameters
    ----------
    atoms : with a calculator; other constraints than those of an earlier TorsionDynamics are refused.
    timestep : in ASE's unit, such as 4 * units.fs.
    bonds : pairs of atoms; None: by distance, see ``bonds_by_distance``.
    clusters, rigid, hinges : as in ``phipsi.molecule.TorsionModel``; atoms are called C0, H1, ….
    ensemble : "nve", "langevin", "nose_hoover" or "hmc"; of "hmc" a step is a whole trajectory of 50 fs.
    temperature_K, friction_per_ps, relaxation_ps, seed, fixman : as in ``TorsionModel.run``.
    trajectory, logfile, loginterval, … : as in ``ase.md``.

    >>> import ase.units
    >>> s = phipsi.molecule.System.from_files("ala_dipeptide.pdb", "ala_dipeptide.xml")
    >>> atoms = phipsi.ase.atoms(s)
    >>> dynamics = phipsi.ase.TorsionDynamics(atoms, 2 * ase.units.fs, bonds=s.bonds, rigid="omega")
    >>> dynamics.draw_velocities(300, seed=1)
    >>> energy = atoms.get_total_energy()
    >>> dynamics.run(100), dynamics.model.degrees_of_freedom, bool(abs(atoms.get_total_energy() - energy) < 5e-3)
    (True, 11, True)
    """

    def __init__(
        self,
        atoms: Atoms,
        timestep: float,
        trajectory: Any = None,
        logfile: Any = None,
        loginterval: int = 1,
        *,
        bonds: Sequence[Sequence[int]] | None = None,
        clusters: Any = None,
        rigid: Any = None,
        hinges: Any = None,
        ensemble: str = "nve",
        temperature_K: float = 300.0,
        friction_per_ps: float = 1.0,
        relaxation_ps: float = 0.1,
        seed: int = 0,
        fixman: bool = False,
        **keywords: Any,
    ) -> None:
        others = [c for c in atoms.constraints if not isinstance(c, RigidClusters)]
        if others:
            found = ", ".join(type(c).__name__ for c in others)
            message = f"`atoms` have the constraints {found}, but none are allowed: clusters and hinges say what moves"
            raise ArgumentError(message, argument="atoms", found=found, required="no constraints", remedy="atoms.set_constraint()")
        if atoms.calc is None:
            message = "`atoms` have no calculator, which gives the forces"
            raise ArgumentError(message, argument="atoms", found="None", required="a calculator", remedy="set atoms.calc")
        if not (np.isfinite(timestep) and timestep > 0):
            message = f"`timestep` is {timestep}, but a positive finite number is required"
            raise ArgumentError(message, argument="timestep", found=timestep, required="a positive finite number")
        system = _system(atoms, bonds_by_distance(atoms) if bonds is None else bonds)
        masses = atoms.get_masses()[:, None]
        momenta = atoms.get_momenta() if atoms.has("momenta") else np.zeros((len(atoms), 3))
        self.model = TorsionModel(system, clusters=clusters, rigid=rigid, hinges=hinges, forces=self._forces_of(atoms))
        self.model.velocities = momenta / masses / _VELOCITY
        atoms.set_constraint(RigidClusters(self.model))
        super().__init__(atoms, timestep, trajectory, logfile, loginterval, **keywords)
        self._arguments = {
            "dt_fs": timestep / units.fs,
            "ensemble": ensemble,
            "temperature_K": temperature_K,
            "friction_per_ps": friction_per_ps,
            "relaxation_ps": relaxation_ps,
            "seed": seed,
            "fixman": fixman,
        }
        steps = max(1, round(50 / self._arguments["dt_fs"])) if ensemble == "hmc" else 1
        self._steps = steps
        self._write_back()

    @staticmethod
    def _forces_of(atoms: Atoms):
        def forces(positions: np.ndarray) -> tuple[float, np.ndarray]:
            atoms.positions = _LENGTH * positions
            forces = atoms.get_forces(apply_constraint=False)
            # The energy that belongs to the forces, where the calculator has two.
            energy = atoms.get_potential_energy(force_consistent=consistent)
            return energy / _DYNAMIC_ENERGY, forces * (_LENGTH / _DYNAMIC_ENERGY)

        consistent = "free_energy" in getattr(atoms.calc, "implemented_properties", ())
        return forces

    def _write_back(self) -> None:
        """The model's state into the atoms, past their constraints."""
        self.atoms.positions = _LENGTH * self.model.positions
        self._momenta = self.model.velocities * _VELOCITY * self.masses
        self.atoms.set_momenta(self._momenta, apply_constraint=False)

    def _take_over(self) -> None:
        """Positions and momenta that were changed since the last step."""
        momenta = self.atoms.get_momenta()
        moved = _place(self.model, self.atoms)
        if moved or not np.array_equal(momenta, self._momenta):
            self.model.velocities = momenta / self.masses / _VELOCITY

    def draw_velocities(self, temperature_K: float, seed: int = 0) -> None:
        """Draws momenta from the Maxwell–Boltzmann distribution of the clusters.

        >>> import ase.units
        >>> s = phipsi.molecule.System.from_files("ala_dipeptide.pdb", "ala_dipeptide.xml")
        >>> atoms = phipsi.ase.atoms(s)
        >>> dynamics = phipsi.ase.TorsionDynamics(atoms, 2 * ase.units.fs, bonds=s.bonds)
        >>> dynamics.draw_velocities(300, seed=1)
        >>> bool(100 < atoms.get_temperature() < 600)
        True
        """
        self._take_over()
        self.model.draw_velocities(temperature_K, seed)
        self._write_back()

    def step(self) -> None:
        """One step of the method, or one Monte Carlo trajectory; ``run`` and ``irun`` call it.

        >>> import ase.units
        >>> s = phipsi.molecule.System.from_files("ala_dipeptide.pdb", "ala_dipeptide.xml")
        >>> dynamics = phipsi.ase.TorsionDynamics(phipsi.ase.atoms(s), 2 * ase.units.fs, bonds=s.bonds)
        >>> dynamics.step()
        >>> round(dynamics.model.time_ps, 12)
        0.002
        """
        self._take_over()
        try:
            self.model.run(self._steps, every=self._steps, **self._arguments)
        finally:
            # After an exception the atoms have the last good state, and not a trial one.
            self._write_back()

    def get_time(self) -> float:
        """Time since the start, in ASE's unit.

        >>> import ase.units
        >>> s = phipsi.molecule.System.from_files("ala_dipeptide.pdb", "ala_dipeptide.xml")
        >>> dynamics = phipsi.ase.TorsionDynamics(phipsi.ase.atoms(s), 2 * ase.units.fs, bonds=s.bonds)
        >>> dynamics.get_time()
        0.0
        """
        return self.nsteps * self._steps * self.dt

    def todict(self) -> dict[str, Any]:
        """What ASE's trajectories keep about the method.

        >>> import ase.units
        >>> s = phipsi.molecule.System.from_files("ala_dipeptide.pdb", "ala_dipeptide.xml")
        >>> phipsi.ase.TorsionDynamics(phipsi.ase.atoms(s), 1.0, bonds=s.bonds).todict()["md-type"]
        'TorsionDynamics'
        """
        return {**super().todict(), **self._arguments}
