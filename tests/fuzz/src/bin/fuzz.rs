//! One target under libFuzzer, selected by `KBAND_FUZZ`.
#![no_main]

use kband_fuzz::Target;
use std::sync::OnceLock;

static TARGET: OnceLock<&Target> = OnceLock::new();

libfuzzer_sys::fuzz_target!(|input: &[u8]| {
    let target = TARGET.get_or_init(|| {
        let name = std::env::var("KBAND_FUZZ").unwrap_or_default();
        Target::named(&name).unwrap_or_else(|| panic!("KBAND_FUZZ = '{name}' names no target"))
    });
    let _ = (target.run)(input);
});
