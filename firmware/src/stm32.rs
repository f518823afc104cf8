//! Hardware layer of the STM32 boards: half bridge, converter, inputs and lamps, watchdogs, flash.
//!
//! The pins are the same on every board, so that one wiring page serves all of them.

use core::hint::black_box;
use core::ptr::{read_volatile, write_volatile};
use core::sync::atomic::{AtomicU8, Ordering};

use core::task::Poll;

use cortex_m::peripheral::DWT;
use embassy_futures::poll_once;
use embassy_stm32::adc::{Adc, AdcChannel, InjectedAdc, SampleTime};
use embassy_stm32::dac::{DacChannel, Value};
use embassy_stm32::gpio::{AfType, Flex, Input, Level, Output, OutputType, Pull, Speed};
use embassy_stm32::interrupt::{self, typelevel::Binding};
use embassy_stm32::mode::Blocking;
use embassy_stm32::pac::iwdg::vals::{Key, Pr};
use embassy_stm32::pac::timer::vals::{Bkp, FilterValue, Lock, Mms, Ossi};
use embassy_stm32::pac::wwdg::regs::Cr;
use embassy_stm32::pac::wwdg::vals::Wdgtb;
use embassy_stm32::peripherals::{
    ADC1, DAC1, PA1, PA2, PA3, PA4, PA7, PA8, PB0, PB1, PB11, PB12, PC0, PC1, PC2, PC3, PC6, PC7,
    PC8, TIM1, USART2,
};
use embassy_stm32::time::Hertz;
use embassy_stm32::timer::complementary_pwm::{ComplementaryPwm, ComplementaryPwmPin};
use embassy_stm32::timer::low_level::CountingMode;
use embassy_stm32::timer::simple_pwm::PwmPin;
use embassy_stm32::timer::{BkIn1, BreakInputPin, Channel};
use embassy_stm32::usart::{BufferedInterruptHandler, BufferedUart, ConfigError};
use embassy_stm32::{Peri, pac};
use embassy_time::Timer;
use embedded_io_async::{Read, Write};
use kband_control::{AdcCode, Inputs, Report, SAMPLE_RATE};

use crate::board::{Drive, Monitor, Panel, Sense, Watchdog};
use crate::cortex::stack_low;
use crate::enable::Contact;
use crate::link::Line;
use crate::log;

/// Dead time of the half bridge, ns: neither switch conducts.
const DEAD_TIME: u32 = 1_000;
/// Share of the switching period that the duty keeps from 0 and 1 at full output, 3.5 us: the edges
/// stay clear of the sample, a bootstrapped driver is charged in every period, and a buffered
/// converter stays off its last 0.2 V (DS8626, DAC characteristics).
const DUTY_END: f32 = 0.07;
/// Period of the independent watchdog as prescaler and reload: 0.8 s.
const WATCHDOG: (Pr, u16) = (Pr::DIVIDE_BY16, 1600);

/// Half bridge on TIM1 (PA8 high side, PA7 low side), and the same output as a voltage on PA4.
///
/// The bridge switches at the sample rate. An output of -1..1 is a duty of 7..93 %. For an external
/// amplifier, PA4 gives the same share of 3.3 V, with half of it for 0, and PC3 its enable: high
/// while the bridge is closed. PB12 high opens the bridge.
pub struct HalfBridge {
    pwm: ComplementaryPwm<'static, TIM1>,
    _voltage: DacChannel<'static, Blocking>,
    /// Held because dropping it would take the pin from the timer.
    _over_current: Flex<'static>,
    /// Held to keep the pin an output; its level is set by register writes.
    _drive_on: Output<'static>,
    closable: fn() -> bool,
    full: f32,
    on: bool,
}

