//! Plant and controller, sample by sample.

use kband_control::{AdcCode, Controller as Control, Inputs, PLAN_SLICES, SAMPLE_RATE, Signal};
use kband_plant::Bench;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::refused::Refused;
use crate::scenes::{Given, impact, report, scene, target};

type Input = (&'static str, fn(&mut Inputs) -> &mut bool);

const INPUTS: [Input; 7] = [
    ("enable", |inputs| &mut inputs.enable),
    ("over_temperature", |inputs| &mut inputs.over_temperature),
    ("link_heard", |inputs| &mut inputs.link_heard),
    ("stack_low", |inputs| &mut inputs.stack_low),
    ("over_current", |inputs| &mut inputs.over_current),
    ("supply_low", |inputs| &mut inputs.supply_low),
    ("clock_failed", |inputs| &mut inputs.clock_failed),
];

/// The simulated feeder of a scene: a converter code for each output, 20 000 times a second.
#[pyclass]
pub struct Plant(Bench);

#[pymethods]
impl Plant {
    #[new]
    fn new(given: Given<'_>) -> PyResult<Self> {
        let bench = Bench::build(&scene(&given)?.scene);
        Ok(Self(bench.map_err(Refused::from)?))
    }

    /// Converter codes of accelerometer and current sensor at the next sample.
    fn sample(&mut self) -> (u16, u16) {
        let code = self.0.sample();
        (code.0, self.0.current().0)
    }

    /// Holds an output until the next sample, while the drive's phase advances by `step`.
    fn hold(&mut self, output: f32, step: u32) -> PyResult<()> {
        if !(-1.0..=1.0).contains(&output) {
            let message = format!("output = {output} is refused; accepted: -1..1");
            return Err(PyValueError::new_err(message));
        }
        self.0.hold(output, step);
        Ok(())
    }

    /// Time since the start in s.
    #[getter]
    fn time(&self) -> f64 {
        self.0.time()
    }

    /// Inputs of the board, by name.
    #[getter]
    fn inputs<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let (mut inputs, dict) = (self.0.inputs(), PyDict::new(py));
        for (name, place) in INPUTS {
            dict.set_item(name, *place(&mut inputs))?;
        }
        Ok(dict)
    }

    /// Displacement (m) and velocity (m/s) of the track normal to itself.
    #[getter]
    fn motion(&self) -> [f32; 2] {
        self.0.motion()
    }

    /// Mean displacement of the parts along the track in m.
    #[getter]
    fn displacement(&self) -> f64 {
        self.0.displacement()
    }

    /// Impacts since the last call: number of the part, phase in rad, speed in m/s.
    fn impacts(&mut self) -> Vec<(u8, f64, f64)> {
        let impacts = self.0.strikes().iter().map(impact).collect();
        self.0.forget_strikes();
        impacts
    }
}

/// The firmware's signal path and controller with the settings and the target of a scene.
#[pyclass]
pub struct Controller {
    signal: Signal,
    control: Control,
}

#[pymethods]
impl Controller {
    /// Samples a second.
    #[classattr]
    const SAMPLE_RATE: u32 = SAMPLE_RATE;

    #[new]
    fn new(given: Given<'_>) -> PyResult<Self> {
        let scene = scene(&given)?.scene;
        let signal = Signal::build(&scene.settings).map_err(Refused::from)?;
        let control = Control::build(&scene.settings, scene.target, scene.start);
        Ok(Self {
            signal,
            control: control.map_err(Refused::from)?,
        })
    }

    /// Processes the converter codes of a sample. Returns the output, the advance of the drive's
    /// phase in 2^-32 turns, and whether a drive cycle ended.
    fn sample(&mut self, code: u16, current: u16) -> (f32, u32, bool) {
        let before = self.signal.phase();
        let sampled = self.signal.sample_with(AdcCode(code), || AdcCode(current));
        let step = (self.signal.phase() - before).bits();
        (sampled.output, step, sampled.wrapped)
    }

    /// Ends a drive cycle with the board's inputs, by name. Returns the controller's report.
    fn cycle<'py>(
        &mut self,
        py: Python<'py>,
        given: &Bound<'py, PyDict>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let mut inputs = Inputs::default();
        for (key, on) in given {
            let key: String = key.extract()?;
            let input = INPUTS.iter().find(|(name, _)| *name == key);
            let (_, place) = input.ok_or_else(|| {
                let names = INPUTS.map(|(name, _)| name).join(", ");
                PyValueError::new_err(format!("input {key} is refused; accepted: {names}"))
            })?;
            *place(&mut inputs) = on.extract()?;
        }
        let reported = self.control.cycle(self.signal.cycle(), &inputs);
        self.signal.command(reported.command);
        (0..PLAN_SLICES).all(|_| self.control.plan_step());
        report(py, &reported)
    }

    /// Whether the target is reached (READY).
    #[getter]
    fn ready(&self) -> bool {
        self.control.is_ready()
    }

    /// Requests another target, written as in a scene: `{"gear": 1}`, `{"k": 0.4}`.
    fn set_target(&mut self, given: &Bound<'_, PyDict>) -> PyResult<()> {
        if let Some(target) = target(given)? {
            self.control.set_target(target).map_err(Refused::from)?;
        }
        Ok(())
    }
}
