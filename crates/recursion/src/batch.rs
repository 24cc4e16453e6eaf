//! Many states of one model: several at once in the lanes of SIMD registers, blocks of them over threads.
//!
//! A [`StateKernel`] is a calculation on one state that is generic over the scalar. States go through it in packs as wide as
//! the processor allows ([`phipsi_spatial::lanes`]); the last pack is filled up with its last state. Lanes do not see each
//! other and do the operations of the plain number, so that a state's result depends neither on its place, nor on the size
//! of the batch, nor on the number of threads, nor on the processor.

pub mod kernels;

use crate::error::DynamicsError;
use core::any::Any;
use phipsi_spatial::Kernel;
use phipsi_spatial::lanes::{Fused, Lanes, Level, Visitor, at_level};
use std::sync::{Mutex, PoisonError};

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
    type Workspace<T: Lanes>: Send + 'static;
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
    /// True if a state by itself has lanes for the columns of its result of `size` numbers: then states go one by one where lanes of them
    /// would not stay in the caches.
    fn has_columns(&self, _size: usize) -> bool {
        false
    }
}

/// A kernel lent.
impl<K: StateKernel> StateKernel for &K {
    type Workspace<T: Lanes> = K::Workspace<T>;
    fn workspace<T: Lanes>(&self) -> Self::Workspace<T> {
        (**self).workspace()
    }
    #[inline(always)]
    fn run<T: Lanes>(
        &self,
        workspace: &mut Self::Workspace<T>,
        inputs: &[Vec<T>],
        out: &mut [T],
    ) -> Result<(), DynamicsError> {
        (**self).run(workspace, inputs, out)
    }
    fn has_columns(&self, size: usize) -> bool {
        (**self).has_columns(size)
    }
}

/// Numbers of an argument, state after state.
#[derive(Clone, Copy, Debug)]
pub struct Input<'a> {
    data: &'a [f64],
    size: usize,
    /// Which of its states belongs to each state of the batch; empty: the same number, or always the first.
    map: &'a [usize],
    same: bool,
    checked: bool,
}

