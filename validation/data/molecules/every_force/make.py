"""Writes small systems with every kind of force that phipsi reads, and their energies and forces by OpenMM's Reference platform."""

import json
import sys

import numpy as np
import openmm as mm
from openmm import unit

rng = np.random.default_rng(20261124)
N = 9


def positions(k):
    r = np.random.default_rng(100 + k)
    while True:
        x = r.uniform(-0.35, 0.35, (N, 3))
        d = np.linalg.norm(x[:, None] - x[None], axis=2) + np.eye(N)
        if d.min() > 0.16:
            return x


def system():
    s = mm.System()
    for i in range(N):
        s.addParticle(float(rng.uniform(1, 20)))
    s.setDefaultPeriodicBoxVectors((2, 0, 0), (0, 2, 0), (0, 0, 2))
    return s


def quads(n):
    return [tuple(int(a) for a in rng.permutation(N)[:4]) for _ in range(n)]


def u(a, b):
    return float(rng.uniform(a, b))


def bonded():
    s = system()
    s.addConstraint(0, 1, 0.21)
    f = mm.HarmonicBondForce()
    f.setName("springs")
    for i in range(N - 1):
        f.addBond(i, i + 1, u(0.1, 0.3), u(100, 5000))
    s.addForce(f)
    f = mm.HarmonicBondForce()
    f.setName("springs")
    f.addBond(8, 2, 0.25, 321.5)
    s.addForce(f)
    f = mm.HarmonicAngleForce()
    for q in quads(6):
        f.addAngle(*q[:3], u(0.5, 3.1), u(10, 500))
    s.addForce(f)
    f = mm.PeriodicTorsionForce()
    for q in quads(4):
        for n in (1, 2, 3, 6):
            f.addTorsion(*q, n, u(-3, 3), u(-20, 20))
    s.addForce(f)
    f = mm.RBTorsionForce()
    for q in quads(5):
        f.addTorsion(*q, *[u(-10, 10) for _ in range(6)])
    s.addForce(f)
    f = mm.CMAPTorsionForce()
    for n in (3, 4, 11):
        f.addMap(n, [u(-10, 10) for _ in range(n * n)])
    for k, (a, b) in enumerate(zip(quads(6), quads(6))):
        f.addTorsion(k % 3, *a, *b)
    s.addForce(f)
    f = mm.CustomBondForce("D*(1-exp(-a*(r-r0)))^2 + lift*r; a=3+lift")
    f.setName("morse")
    f.addGlobalParameter("lift", 0.75)
    for n in ("D", "r0"):
        f.addPerBondParameter(n)
    for i in range(5):
        f.addBond(i, i + 3, [u(10, 50), u(0.1, 0.3)])
    s.addForce(f)
    f = mm.CustomAngleForce("k*(cos(theta)-cos(theta0))^2 + lift*theta^3")
    f.setName("cosine")
    f.addGlobalParameter("lift", 0.75)
    for n in ("k", "theta0"):
        f.addPerAngleParameter(n)
    for q in quads(5):
        f.addAngle(*q[:3], [u(10, 50), u(0.5, 3)])
    s.addForce(f)
    f = mm.CustomTorsionForce("k*min(dtheta, 2*pi-dtheta)^2; dtheta = abs(theta-theta0); pi = 3.1415926535")
    f.setName("improper")
    for n in ("k", "theta0"):
        f.addPerTorsionParameter(n)
    for q in quads(5):
        f.addTorsion(*q, [u(10, 50), u(-3, 3)])
    s.addForce(f)
    s.addForce(mm.CMMotionRemover(10))
    s.addForce(mm.MonteCarloBarostat(1, 300))
    return s


