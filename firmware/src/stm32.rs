//! What the boards with an STM32 share: half bridge, converter, inputs and lamps, watchdog.
//!
//! The pins are the same on every board, so that one page of wiring serves them all.

use core::hint::black_box;
use core::ptr::{read_volatile, write_volatile};
use core::sync::atomic::{AtomicU8, Ordering};

use core::task::Poll;

use cortex_m::peripheral::DWT;
use embassy_futures::poll_once;
use embassy_stm32::Peri;
use embassy_stm32::adc::{Adc, AdcChannel, InjectedAdc, SampleTime};
use embassy_stm32::dac::{DacChannel, Value};
use embassy_stm32::gpio::{AfType, Flex, Input, Level, Output, OutputType, Pull, Speed};
use embassy_stm32::interrupt::{self, typelevel::Binding};
use embassy_stm32::mode::Blocking;
use embassy_stm32::pac;
use embassy_stm32::pac::iwdg::vals::{Key, Pr};
use embassy_stm32::pac::timer::vals::{Bkp, FilterValue, Lock, Mms, Ossi};
use embassy_stm32::pac::wwdg::regs::Cr;
use embassy_stm32::pac::wwdg::vals::Wdgtb;
use embassy_stm32::peripherals::{
    ADC1, DAC1, PA1, PA2, PA3, PA4, PA7, PA8, PB0, PB1, PB11, PB12, PC1, PC2, PC3, TIM1, USART2,
};
use embassy_stm32::time::Hertz;
use embassy_stm32::timer::complementary_pwm::{ComplementaryPwm, ComplementaryPwmPin};
use embassy_stm32::timer::low_level::CountingMode;
use embassy_stm32::timer::simple_pwm::PwmPin;
use embassy_stm32::timer::{BkIn1, BreakInputPin, Channel};
use embassy_stm32::usart::{BufferedInterruptHandler, BufferedUart, ConfigError};
use embassy_time::Timer;
use embedded_io_async::{Read, Write};
use kband::control::{AdcCode, Inputs, Report, SAMPLE_RATE};

use crate::board::{Drive, Monitor, Panel, Sense, Watchdog};
use crate::cortex::stack_low;
use crate::enable::Contact;
use crate::link::Line;
use crate::log;

/// Time in which neither switch of the half bridge conducts, in ns.
const DEAD_TIME: u32 = 1_000;
/// Share of a period that the bridge's duty keeps from either end at full output, 3.5 us: its edges stay clear of the
/// sample, and a bootstrapped driver is charged in every period. The voltage keeps as much: a buffered converter does not
/// reach its last 0.2 V (DS8626, DAC characteristics).
const DUTY_END: f32 = 0.07;
/// Period of the independent watchdog as its prescaler and reload: 0.8 s at 32 kHz. A cycle at 5 Hz takes 0.2 s, so
/// that each gets a chance to check in.
const WATCHDOG: (Pr, u16) = (Pr::DIVIDE_BY16, 1600);

/// Half bridge on TIM1 (PA8 high side, PA7 low side), and the same output as a voltage on PA4.
///
/// The bridge switches at the sample rate; output -1..1 is a duty of 7..93 %, so that full output of the
/// control is the most that the bridge gives. The voltage is the same share of 3.3 V, with the middle for 0, for an external amplifier. PB12 high opens the bridge.
/// PC3 is high while the bridge is closed: the enable of an external amplifier.
pub struct HalfBridge {
    pwm: ComplementaryPwm<'static, TIM1>,
    voltage: DacChannel<'static, Blocking>,
    /// Kept: given back, the pin would leave the timer.
    _over_current: Flex<'static>,
    /// Kept as an output; its level is written by registers.
    _drive_on: Output<'static>,
    /// Whether the supply lets the bridge close.
    closable: fn() -> bool,
    full: f32,
    on: bool,
}

