//! Fault scenarios of `docs/safety.md` for an image on the emulated chip.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use crate::chip::Hang;
use crate::chip::kind::Kind;
use crate::chip::world::Seen;
use crate::images::feeder_on;
use crate::rig::{Act, Rig, chip_of, ticks};
use kband_control::wire::Request;
use kband_control::{Settings, Target};
use kband_plant::{Change, Scene};

/// Time at which the enable input comes on, s. The settings are saved, and the fault of the first
/// start without them is acknowledged.
pub const ENABLE_TIME: f64 = 1.1;
/// Time at which a board has its settings, s.
const COMMISSIONED_TIME: f64 = 1.0;
/// Time of the first failure, s.
const FAILURE_TIME: f64 = 2.5;

/// A scenario: a working machine, then a failure.
#[derive(Clone, Debug)]
pub struct Hazard {
    /// Name of the scenario.
    pub name: &'static str,
    /// The machine and the configured settings.
    pub scene: Scene,
    /// The requested target.
    pub target: Target,
    /// Times in s and the failures.
    pub acts: Vec<(f64, Act)>,
    /// Time of the first failure, s.
    pub from: f64,
    /// End of the scenario, s.
    pub until: f64,
}

/// Result of a scenario.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// Amplitude of the track before the failure, mm.
    pub before: f64,
    /// Largest displacement of the track after the failure, mm.
    pub largest: f64,
    /// Amplitude at the end, mm.
    pub after: f64,
    /// Time from the first failure until the bridge opens, s.
    pub opens: Option<f64>,
    /// Time from the first failure until the lamp FAULT is on, s.
    pub fault: Option<f64>,
    /// Time at which the lamp READY is first on, s.
    pub ready: Option<f64>,
    /// The board at the end.
    pub rig: Rig,
}

impl Hazard {
    /// A machine with this frequency in Hz and target, without parts and without a failure.
    pub fn of(name: &'static str, frequency: f32, target: Target) -> Self {
        let mut scene = Scene::default();
        scene.parts.clear();
        scene.settings.frequency = frequency;
        scene.settings.resonance = frequency;
        scene.drive.resonance = frequency;
        Self {
            name,
            scene,
            target,
            acts: Vec::new(),
            from: FAILURE_TIME,
            until: 4.3,
        }
    }

    /// Changes the scene.
    pub fn with(mut self, change: impl FnOnce(&mut Scene)) -> Self {
        change(&mut self.scene);
        self
    }

    /// Sets the failures; the first one gives the start.
    pub fn acts(mut self, acts: impl IntoIterator<Item = (f64, Act)>) -> Self {
        self.acts = acts.into_iter().collect();
        self.from = self.acts.first().map_or(self.from, |act| act.0);
        self
    }

    /// Sets the end, s.
    pub fn end(mut self, seconds: f64) -> Self {
        self.until = seconds;
        self
    }

    /// A board with this chip, its machine's settings set and saved.
    fn commission(&self, kind: Kind) -> Rig {
        let mut rig = Rig::with(chip_of(kind, &feeder_on(kind)), &self.scene);
        rig.chip.power_on();
        rig.run(0.3);
        let told = self.scene.settings.values();
        let defaults = Settings::default().values();
        // Two passes: a value may be refused until related values are set.
        for _ in 0..2 {
            for ((key, value), default) in Settings::KEYS.iter().zip(told).zip(defaults) {
                if value != default {
                    rig.send(&Request::set(key.name, value));
                }
            }
        }
        rig.send(&Request::Target(self.target))
            .send(&Request::Save)
            .run(COMMISSIONED_TIME);
        rig
    }

    /// A board with this chip at the first failure. The common part of scenarios runs once.
    pub fn before(&self, kind: Kind) -> Rig {
        cached_rig(format!("{} {}", self.machine(kind), self.from), || {
            let mut rig = self.commissioned(kind);
            self.run_to_failure(&mut rig);
            rig
        })
    }

    /// A commissioned board with this chip; made once for each machine and target.
    pub fn commissioned(&self, kind: Kind) -> Rig {
        cached_rig(self.machine(kind), || self.commission(kind))
    }

    /// Name of its machine and target.
    fn machine(&self, kind: Kind) -> String {
        let Self { scene, target, .. } = self;
        format!("{kind:?} {scene:?} {target:?}")
    }

    /// Sends a frame of the desk every 0.3 s between two times.
    fn send_alive(rig: &mut Rig, from: f64, to: f64) {
        let times = (0..).map(|n| COMMISSIONED_TIME + 0.3 * f64::from(n));
        let times = times.take_while(|time| *time < to);
        for time in times.skip_while(|time| *time < from) {
            let frame = rig.frame(&Request::Alive);
            rig.at(time, Act::Link(frame));
        }
    }

