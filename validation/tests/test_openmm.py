"""Live comparison with OpenMM, systems from its objects, and the example that makes files."""

from __future__ import annotations

import gzip
import subprocess
import sys

import numpy as np
import openmm
import pytest
from openmm import app, unit

import phipsi
from validation import openmm as live
from validation.compare import CannotCompare

from .common import EXAMPLES, MOLECULE
from .test_molecule import CASES, DATA, System, unpack


@pytest.mark.parametrize(("name", "environment"), CASES)
def test_live(tmp_path, name, environment):
    pdb, xml = unpack(name, environment, tmp_path)
    result = live.compare(str(pdb), str(xml), range(4))
    assert result.agrees, result.table()
    terms = System.from_files(pdb, xml).terms
    assert len(result.rows) == 2 * len(terms) + 3 and result.rows["forces, total"].states == 5


@pytest.mark.parametrize("name", ["bonded", "pairs", "implicit"])
def test_live_every_force(tmp_path, name):
    """Nine particles with every kind of force that phipsi reads; their PDB has positions at random."""
    xml = tmp_path / "s.xml"
    xml.write_bytes(gzip.decompress((DATA / "every_force" / f"{name}.xml.gz").read_bytes()))
    x = np.random.default_rng(5).uniform(0, 6, (9, 3))
    # Names that are no elements: the particles are none.
    row = "HETATM{0:5} XX{0}  NON A   1    {1[0]:8.3f}{1[1]:8.3f}{1[2]:8.3f}  1.00  0.00\n"
    pdb = tmp_path / "s.pdb"
    pdb.write_text("".join(row.format(i + 1, x[i]) for i in range(9)) + "END\n")
    result = live.compare(str(pdb), str(xml), range(4), 1e-10)
    assert result.agrees, result.table()


def test_a_wrong_system_is_found(monkeypatch):
    """The table must name what differs: here OpenMM gets one charge more."""
    load = live.load

    def other(xml, ignore=()):
        system = load(xml, ignore)
        force = next(f for f in system.getForces() if f.getName() == "NonbondedForce")
        charge, sigma, epsilon = force.getParticleParameters(8)
        force.setParticleParameters(8, charge + 1e-6 * unit.elementary_charge, sigma, epsilon)
        return system

    monkeypatch.setattr(live, "load", other)
    result = live.compare(*map(str, MOLECULE), range(2))
    assert not result.agrees
    bad = {row.quantity for row in result.rows.values() if not row.agrees}
    assert bad == {"energy, NonbondedForce", "forces, NonbondedForce", "energy, total", "forces, total"}
    assert "DIFFERS" in result.table() and result.rows["forces, NonbondedForce"].where[:4] in ("ACE1", "ALA2", "NME3")


def test_another_coulomb_constant_is_said(monkeypatch):
    ours, theirs = live.coulomb_constants()
    assert abs(ours / theirs - 1) < 1e-12
    monkeypatch.setattr(live, "coulomb_constants", lambda: (ours, theirs * (1 + 1e-8)))
    result = live.compare(*map(str, MOLECULE), range(1))
    assert "Coulomb constant" in result.left_out and "Coulomb constants differ" in result.table()
    assert result.rows["energy, HarmonicBondForce"].bound == live.BOUND < result.rows["energy, NonbondedForce"].bound


def test_exit_status(tmp_path, capsys):
    files = list(map(str, MOLECULE))
    assert live.main([*files, "--states", "2"]) == 0
    out = capsys.readouterr().out
    assert "energy, NonbondedForce" in out and "forces, total" in out and "all agree" in out
    # Nothing agrees to less than rounding.
    assert live.main([*files, "--bound", "1e-18"]) == 1
    assert "DIFFERS" in capsys.readouterr().out
    assert live.main([files[0], str(tmp_path / "none.xml")]) == 1
    assert "none.xml" in capsys.readouterr().err
    assert live.main([*files, "--ignore", "NonbondedForce"]) == 0
    out = capsys.readouterr().out
    assert "energy, NonbondedForce" not in out and "ignored" in out
    with pytest.raises(SystemExit) as stop:
        live.main([*files, "--states", "-1"])
    assert stop.value.code == 2


