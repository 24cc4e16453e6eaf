"""Makes the two files that phipsi reads from a PDB: hydrogens, AMBER ff14SB, and with --obc2 an implicit solvent.

    pip install openmm
    python examples/make_system.py protein.pdb ready --obc2 --minimize      # writes ready.pdb and ready.xml
    phipsi energy ready.pdb --system ready.xml
"""

import argparse

from openmm import LangevinIntegrator, Platform, XmlSerializer, app

parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument("pdb", help="the structure, without water; missing hydrogens are added at pH 7")
parser.add_argument("out", help="writes OUT.pdb and OUT.xml")
parser.add_argument("--obc2", action="store_true", help="implicit solvent: generalized Born with OBC2 radii")
parser.add_argument("--minimize", action="store_true", help="minimize the energy")
given = parser.parse_args()

pdb = app.PDBFile(given.pdb)
field = app.ForceField("amber14/protein.ff14SB.xml", *(["implicit/obc2.xml"] if given.obc2 else []))
modeller = app.Modeller(pdb.topology, pdb.positions)
modeller.addHydrogens(field, pH=7.0)
# phipsi has no cutoffs; torsion models keep bond lengths and angles by themselves.
system = field.createSystem(modeller.topology, nonbondedMethod=app.NoCutoff, constraints=None, removeCMMotion=False)
simulation = app.Simulation(
    modeller.topology, system, LangevinIntegrator(300, 1, 0.001), Platform.getPlatformByName("Reference")
)
simulation.context.setPositions(modeller.positions)
if given.minimize:
    simulation.minimizeEnergy(tolerance=0.1)
positions = simulation.context.getState(positions=True).getPositions()
with open(f"{given.out}.pdb", "w") as file:
    app.PDBFile.writeFile(modeller.topology, positions, file)
with open(f"{given.out}.xml", "w") as file:
    file.write(XmlSerializer.serialize(system))
