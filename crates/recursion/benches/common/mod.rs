//! Models and states that the benches share, and the lines that each prints first.
#![allow(dead_code)] // each bench uses its own part

use phipsi_model::{Base, Body, Inertia, Joint, JointKind, Model, ModelBuilder, Placement, Random};
use phipsi_recursion::{DynamicsError, Layout};
use phipsi_spatial::lanes::Level;
use std::hint::black_box;

/// The models of benches on one state: an arm, the same with a hand of two sliding fingers, a quadruped on a free base (18 degrees of
/// freedom), a chain, a binary tree.
pub const MODELS: [&str; 5] = ["arm_7", "hand_9", "quadruped_18", "chain_64", "tree_63"];

/// States that calls take in turn, once around in every sample: what a processor predicts on one helps little on the next.
pub const STATES: u32 = 16;

/// A model, compiled, with states.
pub struct Example {
    pub model: Model,
    pub layout: Layout<f64>,
    pub states: Vec<State>,
}

/// Coordinates, velocities, and accelerations or forces.
pub struct State {
    pub q: Vec<f64>,
    pub v: Vec<f64>,
    pub x: Vec<f64>,
}

impl Example {
    /// `arm_N`, `hand_N` (an arm whose last two bodies slide), `chain_N`, `tree_N` (binary; N bodies), `quadruped_18`.
    pub fn named(name: &str) -> Self {
        Self::with_states(name, STATES)
    }
    /// The same with another number of states.
    pub fn with_states(name: &str, states: u32) -> Self {
        let model = model(name);
        let states = (0..u64::from(states)).map(|seed| {
            let state = model.random_state(seed);
            let mut random = Random::new(seed);
            State { q: state.q, v: state.v, x: (0..model.nv()).map(|_| random.signed()).collect() }
        });
        let states = states.collect();
        Example { layout: Layout::new(&model), states, model }
    }
    /// A part of all states, one after the other, for batches.
    pub fn rows(&self, part: impl Fn(&State) -> &[f64]) -> Vec<f64> {
        self.states.iter().flat_map(part).copied().collect()
    }
}

fn model(name: &str) -> Model {
    let (kind, count) = name.split_once('_').expect("KIND_N");
    let count: usize = count.parse().expect("a number of bodies");
    match kind {
        // Right angles between the axes, as in arms of the factory.
        "arm" => tree(name, count, Base::Fixed, |k| k.checked_sub(1), |k| [0.0, 1.57, -1.57, 1.57][k % 4]),
        "hand" => {
            let parent = |k: usize| k.checked_sub(1).map(|p| p.min(count - 3));
            tree(name, count, Base::Fixed, parent, |k| [0.0, 1.57, -1.57, 1.57][k % 4])
        }
        "chain" => tree(name, count, Base::Fixed, |k| k.checked_sub(1), |k| 0.3 + 0.1 * (k % 5) as f64),
        "tree" => {
            tree(name, count, Base::Fixed, |k| (k > 0).then(|| (k - 1) / 2), |k| 0.3 + 0.1 * (k % 5) as f64)
        }
        // A trunk with four legs of three hinges.
        "quadruped" => tree(
            name,
            13,
            Base::Free,
            |k| match k {
                0 => None,
                _ if k % 3 == 1 => Some(0),
                _ => Some(k - 1),
            },
            |k| if k % 3 == 1 { 1.57 } else { 0.0 },
        ),
        _ => panic!("no model is called {name}"),
    }
}

/// Rods on hinges along z of frames that are turned about x against the parent's.
fn tree(
    name: &str,
    count: usize,
    base: Base,
    parent: impl Fn(usize) -> Option<usize>,
    turn: impl Fn(usize) -> f64,
) -> Model {
    let rod = Inertia::from_principal(1.0, [0.02, 0.01, 0.15], [0.012, 0.011, 0.002]);
    let mut builder = ModelBuilder::new(name).base(base);
    for k in 0..count {
        let body = format!("b{k}");
        builder = builder.body(Body::new(body.as_str(), rod));
        let on = match parent(k) {
            Some(p) => format!("b{p}"),
            None if base == Base::Free => continue,
            None => "world".to_owned(),
        };
        let placement = Placement::from_xyz_rpy([0.05, 0.0, 0.3], [turn(k), 0.0, 0.0]);
        let axis = [0.0, 0.0, 1.0];
        let kind = match k {
            _ if name.starts_with("hand") && k + 2 >= count => JointKind::Prismatic { axis },
            _ => JointKind::Revolute { axis },
        };
        let joint = Joint::new(format!("j{k}"), kind);
        builder = builder.joint(joint.at(placement), on, body);
    }
    builder.build().expect("a valid model")
}

