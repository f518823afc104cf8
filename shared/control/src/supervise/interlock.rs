//! The interlock: it keeps the drive off until a person acts at the machine.
//!
//! No request over the link changes fault, latch or lock-out. Only the enable input ends them (IEC
//! 60204-1, 9.2.5.4.2), and they outlast every new controller. One exception: a fieldbus with that
//! authority acknowledges a fault, but no lock-out.

use crate::saturate::consecutive;
use crate::{Event, Events, Fault, Inputs, StartCause};

/// Time in s for which the enable input must be off to acknowledge a fault: longer than any bounce.
const ACKNOWLEDGE_SECONDS: f32 = 0.5;
/// Window in s in which the third fault locks the drive out, and time off that acknowledges it.
const LOCKOUT_SECONDS: f32 = 60.0;

/// The causes that keep the drive off.
#[derive(Clone, Debug, Default)]
pub struct Interlock {
    /// The fault that keeps the drive off, if any.
    pub fault: Option<Fault>,
    /// Whether the enable input must be off once before the drive may start.
    latched: bool,
    locked_out: bool,
    /// Drive cycles since the beginning, and those of the last two faults, newest first.
    now: u32,
    faults: [Option<u32>; 2],
    /// Drive cycles for which the enable input has been off.
    withdrawn: u32,
    /// Drive cycles per second.
    rate: f32,
    /// Whether settings were saved since they were found invalid.
    pub(crate) settings_saved: bool,
    /// Whether the link stopped a running drive: then the link may start it again.
    stopped_by_link: bool,
    bus_controls: bool,
    /// Whether the run bit was 0 since power-on, a fault, or an enable withdrawn by input or link.
    run_was_off: bool,
}

impl Interlock {
    /// The interlock of a drive that starts for this cause; `rate` in cycles per second.
    pub fn begin(start: StartCause, rate: f32) -> Self {
        Self {
            fault: match start {
                StartCause::Ordinary | StartCause::PowerOn => None,
                StartCause::Reset => Some(Fault::WatchdogReset),
                StartCause::Repeated => Some(Fault::RepeatedResets),
                StartCause::ImageDamaged => Some(Fault::ImageDamaged),
                StartCause::Refused => Some(Fault::SettingsInvalid),
            },
            latched: start != StartCause::Ordinary,
            rate,
            ..Self::default()
        }
    }

    /// The same interlock at another number of cycles per second; times keep their seconds.
    pub(crate) fn at_rate(&self, rate: f32) -> Self {
        let scale = rate / self.rate;
        let rescaled = |cycles: u32| (cycles as f32 * scale) as u32;
        let age = |then: u32| self.now.wrapping_sub(rescaled(self.now.wrapping_sub(then)));
        Self {
            faults: self.faults.map(|fault| fault.map(age)),
            withdrawn: rescaled(self.withdrawn),
            rate,
            ..self.clone()
        }
    }

    /// The same interlock after a simulation: the enable input must be off once.
    pub fn latched(&self) -> Self {
        Self {
            latched: true,
            stopped_by_link: false,
            ..self.clone()
        }
    }

    /// The same interlock with invalid settings: the drive stays off until settings are saved.
    pub fn without_settings(&self) -> Self {
        Self {
            fault: Some(Fault::SettingsInvalid),
            settings_saved: false,
            ..self.latched()
        }
    }

    pub(crate) fn count(&mut self) {
        self.now = self.now.wrapping_add(1);
    }

    /// Stores a fault, unless there is one. Returns whether it was stored.
    pub(crate) fn fail(&mut self, fault: Fault, events: &mut Events) -> bool {
        if self.fault.is_some() {
            return false;
        }
        self.fault = Some(fault);
        self.withdrawn = 0;
        events.push(Event::Faulted);
        let [newest, oldest] = self.faults;
        let since = |then: u32| self.now.wrapping_sub(then) as f32;
        if oldest.is_some_and(|then| since(then) < LOCKOUT_SECONDS * self.rate) {
            self.locked_out = true;
            events.push(Event::LockedOut);
        }
        self.faults = [Some(self.now), newest];
        true
    }

    /// Processes the inputs of a drive cycle, before any other function uses them.
    pub(crate) fn watch(&mut self, inputs: &Inputs) {
        self.withdrawn = consecutive(self.withdrawn, !inputs.enable);
        if !inputs.enable || inputs.held_off {
            self.stopped_by_link = false;
        }
        // When control passes from the bus to the enable input, nothing starts.
        self.latched |= self.bus_controls && inputs.bus.is_none();
        self.bus_controls = inputs.bus.is_some();
        let effective = inputs.enable && !inputs.withheld && self.fault.is_none();
        self.run_was_off =
            (inputs.bus).is_some_and(|bus| bus.run == Some(false) || self.run_was_off && effective);
    }

