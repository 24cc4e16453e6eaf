//! Many states of one model: several at once in the lanes of SIMD registers, blocks of them over threads.
//!
//! A [`StateKernel`] is a calculation on one state that is generic over the scalar. States go through it in packs as wide as
//! the processor allows ([`phipsi_spatial::lanes`]); the last pack is filled up with its last state. Lanes do not see each
//! other and do the operations of the plain number, so that a state's result depends neither on its place, nor on the size
//! of the batch, nor on the number of threads, nor on the processor.

pub mod kernels;

use crate::error::DynamicsError;
use phipsi_spatial::Kernel;
use phipsi_spatial::lanes::{Fused, Lanes, Level, Visitor, at_level};

/// A calculation on one state, generic over the scalar.
///
/// [`kernels`] has those of this crate.
///
/// # Example
/// ```
/// use phipsi_model::{Body, Inertia, Joint, JointKind, ModelBuilder};
/// use phipsi_recursion::Layout;
/// use phipsi_recursion::batch::{Input, kernels, run_batch};
/// use phipsi_spatial::lanes::Level;
///
/// let rod = Inertia::from_principal(1.0, [0.5, 0.0, 0.0], [0.0, 1.0 / 12.0, 1.0 / 12.0]);
/// let model = ModelBuilder::new("pendulum")
///     .body(Body::new("rod", rod))
///     .joint(Joint::new("hinge", JointKind::Revolute { axis: [0.0, 1.0, 0.0] }), "world", "rod")
///     .build()?;
/// let layout = Layout::new(&model);
/// let kernel = kernels::ForwardDynamics { layout: &layout, loaded: &[] };
/// let (q, zero) = ([0.0, 0.1, 0.2], [0.0]);
/// let inputs = [Input::each(&q, 1), Input::same(&zero), Input::same(&zero)];
/// let mut out = [0.0; 3];
/// run_batch(&kernel, Level::best(), &inputs, 3, &mut out).map_err(|e| e.1)?;
/// assert!(out[0] > out[1] && out[1] > out[2]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub trait StateKernel: Sync {
    /// Its scratch.
    type Workspace<T: Lanes>;
    /// Makes the scratch; once for every run of blocks of states.
    fn workspace<T: Lanes>(&self) -> Self::Workspace<T>;
    /// The calculation: one slice for each input. To be `#[inline(always)]`, as [`Kernel::run`].
    ///
    /// # Errors
    /// Those of the calculation, for any of the lanes.
    fn run<T: Lanes>(
        &self,
        workspace: &mut Self::Workspace<T>,
        inputs: &[Vec<T>],
        out: &mut [T],
    ) -> Result<(), DynamicsError>;
}

/// Numbers of an argument, state after state.
#[derive(Clone, Copy, Debug)]
pub struct Input<'a> {
    data: &'a [f64],
    size: usize,
    /// Which of its states belongs to each state of the batch; empty: the same number, or always the first.
    map: &'a [usize],
    same: bool,
}

impl<'a> Input<'a> {
    /// `size` numbers for each state of the batch.
    pub fn each(data: &'a [f64], size: usize) -> Self {
        Input { data, size, map: &[], same: false }
    }
    /// The same numbers for all states.
    pub fn same(data: &'a [f64]) -> Self {
        Input { data, size: data.len(), map: &[], same: true }
    }
    /// For state i of the batch the numbers of state `map[i]`.
    pub fn mapped(data: &'a [f64], size: usize, map: &'a [usize]) -> Self {
        Input { data, size, map, same: false }
    }
    /// The first of `count` states that has no numbers here.
    fn shortage(&self, count: usize) -> Option<usize> {
        let has = |state: &usize| self.at(*state).is_some();
        match self.map {
            [] if self.same => (!has(&0)).then_some(0),
            // The last state has the highest place.
            [] => (!has(&(count - 1))).then(|| self.data.len() / self.size.max(1)),
            _ => (0..count).find(|state| !has(state)),
        }
    }
    /// Its numbers for a state; `None` beyond its end.
    #[inline(always)]
    pub fn at(&self, state: usize) -> Option<&'a [f64]> {
        let own = match self.map.get(state) {
            Some(&own) => own,
            None if self.same => 0,
            None if self.map.is_empty() => state,
            None => return None,
        };
        self.data.get(own * self.size..(own + 1) * self.size)
    }
}

/// Runs a kernel on `count` states. `out`: the results, state after state, of equal size.
///
/// # Cost
/// Threads (feature `parallel`) take blocks of states; allocates a workspace for each run of blocks on a thread.
///
/// # Errors
/// The first state that fails, and how; [`DynamicsError::NotFinite`] if a number of its result is not finite.
/// [`DynamicsError::Shape`] if an input has fewer states than `count`, or `out` no
/// whole number of entries a state.
pub fn run_batch<K: StateKernel>(
    kernel: &K,
    level: Level,
    inputs: &[Input<'_>],
    count: usize,
    out: &mut [f64],
) -> Result<(), (usize, DynamicsError)> {
    if count == 0 {
        return Ok(());
    }
    let size = out.len() / count;
    let shape = |argument, expected, found| (0, DynamicsError::Shape { argument, expected, found });
    if size * count != out.len() {
        return Err(shape("out", size * count, out.len()));
    }
    for input in inputs {
        if let Some(found) = input.shortage(count) {
            return Err(shape("input", count, found));
        }
    }
    if size == 0 {
        return Ok(());
    }
    // Narrow batches need no wide registers.
    let level = if count == 1 { Level::Scalar } else { level };
    let work = Work { kernel, inputs, count, size };
    let failed = match at_level(level, Blocks { work, out: &mut *out }) {
        Some(failed) => failed,
        None => at_level(Level::Scalar, Blocks { work, out }).flatten(),
    };
    failed.map_or(Ok(()), Err)
}

/// What all blocks share.
struct Work<'a, K> {
    kernel: &'a K,
    inputs: &'a [Input<'a>],
    count: usize,
    size: usize,
}

