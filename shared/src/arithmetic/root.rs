//! Square roots, correctly rounded on every CPU.

/// Square root in f32, correctly rounded; NaN below 0.
#[cfg(not(all(target_arch = "arm", target_abi = "eabihf")))]
#[inline(always)]
pub fn square_root_single(x: f32) -> f32 {
    libm::sqrtf(x)
}

/// Square root in f32, correctly rounded; NaN below 0.
///
/// `core` has no square root on stable Rust, and `libm::sqrtf` takes about 70 instructions here.
/// `asm!` rejects FPU registers for this target (rust-lang/rust#159976). The compiler replaces C's
/// `sqrtf` by the FPU's instruction and calls it for NaN only.
#[cfg(all(target_arch = "arm", target_abi = "eabihf"))]
#[inline(always)]
pub fn square_root_single(x: f32) -> f32 {
    // SAFETY: C's function is total and pure; the compiler's library provides it for this target.
    unsafe { sqrtf(x) }
}

#[cfg(all(target_arch = "arm", target_abi = "eabihf"))]
unsafe extern "C" {
    fn sqrtf(x: f32) -> f32;
}

/// Square root in f64, correctly rounded; NaN below 0.
#[inline(always)]
pub(crate) fn square_root(x: f64) -> f64 {
    // The `libm` crate gives the same result; the compiler can schedule the intrinsic.
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
