//! Square roots, correctly rounded on every CPU.

/// Square root in f32, correctly rounded; NaN below 0.
#[cfg(not(all(target_arch = "arm", target_abi = "eabihf")))]
#[inline(always)]
pub(crate) fn square_root_single(x: f32) -> f32 {
    libm::sqrtf(x)
}

/// Square root in f32, correctly rounded; NaN below 0.
#[cfg(all(target_arch = "arm", target_abi = "eabihf"))]
#[inline(always)]
pub(crate) fn square_root_single(x: f32) -> f32 {
    // SAFETY: the function below takes and returns its f32 in s0 as the hard-float convention says,
    // touches nothing else and is total.
    unsafe { kband_square_root_single(x) }
}

// `core` has no square root on stable Rust, `libm::sqrtf` is software here (about 70 instructions),
// and `asm!` refuses FPU registers for this target (rust-lang/rust#159976).
#[cfg(all(target_arch = "arm", target_abi = "eabihf"))]
core::arch::global_asm!(
    ".section .text.kband_square_root_single,\"ax\",%progbits",
    ".syntax unified",
    ".thumb",
    ".fpu fpv4-sp-d16",
    ".global kband_square_root_single",
    ".type kband_square_root_single,%function",
    ".thumb_func",
    "kband_square_root_single:",
    "vsqrt.f32 s0, s0",
    "bx lr",
);

#[cfg(all(target_arch = "arm", target_abi = "eabihf"))]
unsafe extern "C" {
    fn kband_square_root_single(x: f32) -> f32;
}
