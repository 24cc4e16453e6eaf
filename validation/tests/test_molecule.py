"""Molecules: reference energies and forces of OpenMM, batches, arguments, errors."""

from __future__ import annotations

import gzip
import json
import re
from pathlib import Path

import numpy as np
import pytest

import phipsi

from .common import EPSILON, MOLECULE

System = phipsi.molecule.System

DATA = Path(__file__).resolve().parents[1] / "data" / "molecules"

CASES = sorted(
    (path.name, file.name.split(".")[1])
    for path in DATA.iterdir()
    if path.is_dir()
    for file in path.glob(f"{path.name}.*.xml.gz")
)


@pytest.fixture(scope="module")
def s():
    return System.from_files(*MOLECULE)


def unpack(name: str, environment: str, folder: Path) -> tuple[Path, Path]:
    """The PDB and the System of a molecule as files."""
    xml = folder / f"{name}.xml"
    xml.write_bytes(gzip.decompress((DATA / name / f"{name}.{environment}.xml.gz").read_bytes()))
    return DATA / name / f"{name}.pdb", xml


def test_there_are_molecules():
    assert len(CASES) >= 20 and {environment for _, environment in CASES} == {"vacuum", "obc2", "obc2_native", "charmm36"}


@pytest.mark.parametrize(("name", "environment"), CASES)
def test_reference_energies_and_forces(tmp_path, name, environment):
    s = System.from_files(*unpack(name, environment, tmp_path))
    reference = json.loads(gzip.decompress((DATA / name / f"{name}.ref.json.gz").read_bytes()))
    count = 0
    for conformation in reference["conformations"]:
        if environment not in conformation:
            continue
        count += 1
        wanted, x = conformation[environment], np.array(conformation["positions"])
        energy, place = s.energy(x), (name, environment, conformation["id"])
        assert sorted(energy) == sorted(wanted["energy"])
        scale = sum(abs(e) for term, e in wanted["energy"].items() if term != "total")
        for term, e in wanted["energy"].items():
            assert abs(energy[term] - e) <= 1e-12 * scale, (place, term)
        # What the rounding of the forces is relative to: in minima they cancel.
        forces = np.array(wanted["forces"])
        largest = max(np.abs(s.forces(x, term=term)).max() for term in s.terms)
        assert np.abs(s.forces(x) - forces).max() <= 1e-12 * max(largest, np.abs(forces).max()), place
    assert count >= 4


def test_attributes(s):
    assert s.n_atoms == 22 and len(s.atom_names) == 22 == len(set(s.atom_names))
    assert s.atom_names[8] == "ALA2:CA" and s.masses.shape == (22,) and s.masses[8] == 12.01
    assert s.positions.shape == (22, 3)
    line = MOLECULE[0].read_text().splitlines()[9]
    assert "CA" in line and np.array_equal(s.positions[8] * 10, [float(line[k : k + 8]) for k in (30, 38, 46)])
    assert len(s.bonds) == 21 and (6, 8) in s.bonds
    assert s.terms == list(s.energy())[:-1]


def test_report_is_of_both_files(s):
    report = s.report
    pdb, xml = (str(path) for path in MOLECULE)
    assert report.source == f"{pdb}, {xml}" and not report.errors and not report.warnings
    assert any(note.source == pdb and "atoms: 22" in note.what for note in report.used)
    assert any(note.source == xml and "particles: 22" in note.what for note in report.used)
    assert f"{pdb}: 0 errors" in str(report) and f"{xml}: 0 errors" in str(report)


def test_positions_of_the_file_are_the_default(s):
    assert s.energy() == s.energy(s.positions) and np.array_equal(s.forces(), s.forces(s.positions))
    assert isinstance(s.energy()["total"], float)
    s.positions[:] = 0.0
    assert s.energy() == s.energy(s.positions)


def test_total_is_the_sum(s):
    rng = np.random.default_rng(1)
    x = s.positions + rng.normal(0, 0.01, (22, 3))
    energy = s.energy(x)
    assert energy["total"] == sum(energy[term] for term in s.terms)
    parts = np.sum([s.forces(x, term=term) for term in s.terms], axis=0)
    # One rounding of each force per term.
    assert np.abs(s.forces(x) - parts).max() <= 100 * EPSILON * max(np.abs(s.forces(x, t)).max() for t in s.terms)