impl<K> Clone for Work<'_, K> {
    fn clone(&self) -> Self {
        *self
    }
}
impl<K> Copy for Work<'_, K> {}

type Failed = Option<(usize, DynamicsError)>;

/// Numbers of results that a block of states has at least, so that threads are worth their start.
const BLOCK: usize = 2048;

struct Blocks<'a, K> {
    work: Work<'a, K>,
    out: &'a mut [f64],
}

impl<K: StateKernel> Visitor for Blocks<'_, K> {
    type Output = Failed;
    fn visit<T: Lanes>(self) -> Failed {
        let Work { count, size, .. } = self.work;
        let packs = (BLOCK / (T::LANES * size)).clamp(1, 32);
        let states = packs * T::LANES;
        let work = self.work;
        let scratch = || Scratch {
            workspace: work.kernel.workspace(),
            packed: work.inputs.iter().map(|i| vec![T::zero(); i.size]).collect(),
            results: vec![T::zero(); size],
        };
        let block = |scratch: &mut Scratch<T, K>, (index, out): (usize, &mut [f64])| {
            T::dispatch(Block { work, first: index * states, out, scratch })
        };
        #[cfg(feature = "parallel")]
        if count > states {
            use rayon::prelude::*;
            let chunks = self.out.par_chunks_mut(states * size).enumerate();
            return chunks.map_init(scratch, block).filter_map(|failed| failed).min_by_key(|failed| failed.0);
        }
        let (mut scratch, _) = (scratch(), count);
        self.out.chunks_mut(states * size).enumerate().find_map(|chunk| block(&mut scratch, chunk))
    }
}

/// What one thread works with.
struct Scratch<T: Lanes, K: StateKernel> {
    workspace: K::Workspace<T>,
    /// The inputs of a pack.
    packed: Vec<Vec<T>>,
    results: Vec<T>,
}

struct Block<'a, T: Lanes, K: StateKernel> {
    work: Work<'a, K>,
    first: usize,
    out: &'a mut [f64],
    scratch: &'a mut Scratch<T, K>,
}

impl<T: Lanes, K: StateKernel> Kernel for Block<'_, T, K> {
    type Output = Failed;
    #[inline(always)]
    fn run(self) -> Failed {
        let Work { kernel, inputs, size, .. } = self.work;
        let Scratch { workspace, packed, results } = self.scratch;
        for (pack, out) in self.out.chunks_mut(T::LANES * size).enumerate() {
            let first = self.first + pack * T::LANES;
            let states = out.len() / size;
            for (input, packed) in inputs.iter().zip(packed.iter_mut()) {
                for lane in 0..T::LANES {
                    // Checked before: every input has numbers for every state.
                    let row = input.at(first + lane.min(states - 1)).unwrap_or_default();
                    T::pack(row, lane, packed);
                }
            }
            if let Err(error) = kernel.run(workspace, packed, results) {
                return Some(self.work.first_failure(first, states).unwrap_or((first, error)));
            }
            if !all_finite(results) {
                let error = DynamicsError::NotFinite { index: 0, found: f64::NAN };
                return Some(self.work.first_failure(first, states).unwrap_or((first, error)));
            }
            for (lane, row) in out.chunks_exact_mut(size).enumerate() {
                T::unpack(results, lane, row);
            }
        }
        None
    }
}

impl<K: StateKernel> Work<'_, K> {
    /// The first state of a pack that fails by itself, and how.
    #[cold]
    #[inline(never)]
    fn first_failure(&self, first: usize, states: usize) -> Failed {
        let mut workspace = self.kernel.workspace::<Fused>();
        let mut results = vec![Fused(0.0); self.size];
        (first..first + states).find_map(|state| {
            let numbers = |i: &Input<'_>| i.at(state).unwrap_or_default().iter().map(|&x| Fused(x)).collect();
            let inputs: Vec<Vec<Fused>> = self.inputs.iter().map(numbers).collect();
            let error = match self.kernel.run(&mut workspace, &inputs, &mut results) {
                Err(error) => Some(error),
                Ok(()) => results
                    .iter()
                    .enumerate()
                    .find(|(_, x)| !x.0.is_finite())
                    .map(|(index, x)| DynamicsError::NotFinite { index, found: x.0 }),
            };
            error.map(|error| (state, error))
        })
    }
}

/// True if all lanes of all numbers are finite.
#[inline(always)]
fn all_finite<T: Lanes>(x: &[T]) -> bool {
    // 0 · x is zero or not a number; several sums, so that none waits for the one before.
    let mut sums = [T::zero(); 4];
    let groups = x.chunks_exact(4);
    for &x in groups.remainder() {
        sums[0] = x.fma(T::zero(), sums[0]);
    }
    for group in groups {
        for i in 0..4 {
            sums[i] = group[i].fma(T::zero(), sums[i]);
        }
    }
    let sum = [(sums[0] + sums[1]) + (sums[2] + sums[3])];
    T::numbers(&sum).iter().all(|x| *x == 0.0)
}