def test_unusable_files(tmp_path):
    (tmp_path / "bad.xml").write_text("<System")
    with pytest.raises(CannotCompare, match="phipsi does not load it"):
        live.compare(str(MOLECULE[0]), str(tmp_path / "bad.xml"), [])
    text = MOLECULE[1].read_text().replace('type="HarmonicAngleForce"', 'type="NoForce"')
    (tmp_path / "bad.xml").write_text(text)
    with pytest.raises(CannotCompare, match="phipsi does not load it:(.|\n)*NoForce"):
        live.compare(str(MOLECULE[0]), str(tmp_path / "bad.xml"), [])
    with pytest.raises(CannotCompare, match="OpenMM does not load it"):
        live.compare(str(MOLECULE[0]), str(tmp_path / "bad.xml"), [], ignore=["NoForce", "HarmonicAngleForce"])


def objects():
    """The example as objects of OpenMM."""
    pdb = app.PDBFile(str(MOLECULE[0]))
    return pdb.topology, openmm.XmlSerializer.deserialize(MOLECULE[1].read_text()), pdb.positions


@pytest.mark.parametrize("how", ["quantity", "angstrom", "numpy", "plain"])
def test_from_openmm(how):
    topology, system, positions = objects()
    positions = {
        "quantity": positions,
        "angstrom": positions.in_units_of(unit.angstrom),
        "numpy": np.array(positions.value_in_unit(unit.nanometer)),
        "plain": [list(p) for p in positions.value_in_unit(unit.nanometer)],
    }[how]
    s, file = System.from_openmm(topology, system, positions), System.from_files(*MOLECULE)
    assert s.atom_names == file.atom_names and s.terms == file.terms and s.bonds == file.bonds
    assert np.abs(s.positions - file.positions).max() < 1e-15
    assert s.energy(file.positions) == file.energy()
    assert np.array_equal(s.forces(file.positions), file.forces())


def test_from_openmm_refuses_what_from_files_refuses():
    topology, system, positions = objects()
    fewer = app.Modeller(topology, positions)
    fewer.delete([list(topology.atoms())[-1]])
    with pytest.raises(phipsi.ModelError, match="21 atoms.*22 particles"):
        System.from_openmm(fewer.topology, system, fewer.positions)
    topology, system, positions = objects()
    system.getForce(2).setNonbondedMethod(openmm.NonbondedForce.PME)
    with pytest.raises(phipsi.ModelError, match="NoCutoff") as caught:
        System.from_openmm(topology, system, positions)
    assert caught.value.errors[0].source == "System"
    topology, system, positions = objects()
    with pytest.raises(phipsi.ArgumentError, match="`positions` has shape"):
        System.from_openmm(topology, system, positions[:-1])


def test_masses_of_all_elements():
    """OpenMM's mass of every element fits it, and that of the next but one does not."""
    for z in range(2, 100):
        element, other = app.Element.getByAtomicNumber(z), app.Element.getByAtomicNumber(z + 3)
        topology = app.Topology()
        topology.addAtom("X", element, topology.addResidue("RES", topology.addChain()))
        for mass, fits in ((element.mass, True), (other.mass, False)):
            system = openmm.System()
            system.addParticle(mass)
            try:
                s = System.from_openmm(topology, system, [[0.0, 0.0, 0.0]])
                assert fits and s.masses[0] == mass.value_in_unit(unit.dalton), element.symbol
            except phipsi.ModelError as error:
                assert not fits, error


@pytest.mark.parametrize("options", [[], ["--obc2", "--minimize"]])
def test_make_system(tmp_path, options):
    """Hydrogens are added, and the files that it writes are read and agree with OpenMM."""
    heavy = [line for line in MOLECULE[0].read_text().splitlines() if not line.endswith("H  ") and "CONECT" not in line]
    (tmp_path / "heavy.pdb").write_text("\n".join(heavy) + "\n")
    command = [sys.executable, str(EXAMPLES / "make_system.py"), "heavy.pdb", "ready", *options]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    files = str(tmp_path / "ready.pdb"), str(tmp_path / "ready.xml")
    s = System.from_files(*files)
    assert s.n_atoms == 22 and not s.report.warnings and ("CustomGBForce" in s.terms) == ("--obc2" in options)
    result = live.compare(*files, range(2))
    assert result.agrees, result.table()


def test_the_example_is_a_minimum():
    """Three decimals of an Å leave forces of up to three stiff bonds: 4.8e5 kJ/mol/nm², both ends off by 5e-5 nm."""
    s = System.from_files(*MOLECULE)
    assert np.abs(s.forces()).max() < 3 * 4.8e5 * 1e-4


def test_import_needs_no_openmm():
    """OpenMM is loaded when it is asked for."""
    code = "import sys, phipsi; assert 'openmm' not in sys.modules"
    assert subprocess.run([sys.executable, "-c", code]).returncode == 0