def test_forces_are_the_slope_of_the_energy(s):
    rng = np.random.default_rng(2)
    x, d, h = s.positions, rng.normal(size=(22, 3)), 1e-5
    e = s.energy(x + h * np.array([-2, -1, 1, 2])[:, None, None] * d)
    for term in s.terms:
        slope = (e[term][0] - 8 * e[term][1] + 8 * e[term][2] - e[term][3]) / (12 * h)
        force = -(s.forces(x, term=term) * d).sum()
        # Truncation h⁴ over lengths of 0.02 nm, rounding ε E / h.
        bound = 1e-11 * np.abs(s.forces(x, term=term)).sum() + 30 * EPSILON * np.abs(e[term]).max() / h
        assert abs(slope - force) <= bound, term


@pytest.mark.parametrize("shape", [(), (1,), (3,), (2, 3), (0,), (300,), (2, 0)])
def test_batches(s, shape):
    rng = np.random.default_rng(3)
    x = s.positions + rng.normal(0, 0.01, (*shape, 22, 3))
    energy, forces = s.energy(x), s.forces(x)
    assert forces.shape == x.shape
    for term in (*s.terms, "total"):
        assert np.shape(energy[term]) == shape
    for at in list(np.ndindex(*shape))[::37]:
        one = s.energy(x[at])
        assert all(one[term] == np.asarray(energy[term])[at] for term in one)
        assert np.array_equal(s.forces(x[at]), forces[at])


def test_array_likes(s):
    x = s.positions
    expected = s.forces(x)
    for same in (x.tolist(), tuple(map(tuple, x)), np.asfortranarray(x), x[::-1][::-1], np.stack([x, x])[1]):
        assert np.array_equal(s.forces(same), expected)
    assert np.abs(s.forces(x.astype(np.float32)) - expected).max() > 0


@pytest.mark.parametrize("method", ["energy", "forces"])
def test_wrong_arguments(s, method):
    call = getattr(s, method)
    with pytest.raises(phipsi.ArgumentError, match=r"`positions` has shape \(21, 3\), but \(…, 22, 3\)") as caught:
        call(np.zeros((21, 3)))
    assert caught.value.argument == "positions" and caught.value.found == (21, 3)
    with pytest.raises(phipsi.ArgumentError):
        call(np.zeros(66))
    with pytest.raises(phipsi.ArgumentTypeError):
        call(np.zeros((22, 3), complex))
    x = np.stack([s.positions, s.positions])
    x[1, 8, 2] = np.nan
    with pytest.raises(phipsi.NumericalError, match="atom ALA2:CA, z is NaN") as caught:
        call(x)
    assert caught.value.state == (1,)


def test_unknown_term(s):
    with pytest.raises(phipsi.ArgumentError, match="there are: \"HarmonicBondForce\"") as caught:
        s.forces(term="total")
    assert caught.value.argument == "term"


def test_atoms_that_coincide(s):
    x = np.stack([s.positions] * 3)
    x[1, 12] = x[1, 1]
    for call in (s.energy, s.forces):
        with pytest.raises(phipsi.NumericalError, match="ACE1:H1") as caught:
            call(x)
        error = caught.value
        assert error.state == (1,) and error.term == "NonbondedForce" and error.atoms == (1, 12)
        assert error.quantity and error.required and error.remedy and "ALA2:CB" in str(error)


def write(folder: Path, pdb=lambda t: t, xml=lambda t: t) -> tuple[Path, Path]:
    """The example with changed texts."""
    paths = folder / "mine.pdb", folder / "mine.xml"
    for path, source, change in zip(paths, MOLECULE, (pdb, xml)):
        text = source.read_text()
        changed = change(text)
        path.write_text(changed)
    return paths


