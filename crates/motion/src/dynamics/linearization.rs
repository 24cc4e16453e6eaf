//! The Jacobian of the equations of motion, for implicit methods.
//!
//! | symbol | meaning | shape |
//! |---|---|---|
//! | A_q, A_v, A_a | ∂v̇ along increments of q, by v, by auxiliary quantities | nv × nv, nv × nv, nv × na |
//! | G | derivatives of the rates of auxiliary quantities | na × (2 nv + na) |

use super::{Dynamics, MotionError};
use crate::force::Situation;
use crate::force_rates::{LoadRates, PointRates};
use crate::system::{Linearization, System, differences};
use phipsi_model::Model;
use phipsi_recursion::{ForwardDynamicsDerivatives, Layout};

/// Scratch of the linearisation.
pub(super) struct Tangent {
    derivatives: ForwardDynamicsDerivatives<f64>,
    inverse: Vec<f64>,
    d_dq: Vec<f64>,
    d_dv: Vec<f64>,
    d_daux: Vec<f64>,
    points: [PointRates; 2],
}

impl Tangent {
    fn new(layout: &Layout<f64>, auxiliary: usize) -> Self {
        let nv = layout.nv();
        let square = || vec![0.0; nv * nv];
        Tangent {
            derivatives: ForwardDynamicsDerivatives::new(layout),
            inverse: square(),
            d_dq: square(),
            d_dv: square(),
            d_daux: vec![0.0; nv * auxiliary],
            points: [PointRates::new(layout), PointRates::new(layout)],
        }
    }
}

/// The loads without forward dynamics: accelerations are zeros.
struct LoadsOnly<'a>(&'a mut Dynamics);

impl System for LoadsOnly<'_> {
    type Error = MotionError;
    fn model(&self) -> &Model {
        &self.0.model
    }
    fn auxiliary_len(&self) -> usize {
        self.0.names.len()
    }
    fn derivative(
        &mut self,
        t: f64,
        q: &[f64],
        v: &[f64],
        aux: &[f64],
        v_dot: &mut [f64],
        aux_dot: &mut [f64],
    ) -> Result<(), MotionError> {
        v_dot.fill(0.0);
        self.0.collect(t, (q, v, aux), aux_dot)
    }
}

impl Dynamics {
    /// A_q, A_v, A_a from the derivatives of forward dynamics and of the forces; false if a force has none.
    ///
    /// ∂v̇ = ∂v̇ at fixed loads + M⁻¹ ∂loads.
    pub(super) fn analytic(
        &mut self,
        t: f64,
        (q, v, aux): (&[f64], &[f64], &[f64]),
        out: &mut Linearization,
    ) -> Result<bool, MotionError> {
        let (nv, na) = (v.len(), aux.len());
        let mut aux_dot = std::mem::take(&mut self.aux_dot);
        aux_dot.resize(na, 0.0);
        let collected = self.collect(t, (q, v, aux), &mut aux_dot);
        self.aux_dot = aux_dot;
        collected?;
        let tangent = self.tangent.get_or_insert_with(|| Tangent::new(&self.layout, na));
        for rates in [&mut tangent.d_dq, &mut tangent.d_dv, &mut tangent.d_daux] {
            rates.fill(0.0);
        }
        let kinematics = self.plan.kinematics.then_some(&self.kinematics);
        let at = Situation { model: &self.model, layout: &self.layout, t, q, v, kinematics };
        for (i, force) in self.forces.iter_mut().enumerate() {
            let mut rates = LoadRates {
                d_dq: &mut tangent.d_dq,
                d_dv: &mut tangent.d_dv,
                d_daux: &mut tangent.d_daux,
                nv,
                auxiliary: na,
                slot: self.slots[i],
                own: &aux[self.slots[i]..self.slots[i + 1]],
                points: &mut tangent.points,
            };
            if !force.add_rates(&at, &mut rates) {
                return Ok(false);
            }
        }
        let wrenches = self.plan.wrenches.then_some(&self.wrenches[..]);
        let Linearization { a_q, a_v, a_aux, .. } = out;
        let Tangent { derivatives, inverse, d_dq, d_dv, d_daux, .. } = tangent;
        derivatives.run(&self.layout, q, v, &self.tau, wrenches, a_q, a_v, inverse)?;
        a_aux.fill(0.0);
        for (rates, columns, out) in [(d_dq, nv, a_q), (d_dv, nv, a_v), (d_daux, na, a_aux)] {
            for k in 0..nv {
                let row = &rates[k * columns..(k + 1) * columns];
                // Most generalised forces of a large tree have no force on them.
                if row.iter().all(|x| *x == 0.0) {
                    continue;
                }
                for i in 0..nv {
                    let weight = inverse[i * nv + k];
                    let out = &mut out[i * columns..(i + 1) * columns];
                    out.iter_mut().zip(row).for_each(|(out, x)| *out += weight * x);
                }
            }
        }
        Ok(true)
    }

    /// G: derivatives of the rates of auxiliary quantities, by central differences of the loads alone.
    pub(super) fn auxiliary_rates(
        &mut self,
        t: f64,
        (q, v, aux): (&[f64], &[f64], &[f64]),
        out: &mut Linearization,
    ) -> Result<(), MotionError> {
        let (nv, na) = (v.len(), aux.len());
        let mut loads = LoadsOnly(self);
        let mut scratch = std::mem::replace(out, Linearization::new(0, 0));
        let mut whole = Linearization::new(nv, na);
        let result = differences(&mut loads, t, (q, v, aux), &mut whole);
        (scratch.g_q, scratch.g_v, scratch.g_aux) = (whole.g_q, whole.g_v, whole.g_aux);
        *out = scratch;
        result.map(|_| ())
    }
}
