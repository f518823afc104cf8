//! Loads and stores (ARM DDI 0403E, A5.3.5 to A5.3.10).

use super::{Board, COUNTER, Core, Cycles, Fault, REFILL, bit, bits};

/// Size of an access in bytes, and whether a load extends the sign.
#[derive(Clone, Copy)]
pub(super) struct Width(pub u32, pub bool);

pub(super) const WORD: Width = Width(4, false);

impl Core {
    /// Value of a base register; the program counter is aligned.
    pub(super) fn base(&self, number: usize) -> u32 {
        let mask = if number == COUNTER { !3 } else { !0 };
        self.r[number] & mask
    }

    /// Sets a register unless it is the program counter.
    pub(super) fn back(&mut self, base: usize, value: Option<u32>) {
        if let Some(value) = value
            && base != COUNTER
        {
            self.r[base] = value;
        }
    }

    /// Address of an access before or after the change of its base, and the new value of the base.
    fn indexed(&self, base: usize, by: i32, before: bool, back: bool) -> (u32, Option<u32>) {
        let from = self.base(base);
        let moved = from.wrapping_add_signed(by);
        (if before { moved } else { from }, back.then_some(moved))
    }

    /// Cycles of an access, which overlaps with the previous one (ARM DDI 0439B, 3.3.3).
    fn access(&mut self, alone: u32) -> u32 {
        self.accessed = true;
        if self.overlaps { 1 } else { alone }
    }

    /// Loads a register after the change of the base.
    #[inline(always)]
    pub(super) fn load(
        &mut self,
        bus: &mut Board,
        width: Width,
        target: usize,
        at: u32,
        after: Option<(usize, u32)>,
    ) -> Cycles {
        let value = read(bus, width, at)?;
        if let Some((base, value)) = after {
            self.r[base] = value;
        }
        let cycles = self.access(2);
        if target == COUNTER {
            self.exchange(value)?;
            return Ok(cycles + REFILL);
        }
        self.r[target] = value;
        Ok(cycles)
    }

    #[inline(always)]
    pub(super) fn store(
        &mut self,
        bus: &mut Board,
        Width(size, _): Width,
        source: usize,
        at: u32,
    ) -> Cycles {
        write(bus, size, at, self.r[source])?;
        Ok(self.access(1))
    }

    /// One access (A5.3.7 to A5.3.10).
    #[inline(always)]
    pub(super) fn single(&mut self, first: u16, second: u16, bus: &mut Board) -> Cycles {
        let (base, target) = (bits(first, 0, 4), bits(second, 12, 4));
        let (load, up) = (bit(first, 4), bit(first, 7));
        let (size, sign) = (1 << bits(first, 5, 2), bit(first, 8));
        if size == 8 || sign && (!load || size == 4) {
            return Err(Fault::Undefined);
        }
        if load && target == COUNTER && size < 4 {
            // A hint to fetch ahead.
            return Ok(1);
        }
        let long = i32::from(second & 0xfff);
        let (before, back) = (bit(second, 10), bit(second, 8));
        let (at, after) = if base == COUNTER && load {
            self.indexed(base, if up { long } else { -long }, true, false)
        } else if base == COUNTER {
            return Err(Fault::Undefined);
        } else if up {
            self.indexed(base, long, true, false)
        } else if !bit(second, 11) && bits(second, 6, 5) == 0 {
            let by = self.r[bits(second, 0, 4)] << bits(second, 4, 2);
            (self.r[base].wrapping_add(by), None)
        } else if bit(second, 11) && (before || back) {
            let short = i32::from(second & 0xff);
            let by = if bit(second, 9) { short } else { -short };
            self.indexed(base, by, before, back)
        } else {
            return Err(Fault::Undefined);
        };
        let width = Width(size, sign);
        if load {
            return self.load(bus, width, target, at, after.map(|after| (base, after)));
        }
        let cycles = self.store(bus, width, target, at)?;
        self.back(base, after);
        Ok(cycles)
    }

