//! Forward dynamics: a Kalman filter from tip to base and a Bryson–Frazier smoother back.
//!
//! Symbols: those of [`crate::articulated_sweep`], and
//!
//! | symbol | meaning | source |
//! |---|---|---|
//! | ω | angular velocity, body axes | paper 2 (3.7) |
//! | a | Coriolis acceleration (missing from paper 1's boundary-value problem): [`crate::kinematics`] | soa.md 3.0, 4 |
//! | c | (0, δω × δv), in the range of H*: sweeps work with θ̈ + c, so that a free body's speed stays out of its moments | |
//! | b | (ω × J ω, ω × (ω × h)) − w, gyroscopic force less the external wrench | soa.md 3.0 |
//! | α, α⁺ | acceleration of the body, and of its inboard side φ*α(p); α(ground) = (0, −g) | paper 1 (9.12)–(9.14) |

use crate::articulated_sweep::{Pivot, eliminate, filter, smooth, smooth_revolute};
use crate::error::{DynamicsError, check_length};
use crate::hinge::Hinge;
use crate::kernel::kernel;
use crate::kinematics::{relative, relative_revolute};
use crate::layout::Pending;
use crate::layout::{GROUND, Layout, Shifts, each_kind};
use crate::link::each_shape;
use crate::packed::Packed;
use num_traits::Zero;
use phipsi_spatial::{ArticulatedInertia, Motion, Scalar, SixLanes, Vec3, Wrench};

mod info;
mod inward;

pub use info::{ForwardInfo, WorstHinge, forward_info};

/// What the first sweep leaves of a body.
#[derive(Clone, Copy, Debug)]
struct Moving<T> {
    omega: Vec3<T>,
    /// a, zero at a root.
    coriolis: Motion<T>,
}

/// P and z of an eliminated body, moved to its parent.
type Moved<T> = (ArticulatedInertia<T>, Wrench<T>);

/// Packed six-vectors of what kernels on `T` compute with.
type Six<T> = <<T as Scalar>::Arithmetic as Scalar>::Six;

/// Workspace of forward dynamics.
#[derive(Clone, Debug)]
pub struct ForwardDynamics<T: Scalar> {
    pub(crate) shifts: Shifts<T::Arithmetic>,
    moving: Vec<Moving<T::Arithmetic>>,
    pub(crate) pivots: Vec<Pivot<T::Arithmetic>>,
    pending: Pending<Moved<T::Arithmetic>>,
    /// P and z of the body that the inward sweep is at.
    here: Moved<T::Arithmetic>,
    packed: Pending<Packed<Six<T>>>,
    /// α of bodies with several children.
    alpha: Vec<Motion<T::Arithmetic>>,
    /// Minus the external wrenches, where there are any.
    loads: Vec<Wrench<T::Arithmetic>>,
}

impl<T: Scalar> ForwardDynamics<T> {
    /// A workspace for a layout.
    pub fn new(layout: &Layout<T::Constant>) -> Self {
        let (n, zero) = (layout.len(), (ArticulatedInertia::zero(), Wrench::zero()));
        ForwardDynamics {
            shifts: Shifts::new(layout),
            moving: vec![Moving { omega: Vec3::zero(), coriolis: Motion::zero() }; n],
            pivots: vec![Pivot::empty(); layout.nv()],
            pending: Pending::new(layout, zero),
            here: zero,
            packed: Pending::new(layout, Packed::zero::<T::Arithmetic>()),
            alpha: vec![Motion::zero(); n],
            loads: vec![Wrench::zero(); n],
        }
    }
    /// Accelerations of generalised forces `tau` at (q, v).
    ///
    /// # Computes
    /// θ̈ = (I − HψK)* D⁻¹ (I − HψK) (T − C), without forming the mass matrix (soa.md 3.1).
    ///
    /// # Shapes & units
    /// `q`: nq; `v`, `tau`, `out`: nv; `wrenches`: one per body of the model, at its frame's origin, its axes.
    ///
    /// # Cost
    /// O(n): three sweeps; no allocation.
    ///
    /// # Accuracy
    /// n·ε·κ, but ε × mass ratio where a heavy body hangs on a light one (soa.md 2.2); [`forward_info`] measures it.
    ///
    /// # Errors
    /// [`DynamicsError::Shape`], [`DynamicsError::Closure`]; [`DynamicsError::SingularHinge`] if a D is not positive,
    /// also when an input is not finite.
    pub fn run(
        &mut self,
        layout: &Layout<T::Constant>,
        q: &[T],
        v: &[T],
        tau: &[T],
        wrenches: Option<&[Wrench<T>]>,
        out: &mut [T],
    ) -> Result<(), DynamicsError> {
        self.accelerate::<true>(layout, q, v, tau, wrenches, out)
    }
    /// [`run`](Self::run) with `TURNING`; without, `out` gets θ̈ + c.
    pub(crate) fn accelerate<const TURNING: bool>(
        &mut self,
        layout: &Layout<T::Constant>,
        q: &[T],
        v: &[T],
        tau: &[T],
        wrenches: Option<&[Wrench<T>]>,
        out: &mut [T],
    ) -> Result<(), DynamicsError> {
        layout.check_tree()?;
        check_length("q", q, layout.nq())?;
        check_length("v", v, layout.nv())?;
        check_length("tau", tau, layout.nv())?;
        check_length("out", out, layout.nv())?;
        check_length("workspace", &self.moving, layout.len())?;
        if let Some(wrenches) = wrenches {
            check_length("wrenches", wrenches, layout.model_bodies())?;
            layout.gather_loads(wrenches, &mut self.loads);
        }
        out.copy_from_slice(tau);
        let (q, v, out) = (T::arithmetic(q), T::arithmetic(v), T::arithmetic_mut(out));
        T::Arithmetic::dispatch(Sweeps {
            work: self,
            layout,
            q,
            v,
            loaded: wrenches.is_some(),
            turning: TURNING,
            out,
        })
    }

