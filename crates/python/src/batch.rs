//! Arrays of Python as states: conversion, shapes, leading batch axes, and the run over states.
//!
//! Inputs are copied, so that nothing that Python does to an array meanwhile is seen, but for large ones of recursions
//! (`lent.rs`), and the interpreter is released. A
//! state's result depends neither on its place in the batch nor on the number of threads: recursions go through
//! [`phipsi::recursion::batch`], also one state by itself; what branches on values is computed state by state. Of several
//! failures the first one is reported.

use crate::buffer::Buffer;
use crate::errors::{Failure, Field, argument_error, exception};
use numpy::{PyArray1, PyArrayDyn, PyArrayMethods, PyUntypedArrayMethods};
use phipsi::recursion::batch::{Input, StateKernel, run_batch};
use phipsi::spatial::lanes::Level;
use pyo3::IntoPyObjectExt;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rayon::prelude::*;
use std::borrow::Cow;

/// Work that one task of a thread takes, in numbers of states × degrees of freedom.
const GRAIN: usize = 1024;

/// Numbers of a result that are copied into an array of NumPy's own, and of an argument that are copied without a lock.
const SMALL: usize = 512;

/// Numbers of a result, 2 MiB, that several threads are worth to clear (an estimate).
const MANY: usize = 256 * 1024;

/// Real numbers of an argument: batch axes, then the axes of one state.
pub struct Argument {
    /// The argument's name.
    pub name: Cow<'static, str>,
    data: Buffer,
    batch: Vec<usize>,
    size: usize,
    /// Which of its states belongs to each state of the batch; `None`: the same one, or its only one.
    map: Option<Vec<usize>>,
}

/// How a number of an argument is called in an error: by its index in one state.
pub type Describe<'a> = &'a dyn Fn(usize) -> String;

impl Argument {
    /// Reads an argument whose last axes are `core`; `meaning` says what they hold.
    ///
    /// # Errors
    /// `ArgumentTypeError`, `ArgumentError` and, for numbers that are not finite, `NumericalError`.
    pub fn read(
        object: &Bound<'_, PyAny>,
        name: impl Into<Cow<'static, str>>,
        core: &[usize],
        meaning: &str,
        describe: Describe<'_>,
    ) -> PyResult<Self> {
        let (py, name) = (object.py(), name.into());
        let (data, finite, shape) = numbers(object, &name)?;
        let argument = Self::without_numbers(py, name, shape, core, meaning)?;
        if !finite {
            argument.refuse_not_finite(py, &data, describe)?;
        }
        Ok(argument.with_numbers(data))
    }
    /// An argument of a shape, whose numbers come later.
    ///
    /// # Errors
    /// `ArgumentError`.
    pub fn without_numbers(
        py: Python<'_>,
        name: impl Into<Cow<'static, str>>,
        shape: Vec<usize>,
        core: &[usize],
        meaning: &str,
    ) -> PyResult<Self> {
        let name = name.into();
        if shape.len() < core.len() || shape[shape.len() - core.len()..] != *core {
            let required = required_shape(core);
            let message =
                format!("`{name}` has shape {}, but {required} is required: {meaning}", show(&shape));
            return Err(argument_error(py, &name, Field::Tuple(shape), required.into(), &message, None));
        }
        let (batch, size) = (shape[..shape.len() - core.len()].to_vec(), core.iter().product());
        Ok(Argument { name, data: Buffer::of(0), batch, size, map: None })
    }
    /// The same with its numbers.
    pub fn with_numbers(self, data: Buffer) -> Self {
        Argument { data, ..self }
    }
    /// Its numbers.
    pub fn numbers(&self) -> &[f64] {
        &self.data
    }
    /// Refuses the first of its numbers that is not finite.
    ///
    /// # Errors
    /// `NumericalError`.
    pub fn refuse_not_finite(&self, py: Python<'_>, data: &[f64], describe: Describe<'_>) -> PyResult<()> {
        let Some(i) = data.iter().position(|x| !x.is_finite()) else { return Ok(()) };
        let (state, at) = (unravel(i / self.size, &self.batch), describe(i % self.size));
        let quantity = format!("`{}`", self.name);
        Err(not_finite(py, &quantity, Some(&at), data[i], state, "pass finite numbers"))
    }
    /// The numbers of one state of the batch.
    #[inline]
    pub fn at(&self, state: usize) -> &[f64] {
        let own = match &self.map {
            Some(map) => map[state],
            None if self.batch.is_empty() => 0,
            None => state,
        };
        &self.data[own * self.size..(own + 1) * self.size]
    }
    /// Its numbers as an input of a batch.
    pub fn input(&self) -> Input<'_> {
        self.input_of(&self.data)
    }
    /// Its numbers, kept elsewhere, as an input of a batch.
    pub fn input_of<'a>(&'a self, data: &'a [f64]) -> Input<'a> {
        match &self.map {
            Some(map) => Input::mapped(data, self.size, map),
            None if self.batch.is_empty() => Input::same(data),
            None => Input::each(data, self.size),
        }
    }
    /// States of the argument itself, before broadcasting.
    pub fn own_states(&self) -> impl Iterator<Item = (usize, &[f64])> {
        self.states_of(&self.data)
    }
    /// The same of its numbers, kept elsewhere.
    pub fn states_of<'a>(&self, data: &'a [f64]) -> impl Iterator<Item = (usize, &'a [f64])> + use<'a> {
        let (count, size) = (self.batch.iter().product(), self.size);
        (0..count).map(move |i| (i, &data[i * size..(i + 1) * size]))
    }
    /// True without batch axes.
    pub fn is_single(&self) -> bool {
        self.batch.is_empty()
    }
    /// Its shape as given, the axes of one state as one.
    pub fn shape(&self) -> Vec<usize> {
        [&self.batch[..], &[self.size]].concat()
    }
    /// Place in the argument's own batch axes.
    pub fn place(&self, own: usize) -> Option<Vec<usize>> {
        unravel(own, &self.batch)
    }
}