    /// Double-word and exclusive accesses, table branches (A5.3.6).
    pub(super) fn pair(&mut self, first: u16, second: u16, bus: &mut Board) -> Cycles {
        let base = bits(first, 0, 4);
        let (before, up) = (bit(first, 8), bit(first, 7));
        let (back, load) = (bit(first, 5), bit(first, 4));
        let (target, further) = (bits(second, 12, 4), bits(second, 8, 4));
        let offset = i32::from(second & 0xff) * 4;
        if before || back {
            let by = if up { offset } else { -offset };
            let (at, after) = self.indexed(base, by, before, back);
            if load {
                let words = [word(bus, at)?, word(bus, at.wrapping_add(4))?];
                self.back(base, after);
                for (number, word) in [target, further].into_iter().zip(words) {
                    self.back(number, Some(word));
                }
            } else {
                put(bus, at, self.r[target])?;
                put(bus, at.wrapping_add(4), self.r[further])?;
                self.back(base, after);
            }
            return Ok(3);
        }
        let last = bits(second, 0, 4);
        let (size, failed, at) = match (up, bits(second, 4, 4)) {
            (false, _) => (4, further, self.r[base].wrapping_add_signed(offset)),
            (true, kind @ (0 | 1)) if load => {
                let at = self.r[base].wrapping_add(self.r[last] << kind);
                let by = bus.load(at, 1 << kind).ok_or(Fault::Access(at))?;
                self.r[COUNTER] = self.r[COUNTER].wrapping_add(by * 2);
                return Ok(2 + REFILL);
            }
            (true, kind @ (4 | 5)) => (1 << (kind - 4), last, self.r[base]),
            _ => return Err(Fault::Undefined),
        };
        if load {
            let value = read(bus, Width(size, false), at)?;
            self.exclusive = true;
            self.set(target, value);
        } else {
            let alone = std::mem::take(&mut self.exclusive);
            if alone {
                write(bus, size, at, self.r[target])?;
            }
            self.set(failed, (!alone).into());
        }
        Ok(2)
    }

    /// First address of an access to several words, and the new value of the base.
    pub(super) fn range(&self, base: usize, count: u32, down: bool) -> (u32, u32) {
        let from = self.r[base];
        if down {
            let low = from.wrapping_sub(4 * count);
            (low, low)
        } else {
            (from, from.wrapping_add(4 * count))
        }
    }

    pub(super) fn load_many(
        &mut self,
        bus: &mut Board,
        base: usize,
        list: u16,
        down: bool,
        back: bool,
    ) -> Cycles {
        let (from, after) = self.range(base, list.count_ones(), down);
        let mut loaded = self.r;
        for (number, at) in list_registers(list, from) {
            loaded[number] = word(bus, at)?;
        }
        if back && !bit(list, base as u32) {
            loaded[base] = after;
        }
        let cycles = 1 + list.count_ones();
        let branches = bit(list, COUNTER as u32);
        if branches {
            self.exchange(loaded[COUNTER])?;
        }
        loaded[COUNTER] = self.r[COUNTER];
        self.r = loaded;
        Ok(cycles + u32::from(branches) * REFILL)
    }

    pub(super) fn store_many(
        &mut self,
        bus: &mut Board,
        base: usize,
        list: u16,
        down: bool,
        back: bool,
    ) -> Cycles {
        let (from, after) = self.range(base, list.count_ones(), down);
        for (number, at) in list_registers(list, from) {
            put(bus, at, self.r[number])?;
        }
        self.back(base, back.then_some(after));
        Ok(1 + list.count_ones())
    }
}

/// Registers of a list, and the addresses of their words from `from` on.
fn list_registers(list: u16, from: u32) -> impl Iterator<Item = (usize, u32)> {
    let rest = |list: &u16| Some(list & list.wrapping_sub(1));
    let rests = std::iter::successors(Some(list), rest).take_while(|rest| *rest != 0);
    let places = (0..16).map(move |n| from.wrapping_add(4 * n));
    (rests.map(|rest| rest.trailing_zeros() as usize)).zip(places)
}

#[inline(always)]
fn read(bus: &mut Board, Width(size, sign): Width, at: u32) -> Result<u32, Fault> {
    let value = bus.load(at, size).ok_or(Fault::Access(at))?;
    Ok(match (size, sign) {
        (2, true) => i32::from(value as i16) as u32,
        (1, true) => i32::from(value as i8) as u32,
        _ => value,
    })
}

#[inline(always)]
fn write(bus: &mut Board, size: u32, at: u32, value: u32) -> Result<(), Fault> {
    let mask = u32::MAX >> (32 - 8 * size);
    bus.store(at, size, value & mask).ok_or(Fault::Access(at))
}

/// Reads a word from an address that must be aligned.
#[inline]
pub(super) fn word(bus: &mut Board, at: u32) -> Result<u32, Fault> {
    if !at.is_multiple_of(4) {
        return Err(Fault::Unaligned);
    }
    bus.load(at, 4).ok_or(Fault::Access(at))
}

#[inline]
pub(super) fn put(bus: &mut Board, at: u32, value: u32) -> Result<(), Fault> {
    if !at.is_multiple_of(4) {
        return Err(Fault::Unaligned);
    }
    bus.store(at, 4, value).ok_or(Fault::Access(at))
}
