//! Long, small, large, far, fast, folded: chains whose numbers are extreme in other ways than by their ratios.

use super::Scene;
use super::chain::Chain;
use super::tree::{Call, judge};
use std::f64::consts::PI;

const FAMILY: &str = "places";

fn scene(name: impl Into<String>, what: &str, chain: Chain, bend: f64, rate: f64) -> Scene {
    Scene::new(FAMILY, name, what, move || {
        let state = chain.state(500, bend, rate);
        judge(Call::new(chain.model(), state))
    })
}

pub(super) fn scenes() -> Vec<Scene> {
    let mut all = Vec::new();
    for n in [256, 1_000, 10_000] {
        let what = "equal rods, axes y and z in turn, bent at random";
        all.push(scene(format!("chain-{n}"), what, Chain::uniform(n), 0.3, 1.0));
    }
    for (name, n) in [("chain-1e5", 100_000), ("chain-1e6", 1_000_000)] {
        let what = "equal rods, axes y and z in turn, bent at random";
        all.push(scene(name, what, Chain::uniform(n), 0.3, 1.0).slow());
    }
    let planar = Chain { axes: vec![2; 256], ..Chain::uniform(256) };
    all.push(scene("straight-256", "equal rods in one line, parallel axes", planar.clone(), 0.0, 1.0));
    let zigzag = planar.clone();
    all.push(Scene::new(
        FAMILY,
        "folded-256",
        "equal rods, each folded back onto the one before",
        move || {
            let mut state = zigzag.state(500, 0.0, 1.0);
            state.q.iter_mut().skip(1).for_each(|q| *q = PI);
            judge(Call::new(zigzag.model(), state))
        },
    ));
    for decade in [-6, 6] {
        let size = 10f64.powi(decade);
        let chain =
            Chain { lengths: vec![size; 10], masses: vec![1e3 * size.powi(3); 10], ..Chain::uniform(10) };
        all.push(scene(
            format!("size-1e{decade}"),
            "ten rods of that length, m, of the density of water",
            chain,
            0.5,
            1.0,
        ));
    }
    for decade in [4, 8] {
        let far = 10f64.powi(decade);
        let chain = Chain { offset: [far, -far, far], ..Chain::uniform(10) };
        all.push(scene(
            format!("far-1e{decade}"),
            "ten rods at that distance from the origin, m",
            chain,
            0.5,
            1.0,
        ));
    }
    for (name, rate) in [("1e-8", 1e-8), ("1e4", 1e4), ("1e8", 1e8), ("1e140", 1e140)] {
        all.push(scene(
            format!("rates-{name}"),
            "ten rods at joint rates of that size, rad/s",
            Chain::uniform(10),
            0.5,
            rate,
        ));
    }
    all.push(scene(
        "rates-1e160",
        "joint rates whose squares are beyond f64",
        Chain::uniform(10),
        0.5,
        1e160,
    ));
    let chain = Chain::uniform(10);
    all.push(Scene::new(FAMILY, "turns-1e8", "joint angles of about 1e8 turns", move || {
        let mut state = chain.state(500, 0.5, 1.0);
        state.q.iter_mut().for_each(|q| *q += 2.0 * PI * 1e8);
        judge(Call::new(chain.model(), state))
    }));
    all
}
