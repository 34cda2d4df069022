//! Constraints and potentials that are Python objects: for trying out, as each evaluation calls
//! Python.

use std::any::Any;
use std::ops::{Add, Div, Mul, Neg, Sub};
use std::sync::{Arc, Mutex, PoisonError};

use nalgebra::{Matrix3, Point3, Vector3};
use numpy::{PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pliant::solvers::{DescentSettings, NoContact};
use pliant::testing::{self, Draw, Subject};
use pliant::{
    Batch, Constraint, Energy, Particles, Potential, Project, Quadratic, QuasiStatic, Scalar,
    SweepOrder,
};
use pyo3::prelude::*;
use pyo3::types::PyList;

use crate::meshes::{array, points};
use crate::refused;

/// A number with a derivative, with which the conformance suite calls `value`.
#[pyclass(module = "pliant", frozen, from_py_object)]
#[derive(Clone, Copy)]
pub(crate) struct Dual(testing::Dual);

#[derive(FromPyObject)]
enum Number {
    Dual(Dual),
    Real(f64),
}

impl Number {
    fn dual(self) -> testing::Dual {
        match self {
            Self::Dual(dual) => dual.0,
            Self::Real(value) => testing::Dual::of(value),
        }
    }
}

#[pymethods]
impl Dual {
    fn __add__(&self, o: Number) -> Self {
        Self(self.0.add(o.dual()))
    }
    fn __radd__(&self, o: Number) -> Self {
        Self(o.dual().add(self.0))
    }
    fn __sub__(&self, o: Number) -> Self {
        Self(self.0.sub(o.dual()))
    }
    fn __rsub__(&self, o: Number) -> Self {
        Self(o.dual().sub(self.0))
    }
    fn __mul__(&self, o: Number) -> Self {
        Self(self.0.mul(o.dual()))
    }
    fn __rmul__(&self, o: Number) -> Self {
        Self(o.dual().mul(self.0))
    }
    fn __truediv__(&self, o: Number) -> Self {
        Self(self.0.div(o.dual()))
    }
    fn __rtruediv__(&self, o: Number) -> Self {
        Self(o.dual().div(self.0))
    }
    fn __neg__(&self) -> Self {
        Self(self.0.neg())
    }
    /// Whole powers.
    fn __pow__(&self, power: i32, _modulo: Option<i32>) -> Self {
        let one = testing::Dual::of(1.0);
        let all = (0..power.unsigned_abs()).fold(one, |product, _| product.mul(self.0));
        Self(if power < 0 { one.div(all) } else { all })
    }
    fn __float__(&self) -> f64 {
        self.0.real.value
    }
    fn __lt__(&self, o: Number) -> bool {
        self.0.real.value < o.dual().real.value
    }
    fn __gt__(&self, o: Number) -> bool {
        self.0.real.value > o.dual().real.value
    }
    fn __abs__(&self) -> Self {
        if self.0.real.value < 0.0 {
            self.__neg__()
        } else {
            *self
        }
    }
    /// Square root, which `numpy.sqrt` calls.
    fn sqrt(&self) -> Self {
        Self(Scalar::sqrt(self.0))
    }
    /// Angle of the point (x, self).
    fn arctan2(&self, x: Number) -> Self {
        Self(Scalar::atan2(self.0, x.dual()))
    }
}

/// What a callable did wrong, kept until the solver returns.
static FAILED: Mutex<Option<PyErr>> = Mutex::new(None);

fn keep(error: PyErr) {
    let mut failed = FAILED.lock().unwrap_or_else(PoisonError::into_inner);
    failed.get_or_insert(error);
}

fn raised() -> PyResult<()> {
    let mut failed = FAILED.lock().unwrap_or_else(PoisonError::into_inner);
    failed.take().map_or(Ok(()), Err)
}

/// Objects of the present call, by their index: a constraint of the library can be copied, an object
/// of Python cannot.
static OBJECTS: Mutex<Vec<Arc<Py<PyAny>>>> = Mutex::new(Vec::new());

/// One call at a time has the objects.
static CALL: Mutex<()> = Mutex::new(());

/// Begins a call. Waiting for another one, which needs the interpreter, would never end.
fn begun() -> PyResult<std::sync::MutexGuard<'static, ()>> {
    match CALL.try_lock() {
        Ok(call) => Ok(call),
        Err(std::sync::TryLockError::Poisoned(call)) => Ok(call.into_inner()),
        Err(std::sync::TryLockError::WouldBlock) => Err(refused(
            "another thread projects or minimises; constraints in Python take one call at a time"
                .to_owned(),
            None,
            None,
        )),
    }
}

