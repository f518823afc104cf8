//! Exception entry and return (ARM DDI 0403E, B1.5.6 and B1.5.8).

use super::{Board, COUNTER, Core, Cycles, Fault, LINK, STACK};

/// Bit of CONTROL: numbers in the floating-point registers.
const FLOAT: u32 = 1 << 2;
const FRAME: u32 = 0x20;
/// Registers of a stack frame before the status.
const FRAME_REGISTERS: [usize; 7] = [0, 1, 2, 3, 12, LINK, COUNTER];
/// Size of a stack frame with floating-point registers, bytes.
const FLOAT_FRAME: u32 = 0x68;
/// Duration of an exception entry or return, cycles (ARM DDI 0439B, 3.9).
const LATENCY: u32 = 12;
/// Extra duration for the floating-point registers, cycles.
const FLOAT_LATENCY: u32 = 17;

impl Core {
    /// Enters exception `number` with its handler at `vector`. Returns the cycles, and whether the
    /// frame fits the stack.
    pub fn enter(&mut self, bus: &mut Board, number: u16, vector: u32) -> (u32, bool) {
        let float = self.control & FLOAT != 0;
        let size = if float { FLOAT_FRAME } else { FRAME };
        let stack = self.r[STACK];
        let place = stack.wrapping_sub(size) & !7;
        let padded = u32::from(stack & 4 != 0);
        let status = self.program_status() | padded << 9;
        let mut frame = FRAME_REGISTERS.map(|number| self.r[number]).to_vec();
        frame.push(status);
        if float {
            frame.extend(&self.s[..16]);
            frame.push(self.status);
        }
        let mut taken = true;
        for (n, value) in (0..).zip(frame) {
            taken &= bus.store(place.wrapping_add(4 * n), 4, value).is_some();
        }
        let thread = u32::from(self.exception == 0) << 3;
        self.r[LINK] = (0xffff_fff1 | thread) & !(u32::from(float) << 4);
        self.r[STACK] = place;
        self.control &= !FLOAT;
        self.exception = number;
        self.block = 0;
        self.exclusive = false;
        self.event = true;
        self.waits = false;
        self.r[COUNTER] = vector & !1;
        let more = if float { FLOAT_LATENCY } else { 0 };
        (LATENCY + more, taken)
    }

    /// Leaves the exception by `link`; returns the cycles.
    pub fn leave(&mut self, bus: &mut Board, link: u32) -> Result<u32, Fault> {
        if !matches!(link & 0xf, 0x1 | 0x9) {
            return Err(Fault::Return);
        }
        let float = link & 0x10 == 0;
        let size = if float { FLOAT_FRAME } else { FRAME };
        let place = self.r[STACK];
        let mut get = |at: u32| {
            let address = place.wrapping_add(at);
            bus.load(address, 4).ok_or(Fault::Access(address))
        };
        for (at, number) in (0_u32..).step_by(4).zip(FRAME_REGISTERS) {
            self.r[number] = get(at)?;
        }
        let status = get(28)?;
        if float {
            for (at, number) in (32_u32..).step_by(4).zip(0..16) {
                self.s[number] = get(at)?;
            }
            self.status = get(96)?;
            self.control |= FLOAT;
        } else {
            self.control &= !FLOAT;
        }
        self.r[COUNTER] &= !1;
        self.r[STACK] = place.wrapping_add(size) | (status >> 9 & 1) << 2;
        self.set_flags(status);
        self.block = (status >> 25 & 3 | status >> 8 & 0xfc) as u8;
        self.exception = (status & 0x1ff) as u16;
        self.exclusive = false;
        self.event = true;
        let thread = link & 8 != 0;
        if thread != (self.exception == 0) {
            return Err(Fault::Return);
        }
        let more = if float { FLOAT_LATENCY } else { 0 };
        Ok(LATENCY + more)
    }

    /// Reads a special register (B5.2.2).
    pub(super) fn special(&self, number: u8) -> Result<u32, Fault> {
        Ok(match number {
            0 => self.program_status() & 0xf000_0000,
            5 => self.exception.into(),
            8 => self.r[STACK],
            16 => self.mask.into(),
            20 => self.control,
            _ => return Err(Fault::Undefined),
        })
    }

    pub(super) fn set_special(&mut self, number: u8, value: u32) -> Cycles {
        match number {
            0 => self.set_flags(value),
            8 => self.r[STACK] = value & !3,
            16 => self.mask = value & 1 == 1,
            20 => self.control = value & (1 | FLOAT),
            _ => return Err(Fault::Undefined),
        }
        self.attention = true;
        Ok(2)
    }

    /// Marks the floating-point registers as used: a frame includes them from now on.
    pub(super) fn touch_float(&mut self) -> Result<(), Fault> {
        if !self.float {
            return Err(Fault::NoCoprocessor);
        }
        self.control |= FLOAT;
        Ok(())
    }
}
