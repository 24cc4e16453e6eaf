//! Hybrid dynamics: some degrees of freedom active (acceleration given, force wanted), the others passive (force given,
//! acceleration wanted), in one filter and one smoother.
//!
//! Symbols: those of [`crate::articulated_sweep`] and [`mod@crate::forward_dynamics`], and
//!
//! | symbol | meaning | source |
//! |---|---|---|
//! | m | Σ over active axes of H_i* (θ̈_i + c_i): a part of the Coriolis acceleration a from here on | soa.md 3.6 |
//! | τ̄ | I − G H over passive axes only; I where all are active | paper 2 §4.7 |
//! | T_i | H_i (z + P α⁺) with the passive axes' motion in α⁺: what an active axis needs | paper 2 (4.22) |
//!
//! Axes of one joint may differ: they are eliminated one after the other, and active ones are passed over.

use crate::articulated_sweep::{Pivot, with_own};
use crate::error::{DynamicsError, check_length};
use crate::kernel::kernel;
use crate::kinematics::relative;
use crate::layout::{GROUND, Layout, Pending, Shifts};
use phipsi_spatial::{ArticulatedInertia, Motion, RigidInertia, Scalar, Vec3, Wrench};

/// What the first sweep leaves of a body, and the filter of a body with active axes.
#[derive(Clone, Copy, Debug)]
struct Held<T> {
    omega: Vec3<T>,
    /// a + m.
    driven: Motion<T>,
    /// P before the joint's elimination.
    P: ArticulatedInertia<T>,
    /// z + P (a + m) before the joint's elimination.
    z: Wrench<T>,
}

/// P and z of an eliminated body, moved to its parent.
type Moved<T> = (ArticulatedInertia<T>, Wrench<T>);

/// Workspace of hybrid dynamics.
#[derive(Clone, Debug)]
pub struct HybridDynamics<T: Scalar> {
    shifts: Shifts<T::Arithmetic>,
    held: Vec<Held<T::Arithmetic>>,
    pivots: Vec<Pivot<T::Arithmetic>>,
    pending: Pending<Moved<T::Arithmetic>>,
    alpha: Vec<Motion<T::Arithmetic>>,
    loads: Vec<Wrench<T::Arithmetic>>,
}