impl HalfBridge {
    /// Builds the bridge, open. `core_clock` is the clock of TIM1 in Hz.
    ///
    /// The over-current input opens both switches in hardware, until the drive was switched off and
    /// on again. The bridge closes only where `closable` returns true.
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
        // Over-current is active when nothing is wired.
        over_current.set_as_af_unchecked(function, AfType::input(Pull::Up));
        pwm.set_break_polarity(Bkp::ACTIVE_HIGH);
        // Eight clocks: 47 ns at 170 MHz. The timer of the STM32F405 has no filter.
        pwm.set_break_filter(FilterValue::FCK_INT_N8);
        pwm.set_break_enable(true);
        // One update event a period, at the counter's bottom: the repetition counter is written
        // while the counter is stopped.
        let timer = pac::TIM1;
        timer.cr1().modify(|control| control.set_cen(false));
        timer.cnt().write(|count| count.set_cnt(0));
        // Counting up and down takes exactly a sample; the driver's own setting is one count lower.
        let half = (core_clock / (2 * SAMPLE_RATE)) as u16;
        timer.arr().write(|reload| reload.set_arr(half));
        pwm.set_repetition_counter(1);
        timer.egr().write(|event| event.set_ug(true));
        timer.cr2().modify(|control| control.set_mms(Mms::UPDATE));
        timer.cr1().modify(|control| control.set_cen(true));
        let full = f32::from(half);
        pwm.set_duty(Channel::Ch1, (0.5 * full) as u32);
        pwm.enable(Channel::Ch1);
        // Off drives both gates low. From here only a reset changes this.
        pwm.set_off_state_selection_idle(Ossi::IDLE_LEVEL);
        timer.bdtr().modify(|w| w.set_lock(Lock::LEVEL2));
        // While a debugger halts the core, a frozen timer might leave its outputs on (RM0090,
        // 38.16.2). So it runs on, and the window watchdog resets the chip within 5 ms.
        pac::DBGMCU.apb2fzr().modify(|w| w.set_tim1(false));
        let mut voltage = DacChannel::new_blocking(converter, voltage);
        voltage.set(Value::Bit12Right(MIDDLE));
        Self {
            pwm,
            _voltage: voltage,
            _over_current: over_current,
            _drive_on: Output::new(drive_on, Level::Low, Speed::Low),
            closable,
            full,
            on: false,
        }
    }
}

/// Code of half the voltage, of 12 bits.
const MIDDLE: u16 = 2048;

impl Drive for HalfBridge {
    #[inline]
    fn set(&mut self, output: f32) {
        if self.on {
            // The break or an interrupt opened the bridge: the voltage goes off too.
            if !pac::TIM1.bdtr().read().moe() {
                drive_off();
                return;
            }
        } else {
            self.on = true;
            if !(self.closable)() {
                return;
            }
            // An earlier break is over, or opens the bridge again.
            forget_break();
            self.pwm.set_master_output_enable(true);
            drive_on();
        }
        let share = 0.5 + (0.5 - DUTY_END) * output.clamp(-1.0, 1.0);
        let duty = share * self.full;
        pac::TIM1.ccr(0).write(|w| w.set_ccr(duty as u16));
        // `DacChannel::set` checks its channel number again, by a panic (embassy-stm32 0.6.0).
        pac::DAC1
            .dhr12r(0)
            .write(|level| level.set_dhr((share * 4095.0 + 0.5) as u16));
    }

    fn off(&mut self) {
        self.on = false;
        drive_off();
    }
}

/// Whether the break has opened the bridge since the last call, or holds it open.
fn broken() -> bool {
    let broken = pac::TIM1.sr().read().bif(0);
    if broken {
        forget_break();
    }
    broken
}

/// Flags of a break by the input (BIF) and by the chip itself (SBIF, STM32G4 only; RM0440, 28.6.5).
const BREAKS: u32 = 1 << 7 | 1 << 13;

/// Clears the break flags.
pub fn forget_break() {
    // Writing 0 clears a flag; writing 1 leaves it.
    pac::TIM1.sr().write_value(pac::timer::regs::SrAdv(!BREAKS));
}

/// Pin number of the drive-on output on port C.
const DRIVE_ON: usize = 3;

fn drive_on() {
    pac::GPIOC.bsrr().write(|set| set.set_bs(DRIVE_ON, true));
}

/// Opens the bridge, sets the voltage to its middle and disables an amplifier, by register writes.
pub fn drive_off() {
    // Without the main output enable both switches are open.
    pac::TIM1.bdtr().modify(|register| register.set_moe(false));
    pac::GPIOC.bsrr().write(|set| set.set_br(DRIVE_ON, true));
    pac::DAC1.dhr12r(0).write(|w| w.set_dhr(MIDDLE));
}

