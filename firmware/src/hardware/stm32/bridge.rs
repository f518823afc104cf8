//! The half bridge on TIM1, its break input, and the output as a voltage.

use crate::board::Drive;
use embassy_stm32::dac::{DacChannel, Value};
use embassy_stm32::gpio::{AfType, Flex, Level, Output, OutputType, Pull, Speed};
use embassy_stm32::pac::timer::vals::{Bkp, FilterValue, Lock, Mms, Ossi};
use embassy_stm32::peripherals::{DAC1, PA4, PA7, PA8, PB12, PC3, TIM1};
use embassy_stm32::time::Hertz;
use embassy_stm32::timer::complementary_pwm::{ComplementaryPwm, ComplementaryPwmPin};
use embassy_stm32::timer::low_level::CountingMode;
use embassy_stm32::timer::simple_pwm::PwmPin;
use embassy_stm32::timer::{BkIn1, BreakInputPin, Channel};
use embassy_stm32::{Peri, pac};
use kband_control::SAMPLE_RATE;

/// Dead time of the half bridge, ns: neither switch conducts.
const DEAD_TIME: u32 = 1_000;
/// Margin of the duty from 0 and 1 at full output, over the switching period: 3.5 us. The edges
/// stay clear of the sample, and a bootstrapped driver is charged in every period. A buffered
/// converter stays off its last 0.2 V (DS8626, DAC characteristics).
const DUTY_END: f32 = 0.07;
/// 12-bit code of half the voltage.
const DAC_MIDDLE: u16 = 2048;
/// Flags of a break by the input (BIF) and by the chip itself (SBIF, STM32G4 only; RM0440, 28.6.5).
const BREAKS: u32 = 1 << 7 | 1 << 13;
/// Pin number of the drive-on output on port C.
const DRIVE_ON: usize = 3;

/// Half bridge on TIM1 (PA8 high side, PA7 low side), and the same output as a voltage on PA4.
///
/// The bridge switches at the sample rate. An output of -1..1 is a duty of 7..93 %. For an external
/// amplifier, PA4 gives the same share of 3.3 V, with half of it for 0. PC3 is the amplifier's
/// enable: high while the bridge is closed. PB12 high opens the bridge.
pub struct HalfBridge {
    pwm: ComplementaryPwm<'static, TIM1>,
    closable: fn() -> bool,
    full: f32,
    on: bool,
}