impl<T: Scalar> HybridDynamics<T> {
    /// A workspace for a layout.
    pub fn new(layout: &Layout<T::Constant>) -> Self {
        let n = layout.len();
        let held = Held {
            omega: Vec3::zero(),
            driven: Motion::zero(),
            P: ArticulatedInertia::zero(),
            z: Wrench::zero(),
        };
        HybridDynamics {
            shifts: Shifts::new(layout),
            held: vec![held; n],
            pivots: vec![Pivot::empty(); layout.nv()],
            pending: Pending::new(layout, (ArticulatedInertia::zero(), Wrench::zero())),
            alpha: vec![Motion::zero(); n],
            loads: vec![Wrench::zero(); n],
        }
    }
    /// Forces of the active and accelerations of the passive degrees of freedom at (q, v).
    ///
    /// # Computes
    /// (T_a, θ̈_p) of M θ̈ + C = T for given (θ̈_a, T_p), by two sweeps (paper 2 (4.22)): no part of M is formed.
    ///
    /// # Shapes & units
    /// `q`: nq; `v`, `active`, `a`, `tau`: nv; `wrenches`: one per body of the model, at its frame's origin, its axes. `a` holds
    /// the given accelerations in the active places and gets the others; `tau` the given forces in the passive places and gets
    /// the others.
    ///
    /// # Cost
    /// O(n): two outward sweeps and one inward; no allocation.
    ///
    /// # Accuracy
    /// As forward dynamics where passive, as inverse dynamics where active; all active is inverse dynamics, none is forward
    /// dynamics, each to rounding.
    ///
    /// # Errors
    /// [`DynamicsError::Shape`], [`DynamicsError::Closure`]; [`DynamicsError::SingularHinge`] if the D of a passive axis is not
    /// positive, also when an input is not finite.
    ///
    /// # Checked by
    /// `every_pattern_of_small_trees`, `random_patterns`, `all_active_and_none`.
    ///
    /// # Example
    /// ```
    /// # use phipsi_model::{Body, Inertia, Joint, JointKind, ModelBuilder, Placement};
    /// # use phipsi_recursion::{Layout, hybrid_dynamics};
    /// // A cart whose acceleration is given; what hangs on it moves freely.
    /// let cart = Joint::new("rail", JointKind::Prismatic { axis: [1.0, 0.0, 0.0] });
    /// let hinge = Joint::new("hinge", JointKind::Revolute { axis: [0.0, 1.0, 0.0] });
    /// let model = ModelBuilder::new("cart")
    ///     .body(Body::new("cart", Inertia::from_principal(2.0, [0.0; 3], [0.1; 3])))
    ///     .body(Body::new("pendulum", Inertia::from_principal(1.0, [0.0, 0.0, -1.0], [0.0; 3])))
    ///     .joint(cart, "world", "cart")
    ///     .joint(hinge, "cart", "pendulum")
    ///     .gravity([0.0, 0.0, -10.0])
    ///     .build()?;
    /// let layout = Layout::<f64>::new(&model);
    /// let (a, tau) = hybrid_dynamics(&layout, &[0.0_f64; 2], &[0.0; 2], &[true, false], &[3.0, 0.0], &[0.0; 2], None)?;
    /// assert!((a[1] - 3.0).abs() < 1e-14); // the mass stays where it is
    /// assert!((tau[0] - 6.0).abs() < 1e-14); // only the cart is driven
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    #[expect(clippy::too_many_arguments, reason = "the two given and the two wanted halves")]
    pub fn run(
        &mut self,
        layout: &Layout<T::Constant>,
        q: &[T],
        v: &[T],
        active: &[bool],
        a: &mut [T],
        tau: &mut [T],
        wrenches: Option<&[Wrench<T>]>,
    ) -> Result<(), DynamicsError> {
        layout.check_closures()?;
        layout.check_rigid("hybrid_dynamics")?;
        check_length("q", q, layout.nq())?;
        check_length("v", v, layout.nv())?;
        check_length("active", active, layout.nv())?;
        check_length("a", a, layout.nv())?;
        check_length("tau", tau, layout.nv())?;
        check_length("workspace", &self.held, layout.len())?;
        if let Some(wrenches) = wrenches {
            check_length("wrenches", wrenches, layout.model_bodies())?;
            layout.gather_loads(wrenches, &mut self.loads);
        }
        let (q, v) = (T::arithmetic(q), T::arithmetic(v));
        let (a, tau) = (T::arithmetic_mut(a), T::arithmetic_mut(tau));
        let loaded = wrenches.is_some();
        T::Arithmetic::dispatch(Sweeps { work: self, layout, q, v, active, a, tau, loaded })
    }
}

kernel! {
    Sweeps<'a, T> {
        work: &'a mut HybridDynamics<T>,
        layout: &'a Layout<T::Constant>,
        q: &'a [T::Arithmetic],
        v: &'a [T::Arithmetic],
        active: &'a [bool],
        a: &'a mut [T::Arithmetic],
        tau: &'a mut [T::Arithmetic],
        loaded: bool,
    } -> Result<(), DynamicsError> {
        work.sweep_velocities(layout, q, v, active, a);
        work.sweep_inboard(layout, active, tau, a, loaded)?;
        work.sweep_outboard(layout, v, active, a, tau);
        Ok(())
    }
}

impl<T: Scalar> HybridDynamics<T> {
    /// ω and a + m of every body, base to tip.
    #[inline(always)]
    fn sweep_velocities(
        &mut self,
        layout: &Layout<T::Constant>,
        q: &[T::Arithmetic],
        v: &[T::Arithmetic],
        active: &[bool],
        a: &[T::Arithmetic],
    ) {
        self.shifts.set_all(layout, q);
        for (k, body) in layout.bodies.iter().enumerate() {
            let joint = body.hinge.expand(&v[body.v..]);
            let (omega, mut driven) = if body.parent == GROUND {
                (joint.angular, Motion::zero())
            } else {
                let inboard = self.held[body.parent].omega;
                let (carried, centripetal) = self.shifts.at(k, body).carried(inboard);
                relative(&body.hinge, carried, centripetal, joint)
            };
            let c = body.hinge.turning(&v[body.v..]);
            for (i, &component) in body.hinge.components().iter().enumerate() {
                if active[body.v + i] {
                    body.hinge.add_axis(i, a[body.v + i] + c.get(component), &mut driven);
                }
            }
            self.held[k].omega = omega;
            self.held[k].driven = driven;
        }
    }

