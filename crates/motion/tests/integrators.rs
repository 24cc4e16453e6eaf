//! Orders, dense output, checkpoints and error estimates of the integrators.

use crate::common::*;
use phipsi_model::State;
use phipsi_motion::{Dynamics, Integrator, JudgedRun, Method, System, Tolerances, estimate_error};

/// Error of the double pendulum's angles at t = 1 with a given number of equal steps.
fn error_with(method: Method, steps: usize, truth: &[f64]) -> f64 {
    let model = double_pendulum();
    let mut dynamics = free_fall(&model, vec![]);
    let accept = Tolerances { rtol: f64::INFINITY, atol: f64::INFINITY, max_step: f64::INFINITY };
    let mut integrator = Integrator::new(&model, method, accept, 0.0, &[0.5, 0.6], &[0.0; 2], &[]);
    for i in 1..=steps {
        let end = i as f64 / steps as f64;
        integrator.propose(end - integrator.t());
        integrator.step(&mut dynamics, end, false).unwrap();
    }
    (0..2).map(|i| (integrator.q()[i] - truth[i]).abs()).fold(0.0, f64::max)
}

#[test]
fn lower_orders_show_on_a_double_pendulum() {
    let mut dynamics = free_fall(&double_pendulum(), vec![]);
    let (end, _) = run(&mut dynamics, Method::Dop853, 1e-15, &[0.5, 0.6], &[0.0; 2], 1.0);
    for (method, steps) in [
        (Method::Rk4 { step: 1.0 }, [100, 150, 200, 300, 400, 600]),
        (Method::Tsit5, [100, 140, 180, 240, 320, 400]),
    ] {
        let order = f64::from(method.order());
        let points = steps.map(|n| ((n as f64).ln(), error_with(method, n, end.q()).ln()));
        let mean = |f: fn(&(f64, f64)) -> f64| points.iter().map(f).sum::<f64>() / points.len() as f64;
        let (x, y) = (mean(|p| p.0), mean(|p| p.1));
        let slope = points.iter().map(|p| (p.0 - x) * (p.1 - y)).sum::<f64>()
            / points.iter().map(|p| (p.0 - x).powi(2)).sum::<f64>();
        // Tsit5's leading error terms are tuned to be small, so the next one still shows.
        let margin = if order == 5.0 { 0.25 } else { 0.1 };
        assert!((-slope - order).abs() < margin, "{method:?}: observed {:.2}, {points:?}", -slope);
    }
}

/// A free body has large rotations in every step: the differential of the retraction must be right for the order to show.
#[test]
fn order_survives_on_rotations() {
    let model = free_body([1.0, 2.0, 2.5]);
    let v = [0.7, 1.3, -0.4, 0.2, 0.1, -0.3];
    let mut dynamics = free_fall(&model, vec![]);
    let (end, _) = run(&mut dynamics, Method::Dop853, 1e-14, &model.neutral::<f64>(), &v, 4.0);
    let error = |method: Method, steps: usize| {
        let mut dynamics = free_fall(&model, vec![]);
        let accept = Tolerances { rtol: f64::INFINITY, atol: f64::INFINITY, max_step: f64::INFINITY };
        let mut i = Integrator::new(&model, method, accept, 0.0, &model.neutral::<f64>(), &v, &[]);
        for n in 1..=steps {
            let t = 4.0 * n as f64 / steps as f64;
            i.propose(t - i.t());
            i.step(&mut dynamics, t, false).unwrap();
        }
        model.difference(end.q(), i.q()).iter().fold(0.0f64, |m, x| m.max(x.abs()))
    };
    for (method, counts) in [(Method::Tsit5, [40, 60, 80, 120]), (Method::Dop853, [12, 16, 22, 30])] {
        let order = f64::from(method.order());
        let errors = counts.map(|n| error(method, n));
        let observed = (errors[0] / errors[3]).ln() / (counts[3] as f64 / counts[0] as f64).ln();
        assert!((observed - order).abs() < 0.3, "{method:?}: observed {observed:.2}, {errors:?}");
    }
}

