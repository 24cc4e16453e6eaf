//! Two independent sequences over a free-flying tree, and their combination at every body.
//!
//! | symbol | meaning | source |
//! |---|---|---|
//! | P, z | inertia and bias outboard of joint k, on body k: f = P α + z | soa.md 3.1 |
//! | P⁺, z⁺ | what the joint lets through: P − P H*(H P H*)⁻¹ H P, z + P a + G (T − H (z + P a)) | paper 1 (9.4), (9.9) |
//! | S, s | inertia and bias of all that is inboard of joint k, on its inboard side: −f = S α_in + s | soa.md 3.7 |
//! | S⁺, s⁺ | what the joint lets through outward: S − S H*(H S H*)⁻¹ H S, s − S⁺ a − g (T + H s) | soa.md 3.7 |
//! | α | −(P + S⁺)⁻¹ (z + s⁺), of every body by itself | paper 2 §4.8 |
//! | θ̈ | (H S H*)⁻¹ (T + H (S (α − a) + s)), of every joint by itself | soa.md 3.7 |
//!
//! Axes of a joint are eliminated one after the other; active axes (acceleration given) are passed over, and their motion
//! belongs to a. α is the papers' acceleration less gravity, which a uniform field does not change between bodies.

use crate::FreeFlightError;
use crate::solve::solve;
use phipsi_recursion::DynamicsError;
use phipsi_recursion::hinge::Hinge;
use phipsi_recursion::layout::{GROUND, Layout, LayoutBody};
use phipsi_spatial::{ArticulatedInertia, Motion, Real, RigidInertia, Transform, Vec3, Wrench};

/// Bodies from which on the two directions of a chain take a thread each.
#[cfg(feature = "parallel")]
const WORTH: usize = 4096;

/// One eliminated axis.
#[derive(Clone, Copy, Debug)]
struct Pivot<T> {
    gain: Wrench<T>,
    D: T,
}

/// One direction's inertias and biases, before and after the joint, and its pivots.
#[derive(Clone, Debug)]
struct Side<T> {
    inertia: Vec<ArticulatedInertia<T>>,
    bias: Vec<Wrench<T>>,
    /// After the joint's elimination, in the frame of body k.
    inertia_plus: Vec<ArticulatedInertia<T>>,
    bias_plus: Vec<Wrench<T>>,
    pivots: Vec<Pivot<T>>,
}

impl<T: Real> Side<T> {
    fn new(bodies: usize, nv: usize) -> Self {
        Side {
            inertia: vec![ArticulatedInertia::zero(); bodies],
            bias: vec![Wrench::zero(); bodies],
            inertia_plus: vec![ArticulatedInertia::zero(); bodies],
            bias_plus: vec![Wrench::zero(); bodies],
            pivots: vec![Pivot { gain: Wrench::zero(), D: T::zero() }; nv],
        }
    }
}

/// What both directions need of a body.
#[derive(Clone, Copy, Debug)]
struct Own<T> {
    pose: Transform<T>,
    M: RigidInertia<T>,
    /// Gyroscopic force less external wrenches.
    b: Wrench<T>,
    /// Coriolis acceleration and the motion of active axes.
    a: Motion<T>,
    omega: Vec3<T>,
}

/// What a call gives.
#[derive(Clone, Copy)]
struct Given<'a, T: Real> {
    layout: &'a Layout<T>,
    active: &'a [bool],
    tau: &'a [T],
}

/// Workspace of two-sided dynamics.
#[derive(Clone, Debug)]
pub struct TwoSided<T> {
    own: Vec<Own<T>>,
    outboard: Side<T>,
    inboard: Side<T>,
    /// Children of each body, one list after the other, and where each begins.
    children: Vec<usize>,
    starts: Vec<usize>,
    /// Sums over the siblings before each child.
    before: Vec<(ArticulatedInertia<T>, Wrench<T>)>,
    /// Rest, no forces, no active axes: for inertias alone.
    rest: Vec<T>,
    results: [Vec<T>; 2],
    passive: Vec<bool>,
}

