"""Systems with cutoffs, and their energies and forces by OpenMM's Reference platform: ``python make.py FOLDER``, then gzip.

The molecules and structures beside this folder, with the method CutoffNonPeriodic in every force between pairs, as
``ForceField.createSystem`` sets it (CutoffPeriodic in two boxes smaller than the molecule): reaction field, switching, generalized Born energies that end at the cutoff, custom forces.
"""

import gzip
import json
import sys
from pathlib import Path

import openmm as mm
from openmm import unit

MOLECULES = Path(__file__).resolve().parent.parent


def system(name, environment):
    file = f"{environment}.xml.gz" if name == "every_force" else f"{name}.{environment}.xml.gz"
    return mm.XmlSerializer.deserialize(
        gzip.decompress((MOLECULES / name / file).read_bytes()).decode()
    )


def cut(s, cutoff, switching=None, dielectric=78.3):
    for f in s.getForces():
        if not hasattr(f, "setCutoffDistance"):
            continue
        f.setNonbondedMethod(type(f).CutoffNonPeriodic)
        f.setCutoffDistance(cutoff)
        if switching and hasattr(f, "setUseSwitchingFunction"):
            f.setUseSwitchingFunction(True)
            f.setSwitchingDistance(switching)
        if isinstance(f, mm.NonbondedForce):
            f.setReactionFieldDielectric(dielectric)
        if isinstance(f, mm.CustomGBForce) and "1/soluteDielectric" in str(f.getEnergyTermParameters(1)[0]):
            # As implicit/obc2.xml does.
            for k in range(f.getNumEnergyTerms()):
                text, kind = f.getEnergyTermParameters(k)
                f.setEnergyTermParameters(k, text.replace("charge2/f;", f"charge2*(1/f-{1 / cutoff});"), kind)
    return s


def periodic(s, vectors, cutoff, switching=None, exceptions=False):
    s.setDefaultPeriodicBoxVectors(*(mm.Vec3(*v) for v in vectors))
    for f in s.getForces():
        if isinstance(f, mm.NonbondedForce):
            f.setNonbondedMethod(mm.NonbondedForce.CutoffPeriodic)
            f.setCutoffDistance(cutoff)
            f.setExceptionsUsePeriodicBoundaryConditions(exceptions)
            f.setUseDispersionCorrection(True)
            f.setUseSwitchingFunction(switching is not None)
            f.setSwitchingDistance(switching or -1)
    return s


RIGHT = [(1.5, 0, 0), (0, 1.6, 0), (0, 0, 1.7)]
# In a box as oblique as (1.5, 0, 0), (0.4, 1.45, 0), (-0.6, 0.5, 1.42) the Reference platform of OpenMM 8.6.1 differs from its CPU
# platform and from a double loop, which agree.
OBLIQUE = [(1.5, 0, 0), (0.2, 1.45, 0), (-0.2, 0.2, 1.42)]

CASES = {
    "reaction_field": lambda: cut(system("met_enkephalin", "vacuum"), 0.7),
    "switched": lambda: cut(system("met_enkephalin", "vacuum"), 0.8, 0.5),
    "born": lambda: cut(system("ace_ala3_nme", "obc2_native"), 0.6, None, 1.0),
    "custom_born": lambda: cut(system("met_enkephalin", "obc2"), 0.7, None, 1.0),
    "charmm": lambda: cut(system("ace_ala3_nme", "charmm36"), 0.7, 0.5),
    "custom_pairs": lambda: cut(system("every_force", "pairs"), 0.3, 0.2),
    "periodic": lambda: periodic(system("met_enkephalin", "vacuum"), RIGHT, 0.75),
    "periodic_switched": lambda: periodic(system("met_enkephalin", "vacuum"), OBLIQUE, 0.7, 0.5, True),
    "custom_implicit": lambda: cut(system("every_force", "implicit"), 0.3),
}


def file(name, case):
    """Reference data of the molecule of a case."""
    folder = MOLECULES / name
    return json.loads(gzip.decompress((folder / f"{case or name}.ref.json.gz").read_bytes()))


def structures(case):
    source = {"born": "ace_ala3_nme", "charmm": "ace_ala3_nme"}.get(case, "met_enkephalin")
    if case in ("custom_pairs", "custom_implicit"):
        found = file("every_force", case.removeprefix("custom_"))
    else:
        found = file(source, None)
    return [c["positions"] for c in found["conformations"]][:3]


out = Path(sys.argv[1])
for case, build in CASES.items():
    s = build()
    for k in reversed(range(s.getNumForces())):
        if isinstance(s.getForce(k), (mm.CMMotionRemover, mm.MonteCarloBarostat)):
            s.removeForce(k)
    # Only what a cutoff changes. Which of two particles is the first is not defined where OpenMM has a list of neighbours: energies
    # that depend on it are left out, or made symmetric.
    for k in reversed(range(s.getNumForces())):
        f = s.getForce(k)
        if not hasattr(f, "setCutoffDistance") or f.getName() in ("tables", "chain") or (f.getName(), case) == ("LennardJones", "custom_pairs"):
            s.removeForce(k)
        elif f.getName() == "CustomNonbondedForce":
            f.setEnergyFunction("a1*a2*exp(-(b1+b2)*r)")
    for k, f in enumerate(s.getForces()):
        f.setForceGroup(k)
    xml = mm.XmlSerializer.serialize(s)
    (out / f"{case}.xml").write_text(xml)
    # Everything is evaluated from the file.
    s = mm.XmlSerializer.deserialize(xml)
    c = mm.Context(s, mm.VerletIntegrator(0.001), mm.Platform.getPlatformByName("Reference"))
    result = {"name": case, "openmm": mm.__version__, "platform": "Reference", "conformations": []}
    for x in structures(case):
        c.setPositions(x)
        terms = {}
        for k, f in enumerate(s.getForces()):
            name = f.getName()
            count = sum(key.split("#")[0] == name for key in terms)
            st = c.getState(energy=True, forces=True, groups={k})
            terms[name + (f"#{count + 1}" if count else "")] = {
                "energy": st.getPotentialEnergy().value_in_unit(unit.kilojoule_per_mole),
                "forces": st.getForces(asNumpy=True).value_in_unit(unit.kilojoule_per_mole / unit.nanometer).tolist(),
            }
        result["conformations"].append({"positions": x, "terms": terms})
    (out / f"{case}.ref.json").write_text(json.dumps(result, separators=(",", ":")))
    print(case, s.getNumParticles(), {k: v["energy"] for k, v in terms.items()})
