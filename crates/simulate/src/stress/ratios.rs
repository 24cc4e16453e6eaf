//! Unequal masses and lengths.

use super::Scene;
use super::chain::Chain;
use super::tree::{Call, judge};
use phipsi_model::Base;

const FAMILY: &str = "ratios";

fn scene(name: String, what: &str, chain: Chain, seed: u64, line: Option<f64>) -> Scene {
    Scene::new(FAMILY, name, what, move || {
        let state = chain.state(seed, 0.5, 1.0);
        judge(Call { line, ..Call::new(chain.model(), state) })
    })
}

pub(super) fn scenes() -> Vec<Scene> {
    let mut all = Vec::new();
    for decade in [-12, -9, -6, -3, 3, 6, 9, 12] {
        let mut chain = Chain::uniform(10);
        chain.masses[9] = 10f64.powi(decade);
        // Lines of soa.md 2.3.
        let line = match decade {
            6 => Some(1e-13),
            9 => Some(1e-12),
            12 => Some(1e-11),
            _ => None,
        };
        let what = "ten rods of 1 kg, the last of another mass";
        all.push(scene(format!("tip-mass-1e{decade}"), what, chain, (100 + decade) as u64, line));
    }
    for decade in [-12, 12] {
        let mut chain = Chain::uniform(10);
        chain.masses[0] = 10f64.powi(decade);
        let what = "ten rods of 1 kg, the first of another mass";
        all.push(scene(format!("base-mass-1e{decade}"), what, chain, (130 + decade) as u64, None));
    }
    for decade in [-9, 9] {
        let mut chain = Chain { base: Base::Free, gravity: 0.0, ..Chain::uniform(10) };
        chain.masses[0] = 10f64.powi(decade);
        let what = "free flyer: nine rods of 1 kg on a base of another mass";
        all.push(scene(format!("free-base-1e{decade}"), what, chain, (140 + decade) as u64, None));
    }
    for (name, mass) in [("0.1", 0.1), ("10", 10.0)] {
        let what = "twenty rods of 1 m, masses by a factor from each to the next";
        all.push(scene(format!("mass-x{name}-per-link"), what, Chain::growing(20, mass, 1.0), 200, None));
    }
    let heavier = Chain { masses: (0..10).map(|k| 1e-50 * 1e10f64.powi(k)).collect(), ..Chain::uniform(10) };
    all.push(scene("mass-x1e10-per-link".into(), "ten rods of 1e-50 to 1e40 kg", heavier, 1, None));
    for decade in [3, 6, 9, 12, 15] {
        let mut chain = Chain::uniform(20);
        chain.masses.iter_mut().skip(1).step_by(2).for_each(|m| *m = 10f64.powi(-decade));
        let what = "twenty rods, every other one lighter";
        all.push(scene(format!("alternating-1e-{decade}"), what, chain, 300 + decade as u64, None));
    }
    for (name, ratio) in [("0.1", 0.1f64), ("2", 2.0), ("4", 4.0)] {
        let what = "twenty rods, lengths by a factor from each to the next, masses by its cube";
        let chain = Chain::growing(20, ratio.powi(3), ratio);
        all.push(scene(format!("length-x{name}-per-link"), what, chain, 400, None));
    }
    let longer = Chain {
        masses: (0..16).map(|k| 1e-30 * 1e3f64.powi(k)).collect(),
        lengths: (0..16).map(|k| 1e-8 * 10f64.powi(k)).collect(),
        ..Chain::uniform(16)
    };
    let what = "sixteen rods of 1e-8 to 1e7 m, masses by the cube of the lengths";
    all.push(scene("length-x10-per-link".into(), what, longer, 1, None));
    all
}
