//! Link to the desk: answers requests, sends telemetry, counts invalid frames.
//!
//! The link must not delay the control. A drive cycle answers a limited number of requests; further
//! ones are counted and dropped. Other tasks run after each request and each block of input.
//! Telemetry that does not fit the line is dropped; an answer waits for at most 100 ms.

use crate::access::LinkLock;
use crate::bus::Registers;
use crate::station::{Result, Station, out_of_range};
use crate::storage::store::{Condition, LoadedSettings, Records, StoreFailed};
use crate::storage::waiting::Waiting;
use crate::update::{Slot, Update};
use core::borrow::BorrowMut;
use core::future::Future;
use embassy_futures::select::{Either, select};
use embassy_futures::yield_now;
use embedded_storage_async::nor_flash::NorFlash;
use kband_bus::{Answer, SaveProgress};
use kband_control::wire::{
    Access, Counters, Identity, Incoming, MAX_FRAME_BYTES, Pin, Receiver, Refusal, Request,
    Response, SCHEMA, SavedSettings, SelfTest, SetUp, Setting, TELEMETRY_FRAME, Telemetry, VERSION,
    read_reading, read_request, update_output_check, write_identity, write_response,
    write_update_answer,
};
use kband_control::{AdcCode, Inputs, PLAN_SLICES, Settings, Signal, StartCause, Target};

/// Number of requests answered in a drive cycle. The most expensive request takes 81 196
/// instructions (counted). Thirty-two take 2.6 of the 3.36 million core cycles at 50 Hz.
const MAX_REQUESTS_PER_CYCLE: u8 = 32;
/// Largest mean acceleration at rest, m/s^2: 9.81 along the sensor's axis and an error of 20 %.
const MAX_MEAN_AT_REST: f32 = 11.8;

/// Longest time that an answer waits for room on the line, ms.
const ANSWER_WAIT_MS: u32 = 100;
/// Share of the line's rate for telemetry, percent; the rest is for answers.
const MAX_TELEMETRY_SHARE_PERCENT: u64 = 80;

/// A serial line to the desk.
pub trait Line {
    /// Waits for input, copies it to `bytes` and returns the number of bytes.
    fn read(&mut self, bytes: &mut [u8]) -> impl Future<Output = usize>;

    /// Sends a whole frame; returns false, with nothing sent, if there is no room for it.
    fn send(&mut self, frame: &[u8]) -> bool;

    /// Waits for 1 ms.
    fn millisecond(&mut self) -> impl Future<Output = ()>;
}

/// Properties of the running image.
#[derive(Clone, Copy, Debug)]
pub struct Image {
    /// Name, version and build.
    pub identity: &'static str,
    /// Number of stack bytes that were never used.
    pub stack_free: fn() -> u32,
    /// Configuration of the chip.
    pub set_up: fn() -> SetUp,
    /// Rate of the line, bytes a second.
    pub line_rate: u32,
    /// Whether the strap that makes the link read-only is wired to ground.
    pub strapped: fn() -> bool,
    /// The slot for an update; `None` on a board without one.
    pub slot: Option<Slot>,
}

/// The board's side of the link.
pub struct Service<F, W> {
    image: Image,
    store: Records<F, W>,
    receiver: Receiver,
    /// Counters since the start.
    pub counters: Counters,
    allowance: u8,
    lock: LinkLock,
    update: Update,
    telemetry_interval: u16,
    cycles_since_telemetry: u16,
    simulation: Option<Simulation>,
    buffer: [u8; MAX_FRAME_BYTES],
}

/// The signal path of a plant that the desk simulates.
#[derive(Clone)]
struct Simulation {
    signal: Signal,
    /// Last converter reading, counts.
    code: u16,
    /// Checksum of the outputs of this cycle.
    outputs: u32,
}

impl<F: NorFlash, W: BorrowMut<Waiting>> Service<F, W> {
    /// Builds the service with telemetry off; `pin` is the PIN saved with the settings.
    pub fn new(image: Image, store: Records<F, W>, pin: Option<Pin>) -> Self {
        Self {
            image,
            store,
            receiver: Receiver::new(),
            counters: Counters::default(),
            allowance: MAX_REQUESTS_PER_CYCLE,
            lock: LinkLock::new(pin),
            update: Update::new(image.slot),
            telemetry_interval: 0,
            cycles_since_telemetry: 0,
            simulation: None,
            buffer: [0; MAX_FRAME_BYTES],
        }
    }

