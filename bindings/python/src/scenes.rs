//! Scenes, run to their end or cycle by cycle.

use std::sync::{Mutex, PoisonError};

use kband_control::{Event, Fault, Report, Target};
use kband_plant::{Change, Moment, Strike};
use kband_scene::refusal::Refusal;
use kband_scene::{Engine, Fidelity, Outcome, SceneFile, Watch, change};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDict, PyFloat, PyInt, PyList, PyString, PyTuple};
use toml::{Table, Value};

use crate::refused::Refused;
use crate::work::InterruptPoll;

/// A Python value as a TOML value.
fn value(object: &Bound<'_, PyAny>) -> PyResult<Value> {
    if object.is_instance_of::<PyBool>() {
        Ok(Value::Boolean(object.extract()?))
    } else if object.is_instance_of::<PyInt>() {
        Ok(Value::Integer(object.extract()?))
    } else if object.is_instance_of::<PyFloat>() {
        Ok(Value::Float(object.extract()?))
    } else if object.is_instance_of::<PyString>() {
        Ok(Value::String(object.extract()?))
    } else if object.is_instance_of::<PyList>() || object.is_instance_of::<PyTuple>() {
        let items = object.try_iter()?.map(|item| value(&item?));
        Ok(Value::Array(items.collect::<PyResult<_>>()?))
    } else if let Ok(dict) = object.cast::<PyDict>() {
        Ok(Value::Table(table_of(dict)?))
    } else if let Ok(number) = object.extract::<f64>() {
        Ok(Value::Float(number))
    } else {
        Err(PyTypeError::new_err(format!(
            "{} is no value of a scene; accepted: bool, int, float, str, list, tuple, dict",
            object.get_type().name()?
        )))
    }
}

/// A dict as a TOML table.
pub fn table_of(dict: &Bound<'_, PyDict>) -> PyResult<Table> {
    let pair = |(key, item): (Bound<'_, PyAny>, _)| Ok((key.extract()?, value(&item)?));
    dict.iter().map(pair).collect()
}

/// A scene: its text in TOML, or a dict.
#[derive(FromPyObject)]
pub enum Given<'py> {
    Text(String),
    Dict(Bound<'py, PyDict>),
}

pub fn scene(given: &Given<'_>) -> PyResult<SceneFile> {
    let read = match given {
        Given::Text(text) => SceneFile::parse(text),
        Given::Dict(dict) => SceneFile::from_table(table_of(dict)?),
    };
    Ok(read.map_err(Refused::from)?)
}

/// The target in a dict, as in a scene: `{"gear": 1}`, `{"k": 0.4}`.
pub fn target(given: &Bound<'_, PyDict>) -> PyResult<Option<Target>> {
    let mut table = Table::new();
    table.insert("target".into(), Value::Table(table_of(given)?));
    Ok(match change(table).map_err(Refused::from)? {
        Change::Target(target) => Some(target),
        _ => None,
    })
}

/// An impact: number of the part, phase in rad, speed in m/s.
pub fn impact(strike: &Strike) -> (u8, f64, f64) {
    (strike.part, strike.phase, strike.speed)
}

/// Fidelity of this name; without a name the scene's own.
fn fidelity(file: &SceneFile, name: Option<&str>) -> PyResult<Fidelity> {
    let name = name.unwrap_or(file.fidelity.unwrap_or_default().name());
    let known = Fidelity::ALL.into_iter().find(|known| known.name() == name);
    known.ok_or_else(|| {
        let names = Fidelity::ALL.map(Fidelity::name).join(", ");
        PyValueError::new_err(format!("fidelity = {name} is refused; accepted: {names}"))
    })
}

/// The controller's report of a drive cycle, as a dict.
pub fn report<'py>(py: Python<'py>, report: &Report) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    dict.set_item("cycle", report.cycle)?;
    dict.set_item("amplitude", report.amplitude)?;
    dict.set_item("reference", report.reference)?;
    dict.set_item("setpoint", report.setpoint)?;
    dict.set_item("k", report.k)?;
    dict.set_item("in_gear", report.in_gear)?;
    dict.set_item("in_gear_error", report.in_gear_error)?;
    dict.set_item("expected_in_gear", report.expected_in_gear)?;
    let margin = report.margin;
    dict.set_item("restitution", margin.map(|margin| margin.restitution))?;
    dict.set_item("scatter", margin.map(|margin| margin.scatter))?;
    dict.set_item("mass", report.load.map(|load| 1e-3 * f64::from(load.mass)))?;
    dict.set_item("flow", report.load.map(|load| 1e-3 * f64::from(load.flow)))?;
    dict.set_item("frequency", report.frequency)?;
    dict.set_item("output", report.command.amplitude)?;
    dict.set_item("state", report.state.name())?;
    dict.set_item("fault", report.fault.map(Fault::name))?;
    let events: Vec<&str> = report.events.iter().map(Event::name).collect();
    dict.set_item("events", PyTuple::new(py, events)?)?;
    Ok(dict)
}

