"""Molecules: energies and forces of OpenMM Systems, and dynamics in torsions.

Units are OpenMM's: nm, ps, Da, kJ/mol.

>>> s = phipsi.molecule.System.from_files("ala_dipeptide.pdb", "ala_dipeptide.xml")
>>> t = phipsi.molecule.TorsionModel(s)
>>> r = t.run(50, dt_fs=2, temperature_K=300, seed=1)
>>> len(r.time_ps), t.degrees_of_freedom
(51, 13)
"""

from ._native import Minimum, Run, System, TorsionModel
from ._replica_exchange import ReplicaExchange, exchange_probability, replica_exchange

__all__ = ["Minimum", "ReplicaExchange", "Run", "System", "TorsionModel", "exchange_probability", "replica_exchange"]
