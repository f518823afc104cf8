//! Processor in the loop: the controller on the board and the plant at the desk, in lock-step.

use kband_control::wire::{Request, Response, update_output_check, write_reading};
use kband_control::{Report, SAMPLE_RATE, Settings, Signal, StartCause};
use kband_link::{Link, set_all};
use kband_plant::{Bench, Moment, Scene, Strike};

use crate::refusal::{Refusal, Result};

const CHUNK_BYTES: usize = 240;

/// The closed loop of a scene with its controller on a board, which receives every reading. At the
/// end of each cycle the board confirms the desk's outputs bit for bit, and sends its next
/// decision.
pub struct BoardLoop {
    link: Link,
    bench: Bench,
    signal: Signal,
    before: u16,
    scene: Scene,
}

impl BoardLoop {
    /// The loop of a scene at time 0, with the board on `link`; its drive stays off.
    pub fn start(mut link: Link, scene: &Scene) -> Result<Self> {
        if scene.settings.current_gain > 0.0 {
            let cause = "the link carries no readings of a current sensor to the board";
            let next = "set drive.current_gain to 0, or leave out --on";
            return Err(Refusal::new(cause, next));
        }
        link.command(&Request::Defaults)?;
        let settings = Settings::KEYS.iter().zip(scene.settings.values());
        let changed = settings.filter(|(key, value)| key.default != *value);
        set_all(
            &mut link,
            changed.map(|(key, value)| (key.name, value)).collect(),
        )?;
        link.command(&Request::Simulate {
            target: scene.target,
            start: scene.start,
        })?;
        Ok(Self {
            link,
            bench: Bench::build(scene)?,
            signal: Signal::build(&scene.settings)?,
            before: 0,
            scene: scene.clone(),
        })
    }

    /// Runs to the end of the next drive cycle; returns it and its impacts.
    pub fn cycle(&mut self) -> Result<(Moment, Vec<Strike>)> {
        self.bench.forget_strikes();
        let (mut codes, mut check) = self.samples()?;
        if self.bench.sagged() {
            // The board restarts, with the readings and the phase from their beginning.
            self.signal = Signal::build(&self.scene.settings)?;
            self.before = 0;
            let (target, start) = (self.scene.target, StartCause::Reset);
            self.link.command(&Request::Simulate { target, start })?;
            (codes, check) = self.samples()?;
        }
        let report = self.end(&codes, check)?;
        self.signal.command(report.command);
        Ok((self.bench.moment(report), self.bench.strikes().to_vec()))
    }

    /// Unsent readings of one cycle, the last ones, and the checksum of its outputs.
    fn samples(&mut self) -> Result<(Vec<u8>, u32)> {
        let (mut codes, mut check) = (Vec::new(), 0);
        for _ in 0..2 * SAMPLE_RATE {
            let code = self.bench.sample();
            if let Some(target) = self.bench.new_target() {
                // A target out of range is refused, as at the desk, and the previous one remains.
                self.link.request(&Request::Target(target), |_| ())?;
            }
            let before = self.signal.phase();
            let sampled = self.signal.sample(code);
            self.bench
                .hold(sampled.output, (self.signal.phase() - before).bits());
            check = update_output_check(check, sampled.output);
            let mut reading = [0; 3];
            let length = write_reading(&mut reading, self.before, code.0);
            codes.extend_from_slice(&reading[..length]);
            self.before = code.0;
            if sampled.wrapped {
                break;
            }
            if codes.len() >= CHUNK_BYTES {
                let request = Request::Samples {
                    codes: &codes,
                    end: None,
                };
                self.link.command(&request)?;
                codes.clear();
            }
        }
        Ok((codes, check))
    }

    fn end(&mut self, codes: &[u8], check: u32) -> Result<Report> {
        let end = Some(self.bench.inputs());
        let request = Request::Samples { codes, end };
        let time = self.bench.time();
        self.link.request(&request, |response| match response {
            Response::Cycle { outputs, report } if outputs == check => Ok(report),
            Response::Cycle { .. } => {
                let cause = format!("at {time} s the board's outputs differ from the desk's");
                let next = "this is a fault of kband: report it with the scene";
                Err(Refusal::new(cause, next))
            }
            other => {
                let cause = format!("at {time} s the board fell out of step: {other:?}");
                Err(Refusal::new(cause, "reset the board and start again"))
            }
        })?
    }
}
