//! The algorithms of this crate as kernels on many states.
//!
//! Each names its inputs, in the order of [`run_batch`](super::run_batch), and its results. Kernels that take external
//! wrenches have `loaded`: bodies of the model that each have a further input, six numbers a state: moment, then force, at
//! the body frame's origin, body axes.

use super::StateKernel;
use crate::energy::{CenterOfMass as CenterOfMassWork, KineticEnergy as KineticEnergyWork};
use crate::error::DynamicsError;
use crate::kinematics::{Kinematics, body_pose, body_velocity};
use crate::layout::Layout;
use crate::momentum::About;
use phipsi_model::Model;
use phipsi_spatial::lanes::Lanes;
use phipsi_spatial::{Vec3, Wrench};

/// True of matrices with a column for each degree of freedom.
fn has_columns(layout: &Layout<f64>, size: usize) -> bool {
    let square = layout.nv() * layout.nv();
    !layout.is_flexible() && size >= square
}

/// Kernels that hold no more than a layout.
macro_rules! on_layout {
    ($(#[$doc:meta] $name:ident: $work:ty, |$layout:ident, $w:ident, $inputs:ident, $out:ident| $run:expr;)*) => {$(
        #[$doc]
        #[derive(Clone, Copy, Debug)]
        pub struct $name<'a> {
            /// The compiled model.
            pub layout: &'a Layout<f64>,
        }
        impl StateKernel for $name<'_> {
            type Workspace<T: Lanes> = $work;
            fn workspace<T: Lanes>(&self) -> Self::Workspace<T> {
                <$work>::new(self.layout)
            }
            #[inline(always)]
            fn run<T: Lanes>(
                &self,
                $w: &mut Self::Workspace<T>,
                $inputs: &[Vec<T>],
                $out: &mut [T],
            ) -> Result<(), DynamicsError> {
                let $layout = self.layout;
                $run
            }
            fn has_columns(&self, size: usize) -> bool {
                has_columns(self.layout, size)
            }
        }
    )*};
}

on_layout! {
    /// Inputs q; result M(q), nv×nv.
    MassMatrix: crate::MassMatrix<T>, |layout, work, inputs, out| work.run(layout, &inputs[0], out);
    /// Inputs q; result M(q)⁻¹, nv×nv.
    MassMatrixInverse: crate::MassMatrixInverse<T>, |layout, work, inputs, out| work.run(layout, &inputs[0], out);
    /// Inputs q, x; result M(q)⁻¹ x.
    MassMatrixSolution: crate::MassMatrixSolution<T>,
        |layout, work, inputs, out| work.run(layout, &inputs[0], &inputs[1], out);
    /// Inputs q, v; result the kinetic energy.
    KineticEnergy: KineticEnergyWork<T>, |layout, work, inputs, out| {
        out[0] = work.run(layout, &inputs[0], &inputs[1])?;
        Ok(())
    };
    /// Inputs q; result the potential energy of gravity.
    PotentialEnergy: CenterOfMassWork<T>, |layout, work, inputs, out| {
        out[0] = work.potential_energy(layout, &inputs[0])?;
        Ok(())
    };
    /// Inputs q; result the centre of mass.
    CenterOfMass: CenterOfMassWork<T>, |layout, work, inputs, out| {
        out.copy_from_slice(&work.run(layout, &inputs[0])?.0);
        Ok(())
    };
    /// Inputs q, v and, if there is a third, the point of the world; result the momentum about it or the centre of mass.
    Momentum: crate::Momentum<T>, |layout, work, inputs, out| {
        let about = point(inputs.get(2)).map_or(About::CenterOfMass, About::Point);
        out.copy_from_slice(&work.run(layout, &inputs[0], &inputs[1], about)?.to_array());
        Ok(())
    };
    /// Inputs q; result the centroidal momentum matrix, 6×nv.
    CentroidalMomentumMatrix: crate::CentroidalMomentumMatrix<T>,
        |layout, work, inputs, out| work.run(layout, &inputs[0], out);
    /// Inputs q; result ∂ ln det M/∂q.
    LogDeterminantGradient: crate::LogDeterminantGradient<T>,
        |layout, work, inputs, out| work.run(layout, &inputs[0], out);
    /// Inputs q; result Υ of every body of the model, 6×6 each.
    Upsilon: crate::Upsilon<T>, |layout, work, inputs, out| work.run(layout, &inputs[0], out);
}

#[inline(always)]
fn point<T: Lanes>(input: Option<&Vec<T>>) -> Option<Vec3<T>> {
    input.map(|x| Vec3([x[0], x[1], x[2]]))
}