impl HalfBridge {
    /// Builds the bridge, open. `core_clock` is the clock of TIM1 in Hz.
    ///
    /// The over-current input opens both switches in hardware, until the drive was switched off and
    /// on again. The bridge closes only if `closable` returns true.
    #[allow(clippy::too_many_arguments)]
    pub fn new(
        timer: Peri<'static, TIM1>,
        high: Peri<'static, PA8>,
        low: Peri<'static, PA7>,
        converter: Peri<'static, DAC1>,
        voltage: Peri<'static, PA4>,
        over_current: Peri<'static, PB12>,
        drive_on: Peri<'static, PC3>,
        closable: fn() -> bool,
        core_clock: u32,
    ) -> Self {
        let mut pwm = ComplementaryPwm::new(
            timer,
            Some(PwmPin::new(high, OutputType::PushPull)),
            Some(ComplementaryPwmPin::new(low, OutputType::PushPull)),
            None,
            None,
            None,
            None,
            None,
            None,
            Hertz(SAMPLE_RATE),
            CountingMode::CenterAlignedBothInterrupts,
        );
        pwm.set_master_output_enable(false);
        pwm.set_dead_time((core_clock / 1_000_000 * DEAD_TIME / 1_000) as u16);
        let function = BreakInputPin::<TIM1, BkIn1>::af_num(&*over_current);
        let mut over_current = Flex::new(over_current);
        // Without wiring the input signals over-current.
        over_current.set_as_af_unchecked(function, AfType::input(Pull::Up));
        pwm.set_break_polarity(Bkp::ACTIVE_HIGH);
        // Eight clocks: 47 ns at 170 MHz. The timer of the STM32F405 has no filter.
        pwm.set_break_filter(FilterValue::FCK_INT_N8);
        pwm.set_break_enable(true);
        // One update a period, at the lowest count; it is written while the counter is stopped.
        let timer = pac::TIM1;
        timer.cr1().modify(|control| control.set_cen(false));
        timer.cnt().write(|count| count.set_cnt(0));
        // Counting up and down takes exactly one sample; the driver sets one count less.
        let half = (core_clock / (2 * SAMPLE_RATE)) as u16;
        timer.arr().write(|reload| reload.set_arr(half));
        pwm.set_repetition_counter(1);
        timer.egr().write(|event| event.set_ug(true));
        timer.cr2().modify(|control| control.set_mms(Mms::UPDATE));
        timer.cr1().modify(|control| control.set_cen(true));
        let full = f32::from(half);
        pwm.set_duty(Channel::Ch1, (0.5 * full) as u32);
        pwm.enable(Channel::Ch1);
        // In the off state both gates are low. From here only a reset changes this.
        pwm.set_off_state_selection_idle(Ossi::IDLE_LEVEL);
        timer.bdtr().modify(|w| w.set_lock(Lock::LEVEL2));
        // While a debugger halts the core, a frozen timer might leave its outputs on (RM0090,
        // 38.16.2). So it keeps running, and the window watchdog resets the chip within 5 ms.
        pac::DBGMCU.apb2fzr().modify(|w| w.set_tim1(false));
        let mut voltage = DacChannel::new_blocking(converter, voltage);
        voltage.set(Value::Bit12Right(DAC_MIDDLE));
        let drive_on = Output::new(drive_on, Level::Low, Speed::Low);
        // `forget` keeps the pins configured while the program runs; register writes set them.
        core::mem::forget((voltage, over_current, drive_on));
        Self {
            pwm,
            closable,
            full,
            on: false,
        }
    }
}

impl Drive for HalfBridge {
    #[inline]
    fn set(&mut self, output: f32) {
        if self.on {
            // The break or an interrupt opened the bridge: the voltage is switched off too.
            if !pac::TIM1.bdtr().read().moe() {
                drive_off();
                return;
            }
        } else {
            // A refused enable stays off: the next call finds the bridge open.
            self.on = true;
            if !(self.closable)() {
                return;
            }
            // An earlier break has ended, or opens the bridge again.
            forget_break();
            self.pwm.set_master_output_enable(true);
            drive_on();
        }
        let share = 0.5 + (0.5 - DUTY_END) * output.clamp(-1.0, 1.0);
        let duty = share * self.full;
        pac::TIM1.ccr(0).write(|w| w.set_ccr(duty as u16));
        // `DacChannel::set` checks its channel number again, by a panic (embassy-stm32 0.6.0).
        let level = (share * 4095.0 + 0.5) as u16;
        pac::DAC1.dhr12r(0).write(|w| w.set_dhr(level));
    }

    fn off(&mut self) {
        self.on = false;
        drive_off();
    }
}

/// Whether the break has opened the bridge since the last call, or holds it open.
pub(super) fn broken() -> bool {
    let broken = pac::TIM1.sr().read().bif(0);
    if broken {
        forget_break();
    }
    broken
}

/// Clears the break flags.
pub fn forget_break() {
    // Writing 0 clears a flag; writing 1 leaves it.
    pac::TIM1.sr().write_value(pac::timer::regs::SrAdv(!BREAKS));
}

fn drive_on() {
    pac::GPIOC.bsrr().write(|set| set.set_bs(DRIVE_ON, true));
}

/// Opens the bridge, sets the voltage to its middle and disables an amplifier, by register writes.
pub fn drive_off() {
    // Without the main output enable both switches are open.
    pac::TIM1.bdtr().modify(|register| register.set_moe(false));
    pac::GPIOC.bsrr().write(|set| set.set_br(DRIVE_ON, true));
    pac::DAC1.dhr12r(0).write(|w| w.set_dhr(DAC_MIDDLE));
}
