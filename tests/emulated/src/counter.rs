//! Instruction counter by SysTick. On the emulated Cortex-M4F an instruction takes 1 ns, and a tick
//! 1000/168 ns.

use cortex_m::Peripherals;
use cortex_m::peripheral::SYST;
use cortex_m::peripheral::syst::SystClkSource;

/// A counter of instructions.
pub struct Counter(());

impl Counter {
    /// Starts the counter once.
    pub fn start() -> Self {
        let peripherals = Peripherals::take();
        let mut system = peripherals.expect("the counter is started once").SYST;
        system.set_clock_source(SystClkSource::Core);
        system.set_reload(0x00ff_ffff);
        system.clear_current();
        system.enable_counter();
        Self(())
    }

    /// Number of instructions of `work`, up to about 99 million.
    pub fn count(&self, work: impl FnOnce()) -> u64 {
        let before = SYST::get_current();
        work();
        let ticks = before.wrapping_sub(SYST::get_current()) & 0x00ff_ffff;
        u64::from(ticks) * 1000 / 168
    }
}