    #[inline(always)]
    fn sweep_velocities(&mut self, layout: &Layout<T::Constant>, q: &[T::Arithmetic], v: &[T::Arithmetic]) {
        let n = layout.bodies.len();
        let moving = &mut self.moving[..n];
        self.shifts.begin(q);
        let mut previous = Vec3::zero();
        for k in 0..n {
            let body = &layout.bodies[k];
            if let Hinge::Revolute = body.hinge {
                let (turn, rate) = (self.shifts.turned(body, q), v[body.v]);
                self.shifts.set_turn(k, turn);
                if body.parent == GROUND {
                    previous = Vec3([T::Arithmetic::zero(), T::Arithmetic::zero(), rate]);
                    moving[k] = Moving { omega: previous, coriolis: Motion::zero() };
                    continue;
                }
                let inboard = if body.follows_parent(k) { previous } else { moving[body.parent].omega };
                let shift = body.link.hinged(turn);
                let (carried, centripetal) = each_shape!(body.link, |link| link.carried(&shift, inboard));
                let (omega, coriolis) = relative_revolute(carried, centripetal, rate);
                moving[k] = Moving { omega, coriolis };
                previous = omega;
                continue;
            }
            let (omega, coriolis) = each_kind!(body, |known| {
                self.shifts.set(k, known, q);
                let joint = known.hinge.expand(&v[known.v..]);
                if known.parent == GROUND {
                    (joint.angular, Motion::zero())
                } else {
                    let inboard = if known.follows_parent(k) { previous } else { moving[known.parent].omega };
                    let (carried, centripetal) = self.shifts.at(k, known).carried(inboard);
                    relative(&known.hinge, carried, centripetal, joint)
                }
            });
            moving[k] = Moving { omega, coriolis };
            previous = omega;
        }
    }

    /// [`Self::sweep_inboard`] with the six-vectors of the state in lanes.
    #[inline(always)]
    fn sweep_inboard_packed(
        &mut self,
        layout: &Layout<T::Constant>,
        loaded: bool,
        residuals: &mut [T::Arithmetic],
    ) -> Result<(), DynamicsError> {
        self.packed.clear();
        let mut hand: Packed<Six<T>> = Packed::zero::<T::Arithmetic>();
        let (bodies, n) = (&layout.bodies[..], layout.bodies.len());
        let (moving, rigid) = (&self.moving[..n], &layout.rigid[..n]);
        for (k, body) in bodies.iter().enumerate().rev() {
            let Moving { omega, coriolis } = &moving[k];
            if body.children > 1 {
                self.packed.gather(body, &mut hand, |sum, x| sum.add::<T::Arithmetic>(x));
            }
            hand.add_body(&rigid[k], *omega);
            if let Hinge::Revolute = body.hinge {
                if loaded {
                    hand.z = hand.z + Packed::lanes(&self.loads[k]);
                }
                if body.parent != GROUND {
                    hand.add_coriolis(coriolis);
                }
                match hand.eliminate_revolute(residuals[body.v]) {
                    Ok((pivot, nu)) => (self.pivots[body.v], residuals[body.v]) = (pivot, nu),
                    Err(D) => return Err(layout.singular(body.v, D)),
                }
                let moved = if body.parent == GROUND {
                    Packed::zero::<T::Arithmetic>()
                } else {
                    hand.moved::<_, true>(&body.link, &body.link.hinged(self.shifts.turn(k)))
                };
                hand = Packed::zero::<T::Arithmetic>();
                self.packed.give(k, body, &mut hand, moved);
                continue;
            }
            if let Hinge::Prismatic = body.hinge
                && body.parent != GROUND
            {
                if loaded {
                    hand.z = hand.z + Packed::lanes(&self.loads[k]);
                }
                hand.add_acceleration(coriolis);
                match hand.eliminate_prismatic(residuals[body.v]) {
                    Ok((pivot, nu)) => (self.pivots[body.v], residuals[body.v]) = (pivot, nu),
                    Err(D) => return Err(layout.singular(body.v, D)),
                }
                let moved = hand.moved::<_, false>(&body.link, &self.shifts.all()[k]);
                hand = Packed::zero::<T::Arithmetic>();
                self.packed.give(k, body, &mut hand, moved);
                continue;
            }
            let (P, mut z) = hand.unpack();
            if loaded {
                z += self.loads[k];
            }
            if body.parent != GROUND {
                z += P.times(*coriolis);
            }
            let dofs = body.v..body.v + body.hinge.nv();
            let pivots = &mut self.pivots[dofs.clone()];
            let passage = self.shifts.at(k, body);
            let moved =
                eliminate(body, passage, P, pivots).map_err(|(i, D)| layout.singular(body.v + i, D))?;
            filter(&body.hinge, pivots, &mut z, &mut residuals[dofs]);
            hand = Packed::zero::<T::Arithmetic>();
            if body.parent != GROUND {
                let moved = Packed::pack(&moved, &passage.wrench_to_parent(z));
                self.packed.give(k, body, &mut hand, moved);
            }
        }
        Ok(())
    }

