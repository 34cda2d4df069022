//! Scenes that run frame by frame.

use std::ops::ControlFlow;
use std::sync::Mutex;

use numpy::ndarray::Array2;
use numpy::{IntoPyArray, PyArray2};
use pliant::progress::Progress;
use pliant::scene::builtin;
use pliant::simulation::{self, FrameState, SceneDescription, Stepped};
use pliant::{LoadError, Scenario, SceneError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};

use crate::meshes::{array, corners, vectors};
use crate::refused;

fn of_scene(error: &SceneError) -> PyErr {
    let all: Vec<String> = error.each().iter().map(|e| e.terse()).collect();
    refused(all.join("\n"), Some(error.problem().code()), error.place())
}

fn of_load(error: LoadError) -> PyErr {
    refused(error.terse(), None, None)
}

/// Ends a computation where Python has a signal, such as that of Ctrl-C.
#[derive(Default)]
struct Signals(Mutex<Option<PyErr>>);

impl Progress for Signals {
    fn report(&self, _: &str, _: usize, _: usize) -> ControlFlow<()> {
        let Err(error) = Python::attach(|py| py.check_signals()) else {
            return ControlFlow::Continue(());
        };
        if let Ok(mut kept) = self.0.lock() {
            *kept = Some(error);
        }
        ControlFlow::Break(())
    }
}

impl Signals {
    fn raised(self) -> PyResult<()> {
        match self.0.into_inner() {
            Ok(Some(error)) => Err(error),
            _ => Ok(()),
        }
    }
}

/// A scene of any kind, ready to run. `load` makes one.
#[pyclass(module = "pliant", frozen)]
pub(crate) struct Simulation {
    scenario: Mutex<Box<dyn Scenario>>,
    description: SceneDescription,
}

/// Loads a scene file, or a built-in scene by its name, with changes `path = value`.
#[pyfunction]
#[pyo3(signature = (scene, set=None))]
pub(crate) fn load(
    py: Python<'_>,
    scene: &str,
    set: Option<&Bound<'_, PyDict>>,
) -> PyResult<Simulation> {
    let mut changes = Vec::new();
    for (path, value) in set.iter().flat_map(|set| set.iter()) {
        let value = match value.extract::<bool>() {
            // A flag of TOML.
            Ok(flag) if value.is_instance_of::<pyo3::types::PyBool>() => flag.to_string(),
            _ => value.str()?.to_string(),
        };
        changes.push(format!("{path}={value}"));
    }
    let content = py
        .detach(|| builtin::load_content_with(scene, &changes, |name| std::env::var_os(name)))
        .map_err(|e| of_scene(&e))?;
    let signals = Signals::default();
    let scenario = py.detach(|| simulation::scenario_with(&content, &signals));
    signals.raised()?;
    let scenario = scenario.map_err(of_load)?;
    Ok(Simulation {
        description: scenario.description(),
        scenario: Mutex::new(scenario),
    })
}

impl Simulation {
    fn with<T>(&self, py: Python<'_>, of: impl FnOnce(&mut dyn Scenario) -> T + Send) -> PyResult<T>
    where
        T: Send,
    {
        py.detach(|| {
            let mut scenario = self.scenario.try_lock().map_err(|_| {
                refused(
                    "the simulation steps in another thread".to_owned(),
                    None,
                    None,
                )
            })?;
            Ok(of(scenario.as_mut()))
        })
    }
}

#[pymethods]
impl Simulation {
    /// Name of the scene.
    #[getter]
    fn name(&self, py: Python<'_>) -> PyResult<String> {
        self.with(py, |s| s.name().to_owned())
    }

    /// Number of the last frame that was computed; 0 is the start.
    #[getter]
    fn frame(&self, py: Python<'_>) -> PyResult<usize> {
        self.with(py, |s| s.frame())
    }

    /// Number of the scene's last frame.
    #[getter]
    fn frame_count(&self, py: Python<'_>) -> PyResult<usize> {
        self.with(py, |s| s.frames())
    }

    /// True after the last frame.
    #[getter]
    fn finished(&self, py: Python<'_>) -> PyResult<bool> {
        self.with(py, |s| s.is_finished())
    }

    /// Names of the bodies.
    #[getter]
    fn names(&self) -> Vec<String> {
        self.description
            .bodies
            .iter()
            .map(|b| b.name.clone())
            .collect()
    }

    /// Names of the bones.
    #[getter]
    fn bone_names(&self) -> Vec<String> {
        self.description
            .bones
            .iter()
            .map(|(name, _)| name.clone())
            .collect()
    }

    /// Computes the next frame. Returns False where the run has ended.
    fn compute(&self, py: Python<'_>) -> PyResult<bool> {
        let signals = Signals::default();
        let stepped = self.with(py, |s| match s.is_finished() {
            true => None,
            false => Some(s.step(&signals)),
        })?;
        signals.raised()?;
        Ok(stepped.is_some_and(|s| s == Stepped::Done))
    }

    /// Number of the frame, its time [s], positions of each body (n, 3) [m], velocities of each body
    /// (n, 3) [m/s], and the pose of each bone (4, 4).
    #[allow(clippy::type_complexity)] // The types of arrays are those of numpy.
    fn state<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<(
        usize,
        f64,
        Bound<'py, PyList>,
        Bound<'py, PyList>,
        Bound<'py, PyList>,
    )> {
        let FrameState {
            frame,
            time,
            bodies,
            bones,
        } = self.with(py, |s| s.state())?;
        let positions = bodies.iter().map(|(x, _)| array(py, x));
        let velocities = bodies.iter().map(|(_, v)| vectors(py, v));
        let poses = bones.iter().map(|pose| {
            let matrix = pose.to_homogeneous();
            let rows = Array2::from_shape_fn((4, 4), |(i, j)| matrix[(i, j)]);
            rows.into_pyarray(py)
        });
        Ok((
            frame,
            time,
            PyList::new(py, positions.collect::<Vec<_>>())?,
            PyList::new(py, velocities.collect::<Vec<_>>())?,
            PyList::new(py, poses.collect::<Vec<_>>())?,
        ))
    }

    /// Triangles (m, 3) of each body.
    fn triangles<'py>(&self, py: Python<'py>) -> Vec<Bound<'py, PyArray2<u32>>> {
        let bodies = self.description.bodies.iter();
        bodies.map(|b| corners(py, &b.rest.triangles)).collect()
    }

    /// Vertices (n, 3) [m] in its own frame and triangles (m, 3) of each bone.
    #[allow(clippy::type_complexity)] // The types of arrays are those of numpy.
    fn bone_meshes<'py>(
        &self,
        py: Python<'py>,
    ) -> Vec<(Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<u32>>)> {
        let bones = self.description.bones.iter();
        bones
            .map(|(_, mesh)| (array(py, &mesh.vertices), corners(py, &mesh.triangles)))
            .collect()
    }

    /// Measures up to the last frame, with the names of `summary.json`.
    fn measures<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let measures = PyDict::new(py);
        for (name, value) in self.with(py, |s| s.measures())? {
            measures.set_item(name, value)?;
        }
        Ok(measures)
    }

    /// True if every frame that must be at rest is at rest.
    #[getter]
    fn converged(&self, py: Python<'_>) -> PyResult<bool> {
        self.with(py, |s| s.converged())
    }
}