/// Calls that take the states of an example in turn. Results are written into `size` numbers.
pub fn calls<W>(
    example: &Example,
    size: usize,
    mut workspace: W,
    run: impl Fn(&mut W, &Example, &State, &mut [f64]) -> Result<(), DynamicsError>,
) -> impl FnMut() {
    let mut turn = example.states.iter().cycle();
    let mut out = vec![0.0; size];
    move || {
        let state = black_box(turn.next().expect("a state"));
        run(&mut workspace, example, state, &mut out).expect("a regular state");
        black_box((&mut out, &mut workspace));
    }
}

/// Three matrices of one buffer.
pub fn thirds<T>(out: &mut [T]) -> [&mut [T]; 3] {
    let n = out.len() / 3;
    let (first, rest) = out.split_at_mut(n);
    let (second, third) = rest.split_at_mut(n);
    [first, second, third]
}

/// What is measured, on which machine, compiled how.
pub fn header(what: &str) {
    println!("{what}");
    println!("  processor  {}", processor());
    println!("  lanes      {} (levels: {})", Level::best().name(), available().join(", "));
    println!("  compiler   {}", compiler().unwrap_or_else(|| "unknown: see `rustc --version`".into()));
    println!("  profile    {}{}", profile(), if cfg!(debug_assertions) { ", debug assertions" } else { "" });
    println!("  features   {}; RUSTFLAGS {:?}", features(), option_env!("RUSTFLAGS").unwrap_or(""));
    let threads = std::thread::available_parallelism().map_or(1, |n| n.get());
    let parallel = if cfg!(feature = "parallel") {
        "used by batches and by branches of large trees"
    } else {
        "not used: no feature `parallel`"
    };
    println!("  threads    {threads}, {parallel}\n");
}

pub fn processor() -> String {
    let text = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let line = text.lines().find(|line| line.starts_with("model name"));
    let name = line.and_then(|line| line.split_once(':')).map_or("unknown", |(_, name)| name.trim());
    format!("{name}, {} {}", std::env::consts::ARCH, std::env::consts::OS)
}

fn available() -> Vec<&'static str> {
    Level::ALL.into_iter().filter(|l| l.is_available()).map(Level::name).collect()
}

/// The version that rustc wrote into this program.
pub fn compiler() -> Option<String> {
    let program = std::fs::read(std::env::current_exe().ok()?).ok()?;
    let mark = b"rustc version ";
    let versions = program.windows(mark.len() + 1).enumerate();
    let (at, _) =
        versions.into_iter().find(|(_, w)| w.starts_with(mark) && w[mark.len()].is_ascii_digit())?;
    let text: Vec<u8> =
        program[at..].iter().copied().take(80).take_while(|c| (b' '..=b'~').contains(c)).collect();
    String::from_utf8(text).ok()
}

/// The folder of the build's profile.
fn profile() -> String {
    let path = std::env::current_exe().unwrap_or_default();
    let folder = path.parent().and_then(|deps| deps.parent()).and_then(|folder| folder.file_name());
    folder.map_or("unknown".into(), |name| name.to_string_lossy().into_owned())
}

/// Instructions that the compiler may use everywhere, without asking the processor.
fn features() -> String {
    let all = [
        ("sse2", cfg!(target_feature = "sse2")),
        ("avx", cfg!(target_feature = "avx")),
        ("avx2", cfg!(target_feature = "avx2")),
        ("fma", cfg!(target_feature = "fma")),
        ("avx512f", cfg!(target_feature = "avx512f")),
        ("neon", cfg!(target_feature = "neon")),
    ];
    let names: Vec<&str> = all.into_iter().filter(|(_, on)| *on).map(|(name, _)| name).collect();
    if names.is_empty() { "the target's least".into() } else { names.join(" ") }
}