/// Eliminates the passive axes of a joint: I − U D⁻¹ U* axis by axis.
fn eliminate<T: Real>(
    body: &LayoutBody<T>,
    active: &[bool],
    mut inertia: ArticulatedInertia<T>,
    pivots: &mut [Pivot<T>],
) -> Result<ArticulatedInertia<T>, (usize, f64)> {
    for i in (0..body.hinge.nv()).filter(|i| !active[body.v + i]) {
        let column = inertia.times(body.hinge.axis(i));
        let D = body.hinge.project(i, &column);
        if !D.is_positive() {
            return Err((body.v + i, D.to_f64()));
        }
        let gain = column.scale(D.recip());
        inertia.subtract_outer(gain, column);
        pivots[body.v + i] = Pivot { gain, D };
    }
    Ok(inertia)
}

impl<T: Real> TwoSided<T> {
    /// A workspace for a layout all of whose roots float.
    ///
    /// # Errors
    /// [`FreeFlightError::NotFree`]; [`DynamicsError::Flexible`].
    pub fn new(layout: &Layout<T>) -> Result<Self, FreeFlightError> {
        layout.check_rigid("TwoSided")?;
        let n = layout.len();
        let mut count = vec![0; n + 1];
        for body in layout.bodies() {
            if body.parent != GROUND {
                count[body.parent + 1] += 1;
            } else if !matches!(body.hinge, Hinge::Free) {
                let joint = layout.joint_of_velocity(body.v).0.to_string();
                return Err(FreeFlightError::NotFree { joint });
            }
        }
        for k in 0..n {
            count[k + 1] += count[k];
        }
        let (starts, mut next) = (count.clone(), count);
        let mut children = vec![0; *starts.last().unwrap_or(&0)];
        for (k, body) in layout.bodies().iter().enumerate() {
            if body.parent != GROUND {
                children[next[body.parent]] = k;
                next[body.parent] += 1;
            }
        }
        let own = Own {
            pose: Transform::identity(),
            M: RigidInertia::zero(),
            b: Wrench::zero(),
            a: Motion::zero(),
            omega: Vec3::zero(),
        };
        Ok(TwoSided {
            own: vec![own; n],
            outboard: Side::new(n, layout.nv()),
            inboard: Side::new(n, layout.nv()),
            before: vec![(ArticulatedInertia::zero(), Wrench::zero()); children.len()],
            children,
            starts,
            rest: vec![T::zero(); layout.nv()],
            results: [vec![T::zero(); layout.nv()], vec![T::zero(); layout.nv()]],
            passive: vec![false; layout.nv()],
        })
    }
    /// Hybrid dynamics of a free-flying system by two independent sequences: forces of active and accelerations of passive
    /// degrees of freedom.
    ///
    /// # Computes
    /// For every body α = −(P + S⁺)⁻¹(z + s⁺), from which its joint's acceleration or force follows (soa.md 3.7): nothing is
    /// handed from body to body but in the two sequences. The same for every choice of the base body.
    ///
    /// # Shapes & units
    /// `q`: nq; `v`, `active`, `a`, `tau`: nv; `wrenches`: one per body of the model, at its frame's origin, its axes. `a` holds
    /// accelerations in the active places and gets the others; `tau` forces in the passive places, the base's wrench among
    /// them, and gets the others.
    ///
    /// # Cost
    /// O(n): velocities outward, then the two sequences, which are independent on a chain (side by side from 4096 bodies on with
    /// the feature `parallel`; on trees the outward one needs what siblings let through); no allocation.
    ///
    /// # Errors
    /// [`DynamicsError::Shape`], [`DynamicsError::SingularHinge`]; [`FreeFlightError::ActiveBase`],
    /// [`FreeFlightError::NoInertia`].
    #[expect(clippy::too_many_arguments, reason = "as HybridDynamics::run")]
    pub fn run(
        &mut self,
        layout: &Layout<T>,
        q: &[T],
        v: &[T],
        active: &[bool],
        a: &mut [T],
        tau: &mut [T],
        wrenches: Option<&[Wrench<T>]>,
    ) -> Result<(), FreeFlightError> {
        for (argument, found, expected) in [
            ("q", q.len(), layout.nq()),
            ("v", v.len(), layout.nv()),
            ("active", active.len(), layout.nv()),
            ("a", a.len(), layout.nv()),
            ("tau", tau.len(), layout.nv()),
            ("workspace", self.own.len(), layout.len()),
            ("wrenches", wrenches.map_or(layout.model_bodies(), <[_]>::len), layout.model_bodies()),
        ] {
            if found != expected {
                return Err(DynamicsError::Shape { argument, expected, found }.into());
            }
        }
        for body in layout.bodies().iter().filter(|body| body.parent == GROUND) {
            if let Some(component) = (0..6).find(|i| active[body.v + i]) {
                let joint = layout.joint_of_velocity(body.v).0.to_string();
                return Err(FreeFlightError::ActiveBase { joint, component });
            }
        }
        self.set_motion(layout, q, v, active, a, tau, wrenches);
        self.sweep(Given { layout, active, tau })?;
        self.combine(layout, v, active, a, tau)
    }
    /// Inertias of the two sequences at a configuration alone; all joints passive. `q`: nq. Cost O(n), no allocation.
    ///
    /// # Errors
    /// As [`TwoSided::run`].
    pub fn set_position(&mut self, layout: &Layout<T>, q: &[T]) -> Result<(), FreeFlightError> {
        let (rest, passive) = (core::mem::take(&mut self.rest), core::mem::take(&mut self.passive));
        let [mut a, mut tau] = core::mem::take(&mut self.results);
        tau.fill(T::zero());
        let done = self.run(layout, q, &rest, &passive, &mut a, &mut tau, None);
        (self.rest, self.passive, self.results) = (rest, passive, [a, tau]);
        done
    }
    /// The inertia that a wrench on a body of the model feels, with every passive joint free and the base floating:
    /// P + S⁺, about the body frame's origin, body axes; its inverse is the inertia matrix's (Υ of a free base). Valid after
    /// [`TwoSided::run`] or [`TwoSided::set_position`]; `None` if there is no such body. Cost O(1).
    pub fn inertia(&self, layout: &Layout<T>, body: usize) -> Option<ArticulatedInertia<T>> {
        let carrier = layout.carriers().get(body).filter(|c| c.body != GROUND)?;
        let own = self.outboard.inertia[carrier.body] + self.inboard.inertia_plus[carrier.body];
        Some(carrier.pose.inverse().articulated_to_parent(&own))
    }