/// A constraint whose object is in [`OBJECTS`].
#[derive(Clone, Copy)]
struct Written<const K: usize> {
    points: [u32; K],
    object: usize,
}

fn object(index: usize) -> Option<Arc<Py<PyAny>>> {
    let objects = OBJECTS.lock().unwrap_or_else(PoisonError::into_inner);
    objects.get(index).cloned()
}

/// Calls `value` with numbers of any type.
fn value<S: Scalar>(object: &Py<PyAny>, x: &[Point3<S>]) -> PyResult<S> {
    Python::attach(|py| {
        let numbers = x.iter().flat_map(|p| p.iter().copied());
        let numbers: Vec<Box<dyn Any>> = numbers.map(|n| Box::new(n) as Box<dyn Any>).collect();
        let real: Option<Vec<f64>> = numbers
            .iter()
            .map(|n| n.downcast_ref::<f64>().copied())
            .collect();
        if let Some(real) = real {
            let place: Vec<Point3<f64>> = real
                .chunks(3)
                .map(|c| Point3::new(c[0], c[1], c[2]))
                .collect();
            let found: f64 = object
                .call_method1(py, "value", (array(py, &place),))?
                .extract(py)?;
            return Ok(S::of(found));
        }
        let duals: Vec<Option<Dual>> = numbers
            .iter()
            .map(|n| n.downcast_ref::<testing::Dual>().map(|d| Dual(*d)))
            .collect();
        let rows: Vec<Vec<Dual>> = duals
            .into_iter()
            .flatten()
            .collect::<Vec<_>>()
            .chunks(3)
            .map(<[Dual]>::to_vec)
            .collect();
        // An array of objects, on which the operators of numpy work.
        let numpy = py.import("numpy")?;
        let place = numpy.call_method1("array", (rows, numpy.getattr("object_")?))?;
        let found: Number = object.call_method1(py, "value", (place,))?.extract(py)?;
        let found: Box<dyn Any> = Box::new(found.dual());
        found.downcast_ref::<S>().copied().ok_or_else(|| {
            refused(
                "`value` returned another type of number".to_owned(),
                None,
                None,
            )
        })
    })
}

/// The vectors of a gradient of shape (count, 3).
fn vectors_of(gradient: Bound<'_, PyAny>, count: usize) -> PyResult<Vec<Vector3<f64>>> {
    let numpy = gradient.py().import("numpy")?;
    let gradient = numpy.call_method1("asarray", (gradient, "float64"))?;
    let gradient: Bound<'_, PyArray2<f64>> = gradient.cast_into().map_err(PyErr::from)?;
    let rows = gradient.readonly();
    let rows = rows.as_array();
    if rows.dim() != (count, 3) {
        let message = format!(
            "`gradient` has the shape {:?} instead of ({count}, 3)",
            rows.dim()
        );
        return Err(refused(message, None, None));
    }
    let rows = rows.rows().into_iter();
    Ok(rows.map(|r| Vector3::new(r[0], r[1], r[2])).collect())
}

/// Calls `value` and `gradient`; `None` where the gradient is None.
fn value_and_gradient(
    object: &Py<PyAny>,
    x: &[Point3<f64>],
) -> PyResult<Option<(f64, Vec<Vector3<f64>>)>> {
    Python::attach(|py| {
        let place = array(py, x);
        let found: f64 = object.call_method1(py, "value", (&place,))?.extract(py)?;
        let gradient = object.call_method1(py, "gradient", (&place,))?;
        if gradient.is_none(py) {
            return Ok(None);
        }
        Ok(Some((found, vectors_of(gradient.into_bound(py), x.len())?)))
    })
}

impl<const K: usize> Constraint<K> for Written<K> {
    const NAME: &'static str = "constraint in Python";