    /// Processes one received byte; returns the answer when a request is complete.
    pub async fn take(&mut self, byte: u8, station: &Station) -> Option<&[u8]> {
        let Self {
            image,
            store,
            receiver,
            counters,
            allowance,
            lock,
            update,
            telemetry_interval: every,
            simulation,
            buffer,
            ..
        } = self;
        let (sequence, incoming) = match receiver.push(byte)?.and_then(read_request) {
            Ok(incoming) => incoming,
            Err(cause) => {
                counters.count(cause);
                return None;
            }
        };
        station.frame_received.set(true);
        // During a simulation the drive is off, so requests need no limit.
        if simulation.is_none() {
            let Some(remaining) = allowance.checked_sub(1) else {
                counters.flooded = counters.flooded.wrapping_add(1);
                return None;
            };
            *allowance = remaining;
        }
        counters.requests = counters.requests.wrapping_add(1);
        let frame = match incoming {
            Incoming::Identity => write_identity(buffer, sequence, &identity(image)),
            Incoming::Update(request) => {
                let strapped = (image.strapped)();
                let answer = update
                    .answer(&request, lock, strapped, station, store)
                    .await;
                write_update_answer(buffer, sequence, &answer)
            }
            Incoming::Request(request) => {
                let access = lock.access((image.strapped)());
                let response = match request {
                    Request::Bus(adu) => {
                        let read_only = access != Access::Full;
                        return answer_bus(buffer, sequence, adu, read_only, image, station);
                    }
                    _ if changes(&request) && access != Access::Full => {
                        Response::Refused(Refusal::ReadOnly(access))
                    }
                    _ if station.bus_controls() && commands(&request) => {
                        Response::Refused(Refusal::NotInControl)
                    }
                    Request::Telemetry(cycles) => {
                        telemetry(cycles, every, &station.settings(), image.line_rate)
                    }
                    Request::Simulate { target, start } => {
                        begin_simulation(simulation, target, start, station)
                    }
                    Request::Samples { codes, end } => {
                        run_samples(simulation, codes, end, station).await
                    }
                    Request::Save | Request::Lock(_) => {
                        let mut locked = *lock;
                        if let Request::Lock(pin) = request {
                            locked = LinkLock::new(pin);
                        }
                        let saved = store.save_settings(station, locked.pin).await;
                        if saved.is_ok() {
                            *lock = locked;
                        }
                        done(saved)
                    }
                    Request::SaveRecipes => done(store.save_recipes_in_use(station).await),
                    Request::Unlock(pin) => done(lock.unlock(pin, station.seconds())),
                    Request::Status => Response::Status(station.status(access)),
                    Request::Alive => Response::Done,
                    Request::Setting(number) => setting(station, Some(usize::from(number))),
                    Request::Get(key) => setting(station, setting_position(key)),
                    Request::Set { key, value } => done(set(station, key, value)),
                    Request::Defaults => done(station.restore_defaults()),
                    Request::Target(target) => done(station.set_target(target)),
                    Request::Enable(enabled) => {
                        station.withheld.set(!enabled);
                        Response::Done
                    }
                    Request::Recipe(number) => Response::Recipe(station.stored_recipe(number)),
                    Request::SetRecipe { number, recipe } => {
                        done(station.set_recipe(number, recipe.as_ref()))
                    }
                    Request::UseRecipe(number) => done(station.use_recipe(number)),
                    Request::Event(number) => Response::Event(station.event(number)),
                    Request::SelfTest | Request::Fault(_) if !station.at_rest() => {
                        Response::Refused(Refusal::Running)
                    }
                    Request::SelfTest => {
                        Response::SelfTest(self_test(station, &store.load().await, image))
                    }
                    Request::Counters => Response::Counters(*counters),
                    Request::LastWords => Response::LastWords(station.last_words.read()),
                    Request::Identification => Response::Identification(station.identification()),
                    Request::Held => Response::Held(station.target()),
                    Request::Fault(back) => Response::Fault(store.fault(back.into()).await),
                };
                write_response(buffer, sequence, &response)
            }
        };
        frame.ok()
    }

    /// Stores new and waiting faults while the drive is at rest.
    pub async fn keep_fault(&mut self, station: &Station) {
        if station.at_rest() {
            if let Some(fault) = station.unsaved_fault.take() {
                self.store.take_fault(&fault);
            }
            self.store.keep_faults().await;
        }
    }

    /// Carries out saves requested by the fieldbus, and reports whether settings may change.
    pub async fn serve_bus(&mut self, station: &Station) {
        let access = self.lock.access((self.image.strapped)());
        station.bus.writable.set(access == Access::Full);
        if station.bus.save.get() == SaveProgress::Pending {
            let saved = self.store.save_settings(station, self.lock.pin).await;
            station.bus.save.set(match saved {
                Ok(()) => SaveProgress::Done,
                Err(_) => SaveProgress::Failed,
            });
        }
    }

