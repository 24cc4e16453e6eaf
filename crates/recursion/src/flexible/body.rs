//! One flexible body at a state: nodes, mass matrix, velocity terms, from shape integrals (form (I)).
//!
//! | symbol | meaning | shape |
//! |---|---|---|
//! | η, η̇ | modal coordinates and their rates | n |
//! | ω | angular velocity of F, in F | 3 |
//! | s, R | node's position in F and rotation, node to F: s0 + Ψ η + ½ S2(η, η), exp(θ~), θ = Ψʳ η | 3, 3×3 |
//! | X, Π | node's motion from F's and from η̇: V_j = X V + Π η̇ | 6×6, 6×n |
//! | c | what the node's acceleration has beyond X α + Π η̈ | 6 |
//! | J | 1 − a θ~ + b θ~², a = (1 − cos x)/x², b = (x − sin x)/x³, x = \|θ\|: θ̇ to angular velocity in node axes | 3×3 |
//! | F_l | E_l + Σ η_m (S_lm + T2_lm) | 3×3 |
//! | M_fl | mass matrix of (η̇, V): M_ee constant, columns (M_we, M_ve), and a rigid block M_ww, d, m | n + 6 |
//! | b_fl | velocity terms: forces at η̈ = 0, α = 0 | n + 6 |
//! | Γ | −X_d⁻¹ Π_d: motion of F by η̇ with the hinge frame at rest; zero where the joint holds F | 6×n |
//!
//! Source: shape integrals as in Shabana (S̄ = S1, S̄_ab = S[a, b]) with the complete inertia, to η² in M_ww. Nothing is dropped
//! once modes are chosen: energy and momentum hold to rounding.

use super::tree::{Modal, ModalNode, symmetric};
use phipsi_spatial::{Mat3, Motion, RigidInertia, Scalar, Sym3, Transform, Vec3, Wrench};

/// A node at a state.
#[derive(Clone, Debug)]
pub(crate) struct NodeState<T> {
    /// Its pose in F: X is this transform's `motion_to_child`.
    pub(crate) pose: Transform<T>,
    /// Π by columns, node axes.
    pub(crate) Pi: Vec<Motion<T>>,
    /// c, node axes.
    pub(crate) c: Motion<T>,
    theta: Vec3<T>,
    /// a, b and their derivatives by x².
    ab: [T; 4],
}

/// A flexible body at a state.
#[derive(Clone, Debug)]
pub(crate) struct BodyState<T> {
    pub(crate) nodes: Vec<NodeState<T>>,
    F: Vec<Mat3<T>>,
    /// (M_we, M_ve), column l.
    pub(crate) M_de: Vec<Wrench<T>>,
    /// M_ww, d, m.
    pub(crate) M_dd: RigidInertia<T>,
    /// Pose of the hinge frame in F: X_d.
    pub(crate) hinge: Transform<T>,
    /// Γ by columns, in F.
    pub(crate) Gamma: Vec<Motion<T>>,
    /// −X_d⁻¹ c_d.
    pub(crate) o: Motion<T>,
    /// b_e.
    pub(crate) b_e: Vec<T>,
    /// (b_w, b_v).
    pub(crate) b_d: Wrench<T>,
}

