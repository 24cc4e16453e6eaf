"""Writes openmm.txt: values and slopes of expressions by OpenMM's own parser. Needs the package openmm.

Each expression is the energy of one particle at (x, y, z); the slopes are minus the force. The last two columns are
scales of the value and of the slopes: their sizes plus what relative changes of the coordinates do to them.
"""

import math
import random

import openmm
from openmm import unit

WRITTEN = """1+2*3; 2^3^2; -2^2; (-2)^2; 2^-2; 2^-1^2; 2*-3; --2; 1--2; 10-4-3; 24/4/3; 24/4*3; -x^2; x^-y; -x^-y^2; x*-y
x/y/z; x-y-z; x-(y-z); x/(y/z); x^y^z; (x^y)^z; 2e-3*x; .5*y; 5.*z; 1.5E+2*x; sqrt(x); exp(x); log(x); sin(x); cos(x)
tan(x); sec(x); csc(x); cot(x); asin(x/9); acos(x/9); atan(x); atan2(x, y); atan2(y, x); sinh(x); cosh(x); tanh(x)
erf(x); erfc(x); step(x-y); delta(x-y); square(x); cube(x); recip(x); min(x, y); max(x, y); abs(x-y); floor(x); ceil(x)
select(x-x, y, x); select(x, x*y, z); select(step(x-1), x^2, x^3); x^12-x^6; (x/2)^-4; x^2.5; x^0.5; x^y; y^x; 2^x
exp(-x^2/2)*cos(3*y+z); x*y/(1+x^2); log(1+exp(x)); sin(x)^2+cos(x)^2; (x+y)*(x-y)""".replace("\n", "; ").split("; ")

DEFINED = [
    "a*b; b=x^2; a=3",
    "a*b; b=a^2; a=3*y",
    "x; x=x+1",
    "b; b=b+1; b=x*z",
    "4*e*((s/x)^12-(s/x)^6); s=0.5*(y+z); e=sqrt(y*z)",
    "0.5*k*(x-r0)^2; k=4; r0=y;",
]


def random_expression(r, depth):
    """Operators without parentheses that would hide how they bind."""
    kind = r.random()
    if depth == 0 or kind < 0.15:
        return r.choice(["x", "y", "z", "2", "0.5", "3.25"])
    if kind < 0.25:
        return "-" + random_expression(r, depth - 1)
    if kind < 0.35:
        return "(" + random_expression(r, depth - 1) + ")"
    if kind < 0.45:
        return r.choice(["sin", "cos", "atan", "tanh", "exp", "abs", "square"]) + "(" + random_expression(r, depth - 1) + ")"
    if kind < 0.5:
        return r.choice(["min", "max", "atan2"]) + "(" + random_expression(r, depth - 1) + "," + random_expression(r, depth - 1) + ")"
    return random_expression(r, depth - 1) + r.choice("+-*/^") + random_expression(r, depth - 1)


def evaluator(text):
    system = openmm.System()
    system.addParticle(1.0)
    force = openmm.CustomExternalForce(text)
    force.addParticle(0, [])
    system.addForce(force)
    integrator = openmm.VerletIntegrator(0.001)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName("Reference"))

    def evaluate(at):
        context.setPositions([openmm.Vec3(*at)])
        state = context.getState(getEnergy=True, getForces=True)
        energy = state.getPotentialEnergy().value_in_unit(unit.kilojoule_per_mole)
        force = state.getForces()[0].value_in_unit(unit.kilojoule_per_mole / unit.nanometer)
        return [energy, *(-f for f in force)]

    return evaluate


def main():
    r = random.Random(7)
    texts = WRITTEN + DEFINED + [random_expression(r, 4) for _ in range(200)]
    with open("openmm.txt", "w") as file:
        file.write(f"# OpenMM {openmm.__version__}, Reference platform, made by make.py\n")
        file.write("# expression | x y z | value | slopes | scale of the value | scale of the slopes\n")
        for text in dict.fromkeys(texts):
            evaluate = evaluator(text)
            at = [r.uniform(0.2, 2.5) for _ in range(3)]
            values = evaluate(at)
            if not all(math.isfinite(v) and abs(v) < 1e6 for v in values):
                continue
            scales = [abs(v) for v in values]
            for i in range(3):
                other = list(at)
                other[i] *= 1 + 1e-6
                for k, (a, b) in enumerate(zip(values, evaluate(other))):
                    scales[k] += abs(a - b) * 1e6
            if not all(math.isfinite(s) and s < 1e8 for s in scales):
                continue
            numbers = [at, values[:1], values[1:], scales[:1], [max(scales[1:])]]
            file.write(" | ".join([text] + [" ".join(map(repr, part)) for part in numbers]) + "\n")


main()