    /// Runs the board up to the first failure.
    fn run_to_failure(&self, rig: &mut Rig) {
        Self::send_alive(rig, COMMISSIONED_TIME, self.from);
        rig.at(ENABLE_TIME, Act::Enable(true)).run(self.from);
    }

    /// Runs the scenario from a commissioned board, or from one at the first failure.
    pub fn play(&self, mut rig: Rig) -> Outcome {
        if rig.time() < self.from {
            self.run_to_failure(&mut rig);
        }
        Self::send_alive(&mut rig, self.from, self.until);
        for (time, act) in &self.acts {
            rig.at(*time, act.clone());
        }
        let before = rig.amplitude();
        rig.peak();
        rig.run(self.until);
        let fault = rig.seen_after(self.from, &Seen::Fault(true));
        Outcome {
            before,
            largest: rig.peak(),
            after: rig.amplitude(),
            opens: rig.opens_after(self.from),
            fault: fault.map(|time| time - self.from),
            ready: rig.seen_after(ENABLE_TIME, &Seen::Ready(true)),
            rig,
        }
    }
}

/// Plays a scenario on a chip, which may not be reset by it. "drive on" must follow the bridge.
///
/// # Panics
/// It is reset, or "drive on" differs.
pub fn play(kind: Kind, hazard: &Hazard) -> Outcome {
    let outcome = hazard.play(hazard.before(kind));
    assert_eq!(outcome.rig.resets().len(), 1, "{}", hazard.name);
    drive_on_follows_the_bridge(&outcome.rig);
    outcome
}

/// "drive on" must equal the bridge's state one sample after each change of either.
///
/// # Panics
/// It differs.
pub fn drive_on_follows_the_bridge(rig: &Rig) {
    let trace = &rig.chip.board.world.trace;
    let (mut bridge, mut output) = ((false, 0), (false, 0));
    for (time, seen) in trace
        .iter()
        .chain([&(rig.chip.board.now, Seen::Ready(false))])
    {
        let since = bridge.1.max(output.1);
        let apart = bridge.0 != output.0 && *time > since + ticks(60e-6);
        assert!(!apart, "{bridge:?} {output:?} at {time}");
        match seen {
            Seen::Bridge(on) => bridge = (*on, *time),
            Seen::DriveOn(on) => output = (*on, *time),
            _ => {}
        }
    }
}

/// Makes each of these functions of a chip's kind a test on both chips.
#[macro_export]
macro_rules! on_both {
    ($($name:ident,)*) => {
        $crate::on_both!(stm32f405rg Stm32f405: $($name)*);
        $crate::on_both!(stm32g474re Stm32g474: $($name)*);
    };
    ($chip:ident $kind:ident: $($name:ident)*) => {
        mod $chip {
            $(
                #[test]
                fn $name() {
                    super::$name($crate::chip::kind::Kind::$kind);
                }
            )*
        }
    };
}

/// A cached board by its name; the first caller makes it.
fn cached_rig(name: String, make: impl FnOnce() -> Rig) -> Rig {
    static MADE: Mutex<BTreeMap<String, Arc<OnceLock<Rig>>>> = Mutex::new(BTreeMap::new());
    let mut made = MADE.lock().unwrap_or_else(PoisonError::into_inner);
    let place = Arc::clone(made.entry(name).or_default());
    drop(made);
    place.get_or_init(make).clone()
}

/// A change of track or sensor at a time in s.
pub fn plant(time: f64, change: Change) -> (f64, Act) {
    (time, Act::Plant(change))
}

/// Changes of sensitivity and voltage of a machine at half its hard limit, whose sensor measures the
/// share `seen` of 1 g at rest. Commissioned with `kband settings commission --sensor`.
pub fn of_sensitivity(name: &'static str, seen: f32) -> Hazard {
    Hazard::of(name, 50.0, Target::Amplitude(0.5)).with(|scene| {
        scene.settings.sensor_rest = 1.65 + 0.1 * seen;
        scene.settings.gain_tolerance = 1.3;
        scene.settings.load_tolerance = 1.3;
    })
}

/// As [`of_sensitivity`] with nothing measured of gravity, and a current sensor of 2 A at full
/// output.
pub fn of_current(name: &'static str) -> Hazard {
    of_sensitivity(name, 0.0).with(measure_current)
}

/// Adds that current sensor.
pub fn measure_current(scene: &mut Scene) {
    scene.settings.current_sensitivity = 0.3;
    scene.settings.current_gain = 0.5;
    scene.drive.current_gain = 0.5;
}