    /// Poses, biases and Coriolis accelerations, base to tip.
    #[expect(clippy::too_many_arguments, reason = "as run")]
    fn set_motion(
        &mut self,
        layout: &Layout<T>,
        q: &[T],
        v: &[T],
        active: &[bool],
        a: &[T],
        tau: &[T],
        wrenches: Option<&[Wrench<T>]>,
    ) {
        for (k, body) in layout.bodies().iter().enumerate() {
            let pose = body.pose(q);
            let joint = body.hinge.expand(&v[body.v..]);
            let (carried, mut driven) = if body.parent == GROUND {
                (Vec3::zero(), Motion::zero())
            } else {
                let inboard = self.own[body.parent].omega;
                let carried = pose.rotation.transpose_mul(inboard);
                let centripetal = pose.rotation.transpose_mul(inboard.cross(inboard.cross(pose.translation)));
                let linear = centripetal + (carried + carried).cross(joint.linear);
                (carried, Motion::new(carried.cross(joint.angular), linear))
            };
            let c = body.hinge.turning(&v[body.v..]);
            for (i, &component) in body.hinge.components().iter().enumerate() {
                if active[body.v + i] {
                    body.hinge.add_axis(i, a[body.v + i] + c.get(component), &mut driven);
                }
            }
            let omega = carried + joint.angular;
            let mut b = body.inertia.gyroscopic(omega);
            if body.parent == GROUND {
                let [x, y, z, fx, fy, fz] = core::array::from_fn(|i| tau[body.v + i]);
                b -= Wrench::new(Vec3([x, y, z]), Vec3([fx, fy, fz]));
            }
            self.own[k] = Own { pose, M: body.inertia, b, a: driven, omega };
        }
        for (carrier, wrench) in layout.carriers().iter().zip(wrenches.unwrap_or_default()) {
            if carrier.body != GROUND {
                self.own[carrier.body].b -= carrier.pose.wrench_to_parent(*wrench);
            }
        }
    }

