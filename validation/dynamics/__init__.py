"""Torsion dynamics of phipsi beside Cartesian dynamics of OpenMM, on one page.

    python -m validation.dynamics                               alanine dipeptide
    python -m validation.dynamics MY.pdb MY.xml                 one's own molecule, without cutoff
    python -m validation.dynamics --ps 50 --out dynamics.html
    python -m validation.dynamics --molecules FOLDER            the whole comparison: alanine dipeptide, Ala10, Trp-cage
    python -m validation.dynamics --molecules FOLDER --page     and docs/src/torsion_dynamics.md from it

For one molecule: constant energy from 300 K, noise and drift of the energy against the step and against the wall time of a
picosecond, for rigid clusters joined by torsions (phipsi, double precision), for all atoms and for all atoms with bonds to hydrogen
constrained (OpenMM, Verlet; Reference platform, double precision). Then the distribution of the first backbone φ and ψ.

The whole comparison has four parts, which ``--parts`` selects: largest steps, cost, distributions of φ and ψ, peptides that keep
their fold. FOLDER holds a folder for each molecule, as ``validation/data/molecules``. ``--results FILE`` keeps what has been measured,
so that parts can be run one after the other and the page be made of all.
"""
