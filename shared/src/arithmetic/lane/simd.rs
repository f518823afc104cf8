//! Detection of the CPU's SIMD extensions at run time.

/// Register width for a block of orbits; the results have the same bits in each.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[cfg_attr(not(target_arch = "x86_64"), allow(dead_code))]
pub enum Simd {
    /// One orbit at a time, on any CPU.
    None,
    /// Four orbits at a time: AVX2, with POPCNT, BMI1 and BMI2.
    Avx2,
}

impl Simd {
    /// All widths, narrowest first.
    #[cfg(test)]
    pub const ALL: [Self; 2] = [Self::None, Self::Avx2];

    /// Widest one supported by CPU and operating system.
    pub fn widest() -> Self {
        #[cfg(target_arch = "x86_64")]
        return x86::widest();
        #[cfg(not(target_arch = "x86_64"))]
        Self::None
    }
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use core::arch::x86_64::{__cpuid, __cpuid_count, _xgetbv};
    use core::sync::atomic::{AtomicU8, Ordering};

    use super::Simd;

    /// Cached result as an index of `WIDTHS`; `WIDTHS.len()` before the first query. A hypervisor
    /// traps each CPUID: a query per register of impacts took nine tenths of a map of gear.
    static CACHED_WIDTH: AtomicU8 = AtomicU8::new(WIDTHS.len() as u8);
    const WIDTHS: [Simd; 2] = [Simd::None, Simd::Avx2];

    pub(super) fn widest() -> Simd {
        // Concurrent queries store the same result.
        let answer = usize::from(CACHED_WIDTH.load(Ordering::Relaxed));
        WIDTHS.get(answer).copied().unwrap_or_else(|| {
            let simd = detect();
            CACHED_WIDTH.store(simd as u8, Ordering::Relaxed);
            simd
        })
    }

    fn detect() -> Simd {
        const OS_SAVES: u32 = 1 << 27;
        const AVX: u32 = 1 << 28;
        const POPCNT: u32 = 1 << 23;
        const AVX2_BMI: u32 = 1 << 5 | 1 << 3 | 1 << 8;
        const YMM: u64 = 0b110;
        let leaves = __cpuid(0).eax;
        let basic = __cpuid(1).ecx;
        const BASIC: u32 = OS_SAVES | AVX | POPCNT;
        if leaves < 7 || basic & BASIC != BASIC {
            return Simd::None;
        }
        let extended = __cpuid_count(7, 0).ebx;
        // SAFETY: the operating system provides xgetbv.
        let saved = unsafe { saved_registers() };
        if saved & YMM != YMM || extended & AVX2_BMI != AVX2_BMI {
            Simd::None
        } else {
            Simd::Avx2
        }
    }

    /// Registers saved by the operating system for a thread.
    #[target_feature(enable = "xsave")]
    fn saved_registers() -> u64 {
        // SAFETY: register 0 always exists.
        unsafe { _xgetbv(0) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(target_arch = "x86_64")]
    #[test]
    fn detected_width_matches_the_standard_library() {
        let bits = std::is_x86_feature_detected!("popcnt")
            && std::is_x86_feature_detected!("bmi1")
            && std::is_x86_feature_detected!("bmi2");
        let expected = if bits && std::is_x86_feature_detected!("avx2") {
            Simd::Avx2
        } else {
            Simd::None
        };
        // First and cached result.
        assert_eq!([Simd::widest(), Simd::widest()], [expected; 2]);
    }
}