/// Time at rest, just before the enable input comes on, s.
pub const AT_REST: f64 = 1.05;

/// Withdraws the enable input between two times, s.
fn withdrawn(from: f64, to: f64) -> [(f64, Act); 2] {
    [(from, Act::Enable(false)), (to, Act::Enable(true))]
}

/// A sensor that is lost three times. After the first loss the enable input bounces at 3 s. It is
/// then withdrawn for 0.6 s at 3.5 and 5.4 s, and for more than a second at 7.3 s.
pub fn bounce() -> Hazard {
    let lost = |from: f64| {
        [
            plant(from, Change::SensorLost(true)),
            plant(from + 0.3, Change::SensorLost(false)),
        ]
    };
    let acts = [
        lost(FAILURE_TIME),
        withdrawn(3.0, 3.025),
        withdrawn(3.5, 4.1),
        lost(5.0),
        withdrawn(5.4, 6.0),
        lost(6.9),
        withdrawn(7.3, 8.5),
    ];
    Hazard::of("the enable input bounces", 50.0, Target::Amplitude(0.2))
        .acts(acts.into_iter().flatten())
        .end(9.5)
}

/// An over-current that lasts for 0.1 s and is acknowledged from 3.0 to 3.6 s.
pub fn over_current() -> Hazard {
    let passes = [
        (FAILURE_TIME, Act::OverCurrent(true)),
        (FAILURE_TIME + 0.1, Act::OverCurrent(false)),
    ];
    Hazard::of("over-current", 50.0, Target::Amplitude(0.2))
        .acts(passes.into_iter().chain(withdrawn(3.0, 3.6)))
        .end(4.2)
}

/// Target gear: with parts whose scatter is so large from 4 s on that they hop irregularly, and
/// without parts.
pub fn of_gear() -> [Hazard; 2] {
    const LOST: f64 = 4.0;
    let parts = Hazard::of("parts fall out of gear", 50.0, Target::Gear { order: 1 })
        .with(|scene| scene.parts = Scene::default().parts)
        .acts([
            plant(LOST, Change::Restitution(0.6)),
            plant(LOST, Change::Scatter(0.1)),
        ])
        .end(LOST + 3.0);
    let none = Hazard::of("gear without a part", 50.0, Target::Gear { order: 1 });
    [parts, none]
}

/// Program errors at [`FAILURE_TIME`] on a chip. `panics` is the address of a function that panics, `stack`
/// that of the stack's far end.
pub fn of_the_program(kind: Kind, panics: u32, stack: u32) -> Vec<Hazard> {
    // The converter's interrupt in the clear-enable register of the NVIC.
    const MASKED: Act = Act::Store(0xe000_e180, 1 << 18);
    // Converter and timer, by their addresses on the STM32F405. The control register of the
    // STM32G474's converter stops injected conversions by bit 5.
    let store = |same: u32, value: u32| Act::Store(kind.address(same), value);
    let converter_off = match kind {
        Kind::Stm32f405 => store(0x4001_2008, 0),
        Kind::Stm32g474 => store(0x4001_2008, 1 << 5),
    };
    let timer_off = store(0x4001_0000, 0);
    // Repetition counter and period of the timer: an update every 25 us, and every 33 us.
    let twice = store(0x4001_0030, 0);
    let half_as_often_again = store(0x4001_002c, 2_800);
    // Between the program and its settings.
    let erased = 0x0800_0000 + 1024 * kind.facts().identity.1 * 15 / 16;
    let astray = [
        ("a panic", Act::Jump(panics)),
        ("a jump into erased flash", Act::Jump(erased)),
        ("the stack overflows", Act::Stack(stack + 4)),
        ("the samples' handler hangs", Act::Hang(Hang::Samples)),
        ("the samples' interrupt is masked", MASKED),
        ("the converter is switched off", converter_off),
        ("the timer stands", timer_off),
        ("samples come twice as often", twice),
        ("samples come half as often again", half_as_often_again),
    ];
    // Enable and pend the interrupt of an unused timer (TIM2, 28).
    let stray = [
        Act::Store(0xe000_e100, 1 << 28),
        Act::Store(0xe000_e200, 1 << 28),
    ];
    let of = |name, acts: Vec<Act>| {
        let acts = acts.into_iter().map(|act| (FAILURE_TIME, act));
        Hazard::of(name, 50.0, Target::Amplitude(0.2)).acts(acts)
    };
    std::iter::once(of("an interrupt that nobody handles", stray.into()))
        .chain(astray.map(|(name, act)| of(name, vec![act])))
        .collect()
}