    fn sweep(&mut self, given: Given<'_, T>) -> Result<(), FreeFlightError> {
        let TwoSided { own, outboard, inboard, children, starts, before, .. } = self;
        let singular = |(i, inertia): (usize, f64)| {
            let (joint, component) = given.layout.joint_of_velocity(i);
            DynamicsError::SingularHinge { joint: joint.into(), component, inertia }
        };
        #[cfg(feature = "parallel")]
        if own.len() >= WORTH && starts.windows(2).all(|w| w[1] - w[0] <= 1) {
            // On a chain no sibling lets anything through: the outward sequence needs nothing of the inward one.
            let nothing = Side::new(0, 0);
            let (inward, outward) = rayon::join(
                || sweep_inboard(given, own, outboard),
                || sweep_outboard(given, own, &nothing, inboard, (children, starts, before)),
            );
            inward.map_err(singular)?;
            return Ok(outward.map_err(singular)?);
        }
        sweep_inboard(given, own, outboard).map_err(singular)?;
        Ok(sweep_outboard(given, own, outboard, inboard, (children, starts, before)).map_err(singular)?)
    }

    /// Every body by itself: α, then its joint's acceleration or force.
    fn combine(
        &self,
        layout: &Layout<T>,
        v: &[T],
        active: &[bool],
        a: &mut [T],
        tau: &mut [T],
    ) -> Result<(), FreeFlightError> {
        let TwoSided { own, outboard, inboard, .. } = self;
        for (k, body) in layout.bodies().iter().enumerate() {
            let total = outboard.inertia[k] + inboard.inertia_plus[k];
            let bias = outboard.bias[k] + inboard.bias_plus[k];
            let alpha = solve(&total, Wrench::zero() - bias).map_err(|pivot| FreeFlightError::NoInertia {
                joint: layout.joint_of_velocity(body.v).0.into(),
                pivot,
            })?;
            let c = body.hinge.turning(&v[body.v..]);
            if body.parent == GROUND {
                let falling = own[k].pose.motion_to_child(Motion::new(Vec3::zero(), -layout.gravity()));
                let x = (alpha - falling - c).to_array();
                a[body.v..body.v + 6].copy_from_slice(&x);
                continue;
            }
            let nv = body.hinge.nv();
            // S (α − a) + s, and its innovations axis by axis.
            let mut w = inboard.inertia[k].times(alpha - own[k].a) + inboard.bias[k];
            for i in (0..nv).filter(|i| !active[body.v + i]) {
                let at = body.v + i;
                let Pivot { gain, D } = inboard.pivots[at];
                let epsilon = tau[at] + body.hinge.project(i, &w);
                w -= gain.scale(epsilon);
                a[at] = epsilon / D;
            }
            let mut motion = Motion::zero();
            for i in (0..nv).rev().filter(|i| !active[body.v + i]) {
                let at = body.v + i;
                let x = a[at] - motion.dot(inboard.pivots[at].gain);
                body.hinge.add_axis(i, x, &mut motion);
                a[at] = x - c.get(body.hinge.components()[i]);
            }
            let f = outboard.inertia[k].times(alpha) + outboard.bias[k];
            for i in (0..nv).filter(|i| active[body.v + i]) {
                tau[body.v + i] = body.hinge.project(i, &f);
            }
        }
        Ok(())
    }
}

