//! Python bindings of phipsi: the native half of the package `phipsi`.
//!
//! | file | what |
//! |---|---|
//! | `batch`, `buffer` | array-likes as states, broadcasting, the loop over states; memory for their copies |
//! | `model`, `dynamics`, `derivatives`, `hybrid`, `freeflight`, `kinematics`, `jacobians`, `velocities` | methods of the class `Model` |
//! | `operators`, `estimation` | `phipsi.operators`: the classes `Operators` and `Operator` |
//! | `flexible` | the class `FlexibleBody`, and methods of the class `Model` about modes |
//! | `closure`, `closure_projection`, `closure_motion` | methods of the class `Model` about loops; the class `ClosureProjection`; closures that move |
//! | `molecule`, `source` | the class `System`: energies and forces of molecules |
//! | `torsion_model`, `torsion_positions`, `torsion_minimum`, `torsion_recluster`, `clustering`, `torsion_run` | the class `TorsionModel`: molecules in torsions |
//! | `engine` | the forces of a torsion model: its System's, or a function in Python |
//! | `simulate`, `trajectory`, `simulator` | motion |
//! | `errors`, `report`, `pickle` | exceptions with fields, reports of readers, results in other processes |

mod batch;
mod buffer;
mod closure;
mod closure_motion;
mod closure_projection;
mod clustering;
mod compiled;
mod derivatives;
mod dynamics;
mod engine;
mod errors;
mod estimation;
mod flexible;
mod freeflight;
mod hybrid;
mod jacobians;
mod kinematics;
mod lent;
mod model;
mod molecule;
mod operator_dynamics;
mod operators;
mod pickle;
mod report;
mod simulate;
mod simulator;
mod source;
mod torsion_minimum;
mod torsion_model;
mod torsion_positions;
mod torsion_recluster;
mod torsion_run;
mod torsion_split;
mod trajectory;
mod velocities;

use pyo3::prelude::*;

/// The native half of the package `phipsi`.
#[pymodule]
fn _native(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add("__version__", env!("CARGO_PKG_VERSION"))?;
    // What the last bits of results depend on.
    m.add("__instruction_level__", phipsi::simulate::level::instruction_level())?;
    m.add_class::<model::Model>()?;
    m.add_class::<operators::Operators>()?;
    m.add_class::<operators::Operator>()?;
    m.add_function(wrap_pyfunction!(operators::operators, m)?)?;
    m.add_class::<estimation::Filtered>()?;
    m.add_class::<estimation::Smoothed>()?;
    m.add_class::<estimation::FieldSamples>()?;
    m.add_class::<flexible::FlexibleBody>()?;
    m.add_class::<molecule::System>()?;
    m.add_class::<torsion_model::TorsionModel>()?;
    m.add_class::<torsion_minimum::Minimum>()?;
    m.add_class::<torsion_run::Run>()?;
    m.add_class::<report::Report>()?;
    m.add_class::<report::Note>()?;
    m.add_class::<report::Problem>()?;
    m.add_class::<dynamics::ForwardInfo>()?;
    m.add_class::<dynamics::WorstHinge>()?;
    m.add_class::<jacobians::OperationalSpaceInfo>()?;
    m.add_class::<jacobians::InverseKinematicsInfo>()?;
    m.add_class::<closure::AssemblyInfo>()?;
    m.add_class::<closure_projection::VelocityProjectionInfo>()?;
    m.add_class::<closure_projection::ClosureProjection>()?;
    m.add_class::<trajectory::Trajectory>()?;
    m.add_class::<trajectory::RunError>()?;
    m.add_class::<simulator::Simulator>()?;
    m.add_function(wrap_pyfunction!(simulate::simulate, m)?)
}