/// The batch axes that the arguments have together.
pub struct Batch {
    shape: Vec<usize>,
    count: usize,
}

impl Batch {
    /// Broadcasts the batch axes of arguments, as NumPy does.
    ///
    /// # Errors
    /// `ArgumentError` with both arguments and shapes.
    pub fn of<'a>(py: Python<'_>, arguments: impl IntoIterator<Item = &'a mut Argument>) -> PyResult<Self> {
        let mut arguments: Vec<&mut Argument> = arguments.into_iter().collect();
        if arguments.iter().all(|argument| argument.is_single()) {
            return Ok(Batch { shape: Vec::new(), count: 1 });
        }
        let rank = arguments.iter().map(|a| a.batch.len()).max().unwrap_or(0);
        let mut shape = vec![1; rank];
        // The argument that gave each axis its size.
        let mut owner = vec![0; rank];
        for (k, argument) in arguments.iter().enumerate() {
            for (i, &n) in argument.batch.iter().rev().enumerate() {
                let axis = rank - 1 - i;
                if n != 1 && shape[axis] != 1 && shape[axis] != n {
                    return Err(mismatch(py, arguments[owner[axis]], argument));
                }
                if n != 1 && shape[axis] == 1 {
                    (shape[axis], owner[axis]) = (n, k);
                }
            }
        }
        let count = shape.iter().product();
        for argument in &mut arguments {
            if argument.batch != shape && !argument.batch.is_empty() {
                argument.map = Some(broadcast(&argument.batch, &shape, count));
            }
        }
        Ok(Batch { shape, count })
    }
    /// Number of states.
    pub fn len(&self) -> usize {
        self.count
    }
    /// Place of a state in the batch; `None` without batch axes.
    pub fn place(&self, state: usize) -> Option<Vec<usize>> {
        unravel(state, &self.shape)
    }
    /// Runs a kernel on every state, `size` numbers of result each, with the interpreter released.
    ///
    /// # Errors
    /// The failure of the first state that fails.
    pub fn run<K: StateKernel>(
        &self,
        py: Python<'_>,
        kernel: &K,
        inputs: &[Input<'_>],
        size: usize,
    ) -> Result<Vec<f64>, (usize, Failure)> {
        let run = || {
            let mut out = zeros(self.count * size);
            run_batch(kernel, Level::best(), inputs, self.count, &mut out).map(|()| out)
        };
        py.detach(run).map_err(|(state, e)| (state, e.into()))
    }
    /// Runs `body(workspace, state, out)` for every state, `size` numbers each, with the interpreter released.
    ///
    /// # Errors
    /// The failure of the first state that fails.
    pub fn each<W>(
        &self,
        py: Python<'_>,
        size: usize,
        workspace: impl Fn() -> W + Sync + Send,
        body: impl Fn(&mut W, usize, &mut [f64]) -> Result<(), Failure> + Sync + Send,
    ) -> Result<Vec<f64>, (usize, Failure)> {
        self.each_of(py, (GRAIN / (size + 1)).clamp(1, 64), size, workspace, body)
    }
    /// The same, with `grain` states to a task of a thread.
    ///
    /// # Errors
    /// The failure of the first state that fails.
    pub fn each_of<W>(
        &self,
        py: Python<'_>,
        grain: usize,
        size: usize,
        workspace: impl Fn() -> W + Sync + Send,
        body: impl Fn(&mut W, usize, &mut [f64]) -> Result<(), Failure> + Sync + Send,
    ) -> Result<Vec<f64>, (usize, Failure)> {
        let mut out = vec![0.0; self.count * size];
        let count = self.count;
        let one = |w: &mut W, state: usize, out: &mut [f64]| -> Result<(), (usize, Failure)> {
            body(w, state, out).map_err(|e| (state, e))?;
            match out.iter().position(|x| !x.is_finite()) {
                Some(i) => Err((state, Failure::NotFinite(i, out[i]))),
                None => Ok(()),
            }
        };
        let result = py.detach(|| {
            if count <= grain || size == 0 {
                let mut w = workspace();
                return (0..count).try_for_each(|i| one(&mut w, i, &mut out[i * size..(i + 1) * size]));
            }
            let failures = out.par_chunks_mut(grain * size).enumerate().filter_map(|(task, chunk)| {
                let mut w = workspace();
                let mut states = chunk.chunks_mut(size).enumerate();
                states.find_map(|(i, out)| one(&mut w, task * grain + i, out).err())
            });
            failures.min_by_key(|e| e.0).map_or(Ok(()), Err)
        });
        result.map(|()| out)
    }
    /// Numbers as a NumPy array of the batch axes and `core`; a Python float if there are no axes at all.
    ///
    /// # Errors
    /// Those of NumPy.
    pub fn array<'py>(&self, py: Python<'py>, data: Vec<f64>, core: &[usize]) -> PyResult<Bound<'py, PyAny>> {
        let shape = [&self.shape, core].concat();
        if shape.is_empty() {
            return data[0].into_bound_py_any(py);
        }
        Ok(array(py, data, shape)?.into_any())
    }
}