def pairs():
    s = system()
    f = mm.NonbondedForce()
    f.setNonbondedMethod(f.NoCutoff)
    for i in range(N):
        f.addParticle(u(-1, 1), u(0.1, 0.3), u(0, 1) if i else 0)
    f.addException(0, 1, 0, 1, 0)
    f.addException(5, 2, 0.3, 0.2, 0.5)
    f.addException(3, 4, -0.1, 0.2, 0)
    s.addForce(f)
    f = mm.CustomNonbondedForce(
        "scale*q1*q2*smooth(r)/r + wave(angle) + site(kind1)*kinds(kind1, kind2)*exp(-b*r) + cube3(kind1, 1, kind2)*r^2; angle = 5*r + site(kind2); b = 1.5"
    )
    f.setName("tables")
    f.addGlobalParameter("scale", 20.0)
    f.addPerParticleParameter("q")
    f.addPerParticleParameter("kind")
    for i in range(N):
        f.addParticle([u(-1, 1), i % 3])
    xs = np.linspace(0.1, 0.7, 12)
    f.addTabulatedFunction("smooth", mm.Continuous1DFunction(list(np.cos(3 * xs)), 0.1, 0.7))
    p = [u(-2, 2) for _ in range(9)]
    f.addTabulatedFunction("wave", mm.Continuous1DFunction(p + [p[0]], -1.0, 1.5, True))
    f.addTabulatedFunction("site", mm.Discrete1DFunction([0.5, -1.25, 2.0]))
    f.addTabulatedFunction("kinds", mm.Discrete2DFunction(3, 3, [u(-3, 3) for _ in range(9)]))
    f.addTabulatedFunction("cube3", mm.Discrete3DFunction(3, 2, 3, [u(-3, 3) for _ in range(18)]))
    f.addExclusion(7, 3)
    f.addExclusion(0, 8)
    s.addForce(f)
    f = mm.CustomNonbondedForce("acoef(type1, type2)/r^12 - bcoef(type1, type2)/r^6;")
    f.setName("LennardJones")
    f.addPerParticleParameter("type")
    for i in range(N):
        f.addParticle([(5 * i) % 4])
    f.addTabulatedFunction("acoef", mm.Discrete2DFunction(4, 4, [u(1e-10, 1e-8) for _ in range(16)]))
    f.addTabulatedFunction("bcoef", mm.Discrete2DFunction(4, 4, [u(1e-6, 1e-3) for _ in range(16)]))
    f.addExclusion(1, 2)
    s.addForce(f)
    # The two arguments of an asymmetric energy: first the particle with the smaller index.
    f = mm.CustomNonbondedForce("a1*exp(-b2*r)")
    f.addPerParticleParameter("a")
    f.addPerParticleParameter("b")
    for i in range(N):
        f.addParticle([u(-1, 1), u(1, 5)])
    s.addForce(f)
    return s