impl<T: Scalar> BodyState<T> {
    pub(crate) fn new(body: &Modal<T::Constant>) -> Self {
        let n = body.n;
        let node = NodeState {
            pose: Transform::identity(),
            Pi: vec![Motion::zero(); n],
            c: Motion::zero(),
            theta: Vec3::zero(),
            ab: [T::zero(); 4],
        };
        BodyState {
            nodes: vec![node; body.nodes.len()],
            F: vec![Mat3::zero(); n],
            M_de: vec![Wrench::zero(); n],
            M_dd: RigidInertia::zero(),
            hinge: Transform::identity(),
            Gamma: vec![Motion::zero(); n],
            o: Motion::zero(),
            b_e: vec![T::zero(); n],
            b_d: Wrench::zero(),
        }
    }
    /// Nodes, M_fl, X_d and Γ at η.
    pub(crate) fn set_position(&mut self, body: &Modal<T::Constant>, series: &[[T::Constant; 2]], eta: &[T]) {
        for (state, node) in self.nodes.iter_mut().zip(&body.nodes) {
            state.set_position(node, series, eta);
        }
        self.set_mass(body, eta);
        let axes = Mat3::constant(&body.hinge_axes);
        let Some(d) = body.inboard else {
            self.hinge = Transform::new(axes, Vec3::zero());
            return;
        };
        let node = &self.nodes[d];
        self.hinge = Transform::new(node.pose.rotation * axes, node.pose.translation);
        for (gamma, Pi) in self.Gamma.iter_mut().zip(&node.Pi) {
            *gamma = -node.pose.motion_to_parent(*Pi);
        }
    }
    fn set_mass(&mut self, body: &Modal<T::Constant>, eta: &[T]) {
        let n = body.n;
        let stiffened = !body.T1.is_empty();
        let half = T::splat(0.5);
        let mut d = Vec3::constant(body.d0);
        // Σ η_l (Y_l + ½ Σ η_m S_lm), whose symmetric part is half of W − W0; Y_l = E_l + ½ Σ η_m T2_lm.
        let mut w = Mat3::zero();
        for l in 0..n {
            let mut F = Mat3::constant(&body.E[l]);
            let mut own = F;
            let mut S1 = Vec3::constant(body.S1[l]);
            d += S1.scale(eta[l]);
            let mut bend = Vec3::zero();
            for m in 0..n {
                let (x, lm) = (eta[m], l * n + m);
                let S = Mat3::<T>::constant(&body.S[lm]).scale(x);
                F = F + S;
                own = own + S.scale(half);
                if stiffened {
                    let T2 = Mat3::<T>::constant(&body.T2[lm]).scale(x);
                    F = F + T2;
                    own = own + T2.scale(half);
                    bend += Vec3::constant(body.T1[lm]).scale(x);
                }
            }
            S1 += bend;
            d += bend.scale(eta[l] * half);
            w = w + own.scale(eta[l]);
            self.M_de[l] = Wrench::new(axial(&F) + Vec3::constant(body.C_r[l]), S1);
            self.F[l] = F;
        }
        let W = symmetric(&Mat3::<T>::constant(&body.W0)) + symmetric(&(w + w.transpose()));
        let trace = W.xx + W.yy + W.zz;
        let J = symmetric(&Mat3::<T>::constant(&body.J_r));
        let inertia = Sym3::diagonal(trace) + minus(&W) + J;
        self.M_dd = RigidInertia { mass: T::constant(body.mass), first_moment: d, inertia };
    }
    /// Velocity terms at η̇ and ω, after [`Self::set_position`].
    pub(crate) fn set_velocity(&mut self, body: &Modal<T::Constant>, eta_dot: &[T], omega: Vec3<T>) {
        for (state, node) in self.nodes.iter_mut().zip(&body.nodes) {
            state.set_velocity(node, eta_dot, omega);
        }
        if let Some(d) = body.inboard {
            let node = &self.nodes[d];
            self.o = -node.pose.motion_to_parent(node.c);
        }
        let n = body.n;
        let two = T::splat(2.0);
        let square = omega.dot(omega);
        let mut F_dot = Mat3::zero();
        let mut drift = Vec3::zero();
        let mut spin = Vec3::zero();
        let mut bend = Vec3::zero();
        let mut second = Mat3::zero();
        for l in 0..n {
            let F = &self.F[l];
            let mut N = Vec3::zero();
            for m in 0..n {
                let x = eta_dot[m];
                // Σ m u̇ × ψ_l: S_ml, not S_lm.
                N += axial(&Mat3::<T>::constant(&body.S[l * n + m])).scale(x);
                if !body.T1.is_empty() {
                    let y = x * eta_dot[l];
                    bend += Vec3::constant(body.T1[l * n + m]).scale(y);
                    second = second + Mat3::<T>::constant(&body.T2[l * n + m]).scale(y);
                }
            }
            self.b_e[l] = omega.dot(*F * omega) - square * trace(F) + two * omega.dot(N);
            F_dot = F_dot + F.scale(eta_dot[l]);
            drift += self.M_de[l].force.scale(eta_dot[l]);
            spin += Vec3::constant(body.C_r[l]).scale(eta_dot[l]);
        }
        let M = &self.M_dd;
        let coriolis = (omega.scale(trace(&F_dot)) - F_dot * omega).scale(two);
        let moment = omega.cross(M.inertia * omega) + coriolis + omega.cross(spin) + axial(&second);
        let force = omega.cross(omega.cross(M.first_moment)) + omega.cross(drift).scale(two) + bend;
        self.b_d = Wrench::new(moment, force);
    }
}