/// External wrenches of a pack: the inputs from `first` on.
#[inline(always)]
fn loads<'w, T: Lanes>(
    loaded: &[usize],
    inputs: &[Vec<T>],
    first: usize,
    wrenches: &'w mut [Wrench<T>],
) -> Option<&'w [Wrench<T>]> {
    for (body, x) in loaded.iter().zip(&inputs[first..]) {
        wrenches[*body] = Wrench::from_array([x[0], x[1], x[2], x[3], x[4], x[5]]);
    }
    if loaded.is_empty() { None } else { Some(wrenches) }
}

fn unloaded<T: Lanes>(loaded: &[usize], bodies: usize) -> Vec<Wrench<T>> {
    if loaded.is_empty() { Vec::new() } else { vec![Wrench::zero(); bodies] }
}

/// Kernels on three inputs and wrenches.
macro_rules! loaded {
    ($(#[$doc:meta] $name:ident, |$work:ident, $layout:ident, $q:ident, $v:ident, $x:ident, $wrenches:ident, $out:ident|
        $run:expr;)*) => {$(
        #[$doc]
        #[derive(Clone, Copy, Debug)]
        pub struct $name<'a> {
            /// The compiled model.
            pub layout: &'a Layout<f64>,
            /// Bodies with external wrenches.
            pub loaded: &'a [usize],
        }
        impl StateKernel for $name<'_> {
            type Workspace<T: Lanes> = (crate::$name<T>, Vec<Wrench<T>>);
            fn workspace<T: Lanes>(&self) -> Self::Workspace<T> {
                (crate::$name::new(self.layout), unloaded(self.loaded, self.layout.model_bodies()))
            }
            #[inline(always)]
            fn run<T: Lanes>(
                &self,
                ($work, wrenches): &mut Self::Workspace<T>,
                inputs: &[Vec<T>],
                $out: &mut [T],
            ) -> Result<(), DynamicsError> {
                let $wrenches = loads(self.loaded, inputs, 3, wrenches);
                let ($layout, $q, $v, $x) = (self.layout, &inputs[0], &inputs[1], &inputs[2]);
                $run
            }
            fn has_columns(&self, size: usize) -> bool {
                has_columns(self.layout, size)
            }
        }
    )*};
}

loaded! {
    /// Inputs q, v, τ, wrenches; result the accelerations, by the plain form.
    ForwardDynamics, |work, layout, q, v, tau, wrenches, out| work.run(layout, q, v, tau, wrenches, out);
    /// Inputs q, v, a, wrenches; result the generalised forces.
    InverseDynamics, |work, layout, q, v, a, wrenches, out| work.run(layout, q, v, a, wrenches, out);
    /// Inputs q, v, τ, wrenches; results ∂θ̈/∂q, ∂θ̈/∂v, M⁻¹, each nv×nv.
    ForwardDynamicsDerivatives, |work, layout, q, v, tau, wrenches, out| {
        let [d_dq, d_dv, d_dtau] = thirds(out);
        work.run(layout, q, v, tau, wrenches, d_dq, d_dv, d_dtau)
    };
    /// Inputs q, v, a, wrenches; results ∂T/∂q, ∂T/∂v, M, each nv×nv.
    InverseDynamicsDerivatives, |work, layout, q, v, a, wrenches, out| {
        let [d_dq, d_dv, d_da] = thirds(out);
        work.run(layout, q, v, a, wrenches, d_dq, d_dv, d_da)
    };
    /// Inputs q, v, τ, wrenches; results A, 2nv×2nv, and B, 2nv×nv.
    Linearization, |work, layout, q, v, tau, wrenches, out| {
        let (a, b) = out.split_at_mut(4 * layout.nv() * layout.nv());
        work.run(layout, q, v, tau, wrenches, a, b)
    };
}

/// Inputs q, v, what is given (accelerations of active, forces of passive degrees of freedom), wrenches; result what is wanted
/// (forces of active, accelerations of passive ones).
#[derive(Clone, Copy, Debug)]
pub struct HybridDynamics<'a> {
    /// The compiled model.
    pub layout: &'a Layout<f64>,
    /// Which degrees of freedom are active.
    pub active: &'a [bool],
    /// Bodies with external wrenches.
    pub loaded: &'a [usize],
}

impl StateKernel for HybridDynamics<'_> {
    type Workspace<T: Lanes> = (crate::HybridDynamics<T>, Vec<Wrench<T>>, Vec<T>);
    fn workspace<T: Lanes>(&self) -> Self::Workspace<T> {
        let wrenches = unloaded(self.loaded, self.layout.model_bodies());
        (crate::HybridDynamics::new(self.layout), wrenches, vec![T::splat(0.0); self.layout.nv()])
    }
    #[inline(always)]
    fn run<T: Lanes>(
        &self,
        (work, wrenches, tau): &mut Self::Workspace<T>,
        inputs: &[Vec<T>],
        out: &mut [T],
    ) -> Result<(), DynamicsError> {
        let wrenches = loads(self.loaded, inputs, 3, wrenches);
        out.copy_from_slice(&inputs[2]);
        tau.copy_from_slice(&inputs[2]);
        work.run(self.layout, &inputs[0], &inputs[1], self.active, out, tau, wrenches)?;
        for ((out, tau), _) in out.iter_mut().zip(tau).zip(self.active).filter(|(_, active)| **active) {
            *out = *tau;
        }
        Ok(())
    }
}

