"""Writes the scene of N four-bars in a row (IFToMM A02): python make_n_four_bar.py N T_END > n_four_bar.toml"""

import math
import sys
from decimal import Decimal, getcontext

G = 9.81


def main():
    n, t_end = int(sys.argv[1]), float(sys.argv[2])
    out = print
    out(f"# {n} four-bars in a row (IFToMM A02), written by make_n_four_bar.py {n} {t_end:g}: rods of 1 m and 1 kg, upright at the start,")
    out("# that pass the singular position in which all lie in one line.\n")
    out(f'title = "{n} four-bars in a row"\n\n[model]\ngravity = [0, 0, {-G}]\n')
    for i in range(n + 1):
        out(f'[[body]]\nname = "crank{i}"\ninertial = {{ mass = 1, origin = {{ xyz = [0, 0, 0.5] }}, '
            f"inertia = {{ ixx = {1 / 12!r}, iyy = {1 / 12!r} }} }}\n")
        out(f'[[joint]]\nname = "a{i}"\ntype = "continuous"\nparent = "world"\nchild = "crank{i}"\n'
            f"origin = {{ xyz = [{i}, 0, 0] }}\naxis = [0, 1, 0]\n")
    for i in range(n):
        out(f'[[body]]\nname = "coupler{i}"\ninertial = {{ mass = 1, origin = {{ xyz = [0.5, 0, 0] }}, '
            f"inertia = {{ iyy = {1 / 12!r}, izz = {1 / 12!r} }} }}\n")
        out(f'[[joint]]\nname = "b{i}"\ntype = "continuous"\nparent = "crank{i}"\nchild = "coupler{i}"\n'
            "origin = { xyz = [0, 0, 1] }\naxis = [0, 1, 0]\n")
        out(f'[[closure]]\nname = "pin{i}"\nkind = "revolute"\nbody_a = "coupler{i}"\n'
            f"pose_a = {{ xyz = [1, 0, 0], rpy = [{-math.pi / 2!r}, 0, 0] }}\n"
            f'body_b = "crank{i + 1}"\npose_b = {{ xyz = [0, 0, 1], rpy = [{-math.pi / 2!r}, 0, 0] }}\n')
    out("[initial]\nv.a0 = 1\nassemble = true                 # finds the other velocities\n")
    out(f'[integrator]\nt_end = {t_end:g}\nmethod = "dop853"\nrtol = 1e-12\n')
    out('[outputs]\nth = { joint = "a0" }\nthd = { joint = "a0", of = "v" }')
    out('B0_x = { body = "crank0", point = [0, 0, 1], axis = "x" }')
    out('B0_y = { body = "crank0", point = [0, 0, 1], axis = "z" }\n')
    th, thd, x, y = reference(n, t_end)
    out(f'[reference]\nsource = "closed form"\nth = {th:.24}\nthd = {thd:.24}\nB0_x = {x:.24}\nB0_y = {y:.24}')


def _taylor(theta, rate, h, k):
    """One step of θ̈ = k sin θ by its Taylor series, with those of s = sin θ and c = cos θ: ṡ = c θ̇, ċ = −s θ̇."""
    th, s, c = [theta, rate], [sin(theta)], [cos(theta)]
    for i in range(TERMS):
        s.append(sum((j + 1) * th[j + 1] * c[i - j] for j in range(i + 1)) / (i + 1))
        c.append(-sum((j + 1) * th[j + 1] * s[i - j] for j in range(i + 1)) / (i + 1))
        th.append(k * s[i] / ((i + 1) * (i + 2)))
    theta = sum(x * h**i for i, x in enumerate(th))
    rate = sum(i * x * h ** (i - 1) for i, x in enumerate(th) if i)
    return theta, rate


def sin(x):
    term, total, i = x, x, 1
    while abs(term) > Decimal(10) ** -DIGITS:
        term *= -x * x / ((i + 1) * (i + 2))
        total, i = total + term, i + 2
    return total


def cos(x):
    return sin(x + PI / 2)


def reference(n, t_end):
    """Angle and rate of the cranks, and the first tip: they turn as one pendulum, θ̈ = (g C / I) sin θ."""
    count = Decimal(n)
    k = Decimal(str(G)) * ((count + 1) / 2 + count) / ((count + 1) / 3 + count)
    theta, rate, steps = Decimal(0), Decimal(1), round(t_end * 50)
    for _ in range(steps):
        theta, rate = _taylor(theta, rate, Decimal(str(t_end)) / steps, k)
    return theta, rate, sin(theta), cos(theta)


DIGITS, TERMS = 40, 40
getcontext().prec = DIGITS + 10
PI = Decimal("3.14159265358979323846264338327950288419716939937510582")

if __name__ == "__main__":
    main()
