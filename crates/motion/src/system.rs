//! What an integrator integrates.

use crate::event::Events;
use phipsi_model::Model;

/// What putting a state back onto closures and prescribed motions did.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Projected {
    /// Largest residual of the closures afterwards, rad or m.
    pub position: f64,
    /// Largest residual of their rates afterwards, rad/s or m/s.
    pub velocity: f64,
    /// Kinetic energy of what was taken from the velocities, J.
    pub energy_removed: f64,
}

/// Equations of motion on the configuration space of a model, with quantities integrated beside the state.
pub trait System {
    /// Why a derivative could not be computed.
    type Error;
    /// The model whose configuration space it is.
    fn model(&self) -> &Model;
    /// Number of auxiliary quantities.
    fn auxiliary_len(&self) -> usize;
    /// Accelerations (nv) and rates of the auxiliary quantities.
    ///
    /// # Errors
    /// A trial step that meets one is tried again with a smaller size.
    fn derivative(
        &mut self,
        t: f64,
        q: &[f64],
        v: &[f64],
        aux: &[f64],
        v_dot: &mut [f64],
        aux_dot: &mut [f64],
    ) -> Result<(), Self::Error>;
    /// Puts a state back onto what the system keeps exactly; `None` and no change where there is no such thing.
    ///
    /// # Errors
    /// The step that led here is then tried again with a smaller size.
    fn project(&mut self, _t: f64, _q: &mut [f64], _v: &mut [f64]) -> Result<Option<Projected>, Self::Error> {
        Ok(None)
    }
    /// True if the derivative does not depend on time itself.
    fn is_autonomous(&self) -> bool {
        false
    }
    /// Its events, where it has any.
    fn events(&mut self) -> Option<&mut dyn Events<Error = Self::Error>> {
        None
    }
    /// Derivatives of the derivative along increments of q, by v and by the auxiliary quantities; returns the evaluations it took.
    ///
    /// By central differences where a system has nothing better: 4 nv + 2 na evaluations, good to ε^⅔.
    ///
    /// # Errors
    /// As [`System::derivative`].
    fn linearize(
        &mut self,
        t: f64,
        q: &[f64],
        v: &[f64],
        aux: &[f64],
        out: &mut Linearization,
    ) -> Result<u64, Self::Error> {
        differences(self, t, (q, v, aux), out)
    }
}

/// Blocks of the Jacobian of (v̇, rates of aux), by rows.
#[derive(Clone, Debug, PartialEq)]
pub struct Linearization {
    /// Number of auxiliary quantities, na.
    pub auxiliary: usize,
    /// ∂v̇ along increments of q, nv×nv.
    pub a_q: Vec<f64>,
    /// ∂v̇ by v, nv×nv.
    pub a_v: Vec<f64>,
    /// ∂v̇ by the auxiliary quantities, nv×na.
    pub a_aux: Vec<f64>,
    /// ∂(rates of aux) along increments of q, na×nv.
    pub g_q: Vec<f64>,
    /// ∂(rates of aux) by v, na×nv.
    pub g_v: Vec<f64>,
    /// ∂(rates of aux) by the auxiliary quantities, na×na.
    pub g_aux: Vec<f64>,
}

impl Linearization {
    /// Zeros.
    pub fn new(nv: usize, auxiliary: usize) -> Self {
        let zero = |n: usize| vec![0.0; n];
        Linearization {
            auxiliary,
            a_q: zero(nv * nv),
            a_v: zero(nv * nv),
            a_aux: zero(nv * auxiliary),
            g_q: zero(auxiliary * nv),
            g_v: zero(auxiliary * nv),
            g_aux: zero(auxiliary * auxiliary),
        }
    }
}

/// ε^⅓: truncation and rounding of a central difference balance.
const DELTA: f64 = 6e-6;

/// [`System::linearize`] by central differences.
///
/// # Errors
/// As [`System::derivative`].
pub fn differences<S: System + ?Sized>(
    system: &mut S,
    t: f64,
    (q, v, aux): (&[f64], &[f64], &[f64]),
    out: &mut Linearization,
) -> Result<u64, S::Error> {
    let (nv, na) = (v.len(), aux.len());
    let mut moved = (q.to_vec(), v.to_vec(), aux.to_vec());
    let mut xi = vec![0.0; nv];
    let mut rates = [vec![0.0; nv + na], vec![0.0; nv + na]];
    for column in 0..2 * nv + na {
        let size = match column {
            c if c < nv => 1.0,
            c if c < 2 * nv => 1.0 + v[c - nv].abs(),
            c => 1.0 + aux[c - 2 * nv].abs(),
        };
        let delta = DELTA * size;
        for (rate, sign) in rates.iter_mut().zip([1.0, -1.0]) {
            match column {
                c if c < nv => {
                    xi[c] = sign * delta;
                    system.model().integrate_into(q, &xi, &mut moved.0);
                    xi[c] = 0.0;
                }
                c if c < 2 * nv => moved.1[c - nv] = v[c - nv] + sign * delta,
                c => moved.2[c - 2 * nv] = aux[c - 2 * nv] + sign * delta,
            }
            let (v_dot, aux_dot) = rate.split_at_mut(nv);
            aux_dot.fill(0.0);
            system.derivative(t, &moved.0, &moved.1, &moved.2, v_dot, aux_dot)?;
        }
        moved.0.copy_from_slice(q);
        moved.1.copy_from_slice(v);
        moved.2.copy_from_slice(aux);
        for row in 0..nv + na {
            let slope = (rates[0][row] - rates[1][row]) / (2.0 * delta);
            match (row < nv, column) {
                (true, c) if c < nv => out.a_q[row * nv + c] = slope,
                (true, c) if c < 2 * nv => out.a_v[row * nv + c - nv] = slope,
                (true, c) => out.a_aux[row * na + c - 2 * nv] = slope,
                (false, c) if c < nv => out.g_q[(row - nv) * nv + c] = slope,
                (false, c) if c < 2 * nv => out.g_v[(row - nv) * nv + c - nv] = slope,
                (false, c) => out.g_aux[(row - nv) * na + c - 2 * nv] = slope,
            }
        }
    }
    Ok(2 * (2 * nv + na) as u64)
}
