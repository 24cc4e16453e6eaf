//! Readers of files: robots in URDF, systems of OpenMM and AMBER, trajectories, and the algebraic expressions that scenes and force fields
//! contain.
//!
//! A reader turns text into a value and a [`Report`]: what was used, what was approximated, what was ignored, and every
//! problem with its line. It never stops at the first problem, and no input makes it panic.
//!
//! ```
//! use phipsi_formats::urdf::{UrdfOptions, read_urdf};
//! let text = r#"<robot name="pendulum">
//!   <link name="world"/>
//!   <link name="rod"><inertial>
//!     <origin xyz="0 0 -0.5"/><mass value="1"/>
//!     <inertia ixx="0.1" iyy="0.1" izz="0.001" ixy="0" ixz="0" iyz="0"/>
//!   </inertial></link>
//!   <joint name="hinge" type="continuous"><parent link="world"/><child link="rod"/><axis xyz="0 1 0"/></joint>
//! </robot>"#;
//! let (model, report) = read_urdf(text, "pendulum.urdf", &UrdfOptions::default()).into_result(true)?;
//! assert_eq!(model.nv(), 1);
//! assert!(report.ignored.is_empty());
//! # Ok::<(), Box<phipsi_formats::Report>>(())
//! ```

pub mod dcd;
pub mod expression;
mod file;
mod joint_kind;
pub mod matrix_market;
pub mod node_table;
pub mod pdb;
pub mod prmtop;
pub mod report;
mod suggest;
pub mod system;
pub mod trajectory;
pub mod urdf;
mod xml;
pub mod xtc;

pub use expression::{Expression, ExpressionError};
pub use joint_kind::{JointKindError, is_extension, joint_kind};
pub use report::{Loaded, Note, Problem, Report};
pub use suggest::nearest;