#[test]
fn dense_output_is_as_good_as_the_steps() {
    let model = double_pendulum();
    for (method, tolerance, allowed) in [(Method::Tsit5, 1e-8, 1e-7), (Method::Dop853, 1e-10, 1e-8)] {
        let mut dynamics = free_fall(&model, vec![]);
        let mut integrator =
            Integrator::new(&model, method, Tolerances::new(tolerance), 0.0, &[1.5, -0.4], &[0.0; 2], &[]);
        let (mut q, mut v) = ([0.0; 2], [0.0; 2]);
        while integrator.t() < 1.0 {
            let step = integrator.step(&mut dynamics, 1.0, false).unwrap();
            for theta in [0.2, 0.5, 0.9] {
                let t = step.t0 + theta * (step.t1 - step.t0);
                integrator.sample(&mut dynamics, t, &mut q, &mut v, &mut []).unwrap();
                let (exact, _) =
                    run(&mut free_fall(&model, vec![]), Method::Dop853, 1e-13, &[1.5, -0.4], &[0.0; 2], t);
                let error = (0..2).map(|i| (q[i] - exact.q()[i]).abs()).fold(0.0, f64::max);
                assert!(error < allowed, "{method:?} at {t}: {error:e}");
            }
        }
    }
}

/// Without evaluations DOP853 is of fifth order between the ends of a step, in q and v, rotations included: the local error falls with the
/// sixth power of the step. With the evaluations made, and with other methods, it is the dense output.
#[test]
fn rough_samples_of_a_step_cost_nothing() {
    let model = free_body([1.0, 2.0, 2.5]);
    let (start, v0) = (model.neutral::<f64>(), [0.7, 1.3, -0.4, 0.2, 0.1, -0.3]);
    let accept = Tolerances { rtol: f64::INFINITY, atol: f64::INFINITY, max_step: f64::INFINITY };
    let stepped = |method: Method, h: f64| {
        let mut dynamics = free_fall(&model, vec![]);
        let mut i = Integrator::new(&model, method, accept, 0.0, &start, &v0, &[]);
        i.propose(h);
        i.step(&mut dynamics, h, false).unwrap();
        (dynamics, i)
    };
    let largest = |x: &[f64]| x.iter().fold(0.0f64, |m, x| m.max(x.abs()));
    let apart = |a: &(Vec<f64>, Vec<f64>), b: &(Vec<f64>, Vec<f64>)| {
        let dv: Vec<f64> = a.1.iter().zip(&b.1).map(|(a, b)| a - b).collect();
        largest(&model.difference(&a.0, &b.0)).max(largest(&dv))
    };
    let rough = |dynamics: &Dynamics, i: &mut Integrator, t: f64| {
        let (mut q, mut v) = (start.clone(), vec![0.0; 6]);
        i.sample_roughly(dynamics, t, &mut q, &mut v, &mut []);
        (q, v)
    };
    let fine = |dynamics: &mut Dynamics, i: &mut Integrator, t: f64| {
        let (mut q, mut v) = (start.clone(), vec![0.0; 6]);
        i.sample(dynamics, t, &mut q, &mut v, &mut []).unwrap();
        (q, v)
    };
    let thetas = [0.1, 0.3, 0.45, 0.7, 0.9, 1.0];
    let errors = [0.8, 0.4].map(|h| {
        thetas.map(|theta| {
            let (mut dynamics, mut i) = stepped(Method::Dop853, h);
            let before = i.counts();
            let sample = rough(&dynamics, &mut i, theta * h);
            assert_eq!(i.counts(), before);
            let (exact, _) =
                run(&mut free_fall(&model, vec![]), Method::Dop853, 1e-14, &start, &v0, theta * h);
            let error = apart(&sample, &(exact.q().to_vec(), exact.v().to_vec()));
            let dense = fine(&mut dynamics, &mut i, theta * h);
            assert_eq!(rough(&dynamics, &mut i, theta * h), dense);
            error
        })
    });
    let [coarse, halved] = errors.map(|e| largest(&e));
    let order = (coarse / halved).log2();
    assert!((5.5..7.5).contains(&order) && coarse < 1e-3, "{order:.2}, {errors:?}");
    for method in [Method::Tsit5, Method::Rk4 { step: 0.4 }, Method::Rodas5p] {
        let (mut dynamics, mut i) = stepped(method, 0.4);
        let sample = rough(&dynamics, &mut i, 0.13);
        assert_eq!(sample, fine(&mut dynamics, &mut i, 0.13), "{method:?}");
    }
}

