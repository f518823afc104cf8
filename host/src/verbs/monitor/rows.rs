//! Telemetry, events and log as rows.

use std::io::{Stdout, stdout};

use kband_control::wire::{Record, Telemetry};
use kband_control::{Event, Fault, Limits, State, UpperTone};

use super::watch::Watch;
use crate::board::{Clock, Said};
use crate::refusal::Refusal;
use crate::report::{Column, Format, Value, columns, number, shortest};
use crate::stream::Stream;

/// Columns of a row, each with its width in the table.
pub(in crate::verbs) const COLUMNS: [(Column, usize); 1 + BEFORE_THE_EVENT] = [
    (columns::TIME, 9),
    (columns::CYCLE, 8),
    (columns::STATE, 9),
    (columns::K.digits(4), 8),
    (columns::B.digits(4), 8),
    (columns::E.titled("e").digits(3), 5),
    (columns::TH.digits(3), 8),
    (columns::E3.titled("e3").digits(3), 5),
    (columns::TH3.digits(3), 8),
    (columns::OUTPUT.titled("output").digits(3), 10),
    (
        columns::IMPACTS_DETECTED
            .titled("impacts (1/cycle)")
            .digits(3),
        17,
    ),
    (columns::PHASE_MEASURED.titled("phase (rad)").digits(3), 11),
    (columns::CONFIDENCE.digits(2), 10),
    (columns::IN_GEAR.digits(2), 7),
    (columns::IN_GEAR_ERROR.digits(1), 13),
    (columns::IN_GEAR_EXPECTED.titled("expected").digits(2), 8),
    (columns::GEAR_BAND_LOW.titled("band from").digits(4), 9),
    (columns::GEAR_BAND_HIGH.titled("to").digits(4), 7),
    (columns::FLIP_ESTIMATED.titled("margin").digits(2), 6),
    (columns::TRACE_ESTIMATED.titled("trace").digits(2), 6),
    (columns::RESTITUTION_ESTIMATED.titled("R").digits(3), 6),
    (columns::SCATTER_ESTIMATED.titled("s").digits(2), 6),
    (
        columns::TO_LOSS_ESTIMATED
            .titled("to_loss (cycles)")
            .digits(3),
        7,
    ),
    (columns::MASS_WEIGHED.titled("mass (g)").digits(4), 8),
    (columns::FLOW_WEIGHED.titled("flow (g/s)").digits(4), 10),
    (columns::EVENT, 0),
];

/// What is printed, row by row.
pub(super) struct Rows {
    stream: Stream<Stdout>,
    row: Row,
    /// Number of the next event.
    pub(super) next: u32,
    pub(super) cycles: u64,
    events: u64,
}

/// Rows of telemetry and events, with the board's time.
#[derive(Default)]
pub(in crate::verbs) struct Row {
    /// Drive frequency in Hz, once received.
    frequency: Option<f64>,
    clock: Clock,
}

/// Columns before that of the event.
const BEFORE_THE_EVENT: usize = 25;

impl Rows {
    pub(super) fn new(format: Format) -> Self {
        Self {
            stream: Stream::new(format, &COLUMNS, stdout()),
            row: Row::default(),
            next: 0,
            cycles: 0,
            events: 0,
        }
    }

    /// Prints it; whether there is still somebody who reads.
    pub(super) fn take(&mut self, said: Said) -> Result<bool, Refusal> {
        match said {
            Said::Setting(key, value) => {
                if key == "frequency" {
                    self.row.set_frequency(value);
                }
                Ok(true)
            }
            Said::Telemetry(telemetry) => {
                self.cycles += 1;
                self.stream.row(&self.row.cycle(&telemetry))
            }
            Said::Event(event) => {
                // Requested twice where an answer was late.
                if (event.number.wrapping_sub(self.next) as i32) < 0 {
                    return Ok(true);
                }
                self.next = event.number.wrapping_add(1);
                self.events += 1;
                self.stream.row(&self.row.event(&event))
            }
            Said::Started(image) => {
                self.next = 0;
                self.stream.row(&self.row.start(&image))
            }
        }
    }