impl<'a> Input<'a> {
    /// `size` numbers for each state of the batch.
    pub fn each(data: &'a [f64], size: usize) -> Self {
        Input { data, size, map: &[], same: false, checked: false }
    }
    /// The same numbers for all states.
    pub fn same(data: &'a [f64]) -> Self {
        Input { data, size: data.len(), map: &[], same: true, checked: false }
    }
    /// For state i of the batch the numbers of state `map[i]`.
    pub fn mapped(data: &'a [f64], size: usize, map: &'a [usize]) -> Self {
        Input { data, size, map, same: false, checked: false }
    }
    /// The same numbers, of which one that is not finite is an error, also if no result depends on it. They are looked at where they are
    /// packed.
    pub fn checked(self) -> Self {
        Input { checked: true, ..self }
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
    /// Its numbers for as many states as there are rows, from `first` on; the last of `states` again for those beyond.
    #[inline(always)]
    fn rows(&self, first: usize, states: usize, rows: &mut [&'a [f64]]) {
        let last = states.saturating_sub(1);
        if self.map.is_empty() && !self.same {
            let all = self.data.get(first * self.size..(first + states) * self.size).unwrap_or_default();
            for (lane, row) in rows.iter_mut().enumerate() {
                let at = lane.min(last) * self.size;
                *row = all.get(at..at + self.size).unwrap_or_default();
            }
            return;
        }
        for (lane, row) in rows.iter_mut().enumerate() {
            *row = self.at(first + lane.min(last)).unwrap_or_default();
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

/// Runs a kernel on `count` states once; a [`BatchRunner`] does it again and again. Arguments, cost and errors as
/// [`BatchRunner::run`].
///
/// # Errors
/// As there.
pub fn run_batch<K: StateKernel>(
    kernel: &K,
    level: Level,
    inputs: &[Input<'_>],
    count: usize,
    out: &mut [f64],
) -> Result<(), (usize, DynamicsError)> {
    BatchRunner::new(kernel, level).run(inputs, count, out)
}

/// A kernel with workspaces that it keeps from batch to batch.
///
/// # Example
/// ```
/// use phipsi_model::{Body, Inertia, Joint, JointKind, ModelBuilder};
/// use phipsi_recursion::Layout;
/// use phipsi_recursion::batch::{BatchRunner, Input, kernels};
/// use phipsi_spatial::lanes::Level;
///
/// let rod = Inertia::from_principal(1.0, [0.5, 0.0, 0.0], [0.0, 1.0 / 12.0, 1.0 / 12.0]);
/// let model = ModelBuilder::new("pendulum")
///     .body(Body::new("rod", rod))
///     .joint(Joint::new("hinge", JointKind::Revolute { axis: [0.0, 1.0, 0.0] }), "world", "rod")
///     .build()?;
/// let layout = Layout::new(&model);
/// let runner = BatchRunner::new(kernels::MassMatrix { layout: &layout }, Level::best());
/// let (q, mut out) = ([0.0, 0.1, 0.2], [0.0; 3]);
/// for _ in 0..2 {
///     runner.run(&[Input::each(&q, 1)], 3, &mut out).map_err(|e| e.1)?;
/// }
/// assert!((out[2] - 1.0 / 3.0).abs() < 1e-15);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct BatchRunner<K> {
    kernel: K,
    level: Level,
    /// Scratches that no thread works with now.
    idle: Mutex<Vec<Box<dyn Any + Send>>>,
}

impl<K: StateKernel> BatchRunner<K> {
    /// For the lanes of a level, or for one state at a time if this processor does not have it.
    pub fn new(kernel: K, level: Level) -> Self {
        let level = if level.is_available() { level } else { Level::Scalar };
        BatchRunner { kernel, level, idle: Mutex::new(Vec::new()) }
    }
    /// Runs the kernel on `count` states. `out`: the results, state after state, of equal size.
    ///
    /// # Cost
    /// Threads (feature `parallel`) take blocks of states. Allocates a workspace for each run of blocks on a thread the
    /// first time; later batches take those.
    ///
    /// # Errors
    /// The first state that fails, and how; [`DynamicsError::NotFinite`] if a number of its result is not finite,
    /// [`DynamicsError::InputNotFinite`] if one of an input is not that is to be checked.
    /// [`DynamicsError::Shape`] if an input has fewer states than `count`, or `out` no whole number of entries a state.
    pub fn run(
        &self,
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
        // Narrow batches need no wide registers, nor do states whose columns fill them.
        let narrow = count == 1 || (size * WIDEST >= LARGE && self.kernel.has_columns(size));
        let level = if narrow { Level::Scalar } else { self.level };
        let work = Work { kernel: &self.kernel, inputs, count, size };
        match at_level(level, Blocks { work, idle: &self.idle, out }).flatten() {
            Some(failed) => Err(failed),
            None => Ok(()),
        }
    }
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

/// Numbers of results from which states with columns go one by one: a pack of eight has 1 MiB then, and derivatives of a chain of 128 bodies take
/// 176 µs a state instead of 224, of 256 bodies 0.93 ms instead of 1.46 (Sapphire Rapids with 2 MiB of second cache). Also of narrower packs, so
/// that the way depends on the model alone.
const LARGE: usize = 128 * 1024;

/// Lanes of the widest level.
const WIDEST: usize = 8;

struct Blocks<'a, K> {
    work: Work<'a, K>,
    idle: &'a Mutex<Vec<Box<dyn Any + Send>>>,
    out: &'a mut [f64],
}

impl<K: StateKernel> Visitor for Blocks<'_, K> {
    type Output = Failed;
    fn visit<T: Lanes>(self) -> Failed {
        let Work { count, size, .. } = self.work;
        let packs = (BLOCK / (T::LANES * size)).clamp(1, 32);
        let states = packs * T::LANES;
        let work = self.work;
        let scratch = || Taken::<T, K>::take(self.idle, work);
        let block = |taken: &mut Taken<'_, T, K>, (index, out): (usize, &mut [f64])| {
            let scratch = taken.scratch.as_mut()?;
            T::dispatch(Block { work, first: index * states, out, scratch })
        };
        #[cfg(feature = "parallel")]
        if count > states && crate::branching::several_threads() {
            use rayon::prelude::*;
            let chunks = self.out.par_chunks_mut(states * size).enumerate();
            return chunks.map_init(scratch, block).filter_map(|failed| failed).min_by_key(|failed| failed.0);
        }
        let (mut scratch, _) = (scratch(), count);
        self.out.chunks_mut(states * size).enumerate().find_map(|chunk| block(&mut scratch, chunk))
    }
}

/// What one thread works with.
struct Scratch<T, W> {
    workspace: W,
    /// The inputs of a pack.
    packed: Vec<Vec<T>>,
    results: Vec<T>,
}

/// A scratch taken from those that are idle, and given back in the end.
struct Taken<'a, T: Lanes, K: StateKernel> {
    idle: &'a Mutex<Vec<Box<dyn Any + Send>>>,
    scratch: Option<Box<Scratch<T, K::Workspace<T>>>>,
}

impl<'a, T: Lanes, K: StateKernel> Taken<'a, T, K> {
    fn take(idle: &'a Mutex<Vec<Box<dyn Any + Send>>>, work: Work<'_, K>) -> Self {
        let found = {
            let mut all = idle.lock().unwrap_or_else(PoisonError::into_inner);
            // Batches of one state have others than wide ones.
            let at = all.iter().position(|scratch| scratch.is::<Scratch<T, K::Workspace<T>>>());
            at.map(|at| all.swap_remove(at)).and_then(|scratch| scratch.downcast().ok())
        };
        let mut scratch: Box<Scratch<T, K::Workspace<T>>> = found.unwrap_or_else(|| {
            Box::new(Scratch { workspace: work.kernel.workspace(), packed: Vec::new(), results: Vec::new() })
        });
        scratch.packed.resize(work.inputs.len(), Vec::new());
        for (packed, input) in scratch.packed.iter_mut().zip(work.inputs) {
            packed.resize(input.size, T::zero());
        }
        scratch.results.resize(work.size, T::zero());
        Taken { idle, scratch: Some(scratch) }
    }
}

impl<T: Lanes, K: StateKernel> Drop for Taken<'_, T, K> {
    fn drop(&mut self) {
        if let Some(scratch) = self.scratch.take() {
            self.idle.lock().unwrap_or_else(PoisonError::into_inner).push(scratch);
        }
    }
}

struct Block<'a, T: Lanes, K: StateKernel> {
    work: Work<'a, K>,
    first: usize,
    out: &'a mut [f64],
    scratch: &'a mut Scratch<T, K::Workspace<T>>,
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
            let mut finite = true;
            for (input, packed) in inputs.iter().zip(packed.iter_mut()) {
                // Checked before: every input has numbers for every state.
                let mut rows: [&[f64]; WIDEST] = [&[]; WIDEST];
                input.rows(first, states, &mut rows[..T::LANES]);
                T::pack(&rows[..T::LANES], packed);
                finite &= !input.checked || all_finite(packed);
            }
            if !finite {
                let error = DynamicsError::InputNotFinite { input: 0, index: 0, found: f64::NAN };
                return Some(self.work.first_failure(first, states).unwrap_or((first, error)));
            }
            if let Err(error) = kernel.run(workspace, packed, results) {
                return Some(self.work.first_failure(first, states).unwrap_or((first, error)));
            }
            if !all_finite(results) {
                let error = DynamicsError::NotFinite { index: 0, found: f64::NAN };
                return Some(self.work.first_failure(first, states).unwrap_or((first, error)));
            }
            T::unpack(results, out);
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
            if let Some(error) = self.not_finite(state) {
                return Some((state, error));
            }
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

impl<K> Work<'_, K> {
    /// The first number of a state that is not finite, among those that are to be checked.
    fn not_finite(&self, state: usize) -> Option<DynamicsError> {
        let checked = self.inputs.iter().enumerate().filter(|(_, input)| input.checked);
        checked.into_iter().find_map(|(input, numbers)| {
            let numbers = numbers.at(state).unwrap_or_default();
            let index = numbers.iter().position(|x| !x.is_finite())?;
            Some(DynamicsError::InputNotFinite { input, index, found: numbers[index] })
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
