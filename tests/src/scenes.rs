//! The scenes, each with the behaviour that it shows and the break that hides it.

use kband_scene::SceneFile;

/// The scene with this name.
pub fn read(name: &str) -> SceneFile {
    let folder = crate::root().join("tests/scenes");
    let text = std::fs::read_to_string(folder.join(name).with_extension("toml"));
    let scene = SceneFile::parse(&text.unwrap_or_else(|error| panic!("{name}: {error}")));
    scene.unwrap_or_else(|refusal| panic!("{name}: {refusal}"))
}

/// Calls the macro `$each` with all scenes; its expressions use names of `tests/proofs.rs`.
#[macro_export]
macro_rules! all_scenes {
    ($each:ident) => {
        $each! {
            acceleration_limit: Limit(Limits::ACCELERATION), Misconfigured(NO_LIMITS);
            amplitude_limit: Limit(Limits::AMPLITUDE), Misconfigured(NO_LIMITS);
            amplitude_oscillates: Stops(AmplitudeOscillates), Hidden;
            nan: Obeying, Hidden;
            track_mass_unstable_gear: Obeying, Misconfigured(ANOTHER_TARGET);
            track_mass_unstable_k: Obeying, Misconfigured(ANOTHER_TARGET);
            brown_out: Stops(WatchdogReset), Restarted(Ordinary);
            brown_out_stays_off: Stops(WatchdogReset), Restarted(Ordinary);
            chaotic: Obeying, Misconfigured(ANOTHER_TARGET);
            deaf: Limit(Limits::DEAF), Misconfigured(ANOTHER_TARGET);
            detuned: Obeying, Misconfigured(TUNED);
            doubled: Listening, Misconfigured(LIVELIER_LOT);
            drawn_parts: Listening, Measured(DEAF);
            empty_band: Limit(Limits::NO_SETPOINT), Misconfigured(NARROW_LOT);
            enable_in_stopping: Obeying, Hidden;
            fault_at_rest: Stops(StackLow), Hidden;
            fault_in_capture: Stops(NoResponse), Hidden;
            fault_in_holding: Stops(SensorLost), Hidden;
            fault_in_limiting: Stops(SensorInverted), Hidden;
            fault_in_stopping: Stops(OverTemperature), Hidden;
            friction: Obeying, Misconfigured(ANOTHER_TARGET);
            from_rest: Listening, Measured(DEAF);
            gain_drift: Listening, Commanded(UNCONTROLLED);
            hopper_dump: Obeying, Misconfigured(HEAVIER);
            identification: Listening, Measured(UNAVERAGED);
            identification_without_parts: Obeying, Misconfigured(ANOTHER_TARGET);
            in_gear: Obeying, Misconfigured(ANOTHER_TARGET);
            link_lost: Limit(Limits::LINK_LOST), Hidden;
            link_lost_in_capture: Limit(Limits::LINK_LOST), Hidden;
            link_lost_in_holding: Limit(Limits::LINK_LOST), Hidden;
            lock_comes_back: Listening, Measured(DEAF);
            lock_lost: Listening, Hidden;
            locked: Listening, Measured(DEAF);
            locked_above_k_1: Listening, Measured(DEAF);
            locked_order_2: Listening, Measured(DEAF);
            mains_ripple: Listening, Measured(DEAF);
            many_parts: Listening, Measured(DEAF);
            misfit: Limit(Limits::MISFIT), Misconfigured(ANOTHER_TARGET);
            new_target: Obeying, Hidden;
            no_common_chaos: Limit(Limits::NO_SETPOINT), Misconfigured(NARROW_LOT);
            no_response: Stops(NoResponse), Hidden;
            not_captured: Obeying, Misconfigured(NO_KICKS);
            output_limit: Limit(Limits::OUTPUT), Hidden;
            outside_every_band: Obeying, Misconfigured(ANOTHER_TARGET);
            over_amplitude: Stops(OverAmplitude), Hidden;
            over_temperature: Stops(OverTemperature), Hidden;
            over_temperature_in_start: Stops(OverTemperature), Hidden;
            parts_leave_and_arrive: Listening, Hidden;
            resonance_tracking: Obeying, Misconfigured(FIXED_FREQUENCY);
            second_tone_cut: Limit(Limits::SECOND_TONE), Hidden;
            sensor_inverted: Stops(SensorInverted), Hidden;
            sensor_lost: Stops(SensorLost), Hidden;
            sensor_saturated: Stops(SensorSaturated), Measured(UNSATURATED);
            settings_invalid: Stops(SettingsInvalid), Misconfigured(FORGET_RESET);
            speed: Obeying, Misconfigured(ANOTHER_TARGET);
            speed_of_no_lock: Limit(Limits::NO_SETPOINT), Misconfigured(ANOTHER_TARGET);
            stack_low: Stops(StackLow), Hidden;
            over_current: Stops(OverCurrent), Hidden;
            supply_low: Stops(SupplyLow), Hidden;
            clock_failed: Stops(ClockFailed), Hidden;
            control_late: Stops(ControlLate), Hidden;
            sensor_implausible: Stops(SensorImplausible), Hidden;
            stop_and_start: Obeying, Hidden;
            stop_in_capture: Obeying, Hidden;
            stop_in_holding: Obeying, Hidden;
            stop_in_limiting: Obeying, Hidden;
            fault_in_lost: Stops(OverTemperature), Hidden;
            stop_in_lost: Obeying, Hidden;
            stop_in_start: Obeying, Hidden;
            stop_in_sweep: Obeying, Hidden;
            stopped: Obeying, Hidden;
            target_in_capture: Obeying, Hidden;
            target_in_holding: Obeying, Hidden;
            target_in_limiting: Obeying, Hidden;
            target_in_lost: Obeying, Hidden;
            image_damaged: Stops(ImageDamaged), Misconfigured(FORGET_RESET);
            repeated_resets: Stops(RepeatedResets), Misconfigured(FORGET_RESET);
            watchdog_reset: Stops(WatchdogReset), Misconfigured(FORGET_RESET);
            watchdog_reset_stays_off: Stops(WatchdogReset), Misconfigured(FORGET_RESET);
        }
    };
}
