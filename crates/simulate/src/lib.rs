//! From scenes to runs: reading a scene file, running it with a stated error, run folders that survive a kill.
//!
//! [`Simulation`] is what a run needs, made by [`scene::load`] from a file or by [`Simulation::new`] from a model.
//! [`run()`] runs it in memory or into any [`Observer`]; [`folder`] runs it into a folder that can be resumed.

pub mod chart;
pub mod check;
pub mod convert;
pub mod drift;
pub mod error;
pub mod event_record;
pub mod folder;
pub mod level;
pub mod molecule;
pub mod output;
pub mod page;
pub mod recluster;
pub mod record;
pub mod report;
pub mod run;
pub mod run_page;
pub mod scene;
pub mod simulation;
pub mod stiffness;
pub mod stress;

pub use error::SimulateError;
pub use event_record::EventRecord;
pub use output::{Output, Quantity};
pub use recluster::ChangeRecord;
pub use record::{LimitPassed, Observer, Recording, Row, StepRecord};
pub use run::{ClosureRecord, Progress, RunState, Summary, resume, run};
pub use simulation::{Choice, JointBehavior, Simulation};
