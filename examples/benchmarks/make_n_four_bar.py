"""Writes the scene of N four-bars in a row (IFToMM A02): python make_n_four_bar.py N T_END > n_four_bar.toml"""

import math
import sys

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
    known = REFERENCE.get((n, t_end))
    if known:
        th, thd, x, y = known
        out(f'[reference]\nsource = "closed form"\nth = {th}\nthd = {thd}\nB0_x = {x}\nB0_y = {y}')


# Angle, rate, position of the first crank tip: closed form with elliptic functions.
REFERENCE = {
    (1, 10.0): ("31.91474129773802450860911", "1.966934719440319456327407", "0.4783850577609705590053952", "0.8781501787912093011639041"),
    (2, 10.0): ("31.75059718698610181708135", "1.506642180841829469894272", "0.3284581115408153786521642", "0.9445185381786009621612854"),
    (10, 20.0): ("63.33000535361435239418455", "1.924668404080291484546628", "0.4778031958773461430904545", "0.8784669066102572276517592"),
    (40, 20.0): ("63.25529536819092803906410", "1.718569610055737259494584", "0.4109011537629452221452456", "0.9116799009719806516314131"),
}

if __name__ == "__main__":
    main()