/// The accelerometer on PA1, converted at TIM1's update, then the current sensor on PC0.
pub struct Converter {
    _sequence: InjectedAdc<'static, ADC1, 2>,
}

impl Converter {
    /// Sets up the converter, with an interrupt at the end of each conversion.
    pub fn new(
        converter: Adc<'static, ADC1>,
        accelerometer: Peri<'static, PA1>,
        current: Peri<'static, PC0>,
        sample_time: SampleTime,
    ) -> Self {
        Self {
            _sequence: converter.setup_injected_conversions(
                [
                    (accelerometer.degrade_adc(), sample_time),
                    (current.degrade_adc(), sample_time),
                ],
                embassy_stm32::triggers::TIM1_TRGO,
                pac::adc::vals::Exten::RISING_EDGE,
                true,
            ),
        }
    }
}

impl Sense for Converter {
    #[inline]
    fn sample(&mut self) -> AdcCode {
        AdcCode(pac::ADC1.jdr(0).read().jdata())
    }

    #[inline]
    fn current(&mut self) -> AdcCode {
        AdcCode(pac::ADC1.jdr(1).read().jdata())
    }

    #[inline]
    fn enable(&mut self) -> Option<Contact> {
        let edges = pac::EXTI.pr(0);
        let moved = edges.read().line(ENABLE);
        if moved {
            edges.write(|lines| lines.set_line(ENABLE, true));
        }
        let high = pac::GPIOB.idr().read().idr(ENABLE) == pac::gpio::vals::Idr::HIGH;
        Some(match (moved, high) {
            (true, _) => Contact::Moved,
            (false, true) => Contact::Closed,
            (false, false) => Contact::Open,
        })
    }
}

/// Pin number of the enable input on port B; also its EXTI line.
const ENABLE: usize = 0;
/// Code of port B in EXTICR.
const PORT_B: u8 = 1;

/// Latches each edge of the enable input in EXTI, for the sample interrupt; its own stays masked.
fn latch_edges() {
    pac::RCC.apb2enr().modify(|w| w.set_syscfgen(true));
    pac::SYSCFG
        .exticr(ENABLE / 4)
        .modify(|pins| pins.set_exti(ENABLE % 4, PORT_B));
    for edges in [pac::EXTI.rtsr(0), pac::EXTI.ftsr(0), pac::EXTI.imr(0)] {
        edges.modify(|lines| lines.set_line(ENABLE, true));
    }
}

/// Inputs: enable on PB0 (3.3 V runs the drive), thermal switch on PB1 (to ground while cool).
pub struct Terminals {
    enable: Input<'static>,
    cool: Input<'static>,
    supply_low: fn() -> bool,
    clock_failed: bool,
    recipe: fn() -> u8,
}

impl Terminals {
    /// Sets up the inputs so that a broken wire stops the drive.
    pub fn new(
        enable: Peri<'static, PB0>,
        cool: Peri<'static, PB1>,
        supply_low: fn() -> bool,
        clock_failed: bool,
        recipe: fn() -> u8,
    ) -> Self {
        let enable = Input::new(enable, Pull::Down);
        latch_edges();
        Self {
            supply_low,
            clock_failed,
            recipe,
            enable,
            cool: Input::new(cool, Pull::Up),
        }
    }
}

impl Panel for Terminals {
    fn inputs(&mut self) -> Inputs {
        Inputs {
            enable: self.enable.is_high(),
            withheld: false,
            held_off: false,
            chatters: false,
            bus: None,
            over_temperature: self.cool.is_high(),
            link_heard: false,
            stack_low: stack_low(),
            over_current: broken(),
            control_late: false,
            supply_low: (self.supply_low)(),
            clock_failed: self.clock_failed,
        }
    }

    fn now(&self) -> u32 {
        DWT::cycle_count()
    }

    fn recipe(&mut self) -> Option<u8> {
        Some((self.recipe)())
    }
}

/// Number of the first pin on port C that selects a recipe: PC6 counts 1, PC7 2, PC8 4.
const FIRST_RECIPE_PIN: usize = 6;

/// Makes PC6, PC7 and PC8 the inputs that select a recipe, each on while it is wired to ground.
pub fn watch_recipe_inputs(
    one: Peri<'static, PC6>,
    two: Peri<'static, PC7>,
    four: Peri<'static, PC8>,
) {
    // `forget` keeps the pull-ups while the program runs.
    core::mem::forget(Input::new(one, Pull::Up));
    core::mem::forget(Input::new(two, Pull::Up));
    core::mem::forget(Input::new(four, Pull::Up));
}