    /// Bryson–Frazier smoother: `residuals` holds ν before and θ̈ after, or θ̈ + c without `turning`.
    #[inline(always)]
    fn sweep_outboard(
        &mut self,
        layout: &Layout<T::Constant>,
        v: &[T::Arithmetic],
        turning: bool,
        residuals: &mut [T::Arithmetic],
    ) {
        let ground = Motion::new(Vec3::zero(), -Vec3::constant(layout.gravity));
        let mut previous = ground;
        let n = layout.bodies.len();
        for k in 0..n {
            let body = &layout.bodies[k];
            let inboard = match body.parent {
                GROUND => ground,
                _ if body.follows_parent(k) => previous,
                parent => self.alpha[parent],
            };
            let mut alpha;
            if let Hinge::Revolute = body.hinge {
                let shift = body.link.hinged(self.shifts.turn(k));
                alpha = each_shape!(body.link, |link| link.motion_to_child(&shift, inboard));
                residuals[body.v] = smooth_revolute(&self.pivots[body.v], &mut alpha, residuals[body.v]);
            } else {
                alpha = each_kind!(body, |known| {
                    let dofs = known.v..body.v + known.hinge.nv();
                    let mut alpha = self.shifts.at(k, known).motion_to_child(inboard);
                    smooth(
                        &known.hinge,
                        &self.pivots[dofs.clone()],
                        &mut alpha,
                        &mut residuals[dofs.clone()],
                    );
                    if turning {
                        known.hinge.subtract_turning(&v[known.v..], &mut residuals[dofs]);
                    }
                    alpha
                });
            }
            alpha += self.moving[k].coriolis;
            if body.children > 1 {
                self.alpha[k] = alpha;
            }
            previous = alpha;
        }
    }
}

kernel! {
    Sweeps<'a, T> {
        work: &'a mut ForwardDynamics<T>,
        layout: &'a Layout<T::Constant>,
        q: &'a [T::Arithmetic],
        v: &'a [T::Arithmetic],
        loaded: bool,
        turning: bool,
        out: &'a mut [T::Arithmetic],
    } -> Result<(), DynamicsError> {
        work.sweep_velocities(layout, q, v);
        // Lone states only: every state of a batch takes the steps that lanes take, for the same bits.
        let lone = core::any::TypeId::of::<T>() != core::any::TypeId::of::<T::Arithmetic>();
        if lone && Six::<T>::is_fast() {
            work.sweep_inboard_packed(layout, loaded, out)?;
        } else {
            work.sweep_inboard(layout, loaded, out)?;
        }
        work.sweep_outboard(layout, v, turning, out);
        Ok(())
    }
}

/// [`ForwardDynamics::run`] for a single call.
///
/// # Errors
/// As there.
pub fn forward_dynamics<T: Scalar>(
    layout: &Layout<T::Constant>,
    q: &[T],
    v: &[T],
    tau: &[T],
    wrenches: Option<&[Wrench<T>]>,
) -> Result<Vec<T>, DynamicsError> {
    let mut out = vec![T::zero(); layout.nv()];
    ForwardDynamics::new(layout).run(layout, q, v, tau, wrenches, &mut out)?;
    Ok(out)
}