#[inline(always)]
fn thirds<T>(out: &mut [T]) -> [&mut [T]; 3] {
    let size = out.len() / 3;
    let (a, rest) = out.split_at_mut(size);
    let (b, c) = rest.split_at_mut(size);
    [a, b, c]
}

/// Inputs q, v, a, wrenches; result six numbers for each body of the model, its wrench from its parent.
#[derive(Clone, Copy, Debug)]
pub struct JointReactions<'a> {
    /// The model.
    pub model: &'a Model,
    /// The compiled model.
    pub layout: &'a Layout<f64>,
    /// Bodies with external wrenches.
    pub loaded: &'a [usize],
}

impl StateKernel for JointReactions<'_> {
    type Workspace<T: Lanes> = (crate::JointReactions<T>, Vec<Wrench<T>>, Vec<Wrench<T>>);
    fn workspace<T: Lanes>(&self) -> Self::Workspace<T> {
        let reactions = vec![Wrench::zero(); self.model.len()];
        let wrenches = unloaded(self.loaded, self.model.len());
        (crate::JointReactions::new(self.model, self.layout), wrenches, reactions)
    }
    #[inline(always)]
    fn run<T: Lanes>(
        &self,
        (work, wrenches, reactions): &mut Self::Workspace<T>,
        inputs: &[Vec<T>],
        out: &mut [T],
    ) -> Result<(), DynamicsError> {
        let wrenches = loads(self.loaded, inputs, 3, wrenches);
        work.run(self.layout, &inputs[0], &inputs[1], &inputs[2], wrenches, reactions)?;
        for (row, reaction) in out.chunks_exact_mut(6).zip(reactions.iter()) {
            row.copy_from_slice(&reaction.to_array());
        }
        Ok(())
    }
}

/// Kernels on one body of the model; `None` is the world.
macro_rules! on_body {
    ($(#[$doc:meta] $name:ident, $workspace:ty, $new:expr,
        |$layout:ident, $body:ident, $work:ident, $inputs:ident, $out:ident| $run:expr;)*) => {$(
        #[$doc]
        #[derive(Clone, Copy, Debug)]
        pub struct $name<'a> {
            /// The compiled model.
            pub layout: &'a Layout<f64>,
            /// The body.
            pub body: Option<usize>,
        }
        impl StateKernel for $name<'_> {
            type Workspace<T: Lanes> = $workspace;
            fn workspace<T: Lanes>(&self) -> $workspace {
                let new: fn(&Layout<f64>) -> $workspace = $new;
                new(self.layout)
            }
            #[inline(always)]
            fn run<T: Lanes>(
                &self,
                $work: &mut $workspace,
                $inputs: &[Vec<T>],
                $out: &mut [T],
            ) -> Result<(), DynamicsError> {
                let ($layout, $body) = (self.layout, self.body);
                $run
            }
        }
    )*};
}

on_body! {
    /// Inputs q; result the pose, 4×4.
    BodyPose, (), |_| (), |layout, body, _work, inputs, out| {
        let pose = body_pose(layout, &inputs[0], body)?;
        let rows = out.chunks_exact_mut(4).zip(pose.rotation.0).zip(pose.translation.0);
        for ((out, row), x) in rows {
            out[..3].copy_from_slice(&row);
            out[3] = x;
        }
        let [o, one] = [T::splat(0.0), T::splat(1.0)];
        out[12..].copy_from_slice(&[o, o, o, one]);
        Ok(())
    };
    /// Inputs q, v; result (ω, velocity of the origin), world axes.
    BodyVelocity, (), |_| (), |layout, body, _work, inputs, out| {
        out.copy_from_slice(&body_velocity(layout, &inputs[0], &inputs[1], body)?.to_array());
        Ok(())
    };
    /// Inputs q, v, a; result the papers' α, world axes.
    BodyAcceleration, Kinematics<T>, Kinematics::new, |layout, body, work, inputs, out| {
        work.set_position(layout, &inputs[0])?;
        work.set_velocity(layout, &inputs[1])?;
        work.set_acceleration(layout, &inputs[1], &inputs[2])?;
        out.copy_from_slice(&work.acceleration(layout, body).to_array());
        Ok(())
    };
    /// Inputs q and, if there is a second, the point in the body's frame; result the Jacobian, 6×nv.
    Jacobian, crate::Jacobian<T>, crate::Jacobian::new, |layout, body, work, inputs, out| {
        work.run(layout, &inputs[0], body, point(inputs.get(1)), out)
    };
}
