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

/// Square root in f64, correctly rounded; NaN below 0.
#[inline(always)]
pub(crate) fn square_root(x: f64) -> f64 {
    // The `libm` crate's answer is the same; the intrinsic lets the compiler schedule it.
    #[cfg(all(target_arch = "x86_64", target_feature = "sse2"))]
    {
        use core::arch::x86_64::{_mm_cvtsd_f64, _mm_set_sd, _mm_sqrt_sd};
        // SAFETY: the target has SSE2.
        unsafe {
            let x = _mm_set_sd(x);
            _mm_cvtsd_f64(_mm_sqrt_sd(x, x))
        }
    }
    #[cfg(not(all(target_arch = "x86_64", target_feature = "sse2")))]
    libm::sqrt(x)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_the_correctly_rounded_root() {
        let mut x = 1e-310;
        while x < 1e300 {
            assert_eq!(square_root(x).to_bits(), libm::sqrt(x).to_bits(), "{x:e}");
            x *= 1.618_033_988_749_895;
        }
        assert!(square_root(-1.0).is_nan());
        assert_eq!(square_root(0.0), 0.0);
    }
}