#[test]
fn a_checkpoint_continues_bit_for_bit() {
    let model = free_body([1.0, 2.0, 2.5]);
    let v = [0.7, 1.3, -0.4, 0.2, 0.1, -0.3];
    let go = |dynamics: &mut Dynamics, i: &mut Integrator| {
        let mut trace = Vec::new();
        while i.t() < 3.0 {
            i.step(dynamics, 3.0, false).unwrap();
            trace.extend(i.q().iter().chain(i.v()).map(|x| x.to_bits()));
        }
        trace
    };
    for method in [Method::Dop853, Method::Tsit5, Method::Rk4 { step: 0.05 }] {
        let mut dynamics = free_fall(&model, vec![]);
        let start =
            || Integrator::new(&model, method, Tolerances::new(1e-8), 0.0, &model.neutral::<f64>(), &v, &[]);
        let whole = go(&mut dynamics, &mut start());
        let mut first = start();
        for _ in 0..5 {
            first.step(&mut dynamics, 3.0, false).unwrap();
        }
        let saved = first.checkpoint();
        let mut second = start();
        second.restore(saved);
        let rest = go(&mut free_fall(&model, vec![]), &mut second);
        assert_eq!(rest[..], whole[whole.len() - rest.len()..], "{method:?}");
        assert!(rest.len() < whole.len());
    }
}

/// A free body has a singular hinge nowhere; energy fed by a runaway force does blow up and must be named.
#[test]
fn a_runaway_is_named_not_hidden() {
    struct Runaway;
    impl phipsi_motion::Force for Runaway {
        fn name(&self) -> &str {
            "runaway"
        }
        fn add(
            &mut self,
            at: &phipsi_motion::Situation<'_>,
            _: &[f64],
            _: &mut [f64],
            loads: &mut phipsi_motion::Loads<'_>,
        ) -> Result<(), phipsi_motion::ForceError> {
            loads.tau[0] += 10.0 * at.v[0].powi(3);
            Ok(())
        }
    }
    let model = pendulum();
    let mut dynamics = free_fall(&model, vec![Box::new(Runaway)]);
    let aux = vec![0.0; dynamics.auxiliary_len()];
    let mut i = Integrator::new(&model, Method::Dop853, Tolerances::new(1e-8), 0.0, &[0.1], &[2.0], &aux);
    let error = loop {
        match i.step(&mut dynamics, 10.0, false) {
            Ok(_) => assert!(i.q().iter().chain(i.v()).all(|x| x.is_finite())),
            Err(e) => break e,
        }
    };
    assert!(error.describe(&model).contains("t = "), "{}", error.describe(&model));
}

/// Global error estimates against the truth, on a regular and a nearly chaotic motion, at tolerances from 1e-5 to 1e-12.
#[test]
fn the_estimate_is_within_a_factor_ten_in_most_runs() {
    let (mut good, mut all) = (0, Vec::new());
    let free = free_body([1.0, 2.0, 2.5]);
    let cases = [
        (pendulum(), vec![1.5], vec![0.0], 5.0),
        (double_pendulum(), vec![0.7, -0.4], vec![0.0, 0.0], 3.0),
        (free.clone(), free.neutral::<f64>(), vec![0.7, 1.3, -0.4, 0.2, 0.1, -0.3], 6.0),
    ];
    for (model, q, v, t_end) in &cases {
        let mut truth = free_fall(model, vec![]);
        let (exact, _) = run(&mut truth, Method::Dop853, 1e-14, q, v, *t_end);
        for method in [Method::Dop853, Method::Tsit5] {
            for exponent in 5..=12 {
                let tolerances = Tolerances::new(10f64.powi(-exponent));
                let mut dynamics = free_fall(model, vec![]);
                let (end, steps) = run(&mut dynamics, method, tolerances.rtol, q, v, *t_end);
                let error = model.difference(exact.q(), end.q()).iter().fold(0.0f64, |m, x| m.max(x.abs()));
                let samples = [State { t: *t_end, q: end.q().to_vec(), v: end.v().to_vec() }];
                let start = (0.0, &q[..], &v[..], &[][..]);
                let judged = JudgedRun {
                    method,
                    tolerances,
                    start,
                    steps: &steps,
                    breaks: &[],
                    samples: &samples,
                    events: &[],
                };
                let estimate = estimate_error(&mut dynamics, &judged).unwrap().q.unwrap_or(f64::INFINITY);
                // Below 1e-12 rounding of the truth itself is of the size of the errors.
                let both_tiny = error < 1e-12 && estimate < 1e-12;
                let ratio = estimate / error;
                good += usize::from(both_tiny || (0.1..=10.0).contains(&ratio));
                all.push(format!(
                    "{} {method:?} 1e-{exponent}: {error:.1e}, estimate {estimate:.1e}",
                    model.name()
                ));
            }
        }
    }
    assert!(good * 100 >= all.len() * 90, "{good} of {}:\n{}", all.len(), all.join("\n"));
}