/// Numbers as a NumPy array.
///
/// # Errors
/// Those of NumPy.
pub fn array<'py>(
    py: Python<'py>,
    data: Vec<f64>,
    shape: Vec<usize>,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    // A few numbers are copied in less time than NumPy takes to adopt a vector.
    let flat =
        if data.len() <= SMALL { PyArray1::from_slice(py, &data) } else { PyArray1::from_vec(py, data) };
    if shape.len() == 1 { Ok(flat.to_dyn().clone()) } else { flat.reshape(shape) }
}

/// As many zeros; of many, each thread writes some.
fn zeros(count: usize) -> Vec<f64> {
    if count < MANY {
        return vec![0.0; count];
    }
    let mut zeros = Vec::new();
    rayon::iter::repeat_n(0.0, count).collect_into_vec(&mut zeros);
    zeros
}

/// A copy, and true if all numbers are finite: each piece is looked at while it is in the cache.
pub fn copied(x: &[f64]) -> (Buffer, bool) {
    let (mut copy, mut finite) = (Buffer::of(x.len()), true);
    for piece in x.chunks(1024) {
        copy.extend(piece);
        finite &= all_finite(piece);
    }
    (copy, finite)
}

/// True if all numbers are finite; looks at many at a time.
pub fn all_finite(x: &[f64]) -> bool {
    // 0 · x is zero or not a number.
    let mut sums = [0.0; 8];
    let groups = x.chunks_exact(8);
    let rest = groups.remainder().iter().all(|x| x.is_finite());
    for group in groups {
        (0..8).for_each(|i| sums[i] += 0.0 * group[i]);
    }
    rest && sums.iter().all(|sum| *sum == 0.0)
}

/// A copy of the numbers of an array-like, whether all are finite, and its shape.
fn numbers(object: &Bound<'_, PyAny>, name: &str) -> PyResult<(Buffer, bool, Vec<usize>)> {
    let py = object.py();
    // A slice alone also takes Fortran order, in memory order.
    if let Ok(array) = object.cast::<PyArrayDyn<f64>>()
        && array.is_c_contiguous()
    {
        if array.len() <= SMALL
            && let Ok(data) = array.to_vec()
        {
            let finite = all_finite(&data);
            return Ok((data.into(), finite, array.shape().to_vec()));
        }
        if let Ok(view) = array.try_readonly()
            && let Ok(data) = view.as_slice()
        {
            let (data, finite) = copied(data);
            return Ok((data, finite, array.shape().to_vec()));
        }
    }
    let type_error = |found: String, cause: Option<PyErr>| {
        let message = format!("`{name}` holds {found}, but real numbers are required");
        let remedy = "pass floats or integers: a list, a tuple or a NumPy array";
        let fields = vec![
            ("argument", Some(name.into())),
            ("found", Some(found.into())),
            ("required", Some("real numbers".into())),
            ("remedy", Some(remedy.into())),
        ];
        let error = exception(py, "ArgumentTypeError", &format!("{message}; {remedy}"), fields);
        error.set_cause(py, cause);
        error
    };
    let numpy = py.import("numpy")?;
    let any = match numpy.call_method1("asarray", (object,)) {
        Ok(any) => any,
        Err(cause) => return Err(type_error("no regular array".into(), Some(cause))),
    };
    let dtype = any.getattr("dtype")?;
    let kind: String = dtype.getattr("kind")?.extract()?;
    if !["f", "i", "u"].contains(&kind.as_str()) {
        return Err(type_error(format!("elements of type {}", dtype.str()?), None));
    }
    let keywords = PyDict::new(py);
    keywords.set_item("dtype", "float64")?;
    keywords.set_item("order", "C")?;
    let converted = numpy.call_method("asarray", (any,), Some(&keywords))?;
    let converted = converted.cast::<PyArrayDyn<f64>>()?;
    let (data, finite) = copied(converted.try_readonly()?.as_slice()?);
    Ok((data, finite, converted.shape().to_vec()))
}

