//! Telemetry and events as rows.

use std::io::{Stdout, stdout};

use kband_control::wire::{Record, Telemetry};
use kband_control::{Event, Fault, Limits, State, UpperTone};

use crate::board::{Clock, Said};
use crate::refusal::Refusal;
use crate::report::{Column, Format, Value, fields, number, shortest};
use crate::stream::Stream;

const WIDTHS: [usize; 1 + BEFORE_THE_EVENT] = [
    9, 8, 9, 8, 8, 5, 8, 5, 8, 10, 17, 11, 10, 7, 13, 8, 9, 7, 6, 6, 6, 6, 7, 8, 10, 0,
];

/// A drive cycle: its time where the frequency is known, its number, and its telemetry.
type Cycle = (Option<f64>, u64, Telemetry);

fields! {
    /// A row of telemetry; rows of events have time, number and event alone.
    fn cycles(of: Cycle) {
        all TIME => of.0;
        all CYCLE => of.1;
        all STATE => State::numbered(of.2.state).map_or("unknown", State::name);
        // At rest k is beyond all bounds.
        all K.digits(4) => Some(of.2.k).filter(|k| *k < 1e4).map(shortest);
        all B.digits(4) => shortest(of.2.amplitude) * 1e3;
        all E.titled("e").digits(3) => tone(&of.2, 0).map(|tone| shortest(tone.ratio));
        all TH.digits(3) => tone(&of.2, 0).map(|tone| shortest(tone.phase));
        all E3.titled("e3").digits(3) => tone(&of.2, 1).map(|tone| shortest(tone.ratio));
        all TH3.digits(3) => tone(&of.2, 1).map(|tone| shortest(tone.phase));
        all OUTPUT.titled("output").digits(3) => shortest(of.2.output);
        all IMPACTS_DETECTED.titled("impacts (1/cycle)").digits(3) => shortest(of.2.rate);
        all PHASE_MEASURED.titled("phase (rad)").digits(3) => shortest(of.2.phase);
        all CONFIDENCE.digits(2) => shortest(of.2.confidence);
        all IN_GEAR.digits(2) => shortest(of.2.in_gear);
        all IN_GEAR_ERROR.digits(1) =>
            Some(of.2.in_gear_error).filter(|error| error.is_finite()).map(shortest);
        all IN_GEAR_EXPECTED.titled("expected").digits(2) =>
            Some(of.2.expected_in_gear).filter(|share| *share > 0.0).map(shortest);
        all GEAR_BAND_LOW.titled("band from").digits(4) =>
            of.2.gear_band.map(|[low, _]| shortest(low));
        all GEAR_BAND_HIGH.titled("to").digits(4) => of.2.gear_band.map(|[_, high]| shortest(high));
        all FLIP_ESTIMATED.titled("margin").digits(2) =>
            of.2.margin.map(|margin| shortest(margin.flip));
        all TRACE_ESTIMATED.titled("trace").digits(2) =>
            of.2.margin.map(|margin| shortest(margin.trace));
        all RESTITUTION_ESTIMATED.titled("R").digits(3) =>
            of.2.margin.map(|margin| shortest(margin.restitution));
        all SCATTER_ESTIMATED.titled("s").digits(2) =>
            of.2.margin.map(|margin| shortest(margin.scatter));
        all TO_LOSS_ESTIMATED.titled("to_loss (cycles)").digits(3) =>
            of.2.margin.map(|margin| shortest(margin.to_loss));
        all MASS_WEIGHED.titled("mass (g)").digits(4) => of.2.load.map(|load| shortest(load.mass));
        all FLOW_WEIGHED.titled("flow (g/s)").digits(4) =>
            of.2.load.filter(|load| load.flow != 0.0).map(|load| shortest(load.flow));
        all EVENT => held(&of.2);
    }
}

/// An upper tone, where one is made: noise without one says nothing.
fn tone(telemetry: &Telemetry, n: usize) -> Option<UpperTone> {
    let shape = telemetry.shape;
    (telemetry.overtones[n] != [0.0; 2]).then_some([shape.second, shape.third][n])
}

/// Columns of a row, each with its width in the table.
pub(in crate::verbs) fn columns() -> Vec<(Column, usize)> {
    cycles().columns().into_iter().zip(WIDTHS).collect()
}

pub(super) struct Rows {
    stream: Stream<Stdout>,
    row: Row,
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
            stream: Stream::new(format, columns(), stdout()),
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

    pub(super) fn close(&self) {
        eprintln!("{} rows of telemetry, {} events", self.cycles, self.events);
    }
}

impl Row {
    /// Takes the drive's frequency in Hz.
    pub fn set_frequency(&mut self, frequency: f32) {
        self.frequency = (frequency > 0.0).then_some(frequency.into());
    }

    fn time(&self, cycles: u64) -> Option<f64> {
        self.frequency.map(|frequency| cycles as f64 / frequency)
    }

    fn words(&self, cycles: u64, words: String) -> Vec<Value> {
        let mut row = vec![self.time(cycles).into(), cycles.into()];
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
        let number = self.clock.now(telemetry.cycle);
        cycles().row(&(self.time(number), number, *telemetry))
    }
}

/// Fault and limits of a cycle in words, where there are any.
fn held(telemetry: &Telemetry) -> Option<String> {
    let fault = Fault::numbered(telemetry.fault)
        .map(|fault| format!("fault {}: {}", fault.number(), fault.name()));
    let limits = Limits::ALL
        .iter()
        .filter(|limit| limit.bits() & telemetry.limits != 0);
    let limits = limits.map(|limit| format!("limit {}: {}", limit.number(), limit.name()));
    let held: Vec<String> = fault.into_iter().chain(limits).collect();
    (!held.is_empty()).then(|| held.join("; "))
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
            format!("{name}: {} g", number(record.mass, 3))
        }
        (Some(Event::Weighed), _) => format!(
            "{name}: {} g, {} g/s",
            number(record.mass, 3),
            number(record.flow, 3)
        ),
        _ => name,
    }
}