    /// Ends a drive cycle; returns the telemetry frame if one is due.
    pub fn tick(&mut self, station: &Station) -> Option<&[u8]> {
        self.allowance = MAX_REQUESTS_PER_CYCLE;
        self.update.tick(station);
        if self.telemetry_interval == 0 {
            return None;
        }
        self.cycles_since_telemetry = self.cycles_since_telemetry.saturating_add(1);
        if self.cycles_since_telemetry < self.telemetry_interval {
            return None;
        }
        self.cycles_since_telemetry = 0;
        let telemetry = Response::Telemetry(Telemetry::from(&station.report()));
        write_response(&mut self.buffer, 0, &telemetry).ok()
    }
}

fn identity(image: &Image) -> Identity<'static> {
    Identity {
        version: VERSION,
        schema: SCHEMA,
        image: image.identity,
    }
}

/// Answers a request of Modbus for any unit, in the bus's session; empty without an answer. A
/// separate call keeps the stack small.
#[inline(never)]
fn answer_bus<'b>(
    buffer: &'b mut [u8; MAX_FRAME_BYTES],
    sequence: u8,
    adu: &[u8],
    read_only: bool,
    image: &Image,
    station: &Station,
) -> Option<&'b [u8]> {
    let mut registers = Registers {
        station,
        image: image.identity,
        read_only,
    };
    let mut answer = Answer::new();
    let mut server = station.bus.server.borrow_mut();
    server.answer(adu, &mut registers, &mut answer);
    write_response(buffer, sequence, &Response::Bus(&answer)).ok()
}

fn self_test(station: &Station, loaded: &LoadedSettings, image: &Image) -> SelfTest {
    SelfTest {
        sensor: station.mean.get().abs() <= MAX_MEAN_AT_REST,
        settings: match loaded.condition {
            Condition::Whole if station.uses(loaded) => SavedSettings::InUse,
            Condition::Whole => SavedSettings::Different,
            Condition::Never => SavedSettings::Never,
            Condition::Lost | Condition::Newer => SavedSettings::Damaged,
        },
        stack_free: (image.stack_free)(),
        missed: station.exchange.missed(),
        set_up: SetUp {
            control: station.longest.get(),
            ..(image.set_up)()
        },
    }
}

fn changes(request: &Request<'_>) -> bool {
    matches!(
        request,
        Request::Set { .. }
            | Request::Defaults
            | Request::Target(_)
            | Request::Save
            | Request::SetRecipe { .. }
            | Request::SaveRecipes
            | Request::UseRecipe(_)
            | Request::Lock(_)
            | Request::Simulate { .. }
            | Request::Samples { .. }
    )
}

/// Whether a request commands the drive, which only the party in control may do. The settings of
/// the bus are no command: they determine who is in control.
fn commands(request: &Request<'_>) -> bool {
    match request {
        Request::Set { key, .. } => !key.starts_with("bus"),
        Request::Save | Request::SaveRecipes | Request::Lock(_) => false,
        _ => changes(request),
    }
}

/// Sets the number of drive cycles between telemetry frames; refused if the line is too slow.
fn telemetry(cycles: u16, every: &mut u16, settings: &Settings, rate: u32) -> Response<'static> {
    let frequency = (settings.frequency + settings.tracking) as u64 + 1;
    let bytes = frequency * TELEMETRY_FRAME as u64 * 100;
    let fewest = (bytes.div_ceil(u64::from(rate) * MAX_TELEMETRY_SHARE_PERCENT)).max(1);
    if cycles > 0 && u64::from(cycles) < fewest {
        return Response::Refused(Refusal::Faster(fewest as u16));
    }
    *every = cycles;
    Response::Done
}

impl<F: NorFlash, W: BorrowMut<Waiting>> Records<F, W> {
    /// Whether the memory may be written now: at rest, with a good supply, at a rate it endures.
    fn take_save(&mut self, station: &Station) -> Result {
        if !station.at_rest() {
            Err(Refusal::Running)
        } else if !self.supply_is_good() {
            Err(Refusal::SupplyLow)
        } else if !self.saves.take_save(station.seconds()) {
            Err(Refusal::TooOften)
        } else {
            Ok(())
        }
    }

    async fn save_settings(&mut self, station: &Station, pin: Option<Pin>) -> Result {
        self.take_save(station)?;
        let saved = self.save(&station.settings(), station.target(), pin).await;
        saved.map_err(refusal_of)?;
        station.saved();
        Ok(())
    }

    async fn save_recipes_in_use(&mut self, station: &Station) -> Result {
        self.take_save(station)?;
        let recipes = station.recipes.borrow().clone();
        self.save_recipes(&recipes).await.map_err(refusal_of)
    }
}

fn refusal_of(cause: StoreFailed) -> Refusal<'static> {
    match cause {
        StoreFailed::SupplyLow => Refusal::SupplyLow,
        StoreFailed::Memory => Refusal::Store,
        StoreFailed::NoSettings => Refusal::NoSettings,
    }
}

