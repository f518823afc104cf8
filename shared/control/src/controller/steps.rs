//! One drive cycle of a controller, step by step.

use super::{Controller, Measured};
use crate::angle::radians_of;
use crate::drive::{Approach, DEAD_TIME_CYCLES, ImpactPhase, ToneInputs, TrackMotion, absolute};
use crate::hear::{DriveState, ImpactEvidence, LoadMeasurement, LoadMeter, MissedImpactDetector};
use crate::identify::{self, Driven, Step};
use crate::supervise::{Clearance, Decision, FaultDetector, LimitInputs, Observation, Prediction};
use crate::{Cycle, Event, Events, Fault, Inputs, Limits, Shape, State, Target, UPPER, phase_of};
use core::f32::consts::TAU;
use kband::arithmetic::{Phase, sine_cosine_single, square_root_single};
use num_complex::Complex32 as Complex;

/// Cycles per quarter of the setpoint from a lock to chaos (docs/theory-capture.md#t7.4).
const GLIDE_CYCLES_PER_QUARTER: f32 = 150.0;
/// Relative error of the amplitude at which the setpoint counts as reached.
const SETPOINT_TOLERANCE: f32 = 0.01;
/// Amplitude over the hard limit below which the track counts as at rest: about sensor noise.
const REST_AMPLITUDE_SHARE: f32 = 0.02;
/// Amplitude, in m per mm of the safe one, above which the resonance is tracked.
const MIN_TRACKING_AMPLITUDE: f32 = 0.3e-3;
/// Amplitude over the smallest detectable one above which the upper tones are phase-locked.
const MIN_FIRST_TONE_RATIO: f32 = 4.0;

struct View<'c> {
    cycle: &'c Cycle,
    finite: bool,
    /// Amplitude b, in m.
    measured: f32,
    /// Phase lead of the track before the output.
    lead: Phase,
    motion: TrackMotion,
}

impl Controller {
    /// As [`Controller::cycle`], without the report.
    pub fn advance(&mut self, cycle: &Cycle, inputs: &Inputs) {
        let mut events = core::mem::take(&mut self.pending_events);
        self.count = self.count.wrapping_add(1);
        // The counter wraps after 99 days at 500 Hz; the classifier's clock restarts with it.
        if self.count == 0 {
            self.listener.begin();
        }
        self.machine.count();
        let silent = Cycle::default();
        let finite = cycle.is_finite();
        let view = self.view(if finite { cycle } else { &silent }, finite);
        let was_limited = !self.limits.limits.is_empty();
        let untrusted = self.detect_faults(&view, inputs, &mut events);
        self.follow_enable_input(inputs, view.measured, &mut events);
        if !untrusted {
            self.lead = radians_of(view.lead);
        }
        self.update_limits(inputs);
        let goal = self.move_reference();
        if !self.machine.running() {
            self.switch_off();
        } else if inputs.held_off {
            self.release_output();
        } else if self.resonance.is_sweeping() {
            self.advance_sweep(view.measured, &mut events);
        } else {
            // The reading of a sensor that may be lost is not used: the output is held.
            if !untrusted {
                self.control_amplitude(&view);
                self.listen(&view, goal);
                self.follow_resonance(view.measured);
                self.control_tones(&view.motion, goal, &mut events);
            }
            self.detect_missed_impacts(&view, goal);
            self.advance_state(goal, view.measured, &mut events);
            self.watch_fit();
            if self.machine.settled() {
                let (margin, missing) = (self.listener.margin(), self.tones.missing_tones());
                (self.selection).retune(margin.as_ref(), missing, &self.settings, &self.scale);
            }
            let flow = self.load().map(|load| load.flow);
            (self.selection).serve_flow(flow, &self.settings, &self.scale, &mut events);
            self.identify(&view, goal, &mut events);
        }
        if let Some(event) = self.weighing.cycle(self.load(), self.resonance.frequency) {
            events.push(event);
        }
        self.report_limits(was_limited, &mut events);
        let (first, upper) = ([self.output, self.output_lead], self.tones.output());
        let mut commands = first.iter().chain(upper.as_flattened());
        if !(view.finite && commands.all(|number| number.is_finite())) {
            self.fail_firmware(&mut events);
        }
        // The limit also holds while an untrusted reading freezes the output.
        self.output = self.output.min(self.output_limit());
        self.predict_envelope();
        self.measured = Measured {
            amplitude: view.measured,
            lead: view.lead,
            shape: if self.tones.allowed() {
                view.motion.shape()
            } else {
                Shape::SINE
            },
            events,
        };
    }

