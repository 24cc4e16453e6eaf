//! Results as pickles: the values of their fields by name.

use pyo3::prelude::*;
use pyo3::types::PyDict;

/// What `__reduce__` returns: a function and its arguments.
pub type Reduced<'py> = (Bound<'py, PyAny>, (Bound<'py, PyDict>,));

/// The static method `_restore` of an object's class, and the fields that it needs.
///
/// # Errors
/// Those of the fields.
pub fn reduced<'py>(object: &Bound<'py, PyAny>, fields: &[&str]) -> PyResult<Reduced<'py>> {
    let state = PyDict::new(object.py());
    for name in fields {
        state.set_item(name, object.getattr(*name)?)?;
    }
    Ok((object.get_type().getattr("_restore")?, (state,)))
}

/// A field.
///
/// # Errors
/// `KeyError` where it is missing, `TypeError` where it is of another type.
pub fn item<'py, T: FromPyObjectOwned<'py>>(state: &Bound<'py, PyDict>, name: &str) -> PyResult<T> {
    let Some(value) = state.get_item(name)? else {
        return Err(pyo3::exceptions::PyKeyError::new_err(name.to_string()));
    };
    value.extract().map_err(Into::into)
}
