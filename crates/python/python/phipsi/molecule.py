"""Molecules: energies and forces of OpenMM Systems.

Units are OpenMM's: nm, ps, Da, kJ/mol.

>>> s = phipsi.molecule.System.from_files("ala_dipeptide.pdb", "ala_dipeptide.xml")
>>> sorted(s.energy())
['HarmonicAngleForce', 'HarmonicBondForce', 'NonbondedForce', 'PeriodicTorsionForce', 'total']
"""

from ._native import System

__all__ = ["System"]