/// Number of the recipe at these inputs now; 0 while all are open.
#[inline]
pub fn recipe_inputs() -> u8 {
    !(pac::GPIOC.idr().read().0 >> FIRST_RECIPE_PIN) as u8 & 7
}

/// Makes PC1 the strap of the link: wired to ground it makes the link read-only.
pub fn watch_strap(strap: Peri<'static, PC1>) {
    // `forget` keeps the pull-up while the program runs.
    core::mem::forget(Input::new(strap, Pull::Up));
}

/// Whether the strap of the link is wired to ground.
pub fn strapped() -> bool {
    pac::GPIOC.idr().read().idr(1) == pac::gpio::vals::Idr::LOW
}

/// Outputs: ready on PC2 (the target is met), fault on PB11.
pub struct Lamps {
    ready: Output<'static>,
    fault: Output<'static>,
}

impl Lamps {
    /// Sets up the outputs, both off.
    pub fn new(ready: Peri<'static, PC2>, fault: Peri<'static, PB11>) -> Self {
        Self {
            ready: Output::new(ready, Level::Low, Speed::Low),
            fault: Output::new(fault, Level::Low, Speed::Low),
        }
    }
}

impl Monitor for Lamps {
    fn report(&mut self, report: &Report, ready: bool) {
        self.ready.set_level(ready.into());
        self.fault.set_level(report.fault.is_some().into());
        log::report(report);
    }
}

/// The independent watchdog.
pub struct Guard;

impl Guard {
    /// Starts the watchdog, on its own oscillator; only a reset stops it.
    pub fn start() -> Self {
        let (prescaler, reload) = WATCHDOG;
        let watchdog = pac::IWDG;
        watchdog.kr().write(|key| key.set_key(Key::START));
        watchdog.kr().write(|key| key.set_key(Key::ENABLE));
        watchdog.pr().write(|register| register.set_pr(prescaler));
        watchdog.rlr().write(|register| register.set_rl(reload));
        Self
    }
}

impl Watchdog for Guard {
    fn feed(&mut self) {
        pac::IWDG.kr().write(|key| key.set_key(Key::RESET));
    }
}

/// The window watchdog. It resets the chip, which opens the bridge, without a sample for 4.7 ms, or
/// at 1.5 times their rate. Its clock and the samples' come from one clock tree.
pub struct Window;

/// Number of window watchdog steps (about 97 us) after a feed at which the chip is reset: 4.7 ms.
const BITES: u8 = 48;
/// Smallest number of such steps between two feeds. Forty samples take 20 or 21 steps (97.5 us at
/// 42 MHz, 96.4 us at 42.5 MHz), 13 or 14 at 1.5 times the rate. A word of the flash takes two off.
const EARLIEST: u8 = 16;
/// Number of samples between feeds of the window watchdog: 2 ms.
const FEED: u8 = 40;
/// Last count of the window watchdog before the reset.
const LAST_COUNT: u8 = 0x40;

/// Number of samples since the last feed.
static SAMPLED: AtomicU8 = AtomicU8::new(0);

impl Window {
    /// Starts the watchdog. A step is 4096 x `divider` periods of its peripheral clock.
    pub fn start(divider: Wdgtb) {
        pac::WWDG.cfr().write(|register| {
            register.set_wdgtb(divider);
            register.set_w(LAST_COUNT + BITES - 1 - EARLIEST);
        });
        SAMPLED.store(0, Ordering::Relaxed);
        feed_window();
    }

    /// Counts a sample; for the sample interrupt only.
    #[inline]
    pub fn sampled() {
        let samples = SAMPLED.load(Ordering::Relaxed) + 1;
        SAMPLED.store(samples % FEED, Ordering::Relaxed);
        if samples == FEED {
            feed_window();
        }
    }
}

/// Value of the window watchdog's control register that starts and feeds it.
const WINDOW_FED: u32 = 0x80 | (LAST_COUNT + BITES - 1) as u32;

#[inline]
fn feed_window() {
    pac::WWDG.cr().write_value(Cr(WINDOW_FED));
}