    /// Processes the inputs of a cycle at rest. Returns whether the drive may start.
    ///
    /// An enable input that comes on while the link withholds the drive is latched: the link may
    /// only return a drive that it stopped itself. A bus in control starts it by an edge.
    pub(crate) fn may_start(&mut self, inputs: &Inputs) -> bool {
        if !inputs.enable {
            self.latched = false;
        } else if inputs.withheld && !self.stopped_by_link {
            self.latched = true;
        }
        let released = match inputs.bus {
            None => !self.latched,
            Some(bus) => bus.runs() && self.run_was_off,
        };
        inputs.enable && !inputs.held_off && !inputs.withheld && released
    }

    pub(crate) fn stopping(&mut self, inputs: &Inputs) {
        self.stopped_by_link = inputs.enable && inputs.withheld;
    }

    /// Whether the enable input or the bus acknowledges the fault, which this call then clears. The
    /// bus ends no lock-out and no series of resets: a person must inspect the machine.
    pub(crate) fn acknowledges(&mut self, inputs: &Inputs) -> bool {
        let lasting = match self.fault {
            Some(Fault::SettingsInvalid) => !self.settings_saved,
            // Only the next start clears it.
            Some(Fault::ImageDamaged) => true,
            Some(Fault::OverTemperature) => inputs.over_temperature,
            Some(Fault::StackLow) => inputs.stack_low,
            Some(Fault::OverCurrent) => inputs.over_current,
            Some(Fault::SupplyLow) => inputs.supply_low,
            Some(Fault::ClockFailed) => inputs.clock_failed,
            _ => false,
        };
        let seconds = if self.locked_out {
            LOCKOUT_SECONDS
        } else {
            ACKNOWLEDGE_SECONDS
        };
        let by_input = !inputs.enable && self.withdrawn as f32 >= seconds * self.rate;
        let by_bus = inputs.bus.is_some_and(|bus| bus.acknowledge)
            && !self.locked_out
            && self.fault != Some(Fault::RepeatedResets);
        if lasting || !(by_input || by_bus) {
            return false;
        }
        (self.fault, self.locked_out, self.latched) = (None, false, false);
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inputs::BusCommand;
    use crate::testing::with;

    const PACE: f32 = 50.0;

    fn inputs(enable: bool, withheld: bool) -> Inputs {
        with(Inputs::default(), |it| {
            (it.enable, it.withheld) = (enable, withheld)
        })
    }

    #[test]
    fn times_keep_their_seconds_at_another_frequency() {
        let mut events = Events::default();
        let mut interlock = Interlock::begin(StartCause::Ordinary, PACE);
        let off = inputs(false, false);
        let wait = |interlock: &mut Interlock, cycles: u32| {
            for _ in 0..cycles {
                interlock.count();
                interlock.watch(&off);
            }
        };
        // Two faults, and 20 s later at 100 Hz the third: within a minute of the first.
        for _ in 0..2 {
            assert!(interlock.fail(Fault::SensorLost, &mut events));
            wait(&mut interlock, 25);
            assert!(interlock.acknowledges(&off));
        }
        wait(&mut interlock, 1000);
        let mut faster = interlock.at_rate(100.0);
        assert!(faster.fail(Fault::SensorLost, &mut events) && faster.locked_out);
        // 59 s more at 100 Hz: the first fault is more than a minute old.
        let mut later = interlock.at_rate(100.0);
        wait(&mut later, 4000);
        assert!(later.fail(Fault::SensorLost, &mut events) && !later.locked_out);
        // Half a second off is 25 cycles at 50 Hz and 50 at 100 Hz.
        let mut half = Interlock::begin(StartCause::Reset, PACE);
        wait(&mut half, 20);
        let mut half = half.at_rate(100.0);
        wait(&mut half, 9);
        assert!(!half.acknowledges(&off));
        wait(&mut half, 1);
        assert!(half.acknowledges(&off));
    }

    /// Inputs with the enable input on and the bus in control.
    fn commanded(run: Option<bool>, acknowledge: bool) -> Inputs {
        with(inputs(true, false), |it| {
            it.bus = Some(BusCommand { run, acknowledge })
        })
    }

    /// Whether the drive may start after these cycles.
    fn may_start_after(interlock: &mut Interlock, cycles: &[Inputs]) -> bool {
        cycles.iter().fold(false, |_, inputs| {
            interlock.watch(inputs);
            interlock.may_start(inputs)
        })
    }

    #[test]
    fn the_run_bit_starts_by_an_edge_only() {
        let [none, off, on] = [None, Some(false), Some(true)].map(|run| commanded(run, false));
        let begin = || Interlock::begin(StartCause::PowerOn, PACE);
        // After power-on the run bit must be 0 once; the enable input may be on all the time.
        assert!(!may_start_after(&mut begin(), &[none, on, on]));
        assert!(!may_start_after(&mut begin(), &[off]));
        assert!(may_start_after(&mut begin(), &[none, off, on]));
        // Without the enable input, or withheld by the link, an edge has no effect.
        let disabled = with(on, |it| it.enable = false);
        let withheld = with(on, |it| it.withheld = true);
        for stopped in [disabled, withheld] {
            assert!(!may_start_after(&mut begin(), &[off, stopped]));
            assert!(!may_start_after(&mut begin(), &[off, stopped, on]));
            assert!(may_start_after(&mut begin(), &[off, stopped, off, on]));
        }
        let held_off = with(on, |it| it.held_off = true);
        assert!(!may_start_after(&mut begin(), &[off, held_off]));
        assert!(may_start_after(&mut begin(), &[off, held_off, on]));
        // When control passes to the enable input, nothing starts before an edge of it.
        let mut interlock = Interlock::begin(StartCause::Ordinary, PACE);
        assert!(may_start_after(&mut interlock, &[off, on]));
        let [local, low] = [true, false].map(|enable| inputs(enable, false));
        assert!(!may_start_after(&mut interlock, &[local, local]));
        assert!(may_start_after(&mut interlock, &[low, local]));
        assert!(!may_start_after(&mut interlock, &[on]));
    }

    #[test]
    fn the_bus_acknowledges_a_fault_but_no_lockout() {
        let mut events = Events::default();
        let [off, on] = [Some(false), Some(true)].map(|run| commanded(run, false));
        let acknowledge = commanded(Some(true), true);
        let mut interlock = Interlock::begin(StartCause::Ordinary, PACE);
        for _ in 0..2 {
            assert!(may_start_after(&mut interlock, &[off, on]));
            assert!(interlock.fail(Fault::OverCurrent, &mut events));
            interlock.watch(&on);
            assert!(!interlock.acknowledges(&on));
            let lasting = with(acknowledge, |it| it.over_current = true);
            assert!(!interlock.acknowledges(&lasting));
            // An edge while the fault lasts does not count.
            interlock.watch(&off);
            interlock.watch(&acknowledge);
            assert!(interlock.acknowledges(&acknowledge));
            assert!(!may_start_after(&mut interlock, &[on, on]));
        }
        assert!(interlock.fail(Fault::OverCurrent, &mut events) && interlock.locked_out);
        assert!(!interlock.acknowledges(&acknowledge));
        let mut resets = Interlock::begin(StartCause::Repeated, PACE);
        assert!(!resets.acknowledges(&acknowledge));
    }

    #[test]
    fn the_link_gives_back_only_what_it_stopped() {
        let [off, on] = [false, true].map(|enable| inputs(enable, false));
        let [off_withheld, withheld] = [false, true].map(|enable| inputs(enable, true));
        let held_off = with(withheld, |it| it.held_off = true);
        // Inputs when the drive stopped, if it ran; those at rest until the link gives it back.
        for (stopped, at_rest, starts) in [
            (Some(withheld), &[withheld][..], true),
            // The input came on while the link withheld the drive.
            (None, &[off_withheld, withheld], false),
            (None, &[off_withheld, withheld, on, off], true),
            // The input was off for the sample interrupt alone, then for all.
            (Some(withheld), &[held_off, withheld], false),
            (Some(withheld), &[off_withheld, withheld], false),
            // The input was off when the drive stopped.
            (Some(off), &[withheld], false),
        ] {
            let mut interlock = Interlock::begin(StartCause::Ordinary, PACE);
            if let Some(stopped) = stopped {
                interlock.watch(&stopped);
                interlock.stopping(&stopped);
            }
            assert!(!may_start_after(&mut interlock, at_rest), "{at_rest:?}");
            let may_start = may_start_after(&mut interlock, &[on]);
            assert_eq!(may_start, starts, "{at_rest:?}");
        }
    }
}
