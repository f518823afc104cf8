//! The scenes, each with the behaviour that it shows and the break that hides it.

use kband_scene::SceneFile;

/// The scene of this name.
///
/// # Panics
/// There is none, or it is refused.
pub fn read(name: &str) -> SceneFile {
    let folder = crate::root().join("tests/scenes");
    let text = std::fs::read_to_string(folder.join(name).with_extension("toml"));
    let scene = SceneFile::parse(&text.unwrap_or_else(|error| panic!("{name}: {error}")));
    scene.unwrap_or_else(|refusal| panic!("{name}: {refusal}"))
}

/// Calls the macro `$each` with all scenes. The expressions have names of `tests/proofs.rs`.
#[macro_export]
macro_rules! all_scenes {
    ($each:ident) => {
        $each! {
            acceleration_limit: Limit(Limits::ACCELERATION), Told(no_limits);
            amplitude_limit: Limit(Limits::AMPLITUDE), Told(no_limits);
            amplitude_oscillates: Stops(AmplitudeOscillates), Hidden(gain);
            nan: Obeying, Hidden(target);
            track_mass_unstable_gear: Obeying, Told(another_target);
            track_mass_unstable_k: Obeying, Told(another_target);
            brown_out: Stops(WatchdogReset), Restarted(Ordinary);
            brown_out_stays_off: Stops(WatchdogReset), Restarted(Ordinary);
            chaotic: Obeying, Told(another_target);
            deaf: Limit(Limits::DEAF), Told(another_target);
            detuned: Obeying, Told(tuned);
            doubled: Listening, Told(livelier_lot);
            drawn_parts: Listening, Seen(deaf);
            empty_band: Limit(Limits::NO_SETPOINT), Told(narrow_lot);
            enable_in_stopping: Obeying, Hidden(enable);
            fault_at_rest: Stops(StackLow), Hidden(stack);
            fault_in_capture: Stops(NoResponse), Hidden(gain);
            fault_in_holding: Stops(SensorLost), Hidden(lost);
            fault_in_limiting: Stops(SensorInverted), Hidden(inverted);
            fault_in_stopping: Stops(OverTemperature), Hidden(hot);
            friction: Obeying, Told(another_target);
            from_rest: Listening, Seen(deaf);
            gain_drift: Listening, Done(uncontrolled);
            hopper_dump: Obeying, Told(heavier);
            identification: Listening, Seen(unfolded);
            identification_without_parts: Obeying, Told(another_target);
            in_gear: Obeying, Told(another_target);
            link_lost: Limit(Limits::LINK_LOST), Hidden(link);
            link_lost_in_capture: Limit(Limits::LINK_LOST), Hidden(link);
            link_lost_in_holding: Limit(Limits::LINK_LOST), Hidden(link);
            lock_comes_back: Listening, Seen(deaf);
            lock_lost: Listening, Hidden(parts);
            locked: Listening, Seen(deaf);
            locked_above_k_1: Listening, Seen(deaf);
            locked_order_2: Listening, Seen(deaf);
            mains_ripple: Listening, Seen(deaf);
            many_parts: Listening, Seen(deaf);
            misfit: Limit(Limits::MISFIT), Told(another_target);
            new_target: Obeying, Hidden(target);
            no_common_chaos: Limit(Limits::NO_SETPOINT), Told(narrow_lot);
            no_response: Stops(NoResponse), Hidden(gain);
            not_captured: Obeying, Told(no_kicks);
            output_limit: Limit(Limits::OUTPUT), Hidden(gain);
            outside_every_band: Obeying, Told(another_target);
            over_amplitude: Stops(OverAmplitude), Hidden(gain);
            over_temperature: Stops(OverTemperature), Hidden(hot);
            over_temperature_in_start: Stops(OverTemperature), Hidden(hot);
            parts_leave_and_arrive: Listening, Hidden(presence);
            resonance_tracking: Obeying, Told(fixed_frequency);
            second_tone_cut: Limit(Limits::SECOND_TONE), Hidden(gain);
            sensor_inverted: Stops(SensorInverted), Hidden(inverted);
            sensor_lost: Stops(SensorLost), Hidden(lost);
            sensor_saturated: Stops(SensorSaturated), Seen(unsaturated);
            settings_invalid: Stops(SettingsInvalid), Told(forget_reset);
            speed: Obeying, Told(another_target);
            speed_of_no_lock: Limit(Limits::NO_SETPOINT), Told(another_target);
            stack_low: Stops(StackLow), Hidden(stack);
            over_current: Stops(OverCurrent), Hidden(over_current);
            supply_low: Stops(SupplyLow), Hidden(supply);
            clock_failed: Stops(ClockFailed), Hidden(clock);
            control_late: Stops(ControlLate), Hidden(late);
            sensor_implausible: Stops(SensorImplausible), Hidden(sensitivity);
            stop_and_start: Obeying, Hidden(enable);
            stop_in_capture: Obeying, Hidden(enable);
            stop_in_holding: Obeying, Hidden(enable);
            stop_in_limiting: Obeying, Hidden(enable);
            fault_in_lost: Stops(OverTemperature), Hidden(hot);
            stop_in_lost: Obeying, Hidden(enable);
            stop_in_start: Obeying, Hidden(enable);
            stop_in_sweep: Obeying, Hidden(enable);
            stopped: Obeying, Hidden(enable);
            target_in_capture: Obeying, Hidden(target);
            target_in_holding: Obeying, Hidden(target);
            target_in_limiting: Obeying, Hidden(target);
            target_in_lost: Obeying, Hidden(target);
            image_damaged: Stops(ImageDamaged), Told(forget_reset);
            repeated_resets: Stops(RepeatedResets), Told(forget_reset);
            watchdog_reset: Stops(WatchdogReset), Told(forget_reset);
            watchdog_reset_stays_off: Stops(WatchdogReset), Told(forget_reset);
        }
    };
}
