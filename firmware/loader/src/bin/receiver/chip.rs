//! The loader of the STM32G474: starts a whole program, else waits for an image on the link.
//!
//! It runs on the internal oscillator of 16 MHz, as after a reset. All outputs float, except FAULT
//! (PB11), which is on while the loader waits. The independent watchdog then runs with its longest
//! period. The loader uses only RAM of the program's stack, and the note. It leaves every register
//! as after a reset: each wait ends with a reset.

use core::ops::Range;
use core::ptr::{read_volatile, write_volatile};
use core::sync::atomic::{AtomicBool, Ordering};
use cortex_m::peripheral::SCB;
use cortex_m::peripheral::syst::SystClkSource;
use cortex_m_rt::{entry, exception};
use kband_control::wire::{
    Identity, Incoming, MAX_FRAME_BYTES, Receiver, read_frozen_request, write_identity,
    write_update_answer,
};
use kband_loader::layout::stm32g474::{NOTE, PAGE, SLOT};
use kband_loader::note::Note;
use kband_loader::one_slot::{Memory, OneSlot};
use registers::{
    FlashController, PROGRAM, change, copy, feed_watchdog, read, start_program, start_watchdog,
    write,
};

#[path = "../../registers.rs"]
mod registers;

/// The flash's controller (RM0440, 3.7), and its registers for access and code.
const CONTROLLER: FlashController = FlashController {
    key: 0x4002_2008,
    status: 0x4002_2010,
    control: 0x4002_2014,
    errors: 0xc3fa,
};
const FLASH_ACCESS: u32 = 0x4002_2000;
const FLASH_CODE: u32 = 0x4002_2018;
const FLASH: u32 = 0x0800_0000;
const DATA_CACHE: u32 = 1 << 10;
/// Number of pages of a bank, and the bit of the second bank.
const PAGES: u32 = 128;
const SECOND_BANK: u32 = 1 << 11;
const DOUBLE_ERROR: u32 = 1 << 31;
/// Clocks (7.4): CRC unit, ports A and B, power controller and USART2.
const AHB1_CLOCKS: u32 = 0x4002_1048;
const AHB2_CLOCKS: u32 = 0x4002_104c;
const APB1_CLOCKS: u32 = 0x4002_1058;
const CHECK: u32 = 1 << 12;
const PORTS: u32 = 3;
const POWER_AND_PORT: u32 = 1 << 28 | 1 << 17;
/// Control and status of the power controller (6.4), and the monitor at its level of 2.9 V.
const POWER_CONTROL: u32 = 0x4000_7004;
const POWER_STATUS: u32 = 0x4000_7014;
const MONITOR: u32 = 6 << 1 | 1;
const BELOW: u32 = 1 << 11;
/// Registers of the ports (9.4). PA2 sends, PA3 receives: alternate function 7. PB11 is FAULT.
const PORT_A_MODE: u32 = 0x4800_0000;
const PORT_A_PULL: u32 = 0x4800_000c;
const PORT_A_FUNCTION: u32 = 0x4800_0020;
const PORT_B_MODE: u32 = 0x4800_0400;
const PORT_B_SET: u32 = 0x4800_0418;
const FAULT: u32 = 11;
/// Registers of USART2 (37.8).
const LINE_CONTROL: u32 = 0x4000_4400;
const LINE_RATE: u32 = 0x4000_440c;
const LINE_STATUS: u32 = 0x4000_441c;
const LINE_CLEAR: u32 = 0x4000_4420;
const LINE_RECEIVED: u32 = 0x4000_4424;
const LINE_SENT: u32 = 0x4000_4428;
/// On, receiver, transmitter, FIFOs.
const LINE_ON: u32 = 1 << 29 | 1 << 3 | 1 << 2 | 1;
/// Divider of 16 MHz for 115200 baud.
const DIVIDER: u32 = 139;
const HAS_RECEIVED: u32 = 1 << 5;
const COMPLETE: u32 = 1 << 6;
const HAS_ROOM: u32 = 1 << 7;
/// Flags of reception: parity, framing, noise, overrun.
const LINE_ERRORS: u32 = 0xf;
/// Data and control of the CRC unit (16.4).
const CHECK_DATA: u32 = 0x4002_3000;
const CHECK_CONTROL: u32 = 0x4002_3008;
/// Core cycles of a millisecond, minus one.
const MILLISECOND: u32 = 16_000 - 1;
/// Time without a request after which a whole program starts, ms.
const SILENCE_MS: u32 = 10_000;
/// Time after an update in which the desk may repeat its last request, ms.
const REPEAT_MS: u32 = 1_500;
const IDENTITY: Identity<'static> = Identity {
    version: 0,
    schema: 0,
    image: "loader of the stm32g474re",
};

static READ_FAILED: AtomicBool = AtomicBool::new(false);

/// Two wrong bits in a word of the flash (3.3.7), as after a power cut.
#[exception]
unsafe fn NonMaskableInt() {
    let code = read(FLASH_CODE);
    if code & DOUBLE_ERROR == 0 {
        SCB::sys_reset();
    }
    // Writing 1 clears the flag.
    write(FLASH_CODE, code);
    READ_FAILED.store(true, Ordering::Relaxed);
}

