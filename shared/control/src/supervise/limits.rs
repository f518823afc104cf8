//! Limit monitor: the limits that hold the drive back; some count only after a delay.

use crate::saturate::consecutive;
use crate::state::Limits;

/// Cycles of a saturated output that are a limit: starts and kicks saturate briefly.
const SATURATION_CYCLES: u32 = 25;

#[derive(Clone, Copy, Debug)]
pub struct LimitInputs {
    pub running: bool,
    pub frame_received: bool,
    /// Timeout of the link in cycles; `None` if its silence is permitted.
    pub link_timeout: Option<f32>,
    pub saturated: bool,
    /// The limits whose causes count at once.
    pub causes: Limits,
}

/// The limits that hold the drive back, and how long their causes have lasted.
#[derive(Clone, Copy, Debug, Default)]
pub struct LimitMonitor {
    pub limits: Limits,
    /// Cycles in a row with the output at its limit.
    saturated_cycles: u32,
    link_silence: u32,
    link_used: bool,
}

impl LimitMonitor {
    pub fn cycle(&mut self, inputs: &LimitInputs) {
        self.link_used |= inputs.frame_received;
        self.link_silence = consecutive(self.link_silence, !inputs.frame_received);
        let lost = self.link_used
            && (inputs.link_timeout).is_some_and(|timeout| self.link_silence as f32 > timeout);
        self.saturated_cycles = consecutive(self.saturated_cycles, inputs.saturated);
        self.limits = Limits::default();
        if inputs.running {
            self.limits = inputs.causes;
            self.limits.set(Limits::LINK_LOST, lost);
            let limited = self.saturated_cycles > SATURATION_CYCLES;
            self.limits.set(Limits::OUTPUT, limited);
        }
    }

    /// The drive is off, so no limit holds it back.
    pub fn rest(&mut self) {
        self.saturated_cycles = 0;
        self.limits = Limits::default();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::with;

    /// A limit of another cause lasts all the time.
    const FREE: LimitInputs = LimitInputs {
        running: true,
        frame_received: false,
        link_timeout: Some(100.0),
        saturated: false,
        causes: Limits::MISFIT,
    };

    /// Number of equal cycles after which a limit holds, of 1000.
    fn after(monitor: &mut LimitMonitor, inputs: &LimitInputs, limit: Limits) -> Option<u32> {
        (1..=1000).find(|_| {
            monitor.cycle(inputs);
            monitor.limits.contains(limit)
        })
    }

    #[test]
    fn link_timeout_counts_from_the_last_frame() {
        let mut monitor = LimitMonitor::default();
        let silent = |monitor: &mut LimitMonitor| after(monitor, &FREE, Limits::LINK_LOST);
        assert_eq!(silent(&mut monitor), None);
        let received = with(FREE, |it| it.frame_received = true);
        for _ in 0..2 {
            monitor.cycle(&received);
            assert_eq!(monitor.limits, Limits::MISFIT);
            assert_eq!(silent(&mut monitor), Some(101));
        }
        monitor.cycle(&received);
        let stopped = with(FREE, |it| it.running = false);
        assert_eq!(after(&mut monitor, &stopped, Limits::LINK_LOST), None);
        let unwatched = with(FREE, |it| it.link_timeout = None);
        assert_eq!(after(&mut monitor, &unwatched, Limits::LINK_LOST), None);
    }

    #[test]
    fn an_output_at_its_limit_holds_back_after_its_cycles_in_a_row() {
        let saturated = with(FREE, |it| it.saturated = true);
        let mut monitor = LimitMonitor::default();
        for _ in 0..SATURATION_CYCLES {
            monitor.cycle(&saturated);
        }
        assert_eq!(monitor.limits, Limits::MISFIT);
        monitor.cycle(&FREE);
        let limit = Limits::OUTPUT;
        assert_eq!(after(&mut monitor, &saturated, limit), Some(26));
        monitor.cycle(&FREE);
        assert_eq!(monitor.limits, Limits::MISFIT);
        assert_eq!(after(&mut monitor, &saturated, limit), Some(26));
        monitor.rest();
        assert!(monitor.limits.is_empty());
        assert_eq!(after(&mut monitor, &saturated, limit), Some(26));
    }
}
