"""Torsion models: reference mass matrices, rigid clusters, dynamics, trajectories, arguments."""

from __future__ import annotations

import _thread
import gzip
import json
import threading

import mdtraj
import numpy as np
import pytest

import phipsi

from .common import EPSILON, MOLECULE
from .test_molecule import DATA, System, unpack

TorsionModel = phipsi.molecule.TorsionModel

#: kJ/mol/K (CODATA 2018).
BOLTZMANN = 0.00831446261815324


@pytest.fixture(scope="module")
def s():
    return System.from_files(*MOLECULE)


@pytest.fixture
def t(s):
    return TorsionModel(s)


REFERENCES = sorted(path.parent.name for path in DATA.glob("*/*.torsion_model.json.gz"))


def test_there_are_references():
    assert len(REFERENCES) >= 5


KINDS = {"all": [], "no_omega_planar_methyl": ["omega", "planar", "methyl"]}


def velocities_of(model: dict, u: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Velocities of the atoms from the reference's speeds: ω and v of each base, then rates about the hinges."""
    cluster_of = {atom: c for c, atoms in enumerate(model["clusters"]) for atom in atoms}
    twist = {}
    bases = model["bases_cluster_origin_atom"]
    for k, (cluster, origin) in enumerate(bases):
        omega, v = u[6 * k : 6 * k + 3], u[6 * k + 3 : 6 * k + 6]
        twist[cluster] = omega, v - np.cross(omega, x[origin])
    for k, (parent, child, i, j) in enumerate(model["hinges"]):
        omega, v = twist[parent]
        rate = u[6 * len(bases) + k] * (x[j] - x[i]) / np.linalg.norm(x[j] - x[i])
        twist[child] = omega + rate, v - np.cross(rate, x[j])
    return np.array([twist[cluster_of[a]][1] + np.cross(twist[cluster_of[a]][0], x[a]) for a in range(len(x))])


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", REFERENCES)
def test_reference_models(tmp_path, name, kind):
    """Clusters, ln det M, kinetic energy, and accelerations of all atoms by brute force."""
    environment = "charmm36" if name == "butane" else "vacuum"
    s = System.from_files(*unpack(name, environment, tmp_path))
    reference = json.loads(gzip.decompress((DATA / name / f"{name}.ref.json.gz").read_bytes()))
    model = json.loads(gzip.decompress((DATA / name / f"{name}.torsion_model.json.gz").read_bytes()))["models"].get(kind)
    if model is None:
        assert name == "butane" and kind != "all"
        return
    positions = {c["id"]: np.array(c["positions"]) for c in reference["conformations"]}
    for case in model["conformations"]:
        x = positions[case["id"]]
        t = TorsionModel(s, x, rigid=KINDS[kind])
        assert sorted(map(sorted, t.clusters)) == sorted(map(sorted, model["clusters"]))
        assert t.degrees_of_freedom == model["n_speeds"] == t.model.nv
        wanted = sorted(tuple(sorted(hinge[2:])) for hinge in model["hinges"])
        assert sorted(tuple(sorted(atoms)) for _, atoms, _ in t.hinges) == wanted
        # Determinants of condition numbers up to 1e6, of sums of squares of coordinates up to 3 nm.
        logarithm = np.linalg.slogdet(t.model.mass_matrix(t.q))[1]
        assert abs(logarithm - case["lndetM"]) < 1e-9 * len(model["hinges"]), case["id"]
        u = velocities_of(model, np.array(case["u"]), x)
        t.velocities = u
        assert np.abs(t.velocities - u).max() < 1e-9 * np.abs(u).max()
        assert abs(t.model.kinetic_energy(t.q, t.v) / case["ke"] - 1) < 1e-9
        known = case[environment].get("atom_acceleration")
        if known is None:
            assert name == "met_enkephalin"
            continue
        # Second differences of short runs forward and backward: h²ω²/12 with rotors of ω up to 100/ps, 4 ε x/h².
        h = 1e-4
        after = t.run(1, dt_fs=1e3 * h).positions[-1]
        t.positions = x
        t.velocities = -u
        before = t.run(1, dt_fs=1e3 * h).positions[-1]
        acceleration, known = (after - 2 * x + before) / h**2, np.array(known)
        bound = 1e-4 * np.abs(known).max() + 100 * EPSILON * np.abs(x).max() / h**2
        assert np.abs(acceleration - known).max() < bound, case["id"]


def test_the_model_is_an_ordinary_one(s, t):
    m = t.model
    assert isinstance(m, phipsi.Model) and m.nv == t.degrees_of_freedom == 13 and m.gravity == (0, 0, 0)
    assert "ALA2:N-CA" in m.joint_names and "8 clusters" in m.report.used[0].what
    assert {kind for _, _, kind in t.hinges} == {"omega", "backbone_phi", "backbone_psi", "methyl"}
    assert t.system is s
    mass = m.momentum(t.q, np.eye(13)[3])[3:]
    assert abs(np.linalg.norm(mass) - s.masses.sum()) < 1e-9
    # A turn about phi turns phi, and nothing else: distances within clusters stay.
    q = np.stack([m.neutral()] * 3)
    q[:, m.joint_q_offset("ALA2:N-CA")] = [0.0, 0.5, -2.0]
    x = t.atom_positions(q)
    names = s.atom_names
    phi = [names.index(a) for a in ("ACE1:C", "ALA2:N", "ALA2:CA", "ALA2:C")]
    angle = dihedral(*(x[:, a] for a in phi))
    assert np.allclose(np.exp(1j * (angle - angle[0])), np.exp(1j * np.array([0, 0.5, -2])), atol=1e-12)
    for cluster in t.clusters:
        d = np.linalg.norm(x[:, cluster, None] - x[:, None, cluster], axis=-1)
        assert np.abs(d - d[0]).max() < 1e-12


def dihedral(a, b, c, d):
    u, v, w = b - a, c - b, d - c
    m, n = np.cross(u, v), np.cross(v, w)
    return np.arctan2(np.linalg.norm(v, axis=-1) * (u * n).sum(-1), (m * n).sum(-1))


def test_rigid_by_atoms_and_by_kind(s):
    groups = TorsionModel(s, rigid=[["ALA2:N", "ALA2:CA", 10], "methyl"])
    assert groups.degrees_of_freedom == 6 + 2
    assert TorsionModel(s, rigid="omega").degrees_of_freedom == 11
    bonds = TorsionModel(s, hinges=[["ALA2:N", "ALA2:CA"], (8, 10)])
    assert bonds.degrees_of_freedom == 8 and [kind for *_, kind in bonds.hinges] == ["backbone_phi", "backbone_psi"]
    again = TorsionModel(s, clusters=bonds.clusters)
    assert again.clusters == bonds.clusters
    assert TorsionModel(s, clusters=[list(range(22))]).degrees_of_freedom == 6
    assert TorsionModel(s, clusters="torsion").degrees_of_freedom == 13


def test_wrong_divisions(s):
    for arguments, argument in (
        ({"clusters": "atoms"}, "clusters"),
        ({"rigid": ["methyls"]}, "rigid"),
        ({"rigid": [["ALA2:CX"]]}, "rigid"),
        ({"rigid": [[22]]}, "rigid"),
        ({"rigid": [[-1]]}, "rigid"),
        ({"hinges": [[1, 2, 3]]}, "hinges"),
        ({"hinges": [[0, 4]], "clusters": [list(range(22))]}, "hinges"),
        ({"positions": np.zeros((21, 3))}, "positions"),
        ({"positions": np.zeros((2, 22, 3))}, "positions"),
    ):
        with pytest.raises(phipsi.ArgumentError) as caught:
            TorsionModel(s, **arguments)
        assert caught.value.argument == argument and str(caught.value)
    with pytest.raises(phipsi.ModelError, match="in 0 clusters") as caught:
        TorsionModel(s, clusters=[list(range(21))])
    assert caught.value.errors[0].remedy
    with pytest.raises(phipsi.ModelError, match="no bond"):
        TorsionModel(s, hinges=[[0, 8]])


def test_positions_are_taken_where_clusters_fit(s, t):
    rng = np.random.default_rng(1)
    q = t.model.integrate(t.model.neutral(), rng.uniform(-1, 1, 13))
    x = t.atom_positions(q)
    t.positions = x
    assert np.abs(t.positions - x).max() < 1e-12
    assert np.abs(t.model.difference(t.q, q)).max() < 1e-11
    assert np.abs(t.model.difference(t.coordinates(x), t.q)).max() < 1e-14
    with pytest.raises(phipsi.ArgumentError, match=r"TorsionModel\(s, positions\)"):
        t.positions = 1.01 * x
    assert np.abs(t.positions - x).max() < 1e-12
    other = TorsionModel(s, 1.01 * x)
    assert np.abs(other.positions - 1.01 * x).max() < 1e-15
    t.q = t.model.neutral()
    assert np.abs(t.positions - s.positions).max() < 1e-15


def test_velocities(t):
    rng = np.random.default_rng(2)
    v = rng.normal(size=13)
    t.v = v
    assert np.abs(t.v - v).max() < 1e-12
    u, h = t.velocities, 1e-6
    moved = t.atom_positions(t.model.integrate(t.q, np.stack([h * v, -h * v])))
    assert np.abs((moved[0] - moved[1]) / (2 * h) - u).max() < 1e-8
    t.velocities = u
    assert np.abs(t.v - v).max() < 1e-11
    # Any velocities: those with the same momentum of the whole.
    w = rng.normal(size=u.shape)
    t.velocities = w
    masses = t.system.masses[:, None]
    assert np.abs((masses * t.velocities).sum(0) - (masses * w).sum(0)).max() < 1e-9


def test_velocities_have_the_temperature(t):
    energies = []
    for seed in range(400):
        t.draw_velocities(300, seed=seed)
        energies.append(t.model.kinetic_energy(t.q, t.v))
    mean, expected = np.mean(energies), 13 / 2 * BOLTZMANN * 300
    # χ² of 13 degrees of freedom: relative standard error √(2/13/400) = 2 %.
    assert abs(mean / expected - 1) < 4 * 0.02
    t.draw_velocities(0)
    assert not t.v.any()
    with pytest.raises(phipsi.ArgumentError) as caught:
        t.draw_velocities(-1)
    assert caught.value.argument == "temperature_K"


def test_minimum(s, t):
    before = t.energy()["total"]
    assert before == pytest.approx(s.energy()["total"], rel=1e-12)
    m = t.minimize(largest_force=1e-3)
    assert m.converged and m.largest_force <= 1e-3 and m.energy < before and m.strain is None
    assert m.energy == pytest.approx(t.energy()["total"], rel=1e-12) and m.joint in t.model.joint_names
    # The slope of the energy over q, by the positions: 1e-3 kJ/mol/rad.
    h = 1e-5
    dq = np.concatenate([h * np.eye(13), -h * np.eye(13)])
    e = s.energy(t.atom_positions(t.model.integrate(t.q, dq)))["total"]
    assert np.abs((e[:13] - e[13:]) / (2 * h)).max() < 1.1e-3
    assert t.minimize(evaluations=1).evaluations == 1
    with pytest.raises(phipsi.ArgumentError):
        t.minimize(largest_force=float("nan"))


def test_a_strained_start_is_told(s, t):
    assert t.strain is None
    x = s.positions
    # A hydrogen of one end on one of the other: 0.02 nm apart.
    x[21] = x[1] + [0.02, 0.0, 0.0]
    strained = TorsionModel(s, x)
    assert "NME3:H3" in strained.strain or "ACE1:H1" in strained.strain
    with pytest.warns(RuntimeWarning, match="starts with a force"):
        strained.run(1, dt_fs=1e-6)
    strained = TorsionModel(s, x)
    before = strained.energy()["total"]
    m = strained.minimize()
    assert "starts with a force" in m.strain and m.energy < before


@pytest.mark.parametrize("dt_fs", [1.0, 4.0])
def test_constant_energy(t, dt_fs):
    t.minimize()
    r = t.run(2000, dt_fs=dt_fs, temperature_K=300, seed=1, every=2)
    assert r.steps == 2000 and r.time_ps.shape == (1001,) and r.positions.shape == (1001, 22, 3)
    assert np.allclose(r.time_ps, np.arange(1001) * 2e-3 * dt_fs, atol=1e-12) and r.acceptance is None
    assert np.array_equal(r.conserved, r.kinetic_energy + r.potential_energy)
    assert np.allclose(r.temperature_K, 2 * r.kinetic_energy / (13 * BOLTZMANN))
    assert abs(r.temperature_K[0] / 300 - 1) < 1
    # Noise of order h²; a fraction of the energy that is exchanged.
    assert np.std(r.conserved) < 0.02 * dt_fs**2 and np.std(r.conserved) < 0.2 * np.std(r.kinetic_energy)
    slope = np.polyfit(r.time_ps, r.conserved, 1)[0]
    assert r.drift == pytest.approx(slope, rel=1e-6, abs=1e-9)
    s = t.system
    assert np.allclose(s.energy(r.positions)["total"], r.potential_energy, rtol=1e-12, atol=1e-10)
    assert np.array_equal(r.positions[-1], t.positions) and t.time_ps == pytest.approx(r.time_ps[-1])


def test_a_run_in_parts_is_the_same(s):
    one, two = TorsionModel(s), TorsionModel(s)
    whole = one.run(60, dt_fs=4, seed=3, every=10)
    parts = [two.run(20, dt_fs=4, seed=3, every=10), two.run(40, dt_fs=4, seed=99, every=10)]
    joined = np.concatenate([parts[0].positions[:-1], parts[1].positions])
    assert np.array_equal(joined, whole.positions) and np.array_equal(one.v, two.v)
    other = TorsionModel(s).run(60, dt_fs=4, seed=4, every=10)
    assert not np.array_equal(other.positions, whole.positions)


def test_reversal(t):
    start = t.positions
    t.run(50, dt_fs=8, seed=5)
    t.v = -t.v
    back = t.run(50, dt_fs=8).positions[-1]
    assert np.abs(back - start).max() < 1e-10


def test_records(t):
    assert len(t.run(7, dt_fs=1, every=3).time_ps) == 3
    assert len(t.run(0, dt_fs=1).time_ps) == 1 and t.run(0, dt_fs=1).drift is None
    assert len(t.run(2500, dt_fs=0.5).time_ps) == 834


def test_trajectory(tmp_path, t):
    path = tmp_path / "run.dcd"
    r = t.run(50, dt_fs=2, seed=1, every=5, trajectory=path)
    read = mdtraj.load_dcd(str(path), top=str(MOLECULE[0]))
    assert read.xyz.shape == r.positions.shape
    # f32 of Å.
    assert np.abs(read.xyz - r.positions).max() < 1e-6
    phi = mdtraj.compute_phi(read)[1][:, 0]
    names = t.system.atom_names
    ours = dihedral(*(r.positions[:, names.index(a)] for a in ("ACE1:C", "ALA2:N", "ALA2:CA", "ALA2:C")))
    assert np.abs(np.exp(1j * phi) - np.exp(1j * ours)).max() < 1e-4
    with pytest.raises(OSError, match="none"):
        t.run(1, dt_fs=1, trajectory=tmp_path / "none" / "run.dcd")


def test_wrong_runs(t):
    for arguments, argument in (
        ({"dt_fs": 0.0}, "dt_fs"),
        ({"dt_fs": float("inf")}, "dt_fs"),
        ({"ensemble": "npt"}, "ensemble"),
        ({"every": 0}, "every"),
        ({"ensemble": "langevin", "friction_per_ps": -1.0}, "friction_per_ps"),
        ({"ensemble": "nose_hoover", "relaxation_ps": 0.0}, "relaxation_ps"),
        ({"ensemble": "hmc", "trajectory_steps": 0}, "trajectory_steps"),
        ({"ensemble": "hmc", "temperature_K": 0.0}, "temperature_K"),
        ({"fixman": True, "temperature_K": 0.0}, "temperature_K"),
        ({"temperature_K": float("nan")}, "temperature_K"),
        ({"inner_steps": 0}, "inner_steps"),
        ({"inner_steps": 1001}, "inner_steps"),
        ({"steps": 10**12, "every": 1}, "every"),
    ):
        with pytest.raises(phipsi.ArgumentError) as caught:
            t.run(**{"steps": 1, "dt_fs": 1.0, **arguments})
        assert caught.value.argument == argument
    assert t.time_ps == 0.0


def test_a_step_that_fails_keeps_the_state(t):
    with pytest.raises(phipsi.NumericalError) as caught:
        t.run(1000, dt_fs=200.0, temperature_K=1000, seed=1, every=1)
    error = caught.value
    assert error.required and error.remedy and error.time == t.time_ps
    so_far = error.trajectory
    assert so_far.steps < 1000 and np.array_equal(so_far.positions[-1], t.positions)
    assert np.isfinite(so_far.conserved).all()


def test_interrupt_and_threads(t):
    """Ctrl-C stops a long run with a usable state; meanwhile another thread is refused."""
    refused, seen = [], []

    def disturb():
        # Looking is allowed.
        seen.extend([t.time_ps, t.time_ps, t.positions])
        try:
            t.run(1, dt_fs=1)
        except phipsi.Error as error:
            refused.append(error)
        _thread.interrupt_main()

    timer = threading.Timer(0.3, disturb)
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        t.run(10**9, dt_fs=1, every=10**6)
    timer.join()
    assert 0 < seen[0] <= seen[1] and seen[2].shape == (22, 3)
    assert len(refused) == 1 and "another thread" in str(refused[0])
    assert t.time_ps > 0 and t.run(1, dt_fs=1).steps == 1


ENSEMBLES = {"langevin": 13, "nose_hoover": 10, "hmc": 13}


@pytest.mark.parametrize("ensemble", ENSEMBLES)
@pytest.mark.parametrize("fixman", [False, True])
def test_ensembles(s, ensemble, fixman):
    t = TorsionModel(s)
    plain = t.energy()["total"]
    arguments = {"ensemble": ensemble, "temperature_K": 300, "seed": 4, "fixman": fixman, "friction_per_ps": 5}
    r = t.run(4000, dt_fs=5, every=10, **arguments)
    assert (r.ensemble, r.degrees_of_freedom) == (ensemble, ENSEMBLES[ensemble])
    assert r.distribution == ("stiff limit" if fixman else "rigid") and r.distribution in repr(r)
    assert r.potential_energy[0] == pytest.approx(plain, abs=1e-9)
    assert (np.ptp(r.fixman_energy) > 0.1) == fixman and fixman == bool(r.fixman_energy.any())
    assert np.allclose(s.energy(r.positions)["total"], r.potential_energy, rtol=1e-12, atol=1e-9)
    # 20 ps; the scatter of 2K/(n k) over it is some 15 K.
    assert abs(r.temperature_K.mean() - 300) < 60
    if ensemble == "hmc":
        assert 0.95 < r.acceptance <= 1 and r.refused == 0
    else:
        assert r.acceptance is None and np.std(r.conserved) < 0.3
    # What the model keeps is without Fixman's potential.
    assert t.energy()["total"] == pytest.approx(r.potential_energy[-1], abs=1e-9)


@pytest.mark.parametrize("ensemble", ENSEMBLES)
def test_a_bath_in_parts_is_the_same(s, ensemble):
    arguments = {"dt_fs": 5, "ensemble": ensemble, "seed": 3, "fixman": True, "every": 10}
    one, two = TorsionModel(s), TorsionModel(s)
    whole = one.run(60, **arguments)
    parts = [two.run(20, **arguments), two.run(40, **arguments)]
    joined = np.concatenate([parts[0].positions[:-1], parts[1].positions])
    assert np.array_equal(joined, whole.positions) and np.array_equal(one.v, two.v)


def test_several_molecules(tmp_path):
    s = System.from_files(*unpack("aladi_water_ions", "vacuum", tmp_path))
    t = TorsionModel(s)
    # Seven torsions and a base, four rigid waters, two ions.
    assert t.degrees_of_freedom == 7 + 6 + 4 * 6 + 2 * 3
    r = t.run(50, dt_fs=1, seed=1)
    assert np.std(r.conserved) < 0.05 * np.std(r.kinetic_energy)
    assert repr(t).startswith("<phipsi.molecule.TorsionModel: 36 atoms")


def test_flexible_rings_stay_closed(tmp_path):
    """Proline: two degrees of freedom of pucker more than the rigid ring; closed to rounding; the distribution of loops."""
    s = System.from_files(*unpack("ace_pro_nme", "vacuum", tmp_path))
    rigid, t = TorsionModel(s), TorsionModel(s, rings="flexible")
    assert t.degrees_of_freedom == rigid.degrees_of_freedom + 2
    assert t.model.nv == t.degrees_of_freedom + 5
    r = t.run(200, dt_fs=2, ensemble="langevin", temperature_K=300, seed=1)
    assert r.degrees_of_freedom == t.degrees_of_freedom
    assert np.abs(t.model.closure_residual(t.q)).max() < 1e-12
    assert np.ptp(r.conserved) < 0.1
    for ensemble in ("langevin", "nose_hoover"):
        r = t.run(100, dt_fs=2, ensemble=ensemble, temperature_K=300, seed=1, fixman=True)
        assert np.ptp(r.conserved) < 0.1
        assert np.abs(t.model.closure_residual(t.q)).max() < 1e-12
    # From the same start: a run may have left its valley.
    lowest, t = rigid.minimize().energy, TorsionModel(s, rings="flexible")
    minimum = t.minimize()
    assert minimum.converged and minimum.energy < lowest + 0.01
    assert np.abs(t.model.closure_residual(t.q)).max() < 1e-12
    with pytest.raises(phipsi.ArgumentError, match="flexible"):
        TorsionModel(s, rings="floppy")


def test_freeze_and_thaw(s, t):
    """Positions and momenta stay; the ledger balances; what is thawed is drawn; other forces must be given again."""
    masses = s.masses[:, None]
    t.draw_velocities(300, seed=4)
    t.run(50, dt_fs=2)
    x, u = t.positions, t.velocities
    frozen, ledger = t.recluster(rigid=["omega", "methyl"])
    assert frozen.time_ps == t.time_ps and ledger["degrees_of_freedom"] == (13, frozen.degrees_of_freedom)
    assert np.abs(frozen.positions - x).max() < 1e-12
    w = frozen.velocities
    for before, after in ((u, w), (np.cross(x, u), np.cross(x, w))):
        assert np.abs((masses * (before - after)).sum(0)).max() < 1e-9
    lost = 0.5 * (masses * (u - w) ** 2).sum()
    assert abs(ledger["removed"] - lost) < 1e-10 and ledger["drawn"] == 0
    assert abs(ledger["before"] - ledger["removed"] - ledger["after"]) < 1e-10
    frozen.run(50, dt_fs=2)
    thawed, ledger = frozen.recluster(thaw_temperature_K=300, seed=1)
    assert thawed.degrees_of_freedom == 13 and ledger["drawn"] > 0 and ledger["removed"] < 1e-10
    r = thawed.run(50, dt_fs=2)
    assert np.ptp(r.conserved) < 0.1
    with pytest.raises(phipsi.ArgumentError, match="forces"):
        t.recluster(forces=lambda x: (0.0, np.zeros_like(x)))
    with pytest.raises(phipsi.ArgumentError, match="temperature_K"):
        t.recluster(thaw_temperature_K=-1)


def test_a_linear_molecule_has_five_degrees_of_freedom(tmp_path):
    """Nitrogen: no spin about its line, five degrees of freedom in the temperature."""
    pdb, xml = tmp_path / "n2.pdb", tmp_path / "n2.xml"
    line = "ATOM  {:5d}  N{}  N2  A   1    {:8.3f}{:8.3f}{:8.3f}  1.00  0.00           N\n"
    pdb.write_text("".join(line.format(i + 1, i + 1, 0.0, 0.0, 1.098 * i) for i in range(2)))
    xml.write_text(
        '<System><Particles><Particle mass="14.007"/><Particle mass="14.007"/></Particles><Forces>'
        '<Force type="HarmonicBondForce"><Bonds><Bond p1="0" p2="1" d="0.1098" k="1"/></Bonds></Force></Forces></System>'
    )
    t = TorsionModel(System.from_files(pdb, xml))
    assert (t.model.nv, t.degrees_of_freedom) == (6, 5)
    r = t.run(200, dt_fs=2, ensemble="langevin", temperature_K=300, seed=2)
    assert r.degrees_of_freedom == 5 and np.ptp(r.conserved) < 1e-6
    x, u = t.positions, t.velocities
    omega = t.model.body_velocity(t.q, t.v, t.model.body_names[0])[:3]
    assert abs(omega @ (x[1] - x[0])) < 1e-10 * np.linalg.norm(omega)
    assert abs((u[1] - u[0]) @ (x[1] - x[0])) < 1e-10


def test_open_angles_and_cartesian_atoms(s):
    """Bends are joints of the model; Cartesian coordinates have three for every atom."""
    t = TorsionModel(s, clusters="torsion+angle")
    plain = TorsionModel(s)
    assert plain.degrees_of_freedom + 5 <= t.degrees_of_freedom <= plain.degrees_of_freedom + 7
    assert TorsionModel(s, angles=[[4, 6, 8]]).degrees_of_freedom == plain.degrees_of_freedom + 1
    assert np.ptp(t.run(100, dt_fs=1, seed=2).conserved) < 0.1
    x = t.positions
    atoms = TorsionModel(s, clusters="cartesian")
    assert atoms.degrees_of_freedom == 3 * len(x)
    assert np.ptp(atoms.run(100, dt_fs=0.5, seed=3).conserved) < 2


@pytest.mark.parametrize("ensemble", ["nve", "langevin"])
def test_inner_steps(s, ensemble):
    def run(model, steps, inner_steps):
        return model.run(steps, dt_fs=4, ensemble=ensemble, fixman=True, seed=1, every=5, inner_steps=inner_steps)

    plain, one, two, parts = (TorsionModel(s) for _ in range(4))
    a, b = plain.run(40, dt_fs=4, ensemble=ensemble, fixman=True, seed=1, every=5), run(one, 40, 1)
    assert np.array_equal(a.positions, b.positions)
    r = run(two, 40, 2)
    assert r.steps == 40 and not np.array_equal(r.positions, a.positions)
    # Both are of second order: they part by the noise of the steps, and the conserved quantity stays.
    assert np.abs(r.positions - a.positions).max() < 0.01
    assert np.ptp(r.conserved) < 0.2
    # Afterwards the model has all of its forces again, and a run in two calls is the one in one.
    assert np.isclose(two.energy()["total"], s.energy(two.positions)["total"])
    first, second = run(parts, 20, 2), run(parts, 20, 2)
    assert np.array_equal(np.concatenate([first.positions, second.positions[1:]]), r.positions)
    before = two.energy()["total"]
    two.minimize()
    assert two.energy()["total"] < before
    with pytest.raises(phipsi.ArgumentError) as caught:
        TorsionModel(s, forces=lambda x: (0.0, np.zeros_like(x))).run(1, dt_fs=1, inner_steps=2)
    assert caught.value.argument == "inner_steps"


def test_a_scene_freezes_and_thaws(tmp_path):
    scene = tmp_path / "scene.toml"
    pdb, xml = (str(path) for path in MOLECULE)
    scene.write_text(
        f"""[molecule]
pdb = {json.dumps(pdb)}
system = {json.dumps(xml)}
temperature_K = 300
seed = 1
[[molecule.recluster]]
time_ps = 0.1
freeze = ["omega", "methyl"]
[integrator]
t_end = 0.2
step_fs = 4
inner_steps = 2
[record]
every = 0.02
"""
    )
    with pytest.raises(phipsi.ArgumentError, match="midpoint"):
        phipsi.simulate(str(scene), method="dop853")
    trajectory = phipsi.simulate(str(scene))
    assert trajectory.q.shape[0] == 11 and trajectory.v.shape[1] == 13
    # Five hinges rest after the change: those of two amide bonds and three methyl groups.
    resting = np.abs(trajectory.v[6:]).max(axis=0) < 1e-8
    assert resting.sum() == 5 and not (np.abs(trajectory.v[:6]).max(axis=0) < 1e-8).any()


def test_the_bath_of_a_scene_acts(tmp_path):
    """A scene keeps its midpoint method, without which the bath would do nothing."""
    pdb, xml = (json.dumps(str(path)) for path in MOLECULE)
    runs = {}
    for ensemble in ("nve", "langevin"):
        scene = tmp_path / f"{ensemble}.toml"
        scene.write_text(
            f"""[molecule]
pdb = {pdb}
system = {xml}
temperature_K = 300
seed = 1
[integrator]
t_end = 0.2
step_fs = 4
ensemble = "{ensemble}"
[record]
every = 0.02
"""
        )
        runs[ensemble] = phipsi.simulate(str(scene))
    assert all("midpoint" in run.method for run in runs.values())
    first = [run.energy[0] for run in runs.values()]
    assert first[0] == first[1]
    # The bath exchanges energies of the size of kT; constant energy has the noise of the method, 0.02 kJ/mol.
    assert np.abs(runs["nve"].energy - first[0]).max() < 0.1 < np.abs(runs["langevin"].energy - first[0]).max()
