//! The command `phipsi`.
//!
//! Exit status: 0 fine, warnings included; 1 the input or the numerics failed, said where and why; 2 wrong usage; 130
//! interrupted. With `--json`, standard output holds exactly one JSON value.

mod check;
mod conventions;
mod convert;
mod energy;
mod interrupt;
mod progress;
mod report;
mod run;
mod show;
mod stress;

use clap::{Args, Parser, Subcommand};
use std::path::PathBuf;
use std::process::ExitCode;

/// Multibody dynamics that says how wrong it is.
#[derive(Parser)]
#[command(name = "phipsi", version, max_term_width = 100)]
#[command(after_help = "Example: phipsi run examples/satellite_arm.toml")]
struct Cli {
    #[command(subcommand)]
    command: Command,
    #[command(flatten)]
    common: Common,
}

/// Options of all commands.
#[derive(Args, Clone, Debug)]
struct Common {
    /// Print exactly one JSON value on standard output
    #[arg(long, global = true)]
    json: bool,
    /// Print nothing but results and errors
    #[arg(long, global = true)]
    quiet: bool,
    /// Treat warnings as errors
    #[arg(long, global = true)]
    strict: bool,
    /// Largest number of threads; results do not depend on it
    #[arg(long, global = true, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    threads: Option<u16>,
}

#[derive(Subcommand)]
enum Command {
    /// Simulate a scene into a run folder, or continue a run
    #[command(after_help = "Examples:\n  phipsi run examples/satellite_arm.toml\n  \
                            phipsi run arm.toml --set integrator.rtol=1e-12 --out runs/tight\n  \
                            phipsi run --resume runs/satellite_arm-001")]
    Run(run::Options),
    /// Say what a model or scene contains, what is ignored, and everything that is wrong with it
    #[command(after_help = "Example: phipsi check examples/satellite_arm.urdf examples/ala_dipeptide.toml")]
    Check {
        /// URDF models, scenes, PDB files, OpenMM Systems
        #[arg(required = true, value_name = "FILE")]
        files: Vec<PathBuf>,
    },
    /// Error against run time: methods × tolerances or steps on a scene, against a reference made for it
    #[command(after_help = "Examples:\n  phipsi report examples/satellite_arm.toml\n  \
                            phipsi report arm.toml --set integrator.t_end=5 --budget 20 --out reports/arm")]
    Report(report::Options),
    /// The stiff and extreme scenes: errors, drift, steps, cost, and whether each comes out right
    #[command(after_help = "Examples:\n  phipsi stress --quick\n  phipsi stress --only loops --json")]
    Stress(stress::Options),
    /// Turn a URDF file, or a PDB file with its OpenMM System, into a scene; a trajectory into DCD, XTC or PDB
    #[command(after_help = "Examples:\n  phipsi convert arm.urdf arm.toml\n  \
                            phipsi convert protein.pdb protein.xml protein.toml\n  \
                            phipsi convert run.dcd run.xtc\n  \
                            phipsi convert run.xtc protein.pdb run.pdb    (names of the atoms from protein.pdb)")]
    Convert {
        /// The inputs, then the scene or trajectory to write, which must not exist
        #[arg(required = true, num_args = 2..=3, value_name = "FILE")]
        files: Vec<PathBuf>,
    },
    /// Print the energy of a molecule, term by term
    #[command(
        after_help = "Example: phipsi energy examples/ala_dipeptide.pdb --system examples/ala_dipeptide.xml"
    )]
    Energy(energy::Options),
    /// Print the conventions: frames, orders, signs, units
    #[command(after_help = "Example: phipsi conventions")]
    Conventions,
}

/// What a command came to.
enum Ending {
    Fine,
    Failed,
    Interrupted,
}

fn main() -> ExitCode {
    let Cli { command, common } = Cli::parse();
    let ending = match command {
        Command::Run(options) => run::run(&options, &common),
        Command::Report(options) => report::make(&options, &common),
        Command::Stress(options) => stress::stress(&options, &common),
        Command::Check { files } => check::check(&files, &common),
        Command::Convert { files } => convert::convert(&files, &common),
        Command::Energy(options) => energy::energy(&options, &common),
        Command::Conventions => conventions::conventions(&common),
    };
    ExitCode::from(match ending {
        Ending::Fine => 0,
        Ending::Failed => 1,
        Ending::Interrupted => 130,
    })
}
