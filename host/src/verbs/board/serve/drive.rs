//! The simulated feeder behind the registers.

use std::time::Duration;

use kband::feeder::OutOfRange;
use kband_bus::{Answer, Authority, Exception, Machine, SaveProgress, Server, Snapshot};
use kband_control::wire::{Access, Record, Status, Telemetry};
use kband_control::{Event, Fault, Inputs, Report, Settings, StartCause, Target};
use kband_plant::{Change, ClosedLoop, Scene};

use super::Feeder;
use crate::board::BoardMessage;
use crate::refusal::Result;

/// Time after power-on at which the enable input turns on, s; earlier it starts nothing.
const ENABLE_TIME: f64 = 0.5;
const IMAGE: &str = concat!("kband serve ", env!("CARGO_PKG_VERSION"));

/// A simulated feeder and its server. All clients share the edges of its control word.
pub struct Simulated {
    drive: Drive,
    server: Server,
    /// Number of the next event for [`Feeder::news`].
    next_event: usize,
}

impl Simulated {
    /// The feeder of a scene at power-on; refused if a value of the scene is out of range.
    pub fn build(scene: &Scene) -> Result<Self, OutOfRange> {
        Ok(Self {
            drive: Drive::build(scene)?,
            server: Server::default(),
            next_event: 0,
        })
    }
}

impl Feeder for Simulated {
    fn name(&self) -> String {
        "a simulated feeder".into()
    }

    fn answer(&mut self, adu: &[u8], answer: &mut Answer) -> bool {
        self.server.answer(adu, &mut self.drive, answer)
    }

    fn advance(&mut self, passed: Duration) -> Result<()> {
        let seconds = passed.as_secs_f64();
        self.drive.advance(seconds, &mut self.server);
        Ok(())
    }

    fn news(&mut self) -> Result<Vec<BoardMessage>> {
        let drive = &self.drive;
        let mut news = vec![
            BoardMessage::Setting("frequency".into(), drive.settings().frequency),
            BoardMessage::Telemetry(Telemetry::from(&drive.report)),
        ];
        let events = drive.events[self.next_event..].iter().copied();
        news.extend(events.map(BoardMessage::Event));
        self.next_event = drive.events.len();
        Ok(news)
    }
}

struct Drive {
    closed: ClosedLoop,
    report: Report,
    /// Simulated time and requested end of the simulation, s.
    time: f64,
    due: f64,
    enabled: bool,
    events: Vec<Record>,
    save: SaveProgress,
}

impl Drive {
    /// If the scene leaves the bus off, it gets the authority to command and to acknowledge.
    fn build(scene: &Scene) -> Result<Self, OutOfRange> {
        let mut scene = scene.clone();
        scene.start = StartCause::PowerOn;
        if scene.settings.bus_address == 0.0 {
            (scene.settings.bus, scene.settings.bus_address) = (2.0, 1.0);
        }
        let mut closed = ClosedLoop::build(&scene)?;
        closed.apply(Change::Enable(false));
        Ok(Self {
            closed,
            report: Report::default(),
            time: 0.0,
            due: 0.0,
            enabled: false,
            events: Vec::new(),
            save: SaveProgress::None,
        })
    }

    fn advance(&mut self, seconds: f64, server: &mut Server) {
        self.due += seconds;
        while self.time < self.due {
            if !self.enabled && self.time >= ENABLE_TIME {
                self.enabled = true;
                self.closed.apply(Change::Enable(true));
            }
            if self.settings().bus_controls() {
                let (command, is_active) = server.take_command();
                self.closed.command(command, is_active);
            }
            let moment = self.closed.cycle();
            (self.time, self.report) = (moment.time, moment.report);
            for event in self.report.events.iter() {
                let load = self.report.load.filter(|_| event == Event::Weighed);
                let load = load.unwrap_or_default();
                self.events.push(Record {
                    number: self.events.len() as u32,
                    cycle: self.report.cycle,
                    event: event.number(),
                    fault: self.report.fault.map_or(0, Fault::number),
                    mass: load.mass,
                    flow: load.flow,
                });
            }
        }
    }
}

impl Machine for Drive {
    fn snapshot(&self) -> Snapshot<'_> {
        let controller = self.closed.controller();
        Snapshot {
            telemetry: Telemetry::from(&self.report),
            status: Status {
                inputs: Inputs {
                    enable: self.enabled,
                    ..Inputs::default()
                },
                permitted: true,
                access: Access::Full,
                ready: controller.is_ready(),
                seconds: self.time as u32,
                ..Status::default()
            },
            authority: Authority::of(controller.settings()),
            target: controller.target(),
            save: self.save,
            events: self.events.len() as u32,
            missed: 0,
            writable: true,
            image: IMAGE,
        }
    }

    fn settings(&self) -> Settings {
        *self.closed.controller().settings()
    }

    fn event(&self, number: u32) -> Option<Record> {
        self.events.get(number as usize).copied()
    }

    fn set_target(&mut self, target: Target) -> Result<(), Exception> {
        let set = self.closed.controller_mut().set_target(target);
        set.map_err(|_| Exception::Value)
    }

    fn set_settings(&mut self, settings: &Settings) -> Result<(), Exception> {
        settings.check().map_err(|_| Exception::Value)?;
        let configured = self.closed.configure(settings);
        configured.map_err(|_| Exception::Value)
    }

    fn save(&mut self) -> Result<(), Exception> {
        self.closed.controller_mut().settings_saved();
        self.save = SaveProgress::Done;
        Ok(())
    }
}
