//! C interface of kband. `include/kband.h` is made of it by cbindgen.
//!
//! A handle is used by one thread at a time: it is live or null, and freed once. Any other pointer
//! is null, or to what the call reads or writes. After its creation the signal path and the
//! controller allocate nothing, unless a call fails.
#![allow(unsafe_code)]

use std::ffi::c_char;

pub mod failure;
pub mod feeder;
pub mod map;
pub mod regimes;

/// Version of kband, as "0.1.0".
#[unsafe(no_mangle)]
pub extern "C" fn kband_version() -> *const c_char {
    concat!(env!("CARGO_PKG_VERSION"), "\0").as_ptr().cast()
}
