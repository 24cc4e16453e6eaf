//! Methods of `Model` about active and passive degrees of freedom.

use crate::batch::{Argument, Batch};
use crate::compiled::{Compiled, Names};
use crate::errors::argument_error;
use crate::model::Model;
use phipsi::recursion::batch::{Input, kernels};
use pyo3::prelude::*;

impl Compiled {
    /// Reads which degrees of freedom are active: (nv,) of bool.
    ///
    /// # Errors
    /// `ArgumentError` for another length or other values.
    pub fn active(&self, object: &Bound<'_, PyAny>) -> PyResult<Vec<bool>> {
        let (py, nv) = (object.py(), self.model.nv());
        let required = format!("({nv},) of bool");
        let refuse = |found: String| {
            let message = format!(
                "`active` is {found}, but {required} is required: one truth value per degree of freedom"
            );
            argument_error(py, "active", found.into(), required.clone().into(), &message, None)
        };
        let active: Vec<bool> = object.extract().map_err(|_| refuse(object.get_type().to_string()))?;
        if active.len() == nv { Ok(active) } else { Err(refuse(format!("of length {}", active.len()))) }
    }
}

#[pymethods]
impl Model {
    /// Hybrid dynamics: forces of the active degrees of freedom, whose accelerations are given, and accelerations of the passive
    /// ones, whose forces are given, in one filter and smoother. Models with closures move with their loops closed; where the
    /// given accelerations contradict them, the closures are what is violated.
    ///
    /// Parameters
    /// ----------
    /// q : (…, nq). v : (…, nv).
    /// active : (nv,) of bool; any pattern, also within one joint.
    /// a_active : (…, number of active), in the order of v. tau_passive : (…, number of passive), in the order of v.
    /// wrenches : {body: (…, 6)}, moment then force on the body, at its frame's origin, in its axes.
    ///
    /// Returns
    /// -------
    /// tau_active, a_passive : (…, number of active), (…, number of passive).
    ///
    /// Raises
    /// ------
    /// ArgumentError; NumericalError at a passive joint without articulated inertia.
    ///
    /// Example
    /// -------
    /// >>> m = phipsi.Model.from_urdf("arm.urdf")
    /// >>> q, v = m.random_state(1)
    /// >>> tau, a = m.hybrid_dynamics(q, v, [True, False], [0.5], [0.0])       # the first joint is driven
    /// >>> bool(np.allclose(m.inverse_dynamics(q, v, [0.5, a[0]]), [tau[0], 0.0]))
    /// True
    #[pyo3(signature = (q, v, active, a_active, tau_passive, wrenches = None))]
    #[expect(clippy::too_many_arguments, reason = "the arguments of the Python method")]
    fn hybrid_dynamics<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        v: &Bound<'py, PyAny>,
        active: &Bound<'py, PyAny>,
        a_active: &Bound<'py, PyAny>,
        tau_passive: &Bound<'py, PyAny>,
        wrenches: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
        let compiled = self.compiled();
        let layout = &compiled.layout;
        let active = compiled.active(active)?;
        let places = |want: bool| (0..layout.nv()).filter(|&i| active[i] == want).collect::<Vec<usize>>();
        let (driven, free) = (places(true), places(false));
        let (mut q, mut v) = (compiled.q(q, "q")?, compiled.v(v, "v")?);
        let read = |x: &Bound<'_, PyAny>, name: &'static str, places: &[usize], meaning: &str| {
            let describe = |i: usize| compiled.place_of_velocity(places[i]);
            Argument::read(x, name, &[places.len()], meaning, &describe)
        };
        let mut a = read(a_active, "a_active", &driven, "one acceleration per active degree of freedom")?;
        let mut tau = read(tau_passive, "tau_passive", &free, "one force per passive degree of freedom")?;
        let mut wrenches = compiled.wrenches(wrenches)?;
        let own = [&mut q, &mut v, &mut a, &mut tau];
        let batch = Batch::of(py, own.into_iter().chain(&mut wrenches.arguments))?;
        let nv = layout.nv();
        let mut given = vec![0.0; batch.len() * nv];
        for (state, given) in given.chunks_exact_mut(nv.max(1)).enumerate() {
            driven
                .iter()
                .zip(a.at(state))
                .chain(free.iter().zip(tau.at(state)))
                .for_each(|(&i, &x)| given[i] = x);
        }
        let out = if compiled.has_loops() {
            let given = (&active[..], &given[..]);
            Model::closed_hybrid_dynamics(py, &compiled, &batch, [&q, &v], given, &wrenches)?
        } else {
            let kernel = kernels::HybridDynamics { layout, active: &active, loaded: &wrenches.bodies };
            let mut inputs = vec![q.input(), v.input(), Input::each(&given, nv)];
            inputs.extend(wrenches.arguments.iter().map(Argument::input));
            let out = batch.run(py, &kernel, &inputs, nv);
            out.map_err(|e| compiled.failure(py, &batch, e, Names::Columns("result")))?
        };
        let part = |places: &[usize]| {
            let states = out.chunks_exact(nv.max(1));
            batch.array(py, states.flat_map(|x| places.iter().map(|&i| x[i])).collect(), &[places.len()])
        };
        Ok((part(&driven)?, part(&free)?))
    }
}
