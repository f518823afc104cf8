//! Source of the dashboard: a simulation in real time, or a board.

use kband::feeder::Restitution;
use kband::regime::Lock;
use kband::regime::band::Band;
use kband_control::wire::Telemetry;
use kband_control::{
    Controller, Event, Fault, Limits, NoSetpoint, Settings, StartCause, State, Target,
};
use kband_plant::{Change, ClosedLoop};

use crate::causes::{Best, Cause, CauseCache};
use crate::refusal::Refusal;
use crate::simulate::SceneFile;

/// One drive cycle of the dashboard.
#[derive(Clone, Debug)]
pub struct Seen {
    /// Time in s since the start.
    pub time: f64,
    /// Report of the controller.
    pub telemetry: Telemetry,
    /// Phases of the track at the impacts of this cycle, in rad.
    pub strikes: Vec<f64>,
    /// Mean distance of the parts so far in m; `None` for a source that does not measure it.
    pub way: Option<f64>,
    /// Events of this cycle.
    pub events: Vec<Event>,
}

impl Seen {
    /// State of the controller.
    pub fn state(&self) -> State {
        State::numbered(self.telemetry.state).unwrap_or_default()
    }

    /// Fault that stopped the drive.
    pub fn fault(&self) -> Option<Fault> {
        Fault::numbered(self.telemetry.fault)
    }

    /// The likeliest cause of parts out of gear, if gear is the target and its amplitude is held.
    pub fn cause(&self, assignment: &Assignment, cache: &mut CauseCache) -> Option<Cause> {
        let Target::Gear { order } = assignment.target else {
            return None;
        };
        if !matches!(self.state(), State::Holding | State::Limiting) {
            return None;
        }
        let now = Best {
            share: f64::from(self.telemetry.expected_in_gear),
            amplitude: f64::from(self.telemetry.setpoint) * 1e3,
        };
        let limits = Limits::from_bits(self.telemetry.limits).unwrap_or_default();
        let causes = cache.causes(&assignment.settings, order, now, limits);
        causes.into_iter().next()
    }

    /// k at the setpoint; `None` without one.
    pub fn k_setpoint(&self, assignment: &Assignment) -> Option<f32> {
        let setpoint = f64::from(self.telemetry.setpoint);
        (setpoint > 0.0).then(|| (assignment.k_unit() / setpoint) as f32)
    }
}

/// Settings and target of the controller.
#[derive(Clone, Copy, Debug)]
pub struct Assignment {
    /// Its settings.
    pub settings: Settings,
    /// Its target.
    pub target: Target,
}

impl Assignment {
    fn restitution(&self) -> Option<Restitution> {
        self.settings.lot().ok()
    }

    fn order(&self) -> u32 {
        match self.target {
            Target::Locked { order } | Target::Gear { order } => u32::from(order),
            _ => 1,
        }
    }

    /// The lot's band of the wanted order; of order 1 for other targets.
    pub fn band(&self) -> Option<Band> {
        let contact = self.settings.contact_time();
        Band::common_with_contact(self.restitution()?, self.order(), contact).ok()
    }

    /// Reason why no amplitude serves the target, if it follows from the settings alone.
    pub fn no_setpoint(&self) -> Option<NoSetpoint> {
        let controller =
            Controller::build(&self.settings, self.target, StartCause::Ordinary).ok()?;
        controller.no_setpoint()
    }

    /// Strike phase in rad of locked parts of middle restitution at this k.
    pub fn lock_phase(&self, k: f64) -> Option<f64> {
        let (middle, contact) = (self.restitution()?.middle(), self.settings.contact_time());
        let lock = Lock::with_contact(k, middle, self.order(), contact).ok()??;
        Some(lock.strike_phase())
    }

    /// k times the amplitude in m.
    pub fn k_unit(&self) -> f64 {
        let settings = &self.settings;
        let speed = std::f64::consts::TAU * f64::from(settings.frequency);
        let incline = f64::from(settings.incline).to_radians();
        f64::from(settings.gravity) * incline.cos() / (speed * speed)
    }
}

/// Request of the user by a key.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Wish {
    /// A target; the present one restarts the capture.
    Target(Target),
    /// The drive on or off.
    Enable(bool),
}

/// A source of cycles for the dashboard.
pub trait Source {
    /// Its name, for the headline.
    fn name(&self) -> String;

    /// Settings and target of its controller.
    fn assignment(&self) -> Assignment;

    /// The cycles of the next `seconds` of its time.
    fn advance(&mut self, seconds: f64) -> Result<Vec<Seen>, Refusal>;

    /// Carries out a request of the user.
    fn obey(&mut self, wish: Wish) -> Result<(), Refusal>;
}

/// A scene in real time.
#[derive(Clone, Debug)]
pub struct Simulation {
    name: String,
    closed: ClosedLoop,
    /// Requested end of the run in s.
    due: f64,
    time: f64,
}

impl Simulation {
    /// The simulation of a scene at time 0.
    pub fn build(name: &str, file: &SceneFile) -> Result<Self, Refusal> {
        Ok(Self {
            name: name.into(),
            closed: ClosedLoop::build(&file.scene)?,
            due: 0.0,
            time: 0.0,
        })
    }
}

impl Source for Simulation {
    fn name(&self) -> String {
        self.name.clone()
    }

    fn assignment(&self) -> Assignment {
        let controller = self.closed.controller();
        Assignment {
            settings: *controller.settings(),
            target: controller.target(),
        }
    }

    fn advance(&mut self, seconds: f64) -> Result<Vec<Seen>, Refusal> {
        self.due += seconds;
        let mut cycles = Vec::new();
        while self.time < self.due {
            let moment = self.closed.cycle();
            self.time = moment.time;
            let strikes = self.closed.plant().strikes().iter();
            cycles.push(Seen {
                time: self.time,
                telemetry: Telemetry::from(&moment.report),
                strikes: strikes.map(|strike| strike.phase).collect(),
                way: Some(moment.displacement),
                events: moment.report.events.iter().collect(),
            });
        }
        Ok(cycles)
    }

    fn obey(&mut self, wish: Wish) -> Result<(), Refusal> {
        self.closed.apply(match wish {
            Wish::Target(target) => Change::Target(target),
            Wish::Enable(enable) => Change::Enable(enable),
        });
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulate::DEFAULT;

    #[test]
    fn a_simulation_starts_takes_a_target_and_stops() {
        let file = SceneFile::parse(DEFAULT).unwrap();
        let mut source = Simulation::build("the default scene", &file).unwrap();
        let cycles = source.advance(1.0).unwrap();
        assert!((49..=51).contains(&cycles.len()), "{}", cycles.len());
        // The drive is off until the plan for gear has a first choice.
        assert_eq!(cycles[0].state(), State::Off);
        assert!(cycles.iter().any(|seen| seen.state() == State::Starting));
        // Below the band of constant restitution, where scattering parts stay in gear.
        let k = source.advance(3.0).unwrap().last().unwrap().telemetry.k;
        assert!((0.38..0.42).contains(&k), "{k}");
        source.obey(Wish::Target(Target::K(0.4))).unwrap();
        source.advance(1.0).unwrap();
        assert_eq!(source.assignment().target, Target::K(0.4));
        source.obey(Wish::Enable(false)).unwrap();
        let cycles = source.advance(3.0).unwrap();
        assert_eq!(cycles.last().unwrap().state(), State::Off);
    }
}