impl<T: Scalar> NodeState<T> {
    fn set_position(&mut self, node: &ModalNode<T::Constant>, series: &[[T::Constant; 2]], eta: &[T]) {
        let n = eta.len();
        let (mut s, mut theta) = (Vec3::constant(node.s0), Vec3::zero());
        for l in 0..n {
            s += Vec3::constant(node.psi[l]).scale(eta[l]);
            theta += Vec3::constant(node.psi_r[l]).scale(eta[l]);
        }
        let square = theta.dot(theta);
        let [mut a, mut b, mut da, mut db] = [T::zero(); 4];
        for [ca, cb] in series.iter().rev() {
            da = da * square + a;
            db = db * square + b;
            a = a * square + T::constant(*ca);
            b = b * square + T::constant(*cb);
        }
        // sin x/x = 1 − x² b, (1 − cos x)/x² = a.
        let cross = Mat3::skew(theta);
        let R = Mat3::identity() + cross.scale(T::one() - square * b) + (cross * cross).scale(a);
        for l in 0..n {
            let psi_r = Vec3::constant(node.psi_r[l]);
            let once = theta.cross(psi_r);
            let turn = psi_r - once.scale(a) + theta.cross(once).scale(b);
            let mut B = Vec3::constant(node.psi[l]);
            if !node.S2.is_empty() {
                let mut bend = Vec3::zero();
                for m in 0..n {
                    bend += Vec3::constant(node.S2[l * n + m]).scale(eta[m]);
                }
                B += bend;
                s += bend.scale(T::splat(0.5) * eta[l]);
            }
            self.Pi[l] = Motion::new(turn, R.transpose_mul(B));
        }
        self.pose = Transform::new(R, s);
        (self.theta, self.ab) = (theta, [a, b, da, db]);
    }
    fn set_velocity(&mut self, node: &ModalNode<T::Constant>, eta_dot: &[T], omega: Vec3<T>) {
        let (R, s, n) = (&self.pose.rotation, self.pose.translation, eta_dot.len());
        let two = T::splat(2.0);
        let (mut rate, mut relative) = (Vec3::zero(), Motion::zero());
        let mut second = Vec3::zero();
        for l in 0..n {
            rate += Vec3::constant(node.psi_r[l]).scale(eta_dot[l]);
            relative += self.Pi[l].scale(eta_dot[l]);
            if !node.S2.is_empty() {
                for m in 0..n {
                    second += Vec3::constant(node.S2[l * n + m]).scale(eta_dot[l] * eta_dot[m]);
                }
            }
        }
        let [_, b, da, db] = self.ab;
        let twice = two * self.theta.dot(rate);
        let once = self.theta.cross(rate);
        // J̇ θ̇; of b θ~² only the second factor's rate stays, θ̇ × (θ × θ̇).
        let turn =
            self.theta.cross(once).scale(db * twice) - once.scale(da * twice) + rate.cross(once).scale(b);
        let angular = R.transpose_mul(omega).cross(relative.angular) + turn;
        let drift = *R * relative.linear;
        let linear = omega.cross(omega.cross(s)) + omega.cross(drift).scale(two) + second;
        self.c = Motion::new(angular, R.transpose_mul(linear));
    }
    /// X V + Π x.
    pub(crate) fn carry(&self, motion: Motion<T>, x: &[T]) -> Motion<T> {
        let moved = self.pose.motion_to_child(motion);
        self.Pi.iter().zip(x).fold(moved, |sum, (Pi, x)| sum + Pi.scale(*x))
    }
}

/// (m32 − m23, m13 − m31, m21 − m12): Σ s × ψ for m = Σ ψ s*.
fn axial<T: Scalar>(m: &Mat3<T>) -> Vec3<T> {
    let m = &m.0;
    Vec3([m[2][1] - m[1][2], m[0][2] - m[2][0], m[1][0] - m[0][1]])
}

fn trace<T: Scalar>(m: &Mat3<T>) -> T {
    m.0[0][0] + m.0[1][1] + m.0[2][2]
}

fn minus<T: Scalar>(m: &Sym3<T>) -> Sym3<T> {
    let [xx, xy, xz, yy, yz, zz] = [m.xx, m.xy, m.xz, m.yy, m.yz, m.zz].map(|x| -x);
    Sym3 { xx, xy, xz, yy, yz, zz }
}
