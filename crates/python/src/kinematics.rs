//! Methods of `Model` about motion: poses, velocities, Jacobians, energies, momentum.

use crate::batch::{Argument, Batch};
use crate::compiled::Names;
use crate::model::Model;
use phipsi::recursion::batch::kernels;
use pyo3::prelude::*;

#[pymethods]
impl Model {
    /// Pose of a body in the world.
    ///
    /// ``q``: (…, nq); ``body``: its name (`world` is allowed). Returns (…, 4, 4): rotation (body to world) and position, m.
    ///
    /// Raises ArgumentError; NumericalError for numbers that are not finite.
    ///
    /// Example
    /// -------
    /// >>> m = phipsi.Model.from_urdf("arm.urdf")
    /// >>> m.body_pose([0.0, 0.0], "lower")[:3, 3]
    /// array([0., 0., 1.])
    fn body_pose<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        body: &str,
    ) -> PyResult<Bound<'py, PyAny>> {
        let compiled = self.compiled();
        let body = compiled.body(py, body)?;
        let (layout, mut q) = (&compiled.layout, compiled.q(q, "q")?);
        let batch = Batch::of(py, [&mut q])?;
        let out = batch.run(py, &kernels::BodyPose { layout, body }, &[q.input()], 16);
        compiled.result(py, &batch, out, Names::Other("pose"), &[4, 4])
    }
    /// Velocity of a body: (ω, velocity of the body-frame origin), world axes.
    ///
    /// ``q``: (…, nq); ``v``: (…, nv); ``body``: its name. Returns (…, 6), rad/s and m/s.
    ///
    /// Raises ArgumentError; NumericalError for numbers that are not finite.
    ///
    /// Example
    /// -------
    /// >>> m = phipsi.Model.from_urdf("arm.urdf")
    /// >>> m.body_velocity([0.0, 0.0], [2.0, 0.0], "lower")
    /// array([0., 2., 0., 2., 0., 0.])
    fn body_velocity<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        v: &Bound<'py, PyAny>,
        body: &str,
    ) -> PyResult<Bound<'py, PyAny>> {
        let compiled = self.compiled();
        let body = compiled.body(py, body)?;
        let (layout, mut q, mut v) = (&compiled.layout, compiled.q(q, "q")?, compiled.v(v, "v")?);
        let batch = Batch::of(py, [&mut q, &mut v])?;
        let kernel = kernels::BodyVelocity { layout, body };
        let out = batch.run(py, &kernel, &[q.input(), v.input()], 6);
        compiled.result(py, &batch, out, Names::Other("velocity"), &[6])
    }
    /// Acceleration of a body: inertial rates of ω and of the velocity of the body-frame origin, world axes; no gravity.
    ///
    /// ``q``: (…, nq); ``v``, ``a``: (…, nv); ``body``: its name. Returns (…, 6), rad/s² and m/s².
    ///
    /// Raises ArgumentError; NumericalError for numbers that are not finite.
    ///
    /// Example
    /// -------
    /// >>> m = phipsi.Model.from_urdf("arm.urdf")
    /// >>> m.body_acceleration([0.0, 0.0], [2.0, 0.0], [0.0, 0.0], "lower")
    /// array([ 0.,  0.,  0.,  0.,  0., -4.])
    fn body_acceleration<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        v: &Bound<'py, PyAny>,
        a: &Bound<'py, PyAny>,
        body: &str,
    ) -> PyResult<Bound<'py, PyAny>> {
        let compiled = self.compiled();
        let body = compiled.body(py, body)?;
        let layout = &compiled.layout;
        let (mut q, mut v, mut a) = (compiled.q(q, "q")?, compiled.v(v, "v")?, compiled.v(a, "a")?);
        let batch = Batch::of(py, [&mut q, &mut v, &mut a])?;
        let kernel = kernels::BodyAcceleration { layout, body };
        let out = batch.run(py, &kernel, &[q.input(), v.input(), a.input()], 6);
        compiled.result(py, &batch, out, Names::Other("acceleration"), &[6])
    }
    /// The Jacobian J: (ω, velocity of the point) = J v, world axes.
    ///
    /// Parameters
    /// ----------
    /// q : (…, nq). body : its name.
    /// point : (…, 3), m, in the body's frame; None is its origin.
    ///
    /// Returns
    /// -------
    /// (…, 6, nv), angular rows first.
    ///
    /// Raises
    /// ------
    /// ArgumentError; NumericalError for numbers that are not finite.
    ///
    /// Example
    /// -------
    /// >>> m = phipsi.Model.from_urdf("arm.urdf")
    /// >>> q, v = m.random_state(4)
    /// >>> bool(np.allclose(m.jacobian(q, "lower") @ v, m.body_velocity(q, v, "lower")))
    /// True
    #[pyo3(signature = (q, body, point = None))]
    fn jacobian<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        body: &str,
        point: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let compiled = self.compiled();
        let body = compiled.body(py, body)?;
        let (layout, mut q) = (&compiled.layout, compiled.q(q, "q")?);
        let mut point = point.map(|p| compiled.point(p, "point")).transpose()?;
        let batch = Batch::of(py, std::iter::once(&mut q).chain(&mut point))?;
        let nv = layout.nv();
        let inputs: Vec<_> = std::iter::once(&q).chain(&point).map(Argument::input).collect();
        let out = batch.run(py, &kernels::Jacobian { layout, body }, &inputs, 6 * nv);
        compiled.result(py, &batch, out, Names::Columns("Jacobian"), &[6, nv])
    }
    /// Kinetic energy, J.
    ///
    /// ``q``: (…, nq); ``v``: (…, nv). Returns (…), a float without batch axes.
    ///
    /// Raises ArgumentError; NumericalError for numbers that are not finite.
    ///
    /// Example
    /// -------
    /// >>> phipsi.Model.from_urdf("arm.urdf").kinetic_energy([0.0, 0.0], [0.0, 0.0])
    /// 0.0
    fn kinetic_energy<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        v: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let compiled = self.compiled();
        let (layout, mut q, mut v) = (&compiled.layout, compiled.q(q, "q")?, compiled.v(v, "v")?);
        let batch = Batch::of(py, [&mut q, &mut v])?;
        let out = batch.run(py, &kernels::KineticEnergy { layout }, &[q.input(), v.input()], 1);
        compiled.result(py, &batch, out, Names::Other("kinetic energy"), &[])
    }
    /// Potential energy of gravity, J; zero at the world's origin. Bodies welded to the world do not count.
    ///
    /// ``q``: (…, nq). Returns (…), a float without batch axes.
    ///
    /// Raises ArgumentError; NumericalError for numbers that are not finite.
    ///
    /// Example
    /// -------
    /// >>> m = phipsi.Model.from_urdf("arm.urdf")
    /// >>> m.gravity = (0, 0, -10)
    /// >>> round(m.potential_energy([0.0, 0.0]), 9)
    /// 22.5
    fn potential_energy<'py>(&self, py: Python<'py>, q: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        let compiled = self.compiled();
        let (layout, mut q) = (&compiled.layout, compiled.q(q, "q")?);
        let batch = Batch::of(py, [&mut q])?;
        let out = batch.run(py, &kernels::PotentialEnergy { layout }, &[q.input()], 1);
        compiled.result(py, &batch, out, Names::Other("potential energy"), &[])
    }
    /// Center of mass of the moving bodies, m, world axes. Bodies welded to the world do not count.
    ///
    /// ``q``: (…, nq). Returns (…, 3).
    ///
    /// Raises ArgumentError; NumericalError where the moving bodies have no mass.
    ///
    /// Example
    /// -------
    /// >>> phipsi.Model.from_urdf("arm.urdf").center_of_mass([0.0, 0.0])
    /// array([0.  , 0.  , 0.75])
    fn center_of_mass<'py>(&self, py: Python<'py>, q: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        let compiled = self.compiled();
        let (layout, mut q) = (&compiled.layout, compiled.q(q, "q")?);
        let batch = Batch::of(py, [&mut q])?;
        let out = batch.run(py, &kernels::CenterOfMass { layout }, &[q.input()], 3);
        compiled.result(py, &batch, out, Names::Other("center of mass"), &[3])
    }
    /// Momentum of the moving bodies: angular, then linear; world axes.
    ///
    /// Parameters
    /// ----------
    /// q : (…, nq). v : (…, nv).
    /// about : (…, 3), a point of the world, m; None is the center of mass.
    ///
    /// Returns
    /// -------
    /// (…, 6), kg·m²/s and kg·m/s.
    ///
    /// Raises
    /// ------
    /// ArgumentError; NumericalError for numbers that are not finite.
    ///
    /// Example
    /// -------
    /// >>> m = phipsi.Model.from_urdf("arm.urdf")
    /// >>> q, v = m.random_state(5)
    /// >>> bool(np.allclose(m.momentum(q, v), m.centroidal_momentum_matrix(q) @ v))
    /// True
    #[pyo3(signature = (q, v, about = None))]
    fn momentum<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        v: &Bound<'py, PyAny>,
        about: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let compiled = self.compiled();
        let (layout, mut q, mut v) = (&compiled.layout, compiled.q(q, "q")?, compiled.v(v, "v")?);
        let mut about = about.map(|p| compiled.point(p, "about")).transpose()?;
        let batch = Batch::of(py, [&mut q, &mut v].into_iter().chain(&mut about))?;
        let inputs: Vec<_> = [&q, &v].into_iter().chain(&about).map(Argument::input).collect();
        let out = batch.run(py, &kernels::Momentum { layout }, &inputs, 6);
        compiled.result(py, &batch, out, Names::Other("momentum"), &[6])
    }
    /// A with momentum(q, v) = A v, about the center of mass; world axes.
    ///
    /// ``q``: (…, nq). Returns (…, 6, nv), angular rows first.
    ///
    /// Raises ArgumentError; NumericalError for numbers that are not finite.
    ///
    /// Example
    /// -------
    /// >>> phipsi.Model.from_urdf("arm.urdf").centroidal_momentum_matrix([0.0, 0.0]).shape
    /// (6, 2)
    fn centroidal_momentum_matrix<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let compiled = self.compiled();
        let (layout, mut q) = (&compiled.layout, compiled.q(q, "q")?);
        let (nv, batch) = (layout.nv(), Batch::of(py, [&mut q])?);
        let out = batch.run(py, &kernels::CentroidalMomentumMatrix { layout }, &[q.input()], 6 * nv);
        compiled.result(py, &batch, out, Names::Columns("centroidal momentum matrix"), &[6, nv])
    }
}
