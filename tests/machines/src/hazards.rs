//! Fault scenarios of `docs/safety.md` for an image on the emulated chip.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use crate::chip::kind::Kind;
use crate::chip::world::Event;
use crate::images::feeder_on;
use crate::rig::{Act, Rig, chip_of, ticks};
use kband_control::wire::Request;
use kband_control::{Settings, Target};
use kband_plant::{Change, Scene};

/// Time at which the enable input turns on, s. By then the settings are saved, and the fault of the
/// first start without settings is acknowledged.
pub const ENABLE_TIME: f64 = 1.1;
/// Time at which a board has its settings, s.
const COMMISSIONED_TIME: f64 = 1.0;
const FAILURE_TIME: f64 = 2.5;

/// A scenario: a working machine, then a failure.
#[derive(Clone, Debug)]
pub struct Hazard {
    pub name: &'static str,
    /// The machine and the configured settings.
    pub scene: Scene,
    pub target: Target,
    /// Times in s and the failures.
    pub acts: Vec<(f64, Act)>,
    /// Time of the first failure, s.
    pub from: f64,
    /// End of the scenario, s.
    pub until: f64,
}

#[derive(Clone, Debug)]
pub struct Outcome {
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
    pub rig: Rig,
}

impl Hazard {
    /// A machine with this frequency in Hz and target, without parts and without a failure.
    pub fn new(name: &'static str, frequency: f32, target: Target) -> Self {
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

    pub fn with(mut self, change: impl FnOnce(&mut Scene)) -> Self {
        change(&mut self.scene);
        self
    }

    /// Sets the failures; the first one defines the start.
    pub fn acts(mut self, acts: impl IntoIterator<Item = (f64, Act)>) -> Self {
        self.acts = acts.into_iter().collect();
        self.from = self.acts.first().map_or(self.from, |act| act.0);
        self
    }

    pub fn end(mut self, seconds: f64) -> Self {
        self.until = seconds;
        self
    }

    fn commission(&self, kind: Kind) -> Rig {
        let mut rig = Rig::with(chip_of(kind, &feeder_on(kind)), &self.scene);
        rig.chip.power_on();
        rig.run(0.3);
        let configured = self.scene.settings.values();
        let defaults = Settings::default().values();
        // Two passes: a value may be refused until related values are set.
        for _ in 0..2 {
            for ((key, value), default) in Settings::KEYS.iter().zip(configured).zip(defaults) {
                if value != default {
                    rig.send(&Request::set(key.name, value));
                }
            }
        }
        rig.send(&Request::Target(self.target));
        rig.send(&Request::Save).run(COMMISSIONED_TIME);
        rig
    }

    /// A board with this chip at the first failure. The common part of several scenarios runs once.
    pub fn before(&self, kind: Kind) -> Rig {
        cached_rig(format!("{} {}", self.machine(kind), self.from), || {
            let mut rig = self.commissioned(kind);
            self.run_to_failure(&mut rig);
            rig
        })
    }

    /// A commissioned board with this chip; computed once for each machine and target.
    pub fn commissioned(&self, kind: Kind) -> Rig {
        cached_rig(self.machine(kind), || self.commission(kind))
    }

    fn machine(&self, kind: Kind) -> String {
        let Self { scene, target, .. } = self;
        format!("{kind:?} {scene:?} {target:?}")
    }

    fn run_to_failure(&self, rig: &mut Rig) {
        rig.keep_link_alive(COMMISSIONED_TIME, self.from);
        rig.at(ENABLE_TIME, Act::Enable(true)).run(self.from);
    }

    /// Runs the scenario from a commissioned board, or from one at the first failure.
    pub fn play(&self, mut rig: Rig) -> Outcome {
        if rig.time() < self.from {
            self.run_to_failure(&mut rig);
        }
        rig.keep_link_alive(self.from, self.until);
        for (time, act) in &self.acts {
            rig.at(*time, act.clone());
        }
        rig.peak();
        rig.run(self.until);
        let fault = rig.faults_after(self.from);
        Outcome {
            largest: rig.peak(),
            after: rig.amplitude(),
            opens: rig.opening_after(self.from),
            fault: fault.map(|time| time - self.from),
            ready: rig.find_time(ENABLE_TIME, &Event::Ready(true)),
            rig,
        }
    }
}

/// Runs a scenario on a chip. The chip must not be reset, and "drive on" must follow the bridge.
pub fn play(kind: Kind, hazard: &Hazard) -> Outcome {
    let outcome = hazard.play(hazard.before(kind));
    assert_eq!(outcome.rig.resets().len(), 1, "{}", hazard.name);
    drive_on_follows_the_bridge(&outcome.rig);
    outcome
}

/// "drive on" must equal the bridge's state one sample after each change of either.
pub fn drive_on_follows_the_bridge(rig: &Rig) {
    let trace = &rig.chip.board.world.trace;
    let (mut bridge, mut output) = ((false, 0), (false, 0));
    let end = (rig.chip.board.now, Event::Ready(false));
    for (time, event) in trace.iter().chain([&end]) {
        let since = bridge.1.max(output.1);
        let differs = bridge.0 != output.0 && *time > since + ticks(60e-6);
        assert!(!differs, "{bridge:?} {output:?} at {time}");
        match event {
            Event::Bridge(on) => bridge = (*on, *time),
            Event::DriveOn(on) => output = (*on, *time),
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

/// A cached board by its name; the first caller computes it.
fn cached_rig(name: String, make: impl FnOnce() -> Rig) -> Rig {
    static RIGS: Mutex<BTreeMap<String, Arc<OnceLock<Rig>>>> = Mutex::new(BTreeMap::new());
    let mut made = RIGS.lock().unwrap_or_else(PoisonError::into_inner);
    let place = Arc::clone(made.entry(name).or_default());
    drop(made);
    place.get_or_init(make).clone()
}

pub fn plant(time: f64, change: Change) -> (f64, Act) {
    (time, Act::Plant(change))
}

/// Changes of sensitivity and voltage of a machine at half its hard limit. At rest its sensor
/// measures the share `share` of 1 g. It is commissioned by `kband settings commission --sensor`.
pub fn sensitivity_hazard(name: &'static str, share: f32) -> Hazard {
    Hazard::new(name, 50.0, Target::Amplitude(0.5)).with(|scene| {
        scene.settings.sensor_rest = 1.65 + 0.1 * share;
        scene.settings.gain_tolerance = 1.3;
        scene.settings.load_tolerance = 1.3;
    })
}

/// Adds a current sensor of 2 A at full output.
pub fn measure_current(scene: &mut Scene) {
    scene.settings.current_sensitivity = 0.3;
    scene.settings.current_gain = 0.5;
    scene.drive.current_gain = 0.5;
}

/// Time at rest, just before the enable input turns on, s.
pub const REST_TIME: f64 = 1.05;