    /// The filter over passive axes, tip to base: `a` gets ν in the passive places.
    #[inline(always)]
    fn sweep_inboard(
        &mut self,
        layout: &Layout<T::Constant>,
        active: &[bool],
        tau: &[T::Arithmetic],
        a: &mut [T::Arithmetic],
        loaded: bool,
    ) -> Result<(), DynamicsError> {
        self.pending.clear();
        let mut hand = (ArticulatedInertia::zero(), Wrench::zero());
        for (k, body) in layout.bodies.iter().enumerate().rev() {
            let outboard = self.pending.all(body, &mut hand, |sum, x| *sum = (sum.0 + x.0, sum.1 + x.1));
            let (P, z) = outboard.map_or((None, Wrench::zero()), |(P, z)| (Some(P), z));
            let held = &mut self.held[k];
            let M = RigidInertia::constant(&body.inertia);
            let mut P = with_own(body, P);
            let mut z = z + M.gyroscopic(held.omega) + P.times(held.driven);
            if loaded {
                z += self.loads[k];
            }
            (held.P, held.z) = (P, z);
            for i in 0..body.hinge.nv() {
                let at = body.v + i;
                if active[at] {
                    continue;
                }
                let column = P.times(body.hinge.axis(i));
                let D = body.hinge.project(i, &column);
                if !D.is_positive() {
                    return Err(layout.singular(at, D.min_lane()));
                }
                let inverse = D.recip();
                let gain = column.scale(inverse);
                P.subtract_outer(gain, column);
                let epsilon = tau[at] - body.hinge.project(i, &z);
                z = gain.scale_add(epsilon, z);
                a[at] = epsilon * inverse;
                self.pivots[at] = Pivot { gain, inverse };
            }
            if body.parent != GROUND {
                let passage = self.shifts.at(k, body);
                let moved = (passage.articulated_to_parent(&P), passage.wrench_to_parent(z));
                self.pending.give(k, body, &mut hand, moved);
            }
        }
        Ok(())
    }

    /// The smoother over passive axes and the forces of active ones, base to tip.
    #[inline(always)]
    fn sweep_outboard(
        &mut self,
        layout: &Layout<T::Constant>,
        v: &[T::Arithmetic],
        active: &[bool],
        a: &mut [T::Arithmetic],
        tau: &mut [T::Arithmetic],
    ) {
        let ground = Motion::new(Vec3::zero(), -Vec3::constant(layout.gravity));
        for (k, body) in layout.bodies.iter().enumerate() {
            let inboard = if body.parent == GROUND { ground } else { self.alpha[body.parent] };
            let mut alpha = self.shifts.at(k, body).motion_to_child(inboard);
            let (c, mut driving) = (body.hinge.turning(&v[body.v..]), false);
            for i in (0..body.hinge.nv()).rev() {
                let at = body.v + i;
                if active[at] {
                    driving = true;
                    continue;
                }
                let x = a[at] - alpha.dot(self.pivots[at].gain);
                body.hinge.add_axis(i, x, &mut alpha);
                a[at] = x - c.get(body.hinge.components()[i]);
            }
            let held = &self.held[k];
            if driving {
                let f = held.P.times(alpha) + held.z;
                for i in 0..body.hinge.nv() {
                    if active[body.v + i] {
                        tau[body.v + i] = body.hinge.project(i, &f);
                    }
                }
            }
            self.alpha[k] = alpha + held.driven;
        }
    }
}

/// [`HybridDynamics::run`] for a single call: all accelerations and all forces.
///
/// # Errors
/// As there.
pub fn hybrid_dynamics<T: Scalar>(
    layout: &Layout<T::Constant>,
    q: &[T],
    v: &[T],
    active: &[bool],
    a: &[T],
    tau: &[T],
    wrenches: Option<&[Wrench<T>]>,
) -> Result<(Vec<T>, Vec<T>), DynamicsError> {
    let (mut a, mut tau) = (a.to_vec(), tau.to_vec());
    HybridDynamics::new(layout).run(layout, q, v, active, &mut a, &mut tau, wrenches)?;
    Ok((a, tau))
}