impl HalfBridge {
    /// The bridge, off; the core's clock in Hz is what TIM1 counts.
    ///
    /// The over-current input opens both switches by itself, within a few cycles of the core and whatever
    /// the program does; they stay open until the drive was switched off and on again. The bridge closes only where
    /// `closable` allows it.
    #[allow(clippy::too_many_arguments)]
    #[must_use]
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
        // Active where nothing is wired.
        over_current.set_as_af_unchecked(function, AfType::input(Pull::Up));
        pwm.set_break_polarity(Bkp::ACTIVE_HIGH);
        // 47 ns at 170 MHz; the timer of the STM32F405 has no filter.
        pwm.set_break_filter(FilterValue::FCK_INT_N8);
        pwm.set_break_enable(true);
        // One update a period, where the counter turns at its bottom: the repetition counter is
        // written while the counter stands, or the update would come at its top.
        let timer = pac::TIM1;
        timer.cr1().modify(|control| control.set_cen(false));
        timer.cnt().write(|count| count.set_cnt(0));
        // Up and down are a period: exactly the sample rate. The driver takes one count less.
        let half = (core_clock / (2 * SAMPLE_RATE)) as u16;
        timer.arr().write(|reload| reload.set_arr(half));
        pwm.set_repetition_counter(1);
        timer.egr().write(|event| event.set_ug(true));
        timer.cr2().modify(|control| control.set_mms(Mms::UPDATE));
        timer.cr1().modify(|control| control.set_cen(true));
        let full = f32::from(half);
        pwm.set_duty(Channel::Ch1, (0.5 * full) as u32);
        pwm.enable(Channel::Ch1);
        // Off, both gates are driven to their off level, low, not let go. Then nothing but a reset can
        // write the dead time, the break or this.
        pwm.set_off_state_selection_idle(Ossi::IDLE_LEVEL);
        timer
            .bdtr()
            .modify(|register| register.set_lock(Lock::LEVEL2));
        // A core that a debugger halts sets no duty. RM0090, 38.16.2, stops a frozen timer's counter and says nothing of
        // its outputs, which might stand on: the timer goes on, and the window watchdog resets the chip within 5 ms.
        pac::DBGMCU
            .apb2fzr()
            .modify(|frozen| frozen.set_tim1(false));
        let mut voltage = DacChannel::new_blocking(converter, voltage);
        voltage.set(Value::Bit12Right(MIDDLE));
        Self {
            pwm,
            voltage,
            _over_current: over_current,
            _drive_on: Output::new(drive_on, Level::Low, Speed::Low),
            closable,
            full,
            on: false,
        }
    }
}

/// Middle of the 12-bit voltage output.
const MIDDLE: u16 = 2048;

impl Drive for HalfBridge {
    #[inline]
    fn set(&mut self, output: f32) {
        if self.on {
            // Opened by the break or by an interrupt: no voltage either, until the control has switched off and on.
            if !pac::TIM1.bdtr().read().moe() {
                drive_off();
                return;
            }
        } else {
            self.on = true;
            if !(self.closable)() {
                return;
            }
            // What opened the bridge before is past, or opens it again.
            forget_break();
            self.pwm.set_master_output_enable(true);
            drive_on();
        }
        let share = 0.5 + (0.5 - DUTY_END) * output.clamp(-1.0, 1.0);
        let duty = share * self.full;
        pac::TIM1
            .ccr(0)
            .write(|compare| compare.set_ccr(duty as u16));
        self.voltage
            .set(Value::Bit12Right((share * 4095.0 + 0.5) as u16));
    }

    fn off(&mut self) {
        self.on = false;
        drive_off();
    }
}

/// Whether the break opened the bridge since this was last asked, or holds it open: its flag is not cleared while its
/// input is active.
fn broken() -> bool {
    let broken = pac::TIM1.sr().read().bif(0);
    if broken {
        forget_break();
    }
    broken
}

