//! Tests of acknowledging a fault, and of the lock-out after three of them.

use super::super::Controller;
use crate::{Cycle, Event, Fault, Inputs, Settings, StartCause, State, Target};

/// Drive cycles per second of the default settings.
const RATE: u32 = 50;

/// A drive whose over-current input opens the bridge in chosen cycles.
struct Drive(Controller);

impl Drive {
    fn new() -> Self {
        let target = Target::Locked { order: 1 };
        let mut drive =
            Self(Controller::build(&Settings::default(), target, StartCause::Ordinary).unwrap());
        drive.runs(1, true, false);
        drive
    }

    /// Runs a number of cycles. Whether one of them locked the drive out.
    fn runs(&mut self, cycles: u32, enable: bool, over_current: bool) -> bool {
        let inputs = Inputs {
            enable,
            over_current,
            ..Inputs::default()
        };
        let cycle = Cycle {
            samples: 400,
            low: 1990,
            high: 2010,
            ..Cycle::default()
        };
        (0..cycles).any(|_| {
            let report = self.0.cycle(&cycle, &inputs);
            report.events.iter().any(|event| event == Event::LockedOut)
        })
    }

    /// A fault, then some cycles without enable, then enable. Whether it was acknowledged, and
    /// whether it locked out.
    fn fails(&mut self, withdrawn: u32) -> (bool, bool) {
        let out = self.runs(1, true, true);
        assert_eq!(self.0.report().fault, Some(Fault::OverCurrent));
        self.runs(withdrawn, false, false);
        self.runs(1, true, false);
        (self.0.state() != State::Fault, out)
    }
}

#[test]
fn half_a_second_without_enable_acknowledges_a_fault() {
    assert_eq!(Drive::new().fails(RATE / 2 - 2), (false, false));
    assert_eq!(Drive::new().fails(RATE / 2 + 1), (true, false));
}

#[test]
fn third_fault_in_a_minute_locks_out_for_a_minute() {
    let soon = |between: u32| {
        let mut drive = Drive::new();
        let acknowledged = RATE / 2 + 1;
        for _ in 0..2 {
            assert_eq!(drive.fails(acknowledged), (true, false));
            drive.runs(between, false, false);
            drive.runs(1, true, false);
        }
        (drive.fails(acknowledged), drive)
    };
    // Two faults 58 s apart in all, and 62 s apart.
    let ((acknowledged, out), mut drive) = soon(28 * RATE + RATE / 2);
    assert!(out && !acknowledged);
    drive.runs(60 * RATE - 2, false, false);
    drive.runs(1, true, false);
    assert_eq!(drive.0.state(), State::Fault);
    drive.runs(60 * RATE + 1, false, false);
    drive.runs(1, true, false);
    assert_ne!(drive.0.state(), State::Fault);
    let (fails, _) = soon(30 * RATE + RATE / 2);
    assert_eq!(fails, (true, false));
}