/// Starts a simulation by the desk; a separate call keeps the stack small.
#[inline(never)]
fn begin_simulation(
    simulation: &mut Option<Simulation>,
    target: Target,
    start: StartCause,
    station: &Station,
) -> Response<'static> {
    done(station.simulate(target, start).map(|signal| {
        *simulation = Some(Simulation {
            signal,
            code: 0,
            outputs: 0,
        });
    }))
}

/// Runs signal path and controller over readings of a simulated converter.
async fn run_samples(
    simulation: &mut Option<Simulation>,
    mut codes: &[u8],
    end: Option<Inputs>,
    station: &Station,
) -> Response<'static> {
    let Some(simulation) = simulation else {
        return Response::Refused(Refusal::OutOfStep);
    };
    // A refused request must change nothing, so the samples first run on a copy.
    let mut trial = simulation.clone();
    let mut wrapped = false;
    while !codes.is_empty() {
        let Some(next) = read_reading(&mut codes, trial.code) else {
            return Response::Refused(Refusal::OutOfStep);
        };
        trial.code = next;
        let sampled = trial.signal.sample(AdcCode(next));
        trial.outputs = update_output_check(trial.outputs, sampled.output);
        wrapped = sampled.wrapped;
        if wrapped && !(codes.is_empty() && end.is_some()) {
            return Response::Refused(Refusal::OutOfStep);
        }
    }
    if end.is_some() && !wrapped {
        return Response::Refused(Refusal::OutOfStep);
    }
    *simulation = trial;
    let Some(inputs) = end else {
        return Response::Done;
    };
    let report = station.simulated_cycle(simulation.signal.cycle(), inputs);
    simulation.signal.command(report.command);
    for _ in 0..PLAN_SLICES {
        if !station.plan_step() {
            break;
        }
        yield_now().await;
    }
    Response::Cycle {
        outputs: core::mem::take(&mut simulation.outputs),
        report,
    }
}

fn setting_position(key: &str) -> Option<usize> {
    Settings::KEYS.iter().position(|entry| entry.name == key)
}

fn set(station: &Station, key: &str, value: f32) -> Result {
    setting_position(key).ok_or(Refusal::Unknown)?;
    let mut settings = station.settings();
    settings.set(key, value).map_err(out_of_range)?;
    station.set_settings(&settings)
}

fn setting(station: &Station, number: Option<usize>) -> Response<'static> {
    let entry = number.and_then(|number| Some((number, Settings::KEYS.get(number)?)));
    let Some((number, entry)) = entry else {
        return Response::Refused(Refusal::Unknown);
    };
    Response::Setting(Setting {
        number: number as u8,
        key: entry.name,
        unit: entry.unit,
        value: station.settings().values()[number],
        low: entry.low,
        high: entry.high,
        default: entry.default,
    })
}

fn done(result: Result) -> Response<'static> {
    result.map_or_else(Response::Refused, |()| Response::Done)
}

/// Sends an answer once the line has room for it, within 100 ms; returns whether it was sent.
async fn send_answer(line: &mut impl Line, frame: &[u8]) -> bool {
    for _ in 1..=ANSWER_WAIT_MS {
        if line.send(frame) {
            return true;
        }
        line.millisecond().await;
    }
    line.send(frame)
}

/// The link's task. It has no deadline and no watchdog. If it hangs, the drive behaves as for a
/// lost link (limit 7).
///
/// The service is borrowed: an async function keeps two copies of an argument taken by value.
pub async fn link(
    service: &mut Service<impl NorFlash, impl BorrowMut<Waiting>>,
    mut line: impl Line,
    station: &Station,
) -> ! {
    service.update.begin_trial(station);
    station.recipes.replace(service.store.recipes().await);
    // Without a request, so that the desk detects a reset.
    if let Ok(frame) = write_identity(&mut service.buffer, 0, &identity(&service.image)) {
        line.send(frame);
    }
    let mut bytes = [0; 64];
    loop {
        // The end of a cycle has priority, so that continuous input cannot block telemetry.
        match select(station.tick.wait(), line.read(&mut bytes)).await {
            Either::First(()) => {
                let sent = service.tick(station).is_none_or(|frame| line.send(frame));
                let dropped = &mut service.counters.rows_dropped;
                *dropped = dropped.wrapping_add((!sent).into());
                service.keep_fault(station).await;
                service.serve_bus(station).await;
            }
            Either::Second(count) => {
                for &byte in bytes.iter().take(count) {
                    if let Some(frame) = service.take(byte, station).await {
                        let sent = send_answer(&mut line, frame).await;
                        let dropped = &mut service.counters.answers_dropped;
                        *dropped = dropped.wrapping_add((!sent).into());
                        // The control task runs between two requests.
                        yield_now().await;
                    }
                }
            }
        }
        yield_now().await;
    }
}

#[cfg(test)]
pub(crate) mod tests;
