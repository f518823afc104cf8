//! Instruction counter by SysTick. The emulator's clock takes 1 ns for each instruction.

use cortex_m::Peripherals;
use cortex_m::peripheral::SYST;
use cortex_m::peripheral::syst::SystClkSource;

/// Rate of SysTick in QEMU's `olimex-stm32-h405`, MHz.
const RATE: u64 = 168;
/// Full range of SysTick: 99 million instructions.
const FULL: u32 = 0x00ff_ffff;

/// A counter of instructions.
pub struct Counter(());

impl Counter {
    /// Starts the counter, once.
    pub fn start() -> Self {
        let peripherals = Peripherals::take();
        let mut system = peripherals.expect("the counter is started once").SYST;
        system.set_clock_source(SystClkSource::Core);
        system.set_reload(FULL);
        system.clear_current();
        system.enable_counter();
        Self(())
    }

    /// Number of instructions of `work`, less than [`FULL`] allows.
    pub fn count(&self, work: impl FnOnce()) -> u64 {
        let before = SYST::get_current();
        work();
        let ticks = before.wrapping_sub(SYST::get_current()) & FULL;
        u64::from(ticks) * 1_000 / RATE
    }
}
