//! One test for each scene: what the file expects is what comes, and nothing else.

use kband_host::desk::Desk;
use kband_host::simulate::{Outcome, SceneFile};

fn run(name: &str) {
    let path = kband_tests::root()
        .join("tests/scenes")
        .join(name)
        .with_extension("toml");
    let text = std::fs::read_to_string(path).unwrap();
    let file = SceneFile::parse(&text).unwrap_or_else(|refusal| panic!("{refusal}"));
    let desk = Desk::new(Some(1)).unwrap();
    let outcome = Outcome::run(&file, &desk).unwrap_or_else(|refusal| panic!("{refusal}"));
    let expected = file
        .expectation
        .expect("a scene states what must come of it");
    let unmet = expected.unmet(&outcome);
    assert!(unmet.is_empty(), "{}", unmet.join("\n"));
}

macro_rules! scenes {
    ($($name:ident)+) => {
        $(#[test]
        fn $name() {
            run(stringify!($name));
        })+

        #[test]
        fn every_scene_has_its_test() {
            let listed = [$(stringify!($name)),+];
            for entry in std::fs::read_dir(kband_tests::root().join("tests/scenes")).unwrap() {
                let path = entry.unwrap().path();
                let name = path.file_stem().unwrap().to_string_lossy().into_owned();
                assert!(listed.contains(&name.as_str()), "{name} has no test");
            }
        }
    };
}

scenes! {
    acceleration_limit
    amplitude_limit
    chaotic
    empty_band
    enable_in_stopping
    fault_at_rest
    fault_in_capture
    fault_in_holding
    fault_in_limiting
    fault_in_stopping
    from_rest
    gain_drift
    link_lost
    link_lost_in_capture
    link_lost_in_holding
    lock_lost
    lock_comes_back
    locked
    locked_order_2
    many_parts
    new_target
    no_common_chaos
    no_response
    not_captured
    output_limit
    outside_every_band
    over_amplitude
    over_temperature
    over_temperature_in_start
    resonance_tracking
    sensor_inverted
    sensor_lost
    sensor_saturated
    settings_invalid
    speed
    speed_of_no_lock
    stack_low
    stop_and_start
    stop_in_capture
    stop_in_holding
    stop_in_limiting
    stop_in_lost
    stop_in_start
    stop_in_sweep
    stopped
    target_in_capture
    target_in_holding
    target_in_limiting
    target_in_lost
    watchdog_reset
    watchdog_reset_stays_off
}