    fn points(&self) -> [u32; K] {
        self.points
    }

    fn value<S: Scalar>(&self, x: &[Point3<S>; K]) -> S {
        let found = object(self.object).map(|object| value(&object, x));
        match found {
            Some(Ok(value)) => value,
            Some(Err(error)) => {
                keep(error);
                S::of(f64::NAN)
            }
            None => S::of(f64::NAN),
        }
    }

    fn value_and_gradient(&self, x: &[Point3<f64>; K]) -> Option<(f64, [Vector3<f64>; K])> {
        match object(self.object).map(|object| value_and_gradient(&object, x))? {
            Ok(found) => {
                found.and_then(|(value, gradient)| Some((value, gradient.try_into().ok()?)))
            }
            Err(error) => {
                keep(error);
                None
            }
        }
    }
}

/// An object of Python as a subject of the conformance suite.
struct Checked {
    object: Arc<Py<PyAny>>,
    count: usize,
}

impl Subject for Checked {
    fn count(&self) -> usize {
        self.count
    }
    fn value<S: Scalar>(&self, x: &[Point3<S>]) -> S {
        value(&self.object, x).unwrap_or_else(|error| {
            keep(error);
            S::of(f64::NAN)
        })
    }
    fn value_and_gradient(&self, x: &[Point3<f64>]) -> Option<(f64, Vec<Vector3<f64>>)> {
        value_and_gradient(&self.object, x).unwrap_or_else(|error| {
            keep(error);
            None
        })
    }
}

/// Checks a constraint with the conformance suite: its gradient at random shapes of its points
/// against derivatives by dual numbers, and against central differences whose error falls as the
/// square of the step. Raises PliantError with the first failed check.
///
/// `value(x)` gets an array (k, 3) of floats, or of numbers with derivatives, for which `+ - * / **`,
/// `numpy.sqrt` and `numpy.arctan2` work. `gradient(x)` gets floats and returns an array (k, 3).
#[pyfunction]
#[pyo3(signature = (constraint, count, cases=20, seed=1))]
pub(crate) fn check_constraint(
    py: Python<'_>,
    constraint: Py<PyAny>,
    count: usize,
    cases: usize,
    seed: u64,
) -> PyResult<()> {
    if !(1..=64).contains(&count) {
        return Err(refused(
            format!("a constraint of {count} points; 1 to 64 can be checked"),
            None,
            None,
        ));
    }
    let subject = Checked {
        object: Arc::new(constraint),
        count,
    };
    py.detach(|| {
        for case in 0..cases as u64 {
            let mut draw = Draw::new(seed.wrapping_add(case));
            // With more than six points in a box some are near each other.
            let x = match count {
                ..=6 => draw.shape(count),
                _ => (0..count)
                    .map(|_| Point3::new(draw.dyadic(), draw.dyadic(), draw.dyadic()))
                    .collect(),
            };
            let checked = testing::check("the constraint", &subject, &x, 1.0, &mut draw);
            raised()?;
            checked.map_err(|failure| refused(failure.to_string(), None, None))?;
        }
        Ok(())
    })
}

/// The constraints of a call in batches by their number of points.
struct Batches {
    one: Vec<Written<1>>,
    two: Vec<Written<2>>,
    three: Vec<Written<3>>,
    four: Vec<Written<4>>,
}

fn batches(constraints: &Bound<'_, PyList>, count: usize) -> PyResult<Batches> {
    let mut all = Batches {
        one: Vec::new(),
        two: Vec::new(),
        three: Vec::new(),
        four: Vec::new(),
    };
    let mut objects = Vec::new();
    for (object, constraint) in constraints.iter().enumerate() {
        let points: Vec<u32> = constraint
            .getattr("points")?
            .try_iter()?
            .map(|p| p?.extract())
            .collect::<PyResult<_>>()?;
        if let Some(point) = points.iter().find(|p| **p as usize >= count) {
            let message = format!("constraint {object} names point {point} of {count}");
            return Err(refused(message, None, None));
        }
        match points[..] {
            [a] => all.one.push(Written {
                points: [a],
                object,
            }),
            [a, b] => all.two.push(Written {
                points: [a, b],
                object,
            }),
            [a, b, c] => all.three.push(Written {
                points: [a, b, c],
                object,
            }),
            [a, b, c, d] => all.four.push(Written {
                points: [a, b, c, d],
                object,
            }),
            _ => {
                let message = format!(
                    "constraint {object} has {} points; 1 to 4 are possible",
                    points.len()
                );
                return Err(refused(message, None, None));
            }
        }
        objects.push(Arc::new(constraint.unbind()));
    }
    *OBJECTS.lock().unwrap_or_else(PoisonError::into_inner) = objects;
    Ok(all)
}

