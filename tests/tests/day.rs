//! A shortened day: no fault without injection, recovery after each event, and no drift.
//!
//! `KBAND_DAYS` selects whole days, in the envelope from the second day on.

use kband_host::simulate::Fidelity;
use kband_tests::day::operate;

#[test]
fn half_an_hour_of_operation_has_no_fault_that_was_not_injected() {
    let days: Option<f64> = std::env::var("KBAND_DAYS")
        .ok()
        .map(|text| text.parse().unwrap());
    let fidelity = if days.is_some_and(|days| days > 1.0) {
        Fidelity::Envelope
    } else {
        Fidelity::Waveform
    };
    let shift = operate(days.map_or(1800.0, |days| 86_400.0 * days), 1, fidelity);
    assert!(shift.wrong.is_empty(), "{}", shift.wrong.join("\n"));
    let times = |name| shift.happened.get(name).copied().unwrap_or(0);
    // Every kind of event occurred, and each lost sensor gave a fault.
    for name in ["other parts", "short drop-out", "lost sensor"] {
        assert!(times(name) > 0, "{name}");
    }
    assert!(times("pause") > 0 && times("silent link") > 0);
    assert_eq!(times("lost sensor"), times("faulted"));
    assert_eq!(times("faulted"), times("acknowledged"));
    // Two samples: one for the place of a wrap, one for its detection.
    assert!(shift.time_off < 2.01 / 20_000.0, "{} s", shift.time_off);
    // In days the error of the phase in lock differs between tenths by less than its scatter.
    let errors = (0..10).map(|tenth| shift.mean_error(tenth));
    let (low, high) = errors.fold((f64::MAX, f64::MIN), |(low, high), error| {
        (low.min(error), high.max(error))
    });
    assert!(days.is_none() || high - low < 0.01, "{low} {high}");
    // An event takes about a minute; parts are out of lock for at most four seconds of it in the
    // mean.
    let (locked, cycles) = (shift.locked, shift.cycles);
    assert!(locked * 10 > cycles * 8, "{locked} of {cycles}");
}
