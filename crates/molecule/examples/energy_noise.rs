//! Energy noise, drift and wall time of torsion dynamics against the step: the table of the page on molecules.
//!
//! `cargo run --release -p phipsi-molecule --example energy_noise -- 100` (ps of each run)
//!
//! Every run begins at the molecule's `md` snapshot, with momenta drawn at 300 K and thermalised: its frozen bonds and angles are
//! strained, so that the torsions relax and would heat it.

use phipsi_formats::pdb::read_pdb_file;
use phipsi_formats::system::{SystemOptions, read_system};
use phipsi_molecule::{
    Atoms, Clustering, Clusters, Deviates, ForceField, MolecularForces, TorsionModel, assemble, draw_momenta,
    temperature,
};
use phipsi_motion::Midpoint;
use phipsi_recursion::articulated_sweep::SolveWorkspace;
use phipsi_spatial::Vec3;
use std::error::Error;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

const STEPS_FS: [f64; 7] = [0.5, 1.0, 2.0, 4.0, 8.0, 12.0, 15.0];

fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../validation/data/molecules").join(name)
}

fn unpacked(path: &Path) -> Result<String, Box<dyn Error>> {
    let mut text = String::new();
    flate2::read::GzDecoder::new(std::fs::File::open(path)?).read_to_string(&mut text)?;
    Ok(text)
}

/// Atoms, positions of the `md` snapshot, force field.
type Molecule = (Atoms, Vec<Vec3<f64>>, ForceField);

fn molecule(name: &str) -> Result<Molecule, Box<dyn Error>> {
    let folder = data(name);
    let text = unpacked(&folder.join(format!("{name}.vacuum.xml.gz")))?;
    let (system, _) = read_system(&text, name, &SystemOptions::default()).into_result(false)?;
    let (pdb, _) = read_pdb_file(folder.join(format!("{name}.pdb"))).into_result(false)?;
    let atoms = assemble(&pdb, &system)?.atoms;
    let reference: serde_json::Value =
        serde_json::from_str(&unpacked(&folder.join(format!("{name}.ref.json.gz")))?)?;
    let all = reference["conformations"].as_array().ok_or("no conformations")?;
    let snapshot = all.iter().find(|c| c["id"] == "md").ok_or("no snapshot")?;
    let positions: Vec<[f64; 3]> = serde_json::from_value(snapshot["positions"].clone())?;
    Ok((atoms, positions.into_iter().map(Vec3).collect(), ForceField::new(&system)?))
}

/// Straight line through energies: slope, its error, root mean square about it.
fn line(h: f64, energies: &[f64]) -> [f64; 3] {
    let n = energies.len() as f64;
    let (t0, e0) = (0.5 * (n - 1.0) * h, energies.iter().sum::<f64>() / n);
    let (mut tt, mut te) = (0.0, 0.0);
    for (i, e) in energies.iter().enumerate() {
        let t = i as f64 * h - t0;
        tt += t * t;
        te += t * (e - e0);
    }
    let slope = te / tt;
    let residual = |(i, e): (usize, &f64)| (e - e0 - slope * (i as f64 * h - t0)).powi(2);
    let squares: f64 = energies.iter().enumerate().map(residual).sum();
    [slope, (squares / (n - 2.0) / tt).sqrt(), (squares / n).sqrt()]
}

fn main() -> Result<(), Box<dyn Error>> {
    let picoseconds: f64 = std::env::args().nth(1).map_or(Ok(100.0), |a| a.parse())?;
    for name in ["aladi", "met_enkephalin"] {
        let (atoms, positions, field) = molecule(name)?;
        let clusters = Clusters::new(&atoms, &positions, &Clustering::default())?;
        let torsion = Arc::new(TorsionModel::new(&atoms, &positions, clusters)?);
        let (model, layout) = (torsion.model(), torsion.layout());
        let nv = model.nv();
        println!("\n{name}: {} atoms, {nv} degrees of freedom, {picoseconds} ps each\n", atoms.len());
        println!(
            "| step, fs | noise, kJ/mol | drift, kJ/mol/ps per degree of freedom | temperature, K | iterations | µs a step | ns a day |"
        );
        println!("|---|---|---|---|---|---|---|");
        let mut fit = Vec::new();
        for fs in STEPS_FS {
            let mut forces = MolecularForces::new(torsion.clone(), field.clone());
            let q = model.neutral::<f64>();
            let mut method = Midpoint::new(model, &mut forces, 0.0, &q, &vec![0.0; nv])?;
            let (mut deviates, mut workspace) = (Deviates::new(1), SolveWorkspace::new(layout));
            let mut p = vec![0.0; nv];
            for _ in 0..20 {
                draw_momenta(layout, method.factors()?, 300.0, &mut deviates, &mut workspace, &mut p);
                method.set_momenta(&p)?;
                (0..50).try_for_each(|_| method.step(&mut forces, 0.002).map(|_| ()))?;
            }
            draw_momenta(layout, method.factors()?, 300.0, &mut deviates, &mut workspace, &mut p);
            method.set_momenta(&p)?;
            let h = fs / 1000.0;
            let steps = (picoseconds / h).round() as usize;
            let (mut energies, mut kinetic) = (Vec::with_capacity(steps), 0.0);
            let before = method.state().iterations;
            let clock = Instant::now();
            for _ in 0..steps {
                if let Err(e) = method.step(&mut forces, h) {
                    println!("| {fs} | stopped: {e} |");
                    break;
                }
                let own = method.kinetic_energy()?;
                kinetic += own;
                energies.push(own + method.state().potential);
            }
            let seconds = clock.elapsed().as_secs_f64();
            if energies.len() < steps {
                continue;
            }
            let [slope, error, noise] = line(h, &energies);
            let per = nv as f64;
            println!(
                "| {fs} | {noise:.2e} | {:.1e} ± {:.0e} | {:.0} | {:.1} | {:.1} | {:.0} |",
                slope / per,
                error / per,
                temperature(kinetic / steps as f64, nv),
                (method.state().iterations - before) as f64 / steps as f64,
                seconds / steps as f64 * 1e6,
                86.4 * picoseconds / seconds,
            );
            if fs <= 8.0 {
                fit.push((fs.ln(), noise.ln()));
            }
        }
        let n = fit.len() as f64;
        let (x, y) = fit.iter().fold((0.0, 0.0), |(x, y), p| (x + p.0 / n, y + p.1 / n));
        let slope = fit.iter().map(|p| (p.0 - x) * (p.1 - y)).sum::<f64>()
            / fit.iter().map(|p| (p.0 - x).powi(2)).sum::<f64>();
        println!("\nslope of log noise against log step, 0.5 … 8 fs: {slope:.2}");
    }
    Ok(())
}
