//! A board: settings, targets, telemetry.

use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use kband_control::wire::{Request, Telemetry};
use kband_control::{Fault, State};
use kband_link::{BoardMessage, BoardSettings, Emulated, Link};
use kband_scene::describe;
use kband_scene::refusal::Refusal;
use pyo3::exceptions::PyConnectionError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::refused::{Refused, message};
use crate::scenes::target;

/// Longest time for which telemetry is collected at once.
const LISTEN: Duration = Duration::from_millis(200);

/// The link to a board; it checks for Ctrl-C while it waits.
#[pyclass]
pub struct Board {
    link: Mutex<Link>,
    raised: Arc<Mutex<Option<PyErr>>>,
}

/// Key, unit, value, lowest and highest accepted value, and default of a setting.
type Setting = (String, String, f32, f32, f32, f32);

/// Exception of a refusal: Ctrl-C if it ended the wait, `ValueError` for a value out of range, else
/// `ConnectionError`.
fn exception(refusal: Refusal, raised: &Mutex<Option<PyErr>>) -> PyErr {
    let raised = raised.lock().unwrap_or_else(PoisonError::into_inner).take();
    raised.unwrap_or_else(|| {
        if refusal.is_of_value() {
            return Refused::from(refusal).into();
        }
        PyConnectionError::new_err(message(&refusal))
    })
}

impl Board {
    /// Uses the link with the interpreter's lock released.
    fn with<T: Send>(
        &mut self,
        py: Python<'_>,
        work: impl FnOnce(&mut Link) -> Result<T, Refusal> + Send,
    ) -> PyResult<T> {
        let link = self.link.get_mut().unwrap_or_else(PoisonError::into_inner);
        let done = py.detach(|| work(link));
        done.map_err(|refusal| exception(refusal, &self.raised))
    }
}

#[pymethods]
impl Board {
    /// Opens the link to the emulated CPU (`qemu`, with its image) or to a serial port.
    #[new]
    fn new(py: Python<'_>, on: &str, image: Option<PathBuf>, running: bool) -> PyResult<Self> {
        let raised = Arc::new(Mutex::new(None));
        let slot = Arc::clone(&raised);
        let check_stop = Box::new(move || {
            Python::attach(|py| py.check_signals()).map_err(|error| {
                *slot.lock().unwrap_or_else(PoisonError::into_inner) = Some(error);
                Refusal::interrupted()
            })
        });
        let emulated = if running {
            Emulated::Running
        } else {
            Emulated::AtRest
        };
        let link = py.detach(|| {
            let link = if on == "qemu" {
                Link::emulate([image.as_deref(), None], emulated, check_stop)
            } else {
                Link::open(on.as_ref(), check_stop)
            };
            link.and_then(|link| link.check_protocol().map(|()| link))
        });
        let link = link.map_err(|refusal| exception(refusal, &raised))?;
        Ok(Self {
            link: Mutex::new(link),
            raised,
        })
    }

    /// Name, version and build of the board's image.
    fn image(&mut self) -> String {
        let link = self.link.get_mut().unwrap_or_else(PoisonError::into_inner);
        link.image().into()
    }

    fn settings(&mut self, py: Python<'_>) -> PyResult<Vec<Setting>> {
        let read = self.with(py, BoardSettings::read)?;
        let all = read.iter().cloned();
        let of_each = all.map(|of| (of.key, of.unit, of.value, of.low, of.high, of.default));
        Ok(of_each.collect())
    }

    fn change(&mut self, py: Python<'_>, wanted: Vec<(String, f32)>) -> PyResult<()> {
        self.with(py, |link| BoardSettings::read(link)?.change(link, &wanted))
    }

    fn save(&mut self, py: Python<'_>) -> PyResult<()> {
        self.with(py, |link| link.command(&Request::Save))
    }

    /// The target in words.
    fn target(&mut self, py: Python<'_>) -> PyResult<String> {
        self.with(py, |link| link.target().map(describe))
    }

    /// Requests another target, written as in a scene: `{"gear": 1}`, `{"k": 0.4}`.
    fn set_target(&mut self, py: Python<'_>, given: &Bound<'_, PyDict>) -> PyResult<()> {
        let requested = target(given)?;
        self.with(py, |link| {
            requested.map_or(Ok(()), |target| link.command(&Request::Target(target)))
        })
    }

    /// Stops the drive over the link, or removes that stop.
    fn enable(&mut self, py: Python<'_>, on: bool) -> PyResult<()> {
        self.with(py, |link| link.command(&Request::Enable(on)))
    }

    /// Telemetry over some seconds, one row per `every` drive cycles. Columns: cycle, b in m, its
    /// setpoint, k, output, share in gear, its error, and the numbers of state and fault.
    fn telemetry(&mut self, py: Python<'_>, seconds: f64, every: u16) -> PyResult<Vec<[f64; 9]>> {
        self.with(py, |link| {
            link.begin_telemetry(every)?;
            let end = Instant::now() + Duration::from_secs_f64(seconds);
            let mut rows = Vec::new();
            while Instant::now() < end {
                let remaining = end.saturating_duration_since(Instant::now());
                let messages = link.listen(remaining.min(LISTEN))?.into_iter();
                rows.extend(messages.filter_map(|message| match message {
                    BoardMessage::Telemetry(telemetry) => Some(row(&telemetry)),
                    _ => None,
                }));
            }
            link.command(&Request::Telemetry(0))?;
            Ok(rows)
        })
    }
}

fn row(telemetry: &Telemetry) -> [f64; 9] {
    [
        telemetry.cycle.into(),
        telemetry.amplitude.into(),
        telemetry.setpoint.into(),
        telemetry.k.into(),
        telemetry.output.into(),
        telemetry.in_gear.into(),
        telemetry.in_gear_error.into(),
        telemetry.state.into(),
        telemetry.fault.into(),
    ]
}

/// Name of a state.
#[pyfunction]
pub fn state_name(number: u8) -> &'static str {
    State::numbered(number).map_or("unknown", State::name)
}

/// Name of a fault; `None` for 0.
#[pyfunction]
pub fn fault_name(number: u8) -> Option<&'static str> {
    Fault::numbered(number).map(Fault::name)
}