fn exchange_note(note: Note) -> Note {
    let place = NOTE as *mut Note;
    // SAFETY: only the note uses this RAM, and any bytes are a valid `Note`; its mark decides
    // whether it counts.
    unsafe {
        let before = read_volatile(place);
        write_volatile(place, note);
        before
    }
}

struct Flash;

impl Flash {
    /// Reads; false if a word had two wrong bits.
    fn watch(reads: impl FnOnce()) -> bool {
        READ_FAILED.store(false, Ordering::Relaxed);
        reads();
        cortex_m::asm::dsb();
        !READ_FAILED.load(Ordering::Relaxed)
    }
}

impl Memory for Flash {
    fn read(&self, address: u32, bytes: &mut [u8]) -> bool {
        Self::watch(|| copy(address, bytes))
    }

    fn program(&mut self, address: u32, word: &[u8; 8]) -> bool {
        let (halves, _) = word.as_chunks();
        CONTROLLER.operate(PROGRAM, || {
            for (address, half) in [address, address + 4].into_iter().zip(halves) {
                write(address, u32::from_le_bytes(*half));
            }
        })
    }

    fn erase(&mut self, address: u32) -> bool {
        let page = (address - FLASH) / PAGE;
        let bank = if page < PAGES { 0 } else { SECOND_BANK };
        CONTROLLER.erase((page % PAGES) << 3 | bank)
    }

    /// The unit takes the highest bit first, CRC-32 the lowest.
    fn crc32(&self, range: Range<u32>) -> Option<u32> {
        let clocks = read(AHB1_CLOCKS);
        write(AHB1_CLOCKS, clocks | CHECK);
        write(CHECK_CONTROL, 1);
        let is_intact = Self::watch(|| {
            for address in range.step_by(4) {
                write(CHECK_DATA, read(address).reverse_bits());
            }
        });
        let sum = !read(CHECK_DATA).reverse_bits();
        write(CHECK_CONTROL, 1);
        write(AHB1_CLOCKS, clocks);
        is_intact.then_some(sum)
    }
}

/// Switches watchdog, FAULT, supply monitor and serial line on. Switches the data cache off,
/// because cached data may be older than the flash.
fn begin() {
    start_watchdog();
    change(&[(AHB2_CLOCKS, 0, PORTS), (APB1_CLOCKS, 0, POWER_AND_PORT)]);
    write(PORT_B_SET, 1 << FAULT);
    change(&[
        (FLASH_ACCESS, DATA_CACHE, 0),
        (PORT_B_MODE, 3 << (2 * FAULT), 1 << (2 * FAULT)),
        (PORT_A_FUNCTION, 0, 0x77 << 8),
        // The pull-up keeps an open line idle.
        (PORT_A_PULL, 0, 1 << 6),
        (PORT_A_MODE, 0xf << 4, 0xa << 4),
        (POWER_CONTROL, 0, MONITOR),
    ]);
    write(LINE_RATE, DIVIDER);
    write(LINE_CONTROL, LINE_ON);
}

fn send(frame: &[u8]) {
    for byte in frame {
        while read(LINE_STATUS) & HAS_ROOM == 0 {}
        write(LINE_SENT, u32::from(*byte));
    }
}

/// Answers a frame; returns whether it was a request of an update.
fn answer(inside: &[u8], slot: &mut OneSlot<Flash>) -> bool {
    let mut buffer = [0; MAX_FRAME_BYTES];
    let (frame, is_update) = match read_frozen_request(inside) {
        Ok((sequence, Incoming::Identity)) => {
            (write_identity(&mut buffer, sequence, &IDENTITY), false)
        }
        Ok((sequence, Incoming::Update(request))) => {
            let answer = slot.answer(&request, read(POWER_STATUS) & BELOW == 0);
            (write_update_answer(&mut buffer, sequence, &answer), true)
        }
        Ok((_, Incoming::Request(_))) | Err(_) => return false,
    };
    frame.into_iter().for_each(send);
    is_update
}

#[entry]
fn main() -> ! {
    let requested = exchange_note(Note::NONE).key();
    let mut slot = OneSlot::new(Flash, requested);
    if requested.is_none() && slot.has_program() {
        // SAFETY: the vector table of the program; the loader uses no memory afterwards.
        unsafe { start_program(SLOT.start) }
    }
    begin();
    // SAFETY: no other code uses the timer.
    let mut timer = unsafe { cortex_m::Peripherals::steal() }.SYST;
    timer.set_clock_source(SystClkSource::Core);
    timer.set_reload(MILLISECOND);
    timer.clear_current();
    timer.enable_counter();
    let mut receiver = Receiver::new();
    let mut silence = 0;
    loop {
        feed_watchdog();
        silence += u32::from(timer.has_wrapped());
        write(LINE_CLEAR, LINE_ERRORS);
        if read(LINE_STATUS) & HAS_RECEIVED != 0
            && let Some(Ok(inside)) = receiver.push(read(LINE_RECEIVED) as u8)
            && answer(inside, &mut slot)
        {
            silence = 0;
        }
        let done = slot.is_done();
        let limit = if done { REPEAT_MS } else { SILENCE_MS };
        if silence >= limit {
            if slot.has_program() {
                while read(LINE_STATUS) & COMPLETE == 0 {}
                exchange_note(Note::STARTED);
                SCB::sys_reset();
            }
            silence = 0;
        }
    }
}
