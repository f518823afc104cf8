//! Processor in the loop: the controller on the board, the plant at the desk, in lock-step.

use kband_control::wire::{Request, Response, fold_output, write_reading};
use kband_control::{Report, SAMPLE_RATE, Settings, Signal, StartCause};
use kband_link::{Link, tell};
use kband_plant::{Bench, Moment, Scene};

use crate::refusal::Refusal;

const CHUNK_BYTES: usize = 240;

/// The closed loop of a scene with its controller on a board.
///
/// The board gets every reading and runs its own signal path and controller on them. The outputs of
/// a cycle are fixed at its start, so the desk computes them too. At the end of each cycle the
/// board confirms them bit for bit, and sends its next decision.
pub struct BoardLoop {
    link: Link,
    bench: Bench,
    signal: Signal,
    before: u16,
    scene: Scene,
}

/// Unsent readings of a cycle, and the checksum of its outputs.
struct Run {
    bytes: [u8; CHUNK_BYTES + 8],
    used: usize,
    check: u32,
}

impl BoardLoop {
    /// The loop of a scene at time 0, on the board at the end of `link`, whose drive stays off.
    pub fn start(mut link: Link, scene: &Scene) -> Result<Self, Refusal> {
        if scene.settings.current_gain > 0.0 {
            return Err(Refusal::new(
                "the link carries no readings of a current sensor to the board",
                "set drive.current_gain to 0, or leave out --on",
            ));
        }
        link.tell(&Request::Defaults)?;
        let changed = Settings::KEYS
            .iter()
            .zip(scene.settings.values())
            .filter(|(key, value)| key.default != *value)
            .map(|(key, value)| (key.name, value));
        tell(&mut link, changed.collect())?;
        link.tell(&Request::Simulate {
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

    /// Runs to the end of the next drive cycle.
    pub fn cycle(&mut self) -> Result<Moment, Refusal> {
        self.bench.forget_strikes();
        let mut run = self.samples()?;
        if self.bench.sagged() {
            self.restart()?;
            run = self.samples()?;
        }
        let report = self.end(&run)?;
        self.signal.command(report.command);
        Ok(self.bench.moment(report))
    }

    /// The board starts anew after a brown-out.
    fn restart(&mut self) -> Result<(), Refusal> {
        self.signal = Signal::build(&self.scene.settings)?;
        self.before = 0;
        self.link.tell(&Request::Simulate {
            target: self.scene.target,
            start: StartCause::Reset,
        })
    }

    /// Samples of one cycle, all but the last of them sent.
    fn samples(&mut self) -> Result<Run, Refusal> {
        let mut run = Run {
            bytes: [0; CHUNK_BYTES + 8],
            used: 0,
            check: 0,
        };
        for _ in 0..2 * SAMPLE_RATE {
            let code = self.bench.sample();
            if let Some(target) = self.bench.new_target() {
                // A target out of range is refused, as at the desk; the old one stays.
                self.link.ask(&Request::Target(target), |_| ())?;
            }
            let before = self.signal.phase();
            let sampled = self.signal.sample(code);
            self.bench
                .hold(sampled.output, (self.signal.phase() - before).bits());
            run.check = fold_output(run.check, sampled.output);
            run.used += write_reading(&mut run.bytes[run.used..], self.before, code.0);
            self.before = code.0;
            if sampled.wrapped {
                break;
            }
            if run.used >= CHUNK_BYTES {
                self.link.tell(&Request::Samples {
                    codes: &run.bytes[..run.used],
                    end: None,
                })?;
                run.used = 0;
            }
        }
        Ok(run)
    }

    fn end(&mut self, run: &Run) -> Result<Report, Refusal> {
        let check = run.check;
        let request = Request::Samples {
            codes: &run.bytes[..run.used],
            end: Some(self.bench.inputs()),
        };
        let time = self.bench.time();
        self.link.ask(&request, |response| match response {
            Response::Cycle { outputs, report } if outputs == check => Ok(report),
            Response::Cycle { .. } => Err(Refusal::new(
                format!("at {time} s the board's outputs differ from the desk's"),
                "this is a fault of kband: report it with the scene",
            )),
            other => Err(Refusal::new(
                format!("at {time} s the board fell out of step: {other:?}"),
                "reset the board and start again",
            )),
        })?
    }

    /// The plant.
    pub fn plant(&self) -> &Bench {
        &self.bench
    }
}
