//! Detection of the CPU's SIMD extensions at run time.

/// Register width for a block of orbits; the results have the same bits in each.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[cfg_attr(not(target_arch = "x86_64"), allow(dead_code))]
pub enum Simd {
    /// One orbit at a time, on any CPU.
    None,
    /// Eight orbits at a time: AVX2, with POPCNT, BMI1 and BMI2.
    Avx2,
}

impl Simd {
    /// All widths, narrowest first.
    #[cfg(test)]
    pub const ALL: [Self; 2] = [Self::None, Self::Avx2];

    /// Widest one supported by CPU and operating system.
    pub fn widest() -> Self {
        #[cfg(all(target_arch = "x86_64", not(target_os = "none")))]
        if std::is_x86_feature_detected!("avx2")
            && std::is_x86_feature_detected!("popcnt")
            && std::is_x86_feature_detected!("bmi1")
            && std::is_x86_feature_detected!("bmi2")
        {
            return Self::Avx2;
        }
        Self::None
    }
}
