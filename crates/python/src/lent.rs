//! Large arrays that a batch reads where they are: a copy costs as much as the dynamics of an arm.
//!
//! The interpreter is released meanwhile. Each number is read once, into the lanes that compute with it: what another thread of Python does to
//! an array during the call is seen in some states or in none, as by NumPy's own functions. A number that is not finite is
//! found where it is read, and told as if all arguments had been looked at first.

use crate::batch::{Argument, Batch, all_finite, copied};
use crate::buffer::LARGE;
use crate::compiled::Compiled;
use crate::errors::Failure;
use numpy::{PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use phipsi::recursion::batch::{Input, StateKernel};
use pyo3::prelude::*;

/// How the numbers of an argument are called in errors.
pub type Place = fn(&Compiled, usize) -> String;

/// An argument whose numbers may lie in an array of NumPy's.
pub struct Lent<'py> {
    /// Its shape and, if it is small or no array of f64, its numbers.
    pub argument: Argument,
    array: Option<PyReadonlyArrayDyn<'py, f64>>,
    place: Place,
}

impl<'py> Lent<'py> {
    /// As [`Argument::read`]; numbers of a large array are not looked at.
    ///
    /// # Errors
    /// As there.
    pub fn read(
        object: &Bound<'py, PyAny>,
        name: &'static str,
        core: &[usize],
        meaning: &str,
        (compiled, place): (&Compiled, Place),
    ) -> PyResult<Self> {
        if let Ok(array) = object.cast::<PyArrayDyn<f64>>()
            && array.len() >= LARGE
            && array.is_c_contiguous()
            && let Ok(view) = array.try_readonly()
            && view.as_slice().is_ok()
        {
            let argument =
                Argument::without_numbers(object.py(), name, array.shape().to_vec(), core, meaning)?;
            return Ok(Lent { argument, array: Some(view), place });
        }
        let argument = Argument::read(object, name, core, meaning, &|i| place(compiled, i))?;
        Ok(Lent { argument, array: None, place })
    }
    fn numbers(&self) -> &[f64] {
        match &self.array {
            Some(array) => array.as_slice().unwrap_or_default(),
            None => self.argument.numbers(),
        }
    }
    /// As an input of a batch.
    pub fn input(&self) -> Input<'_> {
        let input = self.argument.input_of(self.numbers());
        if self.array.is_some() { input.checked() } else { input }
    }
    /// States of the argument itself, before broadcasting.
    pub fn own_states(&self) -> impl Iterator<Item = (usize, &[f64])> {
        self.argument.states_of(self.numbers())
    }
    /// Looks at all numbers.
    ///
    /// # Errors
    /// `NumericalError` for the first that is not finite.
    pub fn check(&self, py: Python<'_>, compiled: &Compiled) -> PyResult<()> {
        let numbers = self.numbers();
        if self.array.is_none() || all_finite(numbers) {
            return Ok(());
        }
        self.argument.refuse_not_finite(py, numbers, &|i| (self.place)(compiled, i))
    }
    /// With its numbers copied and looked at, for what is no batch of a kernel.
    ///
    /// # Errors
    /// As [`Lent::check`].
    pub fn settled(self, py: Python<'_>, compiled: &Compiled) -> PyResult<Argument> {
        let Some(array) = &self.array else { return Ok(self.argument) };
        let (copy, finite) = copied(array.as_slice().unwrap_or_default());
        if !finite {
            self.argument.refuse_not_finite(py, &copy, &|i| (self.place)(compiled, i))?;
        }
        Ok(self.argument.with_numbers(copy))
    }
}

impl Batch {
    /// [`Batch::run`] on arguments that may be lent, and others.
    ///
    /// # Errors
    /// `NumericalError` for an argument that is not finite; inside, the failure of the first state that fails.
    pub fn run_lent<K: StateKernel>(
        &self,
        py: Python<'_>,
        compiled: &Compiled,
        kernel: &K,
        (lent, others): (&[&Lent<'_>], &[Argument]),
        size: usize,
    ) -> PyResult<Result<Vec<f64>, (usize, Failure)>> {
        let inputs: Vec<Input<'_>> =
            lent.iter().map(|x| x.input()).chain(others.iter().map(Argument::input)).collect();
        let out = self.run(py, kernel, &inputs, size);
        if out.is_err() {
            // What is not finite comes before all that it leads to.
            lent.iter().try_for_each(|x| x.check(py, compiled))?;
        }
        Ok(out)
    }
}