    /// The view of a cycle, with the track's motion corrected for the parts' load.
    fn view<'c>(&mut self, cycle: &'c Cycle, finite: bool) -> View<'c> {
        let motion = Complex::new(-cycle.quadrature, -cycle.in_phase);
        let mut motion = self.estimate_load(cycle, motion / self.scale.angular_squared);
        let finite = finite && motion.is_finite();
        if !motion.is_finite() {
            motion = Complex::default();
        }
        // Displacement over acceleration, at twice and three times the frequency.
        let tone = |[cosine, sine]: [f32; 2], scale: f32| {
            Complex::new(sine, cosine) * (scale / self.scale.angular_squared)
        };
        let [second, third] = cycle.upper;
        let upper = [tone(second, -1.0 / 4.0), tone(third, -1.0 / 9.0)];
        View {
            cycle,
            finite,
            measured: square_root_single(motion.norm_sqr()),
            lead: phase_of(libm::atan2f(motion.im, motion.re)),
            motion: TrackMotion {
                first: motion,
                upper,
            },
        }
    }

    /// Estimates the load, and corrects the track's motion (m) for blanked impacts.
    fn estimate_load(&mut self, cycle: &Cycle, motion: Complex) -> Complex {
        if self.meter.is_none() {
            return motion;
        }
        let one = self.listener.margin();
        let phases = &self.listener.phases;
        let goal = self.selection.setpoint(&self.scale);
        let (quadrature, in_phase) = sine_cosine_single(phase_of(self.output_lead));
        let observed = LoadMeasurement {
            motion,
            output: Complex::new(in_phase, quadrature) * self.output,
            blanked: cycle.blanked,
            square: self.scale.angular_squared,
            frequency: self.resonance.frequency,
            normal_gravity: self.scale.normal_gravity,
            in_gear: self.in_gear(),
            order: self.order().unwrap_or(1),
            restitution: one.map(|margin| margin.restitution),
            cosine: one.map(|_| phases.mean_cosine()),
            sine: self.selection.shape().is_sine(),
            concentration: phases.concentration(),
            has_impact: !cycle.impacts.is_empty(),
            settled: self.machine.kick().is_none()
                && self.machine.running()
                && self.selection.chosen()
                && (self.reference.value - goal).abs() < SETPOINT_TOLERANCE * goal
                && (self.measured.amplitude - goal).abs() < 10.0 * SETPOINT_TOLERANCE * goal,
        };
        (self.meter.as_mut()).map_or(motion, |meter| meter.cycle(&observed))
    }

    /// Controls the upper tones, if the settings allow any, and only at the selected setpoint.
    fn control_tones(&mut self, motion: &TrackMotion, goal: f32, events: &mut Events) {
        if !self.tones.allowed() {
            return;
        }
        let limits = self.limits.limits;
        let allowed = !limits.contains(Limits::LINK_LOST)
            && !limits.contains(Limits::NO_SETPOINT)
            && self.machine.state != State::Stopping
            && self.selection.chosen();
        let tone_inputs = ToneInputs {
            motion: *motion,
            requested: if allowed {
                self.selection.shape()
            } else {
                Shape::SINE
            },
            // Tones that follow a rising reference would be too large while they fall.
            reference: self.reference.value.max(goal),
            square: self.scale.angular_squared,
            headroom: self.settings.output_maximum - self.output,
            min_amplitude: MIN_FIRST_TONE_RATIO * self.scale.min_amplitude,
        };
        let [second, third] = self.tones.cycle(&tone_inputs);
        if second {
            events.push(Event::SecondToneUnlike);
        }
        if third {
            events.push(Event::ThirdToneUnlike);
        }
    }

    /// Detects faults. Returns whether this cycle's reading is untrusted.
    fn detect_faults(&mut self, view: &View, inputs: &Inputs, events: &mut Events) -> bool {
        let (cycle, measured, lead) = (view.cycle, view.measured, radians_of(view.lead));
        if inputs.chatters {
            events.push(Event::EnableChatters);
        }
        for (present, at_rest_too, fault) in [
            (inputs.stack_low, true, Fault::StackLow),
            (inputs.supply_low, true, Fault::SupplyLow),
            (inputs.clock_failed, true, Fault::ClockFailed),
            (inputs.over_current, false, Fault::OverCurrent),
            (inputs.control_late, false, Fault::ControlLate),
            (inputs.over_temperature, false, Fault::OverTemperature),
        ] {
            if present && (at_rest_too || self.machine.running()) {
                self.machine.fail(fault, events);
            }
        }
        self.rest_test.cycle(cycle);
        let driven = (self.scale.envelope).advance(self.by_current, cycle.current);
        let by_current = (self.by_current + driven) * (0.5 * self.scale.per_ampere);
        self.by_current = driven;
        let predicted = (self.predicted_envelopes[1] + self.predicted_envelopes[2])
            * (0.5 * self.scale.full_amplitude);
        let expected = Prediction {
            running: self.machine.running(),
            valid: !self.resonance.is_sweeping(),
            amplitude: absolute(predicted),
            by_current: (self.scale.per_ampere > 0.0).then(|| absolute(by_current)),
            opposed: self.scale.is_opposed(predicted, lead),
            min_amplitude: self.scale.min_amplitude,
            ceiling: self.scale.ceiling,
            reference: self.reference.value,
            error: cycle.noise * square_root_single(2.0 / f32::from(cycle.samples.max(1)))
                / self.scale.angular_squared,
            tolerance: self.settings.load_tolerance,
            shifted: self.rest_test.deviates() == Some(true),
        };
        let (fault, untrusted) = self.faults.cycle(cycle, measured, lead, &expected);
        if let Some(fault) = fault {
            self.machine.fail(fault, events);
        }
        let by_current = expected.by_current.unwrap_or(expected.amplitude);
        match self.swing.cycle(measured, [expected.amplitude, by_current]) {
            None => {}
            // The test swing moves no part, so the usual ratio under load must be estimated again.
            Some(true) => self.faults.reset_load_ratio(),
            Some(false) => self.machine.fail(Fault::SensorImplausible, events),
        }
        untrusted
    }

    fn follow_enable_input(&mut self, inputs: &Inputs, measured: f32, events: &mut Events) {
        let at_rest =
            self.reference.value <= 0.0 && measured < REST_AMPLITUDE_SHARE * self.scale.ceiling;
        let stop_timeout = 4.0 * self.settings.soft_stop * self.settings.frequency;
        let waits = !inputs.enable || inputs.bus.is_some_and(|bus| !bus.runs());
        if waits && !self.machine.running() {
            self.rest_test.restart();
        }
        let clearance = match self.rest_test.deviates() {
            Some(true) => Clearance::Refused(Fault::SensorImplausible),
            Some(false) if self.selection.chosen() => Clearance::Granted,
            _ => Clearance::Pending,
        };
        let response =
            (self.machine).follow_enable_input(inputs, clearance, (at_rest, stop_timeout), events);
        response.into_iter().for_each(|event| events.push(event));
        match response {
            Some(Event::Acknowledged) => self.faults = FaultDetector::default(),
            Some(Event::Stopping) if self.resonance.is_sweeping() => {
                self.resonance.sweep = None;
                self.amplitude.resume(measured, self.output);
            }
            Some(Event::Started) => {
                self.predicted_envelopes = [Complex::default(); 3];
                self.tones.restart();
                self.swing.begin();
                if self.selection.target == Target::Identify
                    && self.selection.no_setpoint().is_none()
                {
                    self.identifier.begin(self.settings.contact_time());
                    self.selection.set_k(identify::FIRST_K);
                }
                if self.resonance.is_tracking() && self.sweep_amplitude() > 0.0 {
                    self.resonance.begin();
                    (self.scale).retune(&self.settings, self.resonance.frequency);
                }
            }
            _ => {}
        }
    }

    fn detect_missed_impacts(&mut self, view: &View, goal: f32) {
        let measured = view.measured;
        let limits = self.limits.limits;
        let settled = match self.machine.state {
            State::Holding | State::Capturing | State::Locked | State::Lost => true,
            State::Limiting => limits == Limits::DEAF || limits == Limits::MISFIT,
            _ => false,
        };
        let at_setpoint = (measured - goal).abs() < 2.0 * SETPOINT_TOLERANCE * goal
            || self.machine.kick().is_some();
        let order = self.order();
        let turns = f32::from(order.unwrap_or(1));
        let unit = measured * square_root_single(self.scale.angular_squared);
        let middle = 0.5 * (self.settings.restitution_low + self.settings.restitution_high);
        self.missed_impact_detector.cycle(&ImpactEvidence {
            listening: settled && order.is_some() && self.selection.chosen(),
            single_lock: self.selection.lock().is_some(),
            at_setpoint,
            rate: self.listener.phases.rate() * turns,
            concentration: self.listener.phases.concentration(),
            speed_from_rest: unit * self.listener.gear.landing_speed_from_rest(),
            locked: unit * TAU * turns * self.scale.k(measured) / (1.0 + middle),
            kicked: self.machine.capture.attempts > 0,
            noise: view.cycle.noise,
        });
    }

    fn update_limits(&mut self, inputs: &Inputs) {
        let timeout = match inputs.bus {
            None => self.settings.link_timeout,
            Some(_) => self.settings.bus_timeout,
        };
        let mut causes = Limits::default();
        // The frequencies of a sweep differ from that of the setpoint.
        let above_ceiling = !self.resonance.is_sweeping()
            && self.selection.setpoint(&self.scale) > self.scale.ceiling;
        let lacks_tones = self.tones.missing_tones() != [false; UPPER];
        causes.set(Limits::NO_SETPOINT, self.selection.no_setpoint().is_some());
        causes.set(self.scale.ceiling_limit, above_ceiling);
        causes.set(Limits::DEAF, self.missed_impact_detector.missed_impacts);
        causes.set(Limits::MISFIT, self.selection.misfit);
        causes.set(Limits::SECOND_TONE, lacks_tones);
        self.limits.cycle(&LimitInputs {
            running: self.machine.running(),
            frame_received: inputs.link_heard,
            link_timeout: (timeout > 0.0).then_some(timeout * self.settings.frequency),
            saturated: self.amplitude.saturated,
            causes,
        });
    }

    /// Moves the reference by one cycle; its goal, in m.
    fn move_reference(&mut self) -> f32 {
        let (settings, setpoint) = (&self.settings, self.selection.setpoint(&self.scale));
        let limits = self.limits.limits;
        let safe = settings.safe_amplitude * 1e-3;
        let scale = setpoint.max(safe) / settings.frequency;
        let (min_cycles, share) = self.amplitude.start_limits();
        let start = settings.soft_start.max(min_cycles / settings.frequency);
        let up = Approach::Ramp(share * scale / start);
        let down = Approach::Ramp(scale / settings.soft_stop);
        let glide = Approach::Ramp(setpoint * (0.25 / GLIDE_CYCLES_PER_QUARTER));
        let (goal, approach) = match (self.machine.state, self.machine.kick()) {
            (State::Off | State::Fault, _) => (0.0, Approach::Step),
            (State::Stopping, _) => (0.0, down),
            // Without a certain target the amplitude falls or stays, but never rises.
            _ if limits.contains(Limits::LINK_LOST) => {
                (safe.min(setpoint).min(self.reference.value), down)
            }
            _ if limits.contains(Limits::NO_SETPOINT) => (safe.min(self.reference.value), down),
            _ if !self.selection.chosen() => (self.reference.value, Approach::Step),
            (_, Some(kick)) => (setpoint * kick, Approach::Lag),
            _ if self.machine.glides() => (setpoint, glide),
            _ => (setpoint, up),
        };
        let goal = goal.min(self.scale.ceiling);
        let limits = self.swing_limits();
        let allowed = limits.map_or(goal, |[limit, _]| goal.min(limit));
        (self.reference).advance(allowed, approach, self.lead, self.settings.envelope);
        self.swing.held = allowed < goal && self.reference.value == allowed;
        goal
    }

    /// Limits of a start's test swing on the reference and on the output's amplitude, in m.
    fn swing_limits(&self) -> Option<[f32; 2]> {
        let (swing, scale) = (&self.swing, &self.scale);
        let limits = swing.limits(self.reference.value, scale.ceiling, scale.min_amplitude);
        limits.filter(|_| !self.resonance.is_sweeping())
    }

    /// Upper limit of the next output, as a share of full output, without the accelerometer.
    fn output_limit(&self) -> f32 {
        let amplitude = self.swing_limits().map(|[_, limit]| limit);
        (self.scale).output_limit(self.predicted_envelopes[0], amplitude)
    }

    fn switch_off(&mut self) {
        self.release_output();
        self.listener.clear();
        self.missed_impact_detector = MissedImpactDetector::default();
        self.limits.rest();
        if self.selection.misfit {
            self.restart_target();
        }
        let decision = self.machine.rest();
        self.carry_out(decision);
        self.identifier.interrupt();
    }

    /// Switches the output off while the track comes to rest; the bridge is open already.
    fn release_output(&mut self) {
        (self.output, self.output_lead) = (0.0, 0.0);
        self.reference.value = 0.0;
        self.amplitude.resume(0.0, 0.0);
        self.tones.rest();
    }

    /// Amplitude at the peak of the resonance search, in m.
    fn sweep_amplitude(&self) -> f32 {
        (self.settings.safe_amplitude * 1e-3)
            .min(self.selection.setpoint(&self.scale))
            .min(self.scale.ceiling)
    }

    /// One cycle of the resonance search, with the output of the safe amplitude at the resonance.
    fn advance_sweep(&mut self, measured: f32, events: &mut Events) {
        let rise = (measured - self.measured.amplitude).max(0.0);
        if measured + DEAD_TIME_CYCLES * rise > self.scale.ceiling {
            self.resonance.halve_sweep();
        }
        let output = self.sweep_amplitude() / self.scale.full_amplitude;
        self.output = self.resonance.sweep_share() * output.min(self.settings.output_maximum);
        self.output_lead = 0.0;
        self.reference.value = measured.min(self.scale.ceiling);
        let ended = self.resonance.advance_sweep(measured);
        (self.scale).retune(&self.settings, self.resonance.frequency);
        if ended {
            self.amplitude.resume(measured, self.output);
            events.push(Event::ResonanceFound);
        }
    }

    fn follow_resonance(&mut self, measured: f32) {
        if self.resonance.is_tracking()
            && measured > MIN_TRACKING_AMPLITUDE * self.settings.safe_amplitude
        {
            self.resonance.track(self.lead - self.output_lead);
            (self.scale).retune(&self.settings, self.resonance.frequency);
        }
    }

    /// Confidence, 0..1, that parts are in the requested lock; 0 if single impacts are too faint.
    pub(super) fn confidence(&self) -> f32 {
        if self.missed_impact_detector.merges_impacts {
            return 0.0;
        }
        self.listener.confidence(self.selection.lock())
    }

    #[inline(always)]
    fn advance_state(&mut self, goal: f32, measured: f32, events: &mut Events) {
        let observed = Observation {
            at_setpoint: self.selection.chosen()
                && self.reference.value == goal
                && (measured - goal).abs() < SETPOINT_TOLERANCE * goal
                && self.tones.is_settled(),
            limits: self.limits.limits,
            lock: self.selection.lock().map(|_| self.confidence()),
            regime: self.listener.regime.as_ref(),
            plan: self.selection.search.plan.as_ref(),
            chaos: self.selection.chaos_result(),
        };
        let decision = self.machine.advance(&observed, events);
        self.carry_out(decision);
    }

    /// Tests whether the parts fit the lot of gear. The result stays until the track is empty.
    fn watch_fit(&mut self) {
        if self.selection.misfit {
            if self.listener.empty {
                self.restart_target();
            }
        } else if self.selection.gear_order().is_some()
            && self.machine.settled()
            && self.listener.is_misfit()
        {
            self.selection.set_misfit(&self.settings, &self.scale);
        }
    }

    #[inline(never)]
    fn restart_target(&mut self) {
        if let Ok(selection) = self.select(self.selection.target, &self.settings) {
            self.selection = selection;
            self.begin_target();
        }
    }

    #[inline(always)]
    fn carry_out(&mut self, decision: Decision) {
        match decision {
            Decision::Stay => {}
            Decision::ForgetImpacts => self.listener.clear(),
            Decision::GoToChaos(k) => self.selection.set_k(k),
            Decision::GoToLock => self.selection.go_to_lock(),
            Decision::NoChaos => self.selection.give_up_chaos(),
        }
    }

    fn identify(&mut self, view: &View, goal: f32, events: &mut Events) {
        if !self.identifier.is_running() {
            return;
        }
        if self.machine.state != State::Holding {
            if self.identifier.wait() != Step::Going {
                events.push(Event::NotIdentified);
            }
            return;
        }
        let measured = view.measured;
        let amplitude_error = if self.reference.value == goal {
            (measured - goal).abs() / goal
        } else {
            f32::INFINITY
        };
        let driven = Driven {
            amplitude_error,
            k: f64::from(self.scale.k(measured)),
            lead: phase_of(self.lead),
            min_k: f64::from(self.scale.k(self.scale.reach(&self.settings))),
            normal_gravity: self.scale.normal_gravity,
            step: self.scale.step,
            listener: &self.listener,
        };
        match self.identifier.cycle(&driven, view.cycle) {
            Step::Going => {}
            Step::At(k) => {
                self.listener.clear();
                self.selection.set_k(k);
            }
            Step::Done(true) => events.push(Event::Identified),
            Step::Done(false) => events.push(Event::NotIdentified),
        }
    }

    fn control_amplitude(&mut self, view: &View) {
        let reference = self.reference.value;
        let limit = self.output_limit();
        let impact_phase = ImpactPhase {
            at: (self.meter.as_ref()).map_or(Complex::default(), LoadMeter::impact_phase),
            silent: self.meter.as_ref().is_none_or(LoadMeter::is_silent),
        };
        [self.output, self.output_lead] = self
            .amplitude
            .control_under_load(view.motion.first, impact_phase, reference, limit)
            .unwrap_or_else(|| [self.amplitude.cycle(view.measured, reference, limit), 0.0]);
    }

    fn listen(&mut self, view: &View, goal: f32) {
        let drive_state = DriveState {
            count: self.count,
            lead: view.lead,
            order: self.order().unwrap_or(1),
            k: self.scale.k(view.measured),
            shape: self.measured.shape,
            step: self.scale.step,
            lot: self.selection.lot(&self.settings),
            settled: self.machine.kick().is_none()
                && self.reference.value == goal
                && (view.measured - goal).abs() < 2.0 * SETPOINT_TOLERANCE * goal,
            contact: self.settings.contact_time(),
            detects_gear: self.watches_ready && self.selection.gear_order().is_some(),
            needs_regime: self.machine.detects_chaos(),
        };
        (self.listener).cycle(view.cycle, &drive_state, self.selection.lock());
    }

    fn report_limits(&self, was_limited: bool, events: &mut Events) {
        let is_limited = !self.limits.limits.is_empty();
        if !was_limited && is_limited {
            events.push(Event::Limited);
        } else if was_limited && !is_limited && self.machine.running() {
            events.push(Event::Freed);
        }
    }

    /// Switches the drive off after an error of the firmware, and clears the loops' estimates.
    fn fail_firmware(&mut self, events: &mut Events) {
        self.machine.fail(Fault::ControlLate, events);
        self.amplitude.forget();
        self.meter = LoadMeter::build(&self.settings);
        self.tones.restart();
        self.predicted_envelopes = [Complex::default(); 3];
        self.switch_off();
    }

    /// Predicts the envelope at the end of the cycle that the output drives.
    fn predict_envelope(&mut self) {
        let [newest, before, _] = self.predicted_envelopes;
        // Missing amplitude counts as load only while impacts are detected.
        let detected = self.listener.phases.rate() > 0.0;
        let load = if detected { self.amplitude.load() } else { 0.0 };
        let (_, in_phase) = sine_cosine_single(phase_of(self.output_lead));
        let driven = self.output * in_phase - load;
        self.predicted_envelopes = [self.scale.envelope.advance(newest, driven), newest, before];
    }
}
