//! A shortened day: no fault without injection, recovery after each event, and no drift.
//!
//! The whole day is `tests/run.sh --soak`.

use kband_host::simulate::Fidelity;
use kband_tests::day::operate;

#[test]
fn half_an_hour_of_operation_has_no_fault_that_was_not_injected() {
    let shift = operate(1800.0, 1, Fidelity::Waveform);
    assert!(shift.wrong.is_empty(), "{}", shift.wrong.join("\n"));
    let times = |name| shift.happened.get(name).copied().unwrap_or(0);
    // Every kind of event occurred, and each lost sensor gave a fault.
    for name in [
        "other parts",
        "short drop-out",
        "lost sensor",
        "pause",
        "silent link",
    ] {
        assert!(times(name) > 0, "{name}");
    }
    assert_eq!(times("lost sensor"), times("faulted"));
    assert_eq!(times("faulted"), times("acknowledged"));
    // Two samples: one for the place of a wrap, one for its detection.
    assert!(shift.time_off < 2.01 / 20_000.0, "{} s", shift.time_off);
    // An event takes about a minute; parts are out of lock for at most four seconds of it in the
    // mean.
    assert!(
        shift.locked * 10 > shift.cycles * 8,
        "{} of {}",
        shift.locked,
        shift.cycles
    );
}