fn same_count(x: &[Point3<f64>], masses: &PyReadonlyArray1<'_, f64>) -> PyResult<Vec<f64>> {
    let masses = masses.as_array().to_vec();
    if masses.len() != x.len() {
        let message = format!("{} inverse masses for {} points", masses.len(), x.len());
        return Err(refused(message, None, None));
    }
    match masses.iter().position(|m| !(*m >= 0.0) || !m.is_finite()) {
        Some(k) => Err(refused(
            format!("inverse mass {k} is {}", masses[k]),
            None,
            None,
        )),
        None => Ok(masses),
    }
}

/// Projects constraints (XPBD): `steps` sweeps over all, with one compliance [1/stiffness] and a time
/// step [s]. Returns new positions (n, 3); points of inverse mass 0 stay.
#[pyfunction]
#[pyo3(signature = (positions, inverse_masses, constraints, compliance=0.0, steps=100, time_step=0.01))]
pub(crate) fn project<'py>(
    py: Python<'py>,
    positions: PyReadonlyArray2<'py, f64>,
    inverse_masses: PyReadonlyArray1<'py, f64>,
    constraints: &Bound<'py, PyList>,
    compliance: f64,
    steps: usize,
    time_step: f64,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    if !(compliance >= 0.0)
        || !(time_step > 0.0)
        || !compliance.is_finite()
        || !time_step.is_finite()
    {
        return Err(refused(
            "a compliance of at least 0 and a time step above 0 are needed".to_owned(),
            None,
            None,
        ));
    }
    let x = points(&positions)?;
    let masses = same_count(&x, &inverse_masses)?;
    let _call = begun()?;
    let all = batches(constraints, x.len())?;
    let mut particles = Particles::at_rest(x, masses);
    let count = particles.len();
    fn batch<const K: usize>(
        all: Vec<Written<K>>,
        compliance: f64,
        count: usize,
    ) -> Box<dyn Project> {
        let compliances = vec![compliance; all.len()];
        Box::new(Batch::new(all, compliances, SweepOrder::Stored, count, &[]))
    }
    let mut parts = [
        batch(all.one, compliance, count),
        batch(all.two, compliance, count),
        batch(all.three, compliance, count),
        batch(all.four, compliance, count),
    ];
    py.detach(|| {
        parts.iter_mut().for_each(|part| part.begin_step());
        for _ in 0..steps {
            parts
                .iter_mut()
                .for_each(|part| part.project(&mut particles, time_step));
            raised()?;
            Python::attach(|py| py.check_signals())?;
        }
        PyResult::Ok(())
    })?;
    Ok(array(py, &particles.position))
}

/// A potential that is an object of Python: `energy(x)` [J] and `gradient(x)` [N] of all positions.
struct WrittenPotential {
    object: Arc<Py<PyAny>>,
    /// A curvature [N/m] for the matrix of the solver.
    stiffness: f64,
    count: u32,
}

impl WrittenPotential {
    fn call(&self, x: &[Point3<f64>]) -> Option<(f64, Vec<Vector3<f64>>)> {
        let found = Python::attach(|py| {
            let place = array(py, x);
            let energy: f64 = self
                .object
                .call_method1(py, "energy", (&place,))?
                .extract(py)?;
            let gradient = self.object.call_method1(py, "gradient", (&place,))?;
            Ok((energy, vectors_of(gradient.into_bound(py), x.len())?))
        });
        found.map_err(keep).ok()
    }
}