def implicit():
    s = system()
    f = mm.GBSAOBCForce()
    f.setSolventDielectric(61.0)
    f.setSoluteDielectric(1.5)
    f.setSurfaceAreaEnergy(1.9)
    for i in range(N):
        f.addParticle(u(-1, 1), u(0.11, 0.2), u(0.6, 1.0))
    # A small atom inside a large one.
    f.setParticleParameters(0, 0.4, 0.35, 0.95)
    f.setParticleParameters(1, -0.3, 0.02, 0.8)
    s.addForce(f)

    def gb(name):
        f = mm.CustomGBForce()
        f.setName(name)
        for n in ("charge", "or", "sr"):
            f.addPerParticleParameter(n)
        for i in range(N):
            o = [0.111, 0.15, 0.161][i % 3]
            f.addParticle([u(-1, 1), o, o * u(0.7, 0.95)])
        f.setParticleParameters(0, [0.4, 0.34, 0.33])
        f.setParticleParameters(1, [-0.3, 0.02, 0.015])
        f.addComputedValue(
            "I",
            "select(step(r+sr2-or1), 0.5*(1/L-1/U+0.25*(r-sr2^2/r)*(1/(U^2)-1/(L^2))+0.5*log(L/U)/r), 0);U=r+sr2;L=max(or1, D);D=abs(r-sr2)",
            f.ParticlePairNoExclusions,
        )
        return f

    # OBC2 as OpenMM's Python writes it, without the surface term.
    f = gb("obc2")
    f.addComputedValue(
        "B",
        "1/(1/or-tanh(psi-0.8*psi^2+4.85*psi^3)/radius);psi=I*or; radius=or+offset; offset=0.009",
        f.SingleParticle,
    )
    f.addEnergyTerm(
        "-0.5*138.935485*(1/soluteDielectric-1/solventDielectric)*charge^2/B; solventDielectric=78.5; soluteDielectric=1; kappa=0; offset=0.009",
        f.SingleParticle,
    )
    f.addEnergyTerm(
        "-138.935485*(1/soluteDielectric-1/solventDielectric)*charge1*charge2/f;f=sqrt(r^2+B1*B2*exp(-r^2/(4*B1*B2))); solventDielectric=78.5; soluteDielectric=1; kappa=0; offset=0.009",
        f.ParticlePairNoExclusions,
    )
    s.addForce(f)
    # OBC1 with salt and surface term.
    f = gb("obc1 with salt")
    f.addComputedValue(
        "B",
        "1/(1/or-tanh(0.8*psi+2.909125*psi^3)/radius);psi=I*or; radius=or+offset; offset=0.009",
        f.SingleParticle,
    )
    tail = "; solventDielectric=78.5; soluteDielectric=1; kappa=0.9; offset=0.009"
    f.addEnergyTerm(
        "-0.5*138.935485*(1/soluteDielectric-exp(-kappa*B)/solventDielectric)*charge^2/B" + tail,
        f.SingleParticle,
    )
    f.addEnergyTerm("28.3919551*(radius+0.14)^2*(radius/B)^6; radius=or+offset" + tail, f.SingleParticle)
    f.addEnergyTerm(
        "-138.935485*(1/soluteDielectric-exp(-kappa*f)/solventDielectric)*charge1*charge2/f;f=sqrt(r^2+B1*B2*exp(-r^2/(4*B1*B2)))"
        + tail,
        f.ParticlePairNoExclusions,
    )
    s.addForce(f)
    # Everything that a CustomGBForce can do: exclusions, tables, a chain of values, a global parameter.
    f = mm.CustomGBForce()
    f.setName("chain")
    for n in ("a", "kind"):
        f.addPerParticleParameter(n)
    f.addGlobalParameter("reach", 4.0)
    for i in range(N):
        f.addParticle([u(0.5, 1.5), i % 2])
    f.addTabulatedFunction("weight", mm.Discrete2DFunction(2, 2, [0.5, 1.0, 1.5, 0.25]))
    f.addTabulatedFunction("curve", mm.Continuous1DFunction([1.0, 0.6, 0.5, 0.1, -0.2], 0.0, 0.9))
    f.addComputedValue("density", "a2*weight(kind1, kind2)*exp(-reach*r^2)*curve(r)", f.ParticlePair)
    f.addComputedValue("root", "sqrt(1+density^2)", f.SingleParticle)
    f.addComputedValue("mixed", "root*density+a", f.SingleParticle)
    f.addEnergyTerm("mixed*root", f.SingleParticle)
    f.addEnergyTerm("3*mixed1*root2*exp(-r)+density1*a2", f.ParticlePair)
    f.addEnergyTerm("mixed1*mixed2/r", f.ParticlePairNoExclusions)
    f.addExclusion(2, 6)
    f.addExclusion(8, 0)
    s.addForce(f)
    return s


out = sys.argv[1]
for name, build in (("bonded", bonded), ("pairs", pairs), ("implicit", implicit)):
    s = build()
    for k, f in enumerate(s.getForces()):
        f.setForceGroup(k)
    xml = mm.XmlSerializer.serialize(s)
    with open(f"{out}/{name}.xml", "w") as f:
        f.write(xml)
    # Everything is evaluated from the file.
    s = mm.XmlSerializer.deserialize(xml)
    for k in reversed(range(s.getNumForces())):
        if isinstance(s.getForce(k), (mm.CMMotionRemover, mm.MonteCarloBarostat)):
            s.removeForce(k)
    c = mm.Context(s, mm.VerletIntegrator(0.001), mm.Platform.getPlatformByName("Reference"))
    result = {"name": name, "openmm": mm.__version__, "platform": "Reference", "conformations": []}
    for k in range(4):
        x = positions(k)
        if k == 3 and name == "implicit":
            x = x * 0.6  # atoms inside atoms
        c.setPositions(x)
        seen, terms = {}, {}
        for g, f in enumerate(s.getForces()):
            key = f.getName()
            seen[key] = seen.get(key, 0) + 1
            if seen[key] > 1:
                key += f"#{seen[key]}"
            st = c.getState(getEnergy=True, getForces=True, groups={f.getForceGroup()})
            terms[key] = {
                "energy": st.getPotentialEnergy().value_in_unit(unit.kilojoule_per_mole),
                "forces": st.getForces(asNumpy=True)
                .value_in_unit(unit.kilojoule_per_mole / unit.nanometer)
                .tolist(),
            }
        result["conformations"].append({"positions": x.tolist(), "terms": terms})
    with open(f"{out}/{name}.ref.json", "w") as f:
        json.dump(result, f, separators=(",", ":"))
    print(name, {k: v["energy"] for k, v in terms.items()})