/// Columns recorded in every drive cycle.
const COLUMNS: [fn(&Moment) -> f64; 9] = [
    |moment| moment.time,
    |moment| moment.report.amplitude.into(),
    |moment| moment.report.reference.into(),
    |moment| moment.report.k.into(),
    |moment| moment.report.in_gear.into(),
    |moment| moment.report.in_gear_error.into(),
    |moment| moment.report.command.amplitude.into(),
    |moment| moment.displacement,
    |moment| moment.load,
];

/// Runs a scene to its end and returns its summary. With `kept` it also returns these columns of
/// every drive cycle: time, amplitude, reference, k, share in gear, its error, output,
/// displacement, load.
#[pyfunction]
pub fn simulate<'py>(
    py: Python<'py>,
    given: Given<'py>,
    fidelity_name: Option<&str>,
    kept: bool,
) -> PyResult<(Bound<'py, PyDict>, Vec<Vec<f64>>)> {
    let file = scene(&given)?;
    let fidelity = fidelity(&file, fidelity_name)?;
    let outcome = py.detach(|| {
        let watch = Watch {
            regime: true,
            all_cycles: kept,
            ..Watch::default()
        };
        let (mut poll, mut interrupted) = (InterruptPoll::new(), None);
        let outcome = Outcome::run(&file, fidelity, watch, &mut |_| {
            poll.poll().map_err(|error| {
                interrupted = Some(error);
                Refusal::interrupted()
            })
        });
        interrupted.map_or_else(|| Ok(outcome.map_err(Refused::from)?), Err)
    })?;
    let columns = COLUMNS.map(|of| outcome.moments().iter().map(of).collect());
    Ok((summary(py, &outcome, fidelity)?, columns.into()))
}

fn summary<'py>(
    py: Python<'py>,
    outcome: &Outcome,
    fidelity: Fidelity,
) -> PyResult<Bound<'py, PyDict>> {
    let (last, record) = (outcome.last(), outcome.record());
    let dict = PyDict::new(py);
    dict.set_item("state", last.state.name())?;
    dict.set_item("fault", last.fault.map(Fault::name))?;
    dict.set_item("limits", PyTuple::new(py, outcome.limits())?)?;
    let events = outcome.events();
    let events = events.map(|happened| (happened.time, happened.event.name()));
    dict.set_item("events", PyTuple::new(py, events.collect::<Vec<_>>())?)?;
    dict.set_item("amplitude", outcome.amplitude())?;
    dict.set_item("k", outcome.k())?;
    dict.set_item("speed", outcome.speed())?;
    dict.set_item("in_gear", outcome.in_gear())?;
    dict.set_item("in_gear_estimated", record.in_gear_estimated())?;
    dict.set_item("in_gear_error", record.in_gear_error())?;
    dict.set_item("regime", outcome.regime())?;
    let identified = outcome.identified();
    dict.set_item("restitution", identified.map(|found| found.restitution))?;
    let unmet = outcome.unmet().map(|unmet| PyTuple::new(py, unmet));
    dict.set_item("unmet", unmet.transpose()?)?;
    dict.set_item("seed", outcome.file().scene.seed)?;
    dict.set_item("fidelity", fidelity.name())?;
    Ok(dict)
}

/// The closed loop of a scene, cycle by cycle.
#[pyclass]
pub struct Loop(Mutex<Engine<'static>>);

impl Loop {
    fn engine(&mut self) -> &mut Engine<'static> {
        self.0.get_mut().unwrap_or_else(PoisonError::into_inner)
    }
}

#[pymethods]
impl Loop {
    #[new]
    fn new(given: Given<'_>, fidelity_name: Option<&str>) -> PyResult<Self> {
        let file = scene(&given)?;
        let fidelity = fidelity(&file, fidelity_name)?;
        let mut engine = Engine::build(&file.scene, fidelity).map_err(Refused::from)?;
        engine.watch(true);
        Ok(Self(Mutex::new(engine)))
    }

    /// Runs drive cycles; returns the last moment as a dict.
    fn cycle<'py>(&mut self, py: Python<'py>, count: usize) -> PyResult<Bound<'py, PyDict>> {
        let engine = self.engine();
        py.detach(|| {
            let mut poll = InterruptPoll::new();
            for _ in 0..count {
                engine.cycle().map_err(Refused::from)?;
                poll.poll()?;
            }
            Ok::<_, PyErr>(())
        })?;
        let moment = self.engine().moment();
        let moment = moment.ok_or_else(|| PyValueError::new_err("no cycle has run"))?;
        let dict = report(py, &moment.report)?;
        dict.set_item("time", moment.time)?;
        dict.set_item("impacts", moment.strikes)?;
        dict.set_item("displacement", moment.displacement)?;
        dict.set_item("load", moment.load)?;
        Ok(dict)
    }

    /// Impacts of the last cycle: number of the part, phase in rad, speed in m/s.
    fn impacts(&mut self) -> Vec<(u8, f64, f64)> {
        self.engine().strikes().iter().map(impact).collect()
    }

    /// Changes the scene from the next cycle on.
    fn apply(&mut self, given: &Bound<'_, PyDict>) -> PyResult<()> {
        let change = change(table_of(given)?).map_err(Refused::from)?;
        self.engine().apply(change);
        Ok(())
    }
}
