use super::*;
use phipsi_reference::generate::{Case, case, case_with_limbs};
use phipsi_spatial::lanes::Level;

/// The axes of the bodies, those of the ground, and lanes for limbs: the same matrix but for rounding, 32 ε (a body is turned and shifted
/// by some 30 operations) for each body of the largest of its entries. The number of limbs in lanes.
fn all_ways_agree(case: &Case, at: &str) -> usize {
    let layout = Layout::<f64>::new(&case.model);
    let nv = layout.nv();
    let run = |ground: bool, limbs: bool| {
        let mut layout = layout.clone();
        if !limbs {
            layout.limbs = None;
        }
        let mut work = MassMatrix::<f64>::new(&layout);
        work.ground = ground.then(|| InGround::of_any(&layout, &work.work.places));
        // What is not written would stay.
        let mut out = vec![f64::NAN; nv * nv];
        work.run(&layout, &case.q, &mut out).expect("lengths agree");
        out
    };
    let (bodies, ground, limbs) = (run(false, false), run(true, false), run(false, true));
    let largest = bodies.iter().fold(0.0, |a: f64, x| a.max(x.abs()));
    let allowed = 32.0 * layout.len() as f64 * f64::EPSILON * largest;
    for i in 0..nv {
        for j in 0..nv {
            for other in [&ground, &limbs] {
                let (a, b) = (bodies[i * nv + j], other[i * nv + j]);
                assert!((a - b).abs() <= allowed, "{at}: ({i}, {j}): {a} and {b}, {allowed:e} allowed");
                assert!(b == other[j * nv + i], "{at}: ({i}, {j}) is not symmetric");
            }
        }
    }
    layout.limb_count()
}

#[test]
fn all_ways_to_the_mass_matrix_agree() {
    let mut limbs = 0;
    for seed in 0..300 {
        all_ways_agree(&case(seed), &format!("seed {seed}"));
        limbs += all_ways_agree(&case_with_limbs(seed), &format!("seed {seed}, with limbs"));
    }
    assert!(limbs > 100 || Level::best() == Level::Scalar, "{limbs}");
}