/// P, z, P⁺, z⁺, tip to base.
fn sweep_inboard<T: Real>(
    Given { layout, active, tau }: Given<'_, T>,
    own: &[Own<T>],
    side: &mut Side<T>,
) -> Result<(), (usize, f64)> {
    for (k, own) in own.iter().enumerate() {
        (side.inertia[k], side.bias[k]) = (own.M.to_articulated(), own.b);
    }
    for (k, body) in layout.bodies().iter().enumerate().rev() {
        if body.parent == GROUND {
            continue;
        }
        let plus = eliminate(body, active, side.inertia[k], &mut side.pivots)?;
        let mut z = side.bias[k] + side.inertia[k].times(own[k].a);
        for i in (0..body.hinge.nv()).filter(|i| !active[body.v + i]) {
            let epsilon = tau[body.v + i] - body.hinge.project(i, &z);
            z += side.pivots[body.v + i].gain.scale(epsilon);
        }
        (side.inertia_plus[k], side.bias_plus[k]) = (plus, z);
        let pose = &own[k].pose;
        side.inertia[body.parent] = side.inertia[body.parent] + pose.articulated_to_parent(&plus);
        side.bias[body.parent] += pose.wrench_to_parent(z);
    }
    Ok(())
}

/// Children of all bodies, where each list begins, and room for sums over siblings.
type Siblings<'a, T> = (&'a [usize], &'a [usize], &'a mut [(ArticulatedInertia<T>, Wrench<T>)]);

/// S, s, S⁺, s⁺, base to tip; `outboard` is what siblings let through.
fn sweep_outboard<T: Real>(
    Given { layout, active, tau }: Given<'_, T>,
    own: &[Own<T>],
    outboard: &Side<T>,
    side: &mut Side<T>,
    (children, starts, before): Siblings<'_, T>,
) -> Result<(), (usize, f64)> {
    for p in 0..own.len() {
        let parent = &layout.bodies()[p];
        if parent.parent == GROUND {
            side.inertia_plus[p] = ArticulatedInertia::zero();
            side.bias_plus[p] = Wrench::zero();
        }
        let inboard = (side.inertia_plus[p] + own[p].M.to_articulated(), side.bias_plus[p] + own[p].b);
        let list = starts[p]..starts[p + 1];
        let several = list.len() > 1;
        let moved = |k: usize| {
            let pose = &own[k].pose;
            let inertia = pose.articulated_to_parent(&outboard.inertia_plus[k]);
            (inertia, pose.wrench_to_parent(outboard.bias_plus[k]))
        };
        // Sums over the siblings before a child, then, backward, over those after it: nothing is subtracted again.
        if several {
            let mut sum = inboard;
            for at in list.clone() {
                before[at] = sum;
                let (inertia, bias) = moved(children[at]);
                sum = (sum.0 + inertia, sum.1 + bias);
            }
        }
        let mut after = (ArticulatedInertia::zero(), Wrench::zero());
        for at in list.rev() {
            let k = children[at];
            let body = &layout.bodies()[k];
            let (inertia, bias) =
                if several { (before[at].0 + after.0, before[at].1 + after.1) } else { inboard };
            if several {
                let (inertia, bias) = moved(k);
                after = (after.0 + inertia, after.1 + bias);
            }
            let back = own[k].pose.inverse();
            (side.inertia[k], side.bias[k]) =
                (back.articulated_to_parent(&inertia), back.wrench_to_parent(bias));
            let plus = eliminate(body, active, side.inertia[k], &mut side.pivots)?;
            let mut s = side.bias[k];
            for i in (0..body.hinge.nv()).filter(|i| !active[body.v + i]) {
                let epsilon = tau[body.v + i] + body.hinge.project(i, &s);
                s -= side.pivots[body.v + i].gain.scale(epsilon);
            }
            (side.inertia_plus[k], side.bias_plus[k]) = (plus, s - plus.times(own[k].a));
        }
    }
    Ok(())
}