def test_numbers_of_atoms_must_agree(tmp_path):
    files = write(tmp_path, pdb=lambda t: re.sub(r"HETATM   22.*\n", "", t))
    with pytest.raises(phipsi.ModelError, match="21 atoms.*22 particles") as caught:
        System.from_files(*files)
    error = caught.value
    assert len(error.errors) == 1 and "NME3:H2" in str(error)
    assert error.errors[0].source == str(files[0]) and error.report.errors


def test_elements_must_agree_with_masses(tmp_path):
    def swap(text: str) -> str:
        """C and O of the acetyl group in the other order."""
        lines = text.splitlines(keepends=True)
        lines[5], lines[6] = lines[6], lines[5]
        return "".join(lines)

    with pytest.raises(phipsi.ModelError) as caught:
        System.from_files(*write(tmp_path, pdb=swap))
    assert "ACE1:O" in caught.value.errors[0].place


def test_heavy_hydrogens_are_no_mismatch(tmp_path):
    """Hydrogen masses as OpenMM's hydrogenMass repartitions them: 4 Da, three of them from a methyl carbon."""

    def heavy(text: str) -> str:
        masses = iter(np.array([3.034, 4, 4, 4, *[0] * 18]))
        return re.sub(r'(mass=")([^"]*)', lambda m: m[1] + str(next(masses) or m[2]), text, count=22)

    s = System.from_files(*write(tmp_path, xml=heavy))
    assert list(s.masses[:5]) == [3.034, 4, 4, 4, 12.01]


def test_all_errors_at_once(tmp_path):
    files = write(
        tmp_path,
        pdb=lambda t: t.replace("   3.535  -1.132", "   3.5x5  -1.132"),
        xml=lambda t: t.replace('method="0"', 'method="4"').replace('k="265265.6"', 'k="nan"', 1),
    )
    with pytest.raises(phipsi.ModelError) as caught:
        System.from_files(*files)
    errors = caught.value.errors
    assert {e.source for e in errors} == {str(f) for f in files} and len(errors) == 3
    assert all(e.line and e.found and e.required and e.remedy for e in errors)


def test_files_that_cannot_be_opened(tmp_path):
    for files in ((tmp_path / "none.pdb", MOLECULE[1]), (MOLECULE[0], tmp_path / "none.pdb")):
        with pytest.raises(FileNotFoundError) as caught:
            System.from_files(*files)
        assert caught.value.filename == str(tmp_path / "none.pdb")


def test_forces_are_ignored_by_name(tmp_path, s):
    less = System.from_files(*MOLECULE, ignore=["NonbondedForce"])
    assert less.terms == [term for term in s.terms if term != "NonbondedForce"]
    assert any("NonbondedForce" in note.place for note in less.report.ignored)
    wrong = System.from_files(*MOLECULE, ignore=["Nonbonded"])
    assert wrong.terms == s.terms and "Nonbonded" in wrong.report.warnings[0].place
    with pytest.raises(phipsi.ModelError, match="strict") as caught:
        System.from_files(*MOLECULE, ignore=["Nonbonded"], strict=True)
    assert caught.value.warnings


def test_names_of_terms(tmp_path):
    """Keys are the names; a second of the same name, and one called like the sum, have a number."""

    def rename(text: str) -> str:
        names = iter(["one", "one", "total", ""])
        return re.sub(r' name="[^"]*"', lambda m: f' name="{next(names)}"', text)

    s = System.from_files(*write(tmp_path, xml=rename))
    assert s.terms == ["one", "one#2", "total#2", "HarmonicAngleForce"]
    energy = s.energy()
    assert energy["total"] == sum(energy[t] for t in s.terms) and list(energy) == [*s.terms, "total"]
    assert s.forces(term="total#2").shape == (22, 3)


def test_a_system_without_forces(tmp_path):
    s = System.from_files(*write(tmp_path, xml=lambda t: re.sub(r"<Forces>.*</Forces>", "<Forces/>", t, flags=re.S)))
    assert s.energy() == {"total": 0.0} and not s.forces().any()
    assert s.energy(np.zeros((3, 22, 3)))["total"].shape == (3,)


def test_objects_are_read_only(s):
    with pytest.raises(AttributeError):
        s.masses = 1
    assert repr(s) == "<phipsi.molecule.System: 22 atoms, 4 terms>"
