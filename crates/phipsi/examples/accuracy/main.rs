//! Accuracy.

use phipsi::recursion::{Layout, forward_dynamics, inverse_dynamics, square_root_forward_dynamics};
use phipsi::spatial::{Dd, Scalar};
use phipsi_reference::extreme::{Chain, Scene, scenes};
use phipsi_reference::sensitivity::widened;

fn error(a: &[f64], truth: &[Dd]) -> f64 {
    let scale = truth.iter().fold(0.0f64, |m, x| m.max(x.hi.abs()));
    a.iter().zip(truth).fold(0.0f64, |m, (x, y)| m.max((Dd::from_f64(*x) - *y).hi.abs() / scale))
}

fn show(scene: &Scene) {
    let c = &scene.case;
    let layout = Layout::<f64>::new(&c.model);
    let wide = Layout::<Dd>::new(&c.model);
    let (q, v, tau) = (widened(&c.q), widened(&c.v), widened(&c.tau));
    let truth = square_root_forward_dynamics(&c.model, &wide, &q, &v, &tau, None);
    let other = forward_dynamics(&wide, &q, &v, &tau, None);
    let truth = match truth { Ok(t) => t, Err(e) => { println!("{}: truth {e}", scene.name); return; } };
    let dd = match other { Ok(o) => error(&o.iter().map(|x| x.hi).collect::<Vec<_>>(), &truth), Err(_) => f64::NAN };
    let plain = forward_dynamics(&layout, &c.q, &c.v, &c.tau, None);
    let plain_error = plain.as_ref().map_or(f64::NAN, |a| error(a, &truth));
    let root = square_root_forward_dynamics(&c.model, &layout, &c.q, &c.v, &c.tau, None);
    let root_error = match &root { Ok(a) => error(a, &truth), Err(e) => { println!("{e}"); f64::NAN } };
    let refine = |a: &[f64]| -> f64 {
        let t = inverse_dynamics(&layout, &c.q, &c.v, a, None).unwrap();
        let r: Vec<f64> = c.tau.iter().zip(&t).map(|(x, y)| x - y).collect();
        let still = layout.clone().with_gravity(phipsi::spatial::Vec3::zero());
        match forward_dynamics(&still, &c.q, &vec![0.0; a.len()], &r, None) {
            Ok(d) => error(&a.iter().zip(&d).map(|(x, y)| x + y).collect::<Vec<_>>(), &truth),
            Err(_) => f64::NAN,
        }
    };
    let refined = plain.as_ref().map_or(f64::NAN, |a| refine(a));
    println!("{:45} plain {plain_error:.1e} refined {refined:.1e} root {root_error:.1e} dd {dd:.1e}", scene.name);
}

fn main() {
    let text = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/../../validation/data/extreme_chains.json")).unwrap();
    let file: serde_json::Value = serde_json::from_str(&text).unwrap();
    for c in file.as_array().unwrap() {
        let n = |k: &str| c[k].as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect::<Vec<_>>();
        let offset = n("offset");
        let chain = Chain { masses: n("m"), lengths: n("L"), axes: n("axis").iter().map(|x| *x as usize).collect(), offset: [offset[0], offset[1], offset[2]], gravity: c["g"].as_f64().unwrap() };
        let s = Scene { name: format!("stored: {}", c["name"].as_str().unwrap()), case: chain.case(n("q"), n("qd"), n("tau")) };
        show(&s);
        let l = Layout::<f64>::new(&s.case.model);
        let a = square_root_forward_dynamics(&s.case.model, &l, &s.case.q, &s.case.v, &s.case.tau, None).unwrap();
        let want: Vec<Dd> = c["acc_ref"].as_array().unwrap().iter().map(|x| Dd::splat(x.as_str().unwrap().parse().unwrap())).collect();
        println!("   against stored: {:.1e}", error(&a, &want));
    }
    for s in scenes() { show(&s); }
}