/// Send and receive buffer of the serial port.
pub struct Buffers {
    send: [u8; 512],
    receive: [u8; 512],
}

impl Buffers {
    /// Empty buffers.
    pub const EMPTY: Self = Self {
        send: [0; 512],
        receive: [0; 512],
    };
}

/// Rate of the link, bytes a second: 115200 baud, ten bits a byte.
pub const LINE_RATE: u32 = 11_520;

/// The link's serial port: USART2, 115200 baud, sends on PA2 and receives on PA3.
pub struct Serial(BufferedUart<'static>);

impl Serial {
    /// Opens the port.
    ///
    /// # Errors
    /// The clocks do not give its baud rate.
    pub fn new(
        port: Peri<'static, USART2>,
        receive: Peri<'static, PA3>,
        send: Peri<'static, PA2>,
        interrupts: impl Binding<interrupt::typelevel::USART2, BufferedInterruptHandler<USART2>>
        + 'static,
        buffers: &'static mut Buffers,
    ) -> Result<Self, ConfigError> {
        let Buffers {
            send: sent,
            receive: received,
        } = buffers;
        BufferedUart::new(
            port,
            receive,
            send,
            sent,
            received,
            interrupts,
            embassy_stm32::usart::Config::default(),
        )
        .map(Self)
    }
}

impl Line for Serial {
    async fn read(&mut self, bytes: &mut [u8]) -> usize {
        // Noise loses bytes; the frame's checksum then refuses the frame.
        Read::read(&mut self.0, bytes).await.unwrap_or(0)
    }

    /// `embassy-stm32` 0.6.0 (usart/buffered.rs, `BufferedUartTx::write`) takes a whole frame, or
    /// returns `Pending` without a waker, so that an await might never end; polling once is sound.
    /// Check this at each update of the crate.
    fn send(&mut self, frame: &[u8]) -> bool {
        matches!(
            poll_once(Write::write(&mut self.0, frame)),
            Poll::Ready(Ok(_))
        )
    }

    async fn millisecond(&mut self) {
        Timer::after_millis(1).await;
    }
}

/// Data register of the CRC unit (RM0090, 4.4; RM0440, 16.4; the same on both).
const CRC_DATA: *mut u32 = 0x4002_3000 as *mut u32;
const CRC_CONTROL: *mut u32 = 0x4002_3008 as *mut u32;
const CRC_RESET: u32 = 1;

/// Whether the flash holds the program as written: its CRC-32 is behind the image.
pub fn image_is_whole() -> bool {
    unsafe extern "C" {
        static _image_start: u32;
        static _image_end: u32;
    }
    pac::RCC.ahb1enr().modify(|clocks| clocks.set_crcen(true));
    let end = &raw const _image_end;
    let mut word = &raw const _image_start;
    // SAFETY: registers that nothing else uses, and the words of the flash between the linker's
    // bounds of the image. The unit takes the highest bit first, CRC-32 the lowest.
    unsafe {
        write_volatile(CRC_CONTROL, CRC_RESET);
        while word < end {
            write_volatile(CRC_DATA, read_volatile(word).reverse_bits());
            word = word.add(1);
        }
        !read_volatile(CRC_DATA).reverse_bits() == read_volatile(end)
    }
}

/// Busy bit of the flash controller's status, the same on all STM32F4 and STM32G4.
const FLASH_BUSY: u32 = 1 << 16;
/// Start bit of the flash controller's control register, the same on all STM32F4 and STM32G4.
const FLASH_START: u32 = 1 << 16;
/// Control register of the window watchdog.
const WINDOW: *mut u32 = 0x4000_2c00 as *mut u32;
const WINDOW_RUNS: u32 = 0x80;
/// Its count, which falls by one a step.
const WINDOW_COUNT: u32 = 0x7f;
/// Count at which it is fed during an erasure: half the interval before its reset.
const HALF_WAY: u32 = 0x58;

/// Erases a page of the flash with interrupts off, where the bridge is open. `page` in the control
/// register selects it; `unlock` unlocks the controller. For up to 2 s the CPU cannot fetch from
/// that flash: code in RAM waits and feeds the window watchdog. Returns whether it ended with a
/// good supply.
///
/// # Safety
/// The addresses are those of the registers of the flash's controller, which is not busy.
pub unsafe fn erase_page(
    status: *const u32,
    control: *mut u32,
    page: u32,
    settled: fn() -> bool,
    unlock: fn(),
) -> bool {
    // Called by its address because it lies beyond the range of a branch.
    let erase: unsafe fn(*const u32, *mut u32, u32) -> bool = black_box(erase);
    let usual = (pac::IWDG.pr().read().pr(), pac::IWDG.rlr().read().rl());
    let began = cortex_m::interrupt::free(|_| {
        if pac::TIM1.bdtr().read().moe() || !settled() {
            return false;
        }
        allow(ERASURE);
        unlock();
        // SAFETY: interrupts are off, and the registers are the controller's, as the caller
        // guarantees.
        if unsafe { erase(status, control, page) } {
            // Counts 40 samples to the next feed; an earlier one would reset the chip.
            SAMPLED.store(0, Ordering::Relaxed);
        }
        pac::FLASH.cr().modify(|control| control.set_lock(true));
        forget_flash();
        true
    });
    if began {
        allow(usual);
    }
    // By now the supply monitor's interrupt has run, if it was pending.
    began && settled()
}

/// Programs `bytes` in words of `SIZE` bytes, each only while `settled`; else the error is `low`.
pub fn program_words<const SIZE: usize, E>(
    bytes: &[u8],
    settled: fn() -> bool,
    low: E,
    mut program: impl FnMut(u32, &[u8; SIZE]) -> Result<(), E>,
) -> Result<(), E> {
    let (words, _) = bytes.as_chunks::<SIZE>();
    for (at, word) in (0..).step_by(SIZE).zip(words) {
        let done = cortex_m::interrupt::free(|_| settled().then(|| program(at, word)));
        match done {
            Some(result) => result?,
            None => return Err(low),
        }
    }
    Ok(())
}

/// Erases a page; returns whether the window watchdog was fed meanwhile.
///
/// # Safety
/// The controller is unlocked and not busy; nothing may run from or read the flash meanwhile.
#[unsafe(link_section = ".data.erase")]
#[inline(never)]
unsafe fn erase(status: *const u32, control: *mut u32, page: u32) -> bool {
    let mut fed = false;
    // SAFETY: registers of the flash and of the window watchdog; the caller has them to itself.
    unsafe {
        write_volatile(control, page);
        write_volatile(control, page | FLASH_START);
        while read_volatile(status) & FLASH_BUSY != 0 {
            let window = read_volatile(WINDOW);
            if window & WINDOW_RUNS != 0 && window & WINDOW_COUNT <= HALF_WAY {
                write_volatile(WINDOW, WINDOW_FED);
                fed = true;
            }
        }
        write_volatile(control, 0);
    }
    fed
}

/// Period of the independent watchdog during an erasure as prescaler and reload: 32 s.
const ERASURE: (Pr, u16) = (Pr::DIVIDE_BY256, 0xfff);

/// Clears the flash caches after an erasure, while they are off (RM0090, 3.5.2; RM0440, 3.3.5).
fn forget_flash() {
    let access = pac::FLASH.acr();
    let before = access.read();
    access.modify(|access| {
        access.set_icen(false);
        access.set_dcen(false);
    });
    access.modify(|access| {
        access.set_icrst(true);
        access.set_dcrst(true);
    });
    access.modify(|access| {
        access.set_icrst(false);
        access.set_dcrst(false);
    });
    access.write_value(before);
}

/// Sets prescaler and reload of the independent watchdog and feeds it.
fn allow((prescaler, reload): (Pr, u16)) {
    let watchdog = pac::IWDG;
    watchdog.kr().write(|key| key.set_key(Key::ENABLE));
    watchdog.pr().write(|register| register.set_pr(prescaler));
    watchdog.rlr().write(|register| register.set_rl(reload));
    // The values pass to the watchdog's clock domain (32 kHz), which takes five of its cycles.
    cortex_m::asm::delay(CORE_CYCLES_FOR_WATCHDOG);
    watchdog.kr().write(|key| key.set_key(Key::RESET));
}

/// Delay for that transfer, core cycles: ten of the watchdog's clock on the fastest board.
const CORE_CYCLES_FOR_WATCHDOG: u32 = 51_000;
