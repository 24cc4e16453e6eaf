//! s
mod common;
use phipsi_model::Random;
use phipsi_recursion as fast;
use phipsi_recursion::*;
use phipsi_reference::generate::*;
#[test]
fn scratch() {
    for seed in [97u64, 304] {
        let mut case = case(seed);
        case.model = starved(&mut Random::new(seed), &case.model);
        let l = Layout::<f64>::new(&case.model);
        let zero = vec![0.0; l.nv()];
        let l0 = l.clone().with_gravity(phipsi_spatial::Vec3::zero());
        let show =
            |n: &str, l: &Layout<f64>, v: &[f64], tau: &[f64], w: Option<&[phipsi_spatial::Wrench<f64>]>| {
                let a = fast::forward_dynamics(l, &case.q, v, tau, w);
                let b = fast::square_root_forward_dynamics(&case.model, l, &case.q, v, tau, w);
                match (a, b) {
                    (Ok(a), Ok(b)) => {
                        let s = a.iter().fold(0.0f64, |m, x| m.max(x.abs()));
                        println!(
                            "{n}: {:e}",
                            a.iter().zip(&b).fold(0.0f64, |m, (x, y)| m.max((x - y).abs())) / s
                        );
                    }
                    (a, b) => println!("{n} {:?} {:?}", a.map(|_| 0), b.map(|_| 0)),
                }
            };
        let mut t = zero.clone();
        if seed == 97 {
            t[9] = 1.0;
        } else {
            t[9] = 1.0;
        }
        show("x", &l0, &zero, &t, None);
        for (k, j) in case.model.joints().iter().enumerate() {
            let i = &case.model.bodies()[k].inertia;
            println!(
                "{k} {} parent {:?} {} m {} t {:?} at {:?}",
                j.name,
                case.model.tree().parent(k),
                j.kind.word(),
                i.mass,
                i.tensor,
                j.placement
            );
        }
        println!(
            "{:?}",
            singular_hinges(&case.model)
                .iter()
                .map(|s| format!("{:?} {}", s.subject, s.found))
                .collect::<Vec<_>>()
        );
    }
}