/// Forgets what opened the bridge.
pub fn forget_break() {
    // Flags are cleared by a zero, and left alone by a one.
    pac::TIM1
        .sr()
        .write_value(pac::timer::regs::SrAdv(!(1 << 7)));
}

/// Number of the pin of port C that says that the drive is on.
const DRIVE_ON: usize = 3;

fn drive_on() {
    pac::GPIOC.bsrr().write(|set| set.set_bs(DRIVE_ON, true));
}

/// Takes the power from the half bridge, the voltage to its middle and the enable from an external amplifier, by
/// registers alone.
pub fn drive_off() {
    // Without the main output enable both switches are held open.
    pac::TIM1.bdtr().modify(|register| register.set_moe(false));
    pac::GPIOC.bsrr().write(|set| set.set_br(DRIVE_ON, true));
    pac::DAC1
        .dhr12r(0)
        .write(|register| register.set_dhr(MIDDLE));
}

/// The accelerometer on PA1, converted where TIM1 turns: far from the switching of the bridge.
pub struct Converter(InjectedAdc<'static, ADC1, 1>);

impl Converter {
    /// The converter, its interrupt asked for at the end of each conversion.
    #[must_use]
    pub fn new(
        converter: Adc<'static, ADC1>,
        accelerometer: Peri<'static, PA1>,
        sample_time: SampleTime,
    ) -> Self {
        Self(converter.setup_injected_conversions(
            [(accelerometer.degrade_adc(), sample_time)],
            embassy_stm32::triggers::TIM1_TRGO,
            pac::adc::vals::Exten::RISING_EDGE,
            true,
        ))
    }
}

impl Sense for Converter {
    #[inline]
    fn sample(&mut self) -> AdcCode {
        AdcCode(self.0.read_injected_samples()[0])
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

/// Number of the pin of port B that is the enable input, and of its line of edges.
const ENABLE: usize = 0;
/// Port B, as the choice of a line's pin.
const PORT_B: u8 = 1;

/// Has the chip latch each edge of the enable input: the sample interrupt reads and clears the latch. The line's own
/// interrupt stays masked in the NVIC.
fn latch_edges() {
    pac::RCC
        .apb2enr()
        .modify(|clocks| clocks.set_syscfgen(true));
    pac::SYSCFG
        .exticr(ENABLE / 4)
        .modify(|pins| pins.set_exti(ENABLE % 4, PORT_B));
    pac::EXTI
        .rtsr(0)
        .modify(|lines| lines.set_line(ENABLE, true));
    pac::EXTI
        .ftsr(0)
        .modify(|lines| lines.set_line(ENABLE, true));
    pac::EXTI
        .imr(0)
        .modify(|lines| lines.set_line(ENABLE, true));
}

/// Inputs: enable on PB0 (3.3 V runs the drive), thermal switch on PB1 (to ground while cool), and what the chip sees
/// of its own state.
pub struct Terminals {
    enable: Input<'static>,
    cool: Input<'static>,
    supply_low: fn() -> bool,
    clock_failed: bool,
}

impl Terminals {
    /// The inputs, inactive where nothing is wired: a broken wire stops the drive.
    #[must_use]
    pub fn new(
        enable: Peri<'static, PB0>,
        cool: Peri<'static, PB1>,
        supply_low: fn() -> bool,
        clock_failed: bool,
    ) -> Self {
        let enable = Input::new(enable, Pull::Down);
        latch_edges();
        Self {
            supply_low,
            clock_failed,
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
}

/// Makes PC1 the strap of the link: wired to ground it makes the link read-only, open it does not.
pub fn watch_strap(strap: Peri<'static, PC1>) {
    // The pin keeps its pull-up while the program runs.
    core::mem::forget(Input::new(strap, Pull::Up));
}

/// Whether the strap of the link is wired to ground.
#[must_use]
pub fn strapped() -> bool {
    pac::GPIOC.idr().read().idr(1) == pac::gpio::vals::Idr::LOW
}

/// Outputs: ready on PC2 (the wanted regime is held), fault on PB11.
pub struct Lamps {
    ready: Output<'static>,
    fault: Output<'static>,
}

impl Lamps {
    /// Both off.
    #[must_use]
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
    /// The watchdog, started; nothing but a reset stops it. It has an oscillator of its own and needs no other clock.
    #[must_use]
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

/// The window watchdog: it resets the chip, and so opens the bridge, where samples stop for 4.7 ms, or come half as often
/// again as they should. It counts a clock of the tree that gives the samples theirs, so that neither drifts from the other.
pub struct Window;

/// Steps of some 97 us from a feed of the window watchdog to its bite, and those before which a feed bites. 40 samples
/// are 20 or 21 steps (97.5 us at 42 MHz, 96.4 at 170 by 4): at half as often again 13 or 14, at twice 10 or 11. What holds
/// a sample up, at most 100 us for a word of the flash, takes two off.
const BITES: u8 = 48;
const EARLIEST: u8 = 16;
/// Samples from feed to feed: 2 ms.
const FEED: u8 = 40;
/// The last count before the bite.
const LAST_COUNT: u8 = 0x40;

/// Samples since the last feed.
static SAMPLED: AtomicU8 = AtomicU8::new(0);

impl Window {
    /// Starts the watchdog, whose peripheral clock divided by 4096 and `divider` gives its steps.
    pub fn start(divider: Wdgtb) {
        pac::WWDG.cfr().write(|register| {
            register.set_wdgtb(divider);
            register.set_w(LAST_COUNT + BITES - 1 - EARLIEST);
        });
        SAMPLED.store(0, Ordering::Relaxed);
        feed_window();
    }

    /// A sample was taken; for the sample interrupt alone.
    #[inline]
    pub fn sampled() {
        let samples = SAMPLED.load(Ordering::Relaxed) + 1;
        SAMPLED.store(samples % FEED, Ordering::Relaxed);
        if samples == FEED {
            feed_window();
        }
    }
}

/// What the window watchdog's control register is written with to feed and to start it.
const WINDOW_FED: u32 = 0x80 | (LAST_COUNT + BITES - 1) as u32;

#[inline]
fn feed_window() {
    pac::WWDG.cr().write_value(Cr(WINDOW_FED));
}

/// Buffers of the serial port.
pub struct Buffers {
    send: [u8; 512],
    receive: [u8; 512],
}

impl Buffers {
    /// Nothing in them.
    pub const EMPTY: Self = Self {
        send: [0; 512],
        receive: [0; 512],
    };
}

/// Bytes that the link carries in a second: 115200 baud, ten bits a byte.
pub const LINE_RATE: u32 = 11_520;

/// The link's serial port: USART2, 115200 baud, sends on PA2 and receives on PA3.
pub struct Serial(BufferedUart<'static>);

impl Serial {
    /// The port; refused if the clocks do not give its rate.
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
        // Noise on the line is lost bytes, and their frame is refused by its check.
        Read::read(&mut self.0, bytes).await.unwrap_or(0)
    }

    /// `embassy-stm32` 0.6.0 (usart/buffered.rs, `BufferedUartTx::write`) takes a whole frame or, where
    /// its ring has no room, returns `Pending` without a waker: whoever awaits it may sleep for ever.
    /// Polled once it does what is wanted here. A version that registers its waker, or takes a part of
    /// the frame, makes this work-around wrong: `cargo update` has to look here.
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

/// The CRC unit (RM0090, 4.4; RM0440, 16.4; the same on both): data, control; a one resets it.
const CRC_DATA: *mut u32 = 0x4002_3000 as *mut u32;
const CRC_CONTROL: *mut u32 = 0x4002_3008 as *mut u32;
const CRC_RESET: u32 = 1;

/// Whether the flash holds the program that was written: the CRC-32 of the image is the word behind it, which
/// `kband flash` computes and writes.
#[must_use]
pub fn image_is_whole() -> bool {
    unsafe extern "C" {
        static _image_start: u32;
        static _image_end: u32;
    }
    pac::RCC.ahb1enr().modify(|clocks| clocks.set_crcen(true));
    let end = &raw const _image_end;
    let mut word = &raw const _image_start;
    // SAFETY: registers that nothing else uses, and the words of the flash between the linker's bounds of the image. The
    // unit takes the highest bit first, CRC-32 the lowest.
    unsafe {
        write_volatile(CRC_CONTROL, CRC_RESET);
        while word < end {
            write_volatile(CRC_DATA, read_volatile(word).reverse_bits());
            word = word.add(1);
        }
        !read_volatile(CRC_DATA).reverse_bits() == read_volatile(end)
    }
}

/// The flash's controller works; it is to begin (the same bits of all STM32F4 and STM32G4).
const FLASH_BUSY: u32 = 1 << 16;
const FLASH_START: u32 = 1 << 16;
/// Control register of the window watchdog: it runs; its count, and the one from which on it is fed in an erasure, half
/// way to its bite.
const WINDOW: *mut u32 = 0x4000_2c00 as *mut u32;
const WINDOW_RUNS: u32 = 0x80;
const WINDOW_COUNT: u32 = 0x7f;
const HALF_WAY: u32 = 0x58;

/// Erases a page of the flash, with interrupts off: `page` in the control register chooses it, `unlock` opens the controller.
/// What the program would fetch from that flash meanwhile stands still, up to 2 s; the end is waited for in RAM, where the
/// window watchdog is fed.
///
/// Whether the page was erased to its end with a supply that `settled` says is good. It is not touched while the bridge is
/// closed.
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
    // Called by its address: it lies farther than a branch reaches.
    let erase: unsafe fn(*const u32, *mut u32, u32) -> bool = black_box(erase);
    let usual = (pac::IWDG.pr().read().pr(), pac::IWDG.rlr().read().rl());
    let began = cortex_m::interrupt::free(|_| {
        if pac::TIM1.bdtr().read().moe() || !settled() {
            return false;
        }
        allow(ERASURE);
        unlock();
        // SAFETY: interrupts are off, and the registers are the controller's, as the caller guarantees.
        if unsafe { erase(status, control, page) } {
            // The next feed is a whole round of samples away: one that was nearly due would come too early.
            SAMPLED.store(0, Ordering::Relaxed);
        }
        pac::FLASH.cr().modify(|control| control.set_lock(true));
        forget_flash();
        true
    });
    if began {
        allow(usual);
    }
    // The supply monitor's interrupt has come by now.
    began && settled()
}

/// Programs `bytes` of the flash in words of `SIZE` bytes, each only while `settled` says that the supply is good.
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

/// Whether the window watchdog was fed meanwhile.
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

/// Time that the independent watchdog is given for the erasure of a page, which takes up to 2 s: 32 s, as its prescaler and
/// reload.
const ERASURE: (Pr, u16) = (Pr::DIVIDE_BY256, 0xfff);

/// Forgets what was read of the flash before an erasure. A cache is reset while it is off (RM0090, 3.5.2; RM0440, 3.3.5).
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

/// Gives the watchdog this prescaler and reload, and feeds it.
fn allow((prescaler, reload): (Pr, u16)) {
    let watchdog = pac::IWDG;
    watchdog.kr().write(|key| key.set_key(Key::ENABLE));
    watchdog.pr().write(|register| register.set_pr(prescaler));
    watchdog.rlr().write(|register| register.set_rl(reload));
    // The values pass to the watchdog's own clock (32 kHz): five of its cycles.
    cortex_m::asm::delay(CORE_CYCLES_FOR_WATCHDOG);
    watchdog.kr().write(|key| key.set_key(Key::RESET));
}

/// Core cycles of 0.3 ms on the fastest board: ten cycles of the watchdog's clock.
const CORE_CYCLES_FOR_WATCHDOG: u32 = 51_000;