/// `NumericalError` of a number that is not finite.
pub fn not_finite(
    py: Python<'_>,
    quantity: &str,
    at: Option<&str>,
    found: f64,
    state: Option<Vec<usize>>,
    remedy: &str,
) -> PyErr {
    numerical(py, quantity, at, found, "a finite number", state, remedy)
}

/// `NumericalError` of a number of a joint that must be positive.
pub fn unfit(
    py: Python<'_>,
    quantity: &str,
    at: &str,
    found: f64,
    state: Option<Vec<usize>>,
    remedy: &str,
) -> PyErr {
    numerical(py, quantity, Some(at), found, "a positive number", state, remedy)
}

fn numerical(
    py: Python<'_>,
    quantity: &str,
    at: Option<&str>,
    found: f64,
    required: &str,
    state: Option<Vec<usize>>,
    remedy: &str,
) -> PyErr {
    let place = state.as_ref().map(|s| format!("state {s:?}: ")).unwrap_or_default();
    let of = at.map(|a| format!(" of {a}")).unwrap_or_default();
    let (joint, component) = at.map_or((None, None), split_place);
    let fields = vec![
        ("quantity", Some(quantity.trim_matches('`').into())),
        ("joint", joint.map(Field::Text)),
        ("component", component.map(Field::Index)),
        ("found", Some(Field::Number(found))),
        ("required", Some(required.into())),
        ("remedy", Some(remedy.into())),
        ("state", state.map(Field::Tuple)),
    ];
    let message = format!("{place}{quantity}{of} is {found}, but {required} is required; {remedy}");
    exception(py, "NumericalError", &message, fields)
}

/// Joint and component of a place like "joint `elbow`, component 0".
fn split_place(place: &str) -> (Option<String>, Option<usize>) {
    let Some(rest) = place.strip_prefix("joint `") else { return (None, None) };
    match rest.rsplit_once("`, component ") {
        Some((joint, component)) => (Some(joint.into()), component.parse().ok()),
        None => (None, None),
    }
}

/// A shape as NumPy prints it.
pub fn show(shape: &[usize]) -> String {
    match shape {
        [n] => format!("({n},)"),
        _ => format!("({})", shape.iter().map(usize::to_string).collect::<Vec<_>>().join(", ")),
    }
}

fn required_shape(core: &[usize]) -> String {
    let axes: Vec<String> = std::iter::once("…".into()).chain(core.iter().map(usize::to_string)).collect();
    format!("({})", axes.join(", "))
}

fn mismatch(py: Python<'_>, first: &Argument, second: &Argument) -> PyErr {
    let message = format!(
        "`{}` has batch axes {} and `{}` has batch axes {}: they must be equal, 1 or absent",
        first.name,
        show(&first.batch),
        second.name,
        show(&second.batch)
    );
    let (found, required) = (Field::Tuple(second.batch.clone()), Field::Tuple(first.batch.clone()));
    argument_error(py, &second.name, found, required, &message, None)
}

/// For every state of `shape`, the state of `batch` that it reads.
fn broadcast(batch: &[usize], shape: &[usize], count: usize) -> Vec<usize> {
    (0..count)
        .map(|state| {
            let (mut rest, mut own, mut stride) = (state, 0, 1);
            for (i, &n) in shape.iter().rev().enumerate() {
                let index = rest % n;
                rest /= n;
                if let Some(axis) = batch.len().checked_sub(1 + i) {
                    own += stride * if batch[axis] == 1 { 0 } else { index };
                    stride *= batch[axis];
                }
            }
            own
        })
        .collect()
}

fn unravel(state: usize, shape: &[usize]) -> Option<Vec<usize>> {
    if shape.is_empty() {
        return None;
    }
    let (mut rest, mut place) = (state, vec![0; shape.len()]);
    for (axis, &n) in shape.iter().enumerate().rev() {
        place[axis] = rest % n.max(1);
        rest /= n.max(1);
    }
    Some(place)
}
