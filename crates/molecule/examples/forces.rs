//! Wall time of energy and forces, of the whole field and of each term.
//!
//! `cargo run --release -p phipsi-molecule --features parallel --example forces -- SYSTEM.xml[.gz] POSITIONS.json[.gz] [SECONDS]`
//!
//! POSITIONS is a list of [x, y, z] in nm, or reference data as in `validation/data/molecules`, whose `md` snapshot is taken.
//! Prints one JSON object on a line: best and median time of an evaluation and its processor time on all threads (Linux only), in
//! seconds; energies in kJ/mol, forces in kJ/mol/nm.
//! RAYON_NUM_THREADS sets the number of threads.

use phipsi_formats::system::{SystemOptions, read_system};
use phipsi_molecule::{ForceField, Potential};
use phipsi_spatial::Vec3;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::error::Error;
use std::io::Read;
use std::time::Instant;

fn text(path: &str) -> Result<String, Box<dyn Error>> {
    let mut text = String::new();
    let mut file = std::fs::File::open(path)?;
    match path.ends_with(".gz") {
        true => flate2::read::GzDecoder::new(file).read_to_string(&mut text)?,
        false => file.read_to_string(&mut text)?,
    };
    Ok(text)
}

fn positions(value: &Value) -> Result<Vec<Vec3<f64>>, Box<dyn Error>> {
    let list = match value["conformations"].as_array() {
        Some(all) => {
            let snapshot = all.iter().find(|c| c["id"] == "md").or(all.first()).ok_or("no conformation")?;
            snapshot["positions"].clone()
        }
        None => value.clone(),
    };
    let list: Vec<[f64; 3]> = serde_json::from_value(list)?;
    Ok(list.into_iter().map(Vec3).collect())
}

/// Processor time of this process, s: Linux counts a hundred a second.
fn processor_seconds() -> Option<f64> {
    let text = std::fs::read_to_string("/proc/self/stat").ok()?;
    let fields: Vec<&str> = text.rsplit(')').next()?.split_whitespace().collect();
    let ticks = |k: usize| fields.get(k)?.parse::<f64>().ok();
    Some((ticks(11)? + ticks(12)?) / 100.0)
}

/// Times of one call, s.
struct Times {
    best: f64,
    median: f64,
    processor: Option<f64>,
}

/// Calls again and again, in batches of about a millisecond.
fn time(seconds: f64, mut call: impl FnMut()) -> Times {
    let clock = Instant::now();
    call();
    let batch = ((1e-3 / clock.elapsed().as_secs_f64()) as usize).clamp(1, 1000);
    let mut times = Vec::new();
    let (start, before) = (Instant::now(), processor_seconds());
    while times.len() < 5 || start.elapsed().as_secs_f64() < seconds {
        let clock = Instant::now();
        (0..batch).for_each(|_| call());
        times.push(clock.elapsed().as_secs_f64() / batch as f64);
    }
    let calls = (batch * times.len()) as f64;
    let processor = processor_seconds().zip(before).map(|(after, before)| (after - before) / calls);
    times.sort_by(f64::total_cmp);
    Times { best: times[0], median: times[times.len() / 2], processor }
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [xml, structure, rest @ ..] = &arguments[..] else {
        return Err("usage: forces SYSTEM.xml[.gz] POSITIONS.json[.gz] [SECONDS]".into());
    };
    let seconds: f64 = rest.first().map_or(Ok(0.3), |text| text.parse())?;
    let (system, _) = read_system(&text(xml)?, xml, &SystemOptions::default()).into_result(false)?;
    let x = positions(&serde_json::from_str(&text(structure)?)?)?;
    let mut field = ForceField::new(&system)?;
    let (mut energies, mut forces) = (vec![0.0; field.terms().len()], vec![Vec3([0.0; 3]); x.len()]);
    field.evaluate(&x, &mut energies, &mut forces)?;
    let names = field.terms().to_vec();
    let by_name: BTreeMap<&String, f64> = names.iter().zip(energies.iter().copied()).collect();
    let rows: Vec<[f64; 3]> = forces.iter().map(|f| f.0).collect();
    let whole = time(seconds, || drop(field.evaluate(&x, &mut energies, &mut forces)));
    let mut terms = BTreeMap::new();
    for (term, name) in names.iter().enumerate() {
        let times = time(0.1 * seconds, || drop(field.evaluate_term(term, &x, &mut forces)));
        terms.insert(name, times.best);
    }
    let report = json!({
        "atoms": x.len(), "best_s": whole.best, "median_s": whole.median, "processor_s": whole.processor, "terms_best_s": terms, "energies": by_name,
        "forces": rows,
    });
    println!("{report}");
    Ok(())
}