    /// Prints what is new in a log; whether there is still somebody who reads.
    pub(super) fn log(&mut self, watch: &mut Watch) -> Result<bool, Refusal> {
        for words in watch.lines()? {
            let mut row = vec![Value::Missing; BEFORE_THE_EVENT];
            row.push(words.into());
            if !self.stream.row(&row)? {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// Says how much it was.
    pub(super) fn close(&self) {
        eprintln!("{} rows of telemetry, {} events", self.cycles, self.events);
    }
}

impl Row {
    /// Takes the drive's frequency in Hz.
    pub fn set_frequency(&mut self, frequency: f32) {
        self.frequency = (frequency > 0.0).then_some(frequency.into());
    }

    /// Time and number of a cycle.
    fn when(&self, cycles: u64) -> Vec<Value> {
        let time = self.frequency.map(|frequency| cycles as f64 / frequency);
        vec![time.into(), cycles.into()]
    }

    fn words(&self, cycles: u64, words: String) -> Vec<Value> {
        let mut row = self.when(cycles);
        row.resize(BEFORE_THE_EVENT, Value::Missing);
        row.push(words.into());
        row
    }

    /// The row of an event.
    pub fn event(&self, record: &Record) -> Vec<Value> {
        self.words(self.clock.then(record.cycle), happened(record))
    }

    /// The row of a board's start with this image; its count begins anew.
    pub fn start(&mut self, image: &str) -> Vec<Value> {
        self.clock = Clock::default();
        self.words(0, format!("the board started: kband {image}"))
    }

    /// The row of a drive cycle.
    pub fn cycle(&mut self, telemetry: &Telemetry) -> Vec<Value> {
        let state = State::numbered(telemetry.state);
        let held = held(telemetry);
        // Only where one is made: what noise looks like without one says nothing.
        let made = |n: usize, tone: UpperTone| (telemetry.overtones[n] != [0.0; 2]).then_some(tone);
        let [second, third] = [
            made(0, telemetry.shape.second),
            made(1, telemetry.shape.third),
        ];
        let cycles = self.clock.now(telemetry.cycle);
        let mut row = self.when(cycles);
        row.extend([
            state.map_or("unknown", |state| state.name()).into(),
            // At rest k is beyond all bounds.
            Some(telemetry.k).filter(|k| *k < 1e4).map(shortest).into(),
            (shortest(telemetry.amplitude) * 1e3).into(),
            second.map(|tone| shortest(tone.ratio)).into(),
            second.map(|tone| shortest(tone.phase)).into(),
            third.map(|tone| shortest(tone.ratio)).into(),
            third.map(|tone| shortest(tone.phase)).into(),
            shortest(telemetry.output).into(),
            shortest(telemetry.rate).into(),
            shortest(telemetry.phase).into(),
            shortest(telemetry.confidence).into(),
            shortest(telemetry.in_gear).into(),
            Some(telemetry.in_gear_error)
                .filter(|error| error.is_finite())
                .map(shortest)
                .into(),
            Some(telemetry.expected_in_gear)
                .filter(|share| *share > 0.0)
                .map(shortest)
                .into(),
            telemetry.gear_band.map(|[low, _]| shortest(low)).into(),
            telemetry.gear_band.map(|[_, high]| shortest(high)).into(),
            telemetry.margin.map(|margin| shortest(margin.flip)).into(),
            telemetry.margin.map(|margin| shortest(margin.trace)).into(),
            (telemetry.margin)
                .map(|margin| shortest(margin.restitution))
                .into(),
            telemetry
                .margin
                .map(|margin| shortest(margin.scatter))
                .into(),
            telemetry
                .margin
                .map(|margin| shortest(margin.to_loss))
                .into(),
            telemetry.load.map(|load| shortest(load.mass)).into(),
            (telemetry.load)
                .filter(|load| load.flow != 0.0)
                .map(|load| shortest(load.flow))
                .into(),
            if held.is_empty() {
                Value::Missing
            } else {
                held.into()
            },
        ]);
        row
    }
}

/// Fault and limits of a cycle in words.
fn held(telemetry: &Telemetry) -> String {
    let fault = Fault::numbered(telemetry.fault)
        .map(|fault| format!("fault {}: {}", fault.number(), fault.name()));
    let limits = Limits::ALL
        .iter()
        .filter(|limit| limit.bits() & telemetry.limits != 0);
    let limits = limits.map(|limit| format!("limit {}: {}", limit.number(), limit.name()));
    fault
        .into_iter()
        .chain(limits)
        .collect::<Vec<_>>()
        .join("; ")
}

fn happened(record: &Record) -> String {
    let event = Event::numbered(record.event);
    let name = event.map_or_else(
        || format!("event {}", record.event),
        |event| event.name().into(),
    );
    let fault = Fault::numbered(record.fault);
    match (event, fault) {
        (Some(Event::Faulted), Some(fault)) => {
            format!("{name}: {} (fault {})", fault.name(), fault.number())
        }
        (Some(Event::Weighed), _) if record.flow == 0.0 => {
            format!("{name}: {} g", number(record.mass.into(), 3))
        }
        (Some(Event::Weighed), _) => format!(
            "{name}: {} g, {} g/s",
            number(record.mass.into(), 3),
            number(record.flow.into(), 3)
        ),
        _ => name,
    }
}
