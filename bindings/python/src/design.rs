//! Feeder design: a Pareto front with the drive of a scene.

use std::cell::RefCell;
use std::num::NonZero;

use kband_scene::design::{CheckStop, Conveyed, Design, Designed, Feeder, Ranges, Workers};
use kband_scene::refusal::Refusal;
use pyo3::prelude::*;

use crate::refused::Refused;
use crate::scenes::{Given, scene};
use crate::work;

/// Threads of a call; an exception ends their work.
struct Threads<'py> {
    py: Python<'py>,
    count: Option<NonZero<usize>>,
    raised: RefCell<Option<PyErr>>,
}

impl Workers for Threads<'_> {
    fn map<T: Send + Sync>(
        &self,
        _: &str,
        count: usize,
        work: impl Fn(usize, CheckStop<'_>) -> Result<T, Refusal> + Sync + Send,
    ) -> Result<Vec<T>, Refusal> {
        let all = work::map(self.py, &[], count, self.count, |n, stop| {
            let check_stop = || match stop.is_requested() {
                true => Err(Refusal::interrupted()),
                false => Ok(()),
            };
            Ok(work(n, &check_stop)?)
        });
        all.map_err(|raised| {
            *self.raised.borrow_mut() = Some(raised);
            Refusal::interrupted()
        })
    }
}

/// Row of a feeder: frequency (Hz), b (mm), angle of throw, phase lead, incline (degrees), k, e,
/// th, e3, th3. Then share in gear, speed (m/s) and parts a minute, simulated and in the closed
/// loop. Last the changes of ln(parts a minute) and of the share, for 1 % of b, 1 % of the
/// frequency and 0.01 of R.
type Row = Vec<f64>;

/// Result of a design: the scene's own feeder, the best feeders, the front. Then the numbers of
/// candidates tried and within the limits, and the deviation of the table from simulated parts.
type DesignResult = (Option<Row>, Vec<Row>, Vec<Row>, [usize; 2], [f64; 4]);

/// Searches feeders with the drive of a scene; a range of `None` is the scene's own.
#[pyfunction]
pub fn design(
    py: Python<'_>,
    given: Given<'_>,
    ranges: [Option<[f64; 2]>; 6],
    candidates: usize,
    least_share: f64,
    checked: usize,
    seed: u64,
    threads: Option<NonZero<usize>>,
) -> PyResult<DesignResult> {
    let file = scene(&given)?;
    let of_scene = Ranges::from_scene(&file);
    let ranges = Ranges {
        frequency: ranges[0].unwrap_or(of_scene.frequency),
        amplitude: ranges[1].unwrap_or(of_scene.amplitude),
        throw_angle: ranges[2].unwrap_or(of_scene.throw_angle),
        phase_lead: ranges[3].unwrap_or(of_scene.phase_lead),
        incline: ranges[4].unwrap_or(of_scene.incline),
        tones: ranges[5].unwrap_or(of_scene.tones),
        candidates,
        least_share,
        checked,
        seed,
    };
    let workers = Threads {
        py,
        count: threads,
        raised: RefCell::new(None),
    };
    let outcome = Design::search(&file, &ranges, &workers);
    if let Some(raised) = workers.raised.into_inner() {
        return Err(raised);
    }
    let outcome = outcome.map_err(Refused::from)?;
    let gravity = f64::from(file.scene.settings.gravity);
    let numbers = |of: &Feeder| {
        let mut row = vec![of.frequency, of.amplitude(gravity), of.throw_angle];
        row.extend([of.phase_lead, of.incline, of.k]);
        row.extend(of.tones.as_flattened());
        row
    };
    let conveyed = |of: Option<Conveyed>| {
        of.map_or([f64::NAN; 3], |Conveyed { share, speed }| {
            [share, 1e-3 * speed, 60.0 * speed / file.part_length]
        })
    };
    let as_row = |of: &Designed| {
        let gradient = &of.sensitivity;
        let mut row = numbers(&of.feeder);
        row.extend(conveyed(Some(of.simulated)));
        row.extend(conveyed(of.closed));
        row.extend([gradient.amplitude, gradient.frequency, gradient.restitution].as_flattened());
        row
    };
    let front = outcome.front.iter().map(|(feeder, simulated)| {
        let mut row = numbers(feeder);
        row.extend(conveyed(Some(*simulated)));
        row.extend([f64::NAN; 9]);
        row
    });
    let of = &outcome.error;
    Ok((
        outcome.today.as_ref().map(as_row),
        outcome.best.iter().map(as_row).collect(),
        front.collect(),
        [outcome.tried, outcome.within],
        [of.share_rms, of.share_max, of.speed_rms, of.speed_max],
    ))
}