impl Potential for WrittenPotential {
    fn name(&self) -> &'static str {
        "potential in Python"
    }
    fn energy(&self, x: &[Point3<f64>]) -> f64 {
        self.call(x).map_or(f64::NAN, |(energy, _)| energy)
    }
    fn energy_and_gradient(&self, x: &[Point3<f64>], gradient: &mut [Vector3<f64>]) -> f64 {
        let Some((energy, own)) = self.call(x) else {
            return f64::NAN;
        };
        gradient.iter_mut().zip(own).for_each(|(g, own)| *g += own);
        energy
    }
    fn pairs(&self, _: &mut dyn FnMut(u32, u32)) {}
    fn hessian(&self, _: &[Point3<f64>], _: bool, add: &mut dyn FnMut(u32, u32, &Matrix3<f64>)) {
        let block = Matrix3::identity() * self.stiffness;
        (0..self.count).for_each(|v| add(v, v, &block));
    }
    fn scalar_hessian(&self, _: &[Point3<f64>], add: &mut dyn FnMut(u32, u32, f64)) {
        (0..self.count).for_each(|v| add(v, v, self.stiffness));
    }
    fn force_scale(&self, _: &[Point3<f64>]) -> f64 {
        self.stiffness
    }
}

/// Positions of least energy: the sum of `stiffness C(x)^2 / 2` over constraints, and of potentials with
/// `energy(x)` [J] and `gradient(x)` (n, 3) [N] of all positions. Points of inverse mass 0 are held.
/// Returns new positions (n, 3), and whether they are at rest.
#[pyfunction]
#[pyo3(signature = (positions, inverse_masses, constraints, stiffness=1.0, potentials=None, tolerance=1e-6, iterations=2000))]
#[allow(clippy::too_many_arguments)] // Python passes them by name.
pub(crate) fn minimise<'py>(
    py: Python<'py>,
    positions: PyReadonlyArray2<'py, f64>,
    inverse_masses: PyReadonlyArray1<'py, f64>,
    constraints: &Bound<'py, PyList>,
    stiffness: f64,
    potentials: Option<&Bound<'py, PyList>>,
    tolerance: f64,
    iterations: u32,
) -> PyResult<(Bound<'py, PyArray2<f64>>, bool)> {
    if !(stiffness > 0.0) || !stiffness.is_finite() || !(tolerance > 0.0) {
        return Err(refused(
            "a stiffness and a tolerance above 0 are needed".to_owned(),
            None,
            None,
        ));
    }
    let mut x = points(&positions)?;
    let masses = same_count(&x, &inverse_masses)?;
    let _call = begun()?;
    let all = batches(constraints, x.len())?;
    let mut elastic: Vec<Box<dyn Potential>> = Vec::new();
    fn add<const K: usize>(all: Vec<Written<K>>, stiffness: f64, to: &mut Vec<Box<dyn Potential>>) {
        if !all.is_empty() {
            let each = vec![stiffness; all.len()];
            to.push(Box::new(Quadratic::new(all, each)));
        }
    }
    add(all.one, stiffness, &mut elastic);
    add(all.two, stiffness, &mut elastic);
    add(all.three, stiffness, &mut elastic);
    add(all.four, stiffness, &mut elastic);
    let count = x.len() as u32;
    for potential in potentials.iter().flat_map(|p| p.iter()) {
        let object = Arc::new(potential.unbind());
        elastic.push(Box::new(WrittenPotential {
            object,
            stiffness,
            count,
        }));
    }
    let energy = Energy {
        elastic,
        ..Energy::default()
    };
    let settings = DescentSettings {
        tolerance,
        iterations,
    };
    let outcome = py.detach(|| {
        let solver = QuasiStatic::new(energy, &x, &masses, settings);
        let mut solver = solver.map_err(|error| refused(error.to_string(), None, None))?;
        let outcome = solver.solve(&mut x, &mut NoContact, |_, _| {
            let failed = FAILED
                .lock()
                .unwrap_or_else(PoisonError::into_inner)
                .is_some();
            let signal = Python::attach(|py| py.check_signals());
            !failed && signal.map_err(keep).is_ok()
        });
        PyResult::Ok(outcome.converged)
    });
    raised()?;
    Ok((array(py, &x), outcome?))
}
