//! Under-actuated systems: some degrees of freedom are driven (active: acceleration given), others move freely (passive).
//!
//! | symbol | meaning | shape | source |
//! |---|---|---|---|
//! | H_a, H_p | rows of H of the active and the passive axes | nv_a × 6n, nv_p × 6n | paper 2 §4.7 |
//! | D_p, K_p, ψ, P | Riccati equation with H_p: joints are articulated about passive axes only | | paper 2 (2.4) |
//! | S_pp | (I − H_pψK_p)* D_p⁻¹ (I − H_pψK_p) = 𝓜_pp⁻¹ | nv_p × nv_p | paper 2 (4.23) corrected |
//! | S_ap | H_a [ψK_p + P ψ* H_p* D_p⁻¹ (I − H_pψK_p)] = 𝓜_ap 𝓜_pp⁻¹ | nv_a × nv_p | soa.md 3.6 |
//! | S_aa | H_a (ψMψ* − P Ω_p P) H_a* = 𝓜_aa − 𝓜_ap 𝓜_pp⁻¹ 𝓜_pa | nv_a × nv_a | soa.md 3.6 |
//!
//! (T_a, θ̈_p) = [[S_aa, S_ap], [−S_ap*, S_pp]] (θ̈_a, T_p), velocity terms left out (paper 2 (4.22)). Every operator is an
//! expression of sweeps, applied in O(n). The dynamics itself, with velocity terms, gravity and wrenches, is the kernel
//! [`phipsi_recursion::HybridDynamics`]: any pattern, O(n), no allocation.
//!
//! With a free base whose six degrees of freedom are passive these are a free-flying robot's: its base moves by −S_ap* θ̇_a at
//! zero momentum, and [`UnderActuated::generalized_jacobian`] is the space Jacobian.
//!
//! ```
//! use phipsi_hybrid::UnderActuated;
//! use phipsi_model::{Body, Inertia, Joint, JointKind, ModelBuilder, Placement};
//! // Two rods on two hinges, of which the first is driven.
//! let rod = Inertia::from_principal(1.0, [0.5, 0.0, 0.0], [0.0, 1.0 / 12.0, 1.0 / 12.0]);
//! let hinge = |name: &str| Joint::new(name, JointKind::Revolute { axis: [0.0, 1.0, 0.0] });
//! let end = Placement { translation: [1.0, 0.0, 0.0], ..Placement::IDENTITY };
//! let model = ModelBuilder::new("acrobot's opposite")
//!     .body(Body::new("upper", rod))
//!     .body(Body::new("lower", rod))
//!     .joint(hinge("shoulder"), "world", "upper")
//!     .joint(hinge("elbow").at(end), "upper", "lower")
//!     .build()?;
//! let system = UnderActuated::new(&model, &[0.0, 0.0_f64], &[true, false])?;
//! // The elbow follows the shoulder with −M_pp⁻¹ M_pa = −(1/3 + 1/2)/(1/3).
//! let follows = system.S_ap.adjoint().apply(&[1.0])?;
//! assert!((follows[0] - 2.5).abs() < 1e-14);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

// Operators carry the papers' symbols.
#![allow(non_snake_case)]

mod error;
mod placement;
mod under_actuated;

pub use error::HybridError;
pub use placement::{Placement, PlacementMeasures, placements};
pub use under_actuated::UnderActuated;
