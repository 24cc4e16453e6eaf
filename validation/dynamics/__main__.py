"""The command: ``python -m validation.dynamics``."""

from __future__ import annotations

import argparse
import os
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "examples"


def main(arguments: list[str] | None = None) -> None:
    # Costs are those of one core; the threads of the package are made at its first sum over pairs.
    os.environ.setdefault("RAYON_NUM_THREADS", "1")
    from validation import dynamics

    from . import one_molecule, study
    from .results import Results

    parser = argparse.ArgumentParser(prog="python -m validation.dynamics", description=dynamics.__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="*", type=Path, metavar="FILE", help="a PDB file and its OpenMM System; default: alanine dipeptide")
    parser.add_argument("--ps", type=float, default=20.0, help="length of each run at constant energy")
    parser.add_argument("--sample-ps", type=float, default=1000.0, help="length of each run for the distribution of angles; 0: none")
    parser.add_argument("--out", type=Path, default=Path("dynamics.html"))
    parser.add_argument("--molecules", type=Path, metavar="FOLDER", help="the whole comparison, with the molecules of this folder")
    parser.add_argument("--parts", nargs="+", choices=study.PARTS, default=study.PARTS, help="of the whole comparison; default: all")
    parser.add_argument("--results", type=Path, metavar="FOLDER", help="keeps what is measured, and goes on from it")
    parser.add_argument("--starts", type=int, default=3, help="of each step")
    parser.add_argument("--rounds", type=int, default=9, help="of the programs that are timed in turns")
    parser.add_argument("--scale", type=float, default=1.0, help="of the lengths of the whole comparison's runs")
    parser.add_argument("--page", action="store_true", help="write the documentation's page from the whole comparison")
    options = parser.parse_args(arguments)
    if len(options.files) not in (0, 2) or (options.files and options.molecules):
        parser.error("give a PDB file and its System, or --molecules FOLDER, or neither")
    if options.page and not options.molecules:
        parser.error("--page needs --molecules FOLDER")
    if options.molecules:
        results = Results(options.results)
        found = study.measure(options.molecules, list(options.parts), results, options.starts, options.rounds, options.scale)
        page = study.page(found, "python -m validation.dynamics --molecules FOLDER --page")
        options.out.write_text("\n".join(page.html), encoding="utf-8")
        if options.page:
            (ROOT / "docs" / "src" / "torsion_dynamics.md").write_text("\n".join(page.markdown), encoding="utf-8")
        print(f"written: {options.out}")
        return
    pdb, xml = options.files or (EXAMPLES / "ala_dipeptide.pdb", EXAMPLES / "ala_dipeptide.xml")
    noises, samples = one_molecule.compare(pdb, xml, options.ps, options.sample_ps)
    title = f"Torsion dynamics beside Cartesian dynamics: {pdb.stem}"
    options.out.write_text(one_molecule.page(title, noises, samples, options.ps, options.sample_ps), encoding="utf-8")
    for n in noises:
        time = f"{1e3 * n.processor_s_per_ps:8.3g} ms a ps"
        print(f"{n.program:26} {n.step_fs:5g} fs  noise {n.noise:9.3g} kJ/mol  drift {n.drift:9.1e} ± {n.drift_error:.0e}  {time}")
    print(f"written: {options.out}")


if __name__ == "__main__":
    main()
