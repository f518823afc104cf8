//! Execution of each instruction (ARM DDI 0403E, A7.7).

use super::op::{Alu, Extension, Flags, Long, Op, Operand, Place, Product, Shift, Turn, Width};
use super::{Bus, COUNTER, Core, Fault, LINK, WaitState};

/// Cycles to refill the pipeline after a branch: 1 to 3 by alignment (ARM DDI 0439B, 3.3.1).
const REFILL: u32 = 2;

/// The upper (`top`) or lower half of a value with its sign.
fn half(value: u32, top: bool) -> i64 {
    let half = if top { value >> 16 } else { value };
    i64::from(half as i16)
}

impl Core {
    #[inline]
    fn get(&self, number: u8) -> u32 {
        self.r[usize::from(number & 15)]
    }

    /// Sets a register; setting the program counter branches.
    #[inline]
    fn set(&mut self, number: u8, value: u32) -> u32 {
        if usize::from(number) == COUNTER {
            self.next = value & !1;
            return 1 + REFILL;
        }
        self.r[usize::from(number)] = value;
        1
    }

    /// A branch that may leave an exception.
    fn exchange(&mut self, value: u32) -> Result<(), Fault> {
        if value >> 28 == 0xf && self.exception != 0 {
            self.returning = Some(value);
            self.attention = true;
            self.next = value & !1;
            return Ok(());
        }
        if value & 1 == 0 {
            return Err(Fault::State);
        }
        self.next = value & !1;
        Ok(())
    }

    #[inline]
    fn flagged(&self, flags: Flags) -> bool {
        match flags {
            Flags::Keep => false,
            Flags::Set => true,
            Flags::Outside => !self.inside,
        }
    }

    #[inline]
    fn sign(&mut self, value: u32) {
        self.negative = value >> 31 == 1;
        self.zero = value == 0;
    }

    /// Result of a shift, and its carry.
    fn shifted(&self, value: u32, kind: Shift, by: u32) -> (u32, bool) {
        let out = |shifted: u32| shifted & 1 == 1;
        match (kind, by) {
            (Shift::Round, 0) => (value >> 1 | u32::from(self.carry) << 31, out(value)),
            (_, 0) => (value, self.carry),
            (Shift::Left, 1..=31) => (value << by, out(value >> (32 - by))),
            (Shift::Left, 32) => (0, out(value)),
            (Shift::Right, 1..=31) => (value >> by, out(value >> (by - 1))),
            (Shift::Right, 32) => (0, value >> 31 == 1),
            (Shift::Left | Shift::Right, _) => (0, false),
            (Shift::Signed, 1..=31) => (
                (value as i32 >> by) as u32,
                out((value as i32 >> (by - 1)) as u32),
            ),
            (Shift::Signed, _) => ((value as i32 >> 31) as u32, value >> 31 == 1),
            (Shift::Round, by) => {
                let value = value.rotate_right(by & 31);
                (value, value >> 31 == 1)
            }
        }
    }

    #[inline(always)]
    fn operand(&self, operand: Operand) -> (u32, bool) {
        match operand {
            Operand::Number(value) => (value, self.carry),
            Operand::Turned(value) => (value, value >> 31 == 1),
            Operand::Register(number) => (self.get(number), self.carry),
            Operand::Shifted(number, kind, by) => self.shifted(self.get(number), kind, by.into()),
        }
    }

    #[inline]
    fn sum(&mut self, set: bool, one: u32, two: u32, carry: bool) -> u32 {
        let wide = u64::from(one) + u64::from(two) + u64::from(carry);
        let value = wide as u32;
        if set {
            self.carry = wide >> 32 == 1;
            self.overflow = (one ^ value) & (two ^ value) & 0x8000_0000 != 0;
            self.sign(value);
        }
        value
    }

    #[inline(always)]
    fn data(&mut self, alu: Alu, flags: Flags, d: u8, n: u8, operand: Operand) -> u32 {
        let set = self.flagged(flags);
        let (two, carry) = self.operand(operand);
        let one = if n == 16 { 0 } else { self.get(n) };
        let value = match alu {
            Alu::And => one & two,
            Alu::Clear => one & !two,
            Alu::Or => one | two,
            Alu::OrNot => one | !two,
            Alu::Exclusive => one ^ two,
            Alu::Move => two,
            Alu::Not => !two,
            Alu::Add => self.sum(set, one, two, false),
            Alu::AddCarry => self.sum(set, one, two, self.carry),
            Alu::SubtractCarry => self.sum(set, one, !two, self.carry),
            Alu::Subtract => self.sum(set, one, !two, true),
            Alu::Reverse => self.sum(set, !one, two, true),
        };
        if set
            && matches!(
                alu,
                Alu::And
                    | Alu::Clear
                    | Alu::Or
                    | Alu::OrNot
                    | Alu::Exclusive
                    | Alu::Move
                    | Alu::Not
            )
        {
            self.carry = carry;
            self.sign(value);
        }
        if d == 16 { 1 } else { self.set(d, value) }
    }

    /// Address of an access, and the new value of its base.
    #[inline(always)]
    fn place(&self, base: u8, place: Place) -> (u32, Option<u32>) {
        let from = self.get(base);
        match place {
            Place::Offset(by) => (from.wrapping_add_signed(by), None),
            Place::Before(by) => {
                let at = from.wrapping_add_signed(by);
                (at, Some(at))
            }
            Place::After(by) => (from, Some(from.wrapping_add_signed(by))),
            Place::Indexed(register, by) => (from.wrapping_add(self.get(register) << by), None),
            Place::Literal(by) => ((from & !3).wrapping_add_signed(by), None),
        }
    }

    fn back(&mut self, base: u8, value: Option<u32>) {
        if let Some(value) = value {
            self.r[usize::from(base)] = value;
        }
    }

    /// Cycles of an access, which overlaps with the previous one (ARM DDI 0439B, 3.3.3).
    fn access(&mut self, alone: u32) -> u32 {
        let overlaps = std::mem::replace(&mut self.accessed, true);
        if overlaps { 1 } else { alone }
    }

    #[inline(always)]
    pub(super) fn execute(&mut self, op: &Op, bus: &mut impl Bus) -> Result<u32, Fault> {
        let before = std::mem::take(&mut self.accessed);
        match *op {
            Op::Data(alu, flags, d, n, operand) => Ok(self.data(alu, flags, d, n, operand)),
            Op::Load(width, target, base, place) => {
                self.accessed = before;
                let (at, base_after) = self.place(base, place);
                let value = load(bus, width, at)?;
                self.back(base, base_after);
                let cycles = self.access(2);
                if usize::from(target) == COUNTER {
                    self.exchange(value)?;
                    return Ok(cycles + REFILL);
                }
                self.r[usize::from(target)] = value;
                Ok(cycles)
            }
            Op::Store(width, source, base, place) => {
                self.accessed = before;
                let (at, base_after) = self.place(base, place);
                store(bus, width, at, self.get(source))?;
                self.back(base, base_after);
                Ok(self.access(1))
            }
            Op::Branch(by) => {
                self.next = self.r[COUNTER].wrapping_add_signed(by);
                Ok(1 + REFILL)
            }
            Op::BranchIf(condition, by) => {
                if self.holds(condition) {
                    self.next = self.r[COUNTER].wrapping_add_signed(by);
                    return Ok(1 + REFILL);
                }
                Ok(1)
            }
            Op::CompareBranch(nonzero, n, by) => {
                if (self.get(n) != 0) == nonzero {
                    self.next = self.r[COUNTER].wrapping_add_signed(by);
                    return Ok(1 + REFILL);
                }
                Ok(1)
            }
            Op::Call(by) => {
                self.r[LINK] = self.next | 1;
                self.next = self.r[COUNTER].wrapping_add_signed(by);
                Ok(1 + REFILL)
            }
            Op::Exchange(m) => {
                self.exchange(self.get(m))?;
                Ok(1 + REFILL)
            }
            Op::CallRegister(m) => {
                let to = self.get(m);
                if to & 1 == 0 {
                    return Err(Fault::State);
                }
                self.r[LINK] = self.next | 1;
                self.next = to & !1;
                Ok(1 + REFILL)
            }
            Op::Table(half, n, m) => {
                let index = self.get(m);
                let (at, size) = if half { (index << 1, 2) } else { (index, 1) };
                let at = self.get(n).wrapping_add(at);
                let by = bus.load(at, size).ok_or(Fault::Access(at))?;
                self.next = self.r[COUNTER].wrapping_add(by * 2);
                Ok(2 + REFILL)
            }
            Op::LoadMany(base, list, down, goes_on) => {
                self.load_many(bus, base, list, down, goes_on)
            }
            Op::StoreMany(base, list, down, goes_on) => {
                self.store_many(bus, base, list, down, goes_on)
            }
            Op::LoadPair(one, two, base, place) => {
                let (at, base_after) = self.place(base, place);
                let first = word(bus, at)?;
                let second = word(bus, at.wrapping_add(4))?;
                self.back(base, base_after);
                self.r[usize::from(one)] = first;
                self.r[usize::from(two)] = second;
                Ok(3)
            }
            Op::StorePair(one, two, base, place) => {
                let (at, base_after) = self.place(base, place);
                put(bus, at, self.get(one))?;
                put(bus, at.wrapping_add(4), self.get(two))?;
                self.back(base, base_after);
                Ok(3)
            }
            Op::ShiftBy(kind, flags, d, n, m) => {
                let by = self.get(m) & 0xff;
                let (value, carry) = if by == 0 {
                    (self.get(n), self.carry)
                } else {
                    self.shifted(self.get(n), kind, by)
                };
                if self.flagged(flags) {
                    self.carry = carry;
                    self.sign(value);
                }
                Ok(self.set(d, value))
            }
            Op::MoveTop(d, value) => {
                let low = self.get(d) & 0xffff;
                Ok(self.set(d, u32::from(value) << 16 | low))
            }
            Op::Near(d, by) => {
                let value = (self.r[COUNTER] & !3).wrapping_add_signed(by);
                Ok(self.set(d, value))
            }
            Op::Multiply(flags, d, n, m) => {
                let value = self.get(n).wrapping_mul(self.get(m));
                if self.flagged(flags) {
                    self.sign(value);
                }
                Ok(self.set(d, value))
            }
            Op::MultiplyAdd(d, n, m, a) => {
                let value = self
                    .get(n)
                    .wrapping_mul(self.get(m))
                    .wrapping_add(self.get(a));
                Ok(self.set(d, value))
            }
            Op::MultiplySubtract(d, n, m, a) => {
                let product = self.get(n).wrapping_mul(self.get(m));
                let value = self.get(a).wrapping_sub(product);
                Ok(self.set(d, value))
            }
            Op::Product(kind, d, n, m, a) => Ok(self.product(kind, d, n, m, a)),
            Op::Long(kind, low, high, n, m) => Ok(self.long(kind, low, high, n, m)),
            Op::Divide(signed, d, n, m) => {
                let (one, two) = (self.get(n), self.get(m));
                let value = match (signed, two) {
                    (_, 0) => 0,
                    (true, _) => (one as i32).wrapping_div(two as i32) as u32,
                    (false, _) => one / two,
                };
                self.set(d, value);
                // 2 to 12 cycles: fewer for a quotient with fewer bits.
                Ok(2 + (32 - value.leading_zeros()) * 10 / 32)
            }
            Op::Extend(kind, d, n, m, turned) => {
                let value = self.get(m).rotate_right(turned.into());
                let base = if usize::from(n) == COUNTER {
                    0
                } else {
                    self.get(n)
                };
                let value = match kind {
                    Extension::SignedByte => base.wrapping_add_signed(i32::from(value as i8)),
                    Extension::Byte => base.wrapping_add(value & 0xff),
                    Extension::SignedHalf => base.wrapping_add_signed(i32::from(value as i16)),
                    Extension::Half => base.wrapping_add(value & 0xffff),
                    Extension::Bytes => {
                        let (low, high) = (value & 0xff, value >> 16 & 0xff);
                        base.wrapping_add(low) & 0xffff | (base >> 16).wrapping_add(high) << 16
                    }
                };
                Ok(self.set(d, value))
            }
            Op::Saturate(signed, d, bits, n, kind, by) => {
                let kind = if by == 0 { Shift::Left } else { kind };
                let value = match (kind, u32::from(by)) {
                    (Shift::Left, by) => self.get(n) << by,
                    (_, by) => (self.get(n) as i32 >> by) as u32,
                };
                let value = self.saturate(signed, bits, i64::from(value as i32));
                Ok(self.set(d, value))
            }
            Op::SaturateLanes(bytes, subtracted, d, n, m) => {
                let value = self.saturate_lanes(bytes, subtracted, n, m);
                Ok(self.set(d, value))
            }
            Op::Saturating(subtracted, d, n, m) => {
                let two = i64::from(self.get(n) as i32);
                let two = if subtracted { -two } else { two };
                let value = self.saturate(true, 32, i64::from(self.get(m) as i32) + two);
                Ok(self.set(d, value))
            }
            Op::Pack(top, d, n, m, by) => {
                let value = if top {
                    let second = (i64::from(self.get(m) as i32) >> by) as u32;
                    self.get(n) & 0xffff_0000 | second & 0xffff
                } else {
                    self.get(n) & 0xffff | self.get(m) << by & 0xffff_0000
                };
                Ok(self.set(d, value))
            }
            Op::Turn(kind, d, m) => {
                let value = self.get(m);
                let value = match kind {
                    Turn::Bytes => value.swap_bytes(),
                    Turn::HalfBytes => value.swap_bytes().rotate_right(16),
                    Turn::Bits => value.reverse_bits(),
                    Turn::SignedHalf => i32::from((value as u16).swap_bytes() as i16) as u32,
                    Turn::Zeros => value.leading_zeros(),
                };
                Ok(self.set(d, value))
            }
            Op::Insert(d, n, low, count) => {
                let mask = ones(count) << low;
                let from = if usize::from(n) == COUNTER {
                    0
                } else {
                    self.get(n)
                };
                let value = self.get(d) & !mask | from << low & mask;
                Ok(self.set(d, value))
            }
            Op::Extract(signed, d, n, low, count) => {
                let (low, count) = (u32::from(low), u32::from(count));
                if low + count > 32 {
                    return Err(Fault::Undefined);
                }
                let top = self.get(n) << (32 - low - count);
                let value = if signed {
                    (top as i32 >> (32 - count)) as u32
                } else {
                    top >> (32 - count)
                };
                Ok(self.set(d, value))
            }
            Op::LoadExclusive(width, t, n, offset) => {
                let at = self.get(n).wrapping_add(offset.into());
                let value = load(bus, width, at)?;
                self.exclusive = true;
                self.set(t, value);
                Ok(2)
            }
            Op::StoreExclusive(width, d, t, n, offset) => {
                let failed = !std::mem::take(&mut self.exclusive);
                if !failed {
                    let at = self.get(n).wrapping_add(offset.into());
                    store(bus, width, at, self.get(t))?;
                }
                self.set(d, failed.into());
                Ok(2)
            }
            Op::ClearExclusive => {
                self.exclusive = false;
                Ok(1)
            }
            Op::IfThen(state) => {
                self.block = state;
                Ok(1)
            }
            Op::Nothing => Ok(1),
            Op::Barrier => Ok(1 + REFILL),
            Op::WaitEvent => {
                if !std::mem::take(&mut self.event) {
                    self.waits = WaitState::Event;
                    self.attention = true;
                }
                Ok(1)
            }
            Op::WaitInterrupt => {
                self.waits = WaitState::Interrupt;
                self.attention = true;
                Ok(1)
            }
            Op::SendEvent => {
                self.event = true;
                Ok(1)
            }
            Op::Breakpoint(_) => Err(Fault::Breakpoint),
            Op::Mask(set, interrupts, faults) => {
                if interrupts {
                    self.mask = set;
                }
                if faults {
                    self.fault_mask = set;
                }
                self.attention = true;
                Ok(1)
            }
            Op::FromSpecial(d, number) => {
                let value = self.special(number);
                self.set(d, value);
                Ok(2)
            }
            Op::ToSpecial(n, number) => {
                self.set_special(number, self.get(n));
                Ok(2)
            }
            Op::Undefined => Err(Fault::Undefined),
            _ => {
                self.touch_float()?;
                self.float_op(op, bus)
            }
        }
    }

    fn float_op(&mut self, op: &Op, bus: &mut impl Bus) -> Result<u32, Fault> {
        match *op {
            Op::Single(operation, d, n, m) => Ok(self.single(operation, d, n, m)),
            Op::Unary(operation, d, m) => Ok(self.unary(operation, d, m)),
            Op::SingleNumber(d, value) => {
                self.s[usize::from(d)] = value;
                Ok(1)
            }
            Op::SingleCompare(d, m) => {
                self.compare(d, m);
                Ok(1)
            }
            Op::SingleMove(true, t, n) => Ok(self.set(t, self.s[usize::from(n)])),
            Op::SingleMove(false, t, n) => {
                self.s[usize::from(n)] = self.get(t);
                Ok(1)
            }
            Op::SingleMovePair(to_core, t, t2, m) => {
                let m = usize::from(m);
                if to_core {
                    self.set(t, self.s[m]);
                    self.set(t2, self.s[m + 1]);
                } else {
                    self.s[m] = self.get(t);
                    self.s[m + 1] = self.get(t2);
                }
                Ok(2)
            }
            Op::FromStatus(15) => {
                let (saturated, flags) = (self.saturated, self.status);
                self.set_flags(flags);
                self.saturated = saturated;
                Ok(1)
            }
            Op::FromStatus(t) => Ok(self.set(t, self.status)),
            Op::ToStatus(t) => {
                self.status = self.get(t);
                Ok(1)
            }
            Op::SingleLoad(d, base, offset, count) => {
                let from = self.base(base).wrapping_add_signed(offset);
                self.singles_from(bus, d, count, from)?;
                Ok(1 + u32::from(count))
            }
            Op::SingleStore(d, base, offset, count) => {
                let to = self.base(base).wrapping_add_signed(offset);
                self.singles_to(bus, d, count, to)?;
                Ok(1 + u32::from(count))
            }
            Op::SingleLoadMany(d, base, count, down, goes_on) => {
                let (from, after) = self.range(base, count.into(), down);
                self.singles_from(bus, d, count, from)?;
                self.back(base, goes_on.then_some(after));
                Ok(1 + u32::from(count))
            }
            Op::SingleStoreMany(d, base, count, down, goes_on) => {
                let (to, after) = self.range(base, count.into(), down);
                self.singles_to(bus, d, count, to)?;
                self.back(base, goes_on.then_some(after));
                Ok(1 + u32::from(count))
            }
            _ => Err(Fault::Undefined),
        }
    }

    /// Value of a base register; the program counter is aligned.
    fn base(&self, number: u8) -> u32 {
        let value = self.get(number);
        if usize::from(number) == COUNTER {
            value & !3
        } else {
            value
        }
    }

    fn singles_from(
        &mut self,
        bus: &mut impl Bus,
        d: u8,
        count: u8,
        from: u32,
    ) -> Result<(), Fault> {
        for index in 0..count {
            self.s[usize::from(d + index)] = word(bus, from.wrapping_add(4 * u32::from(index)))?;
        }
        Ok(())
    }

    fn singles_to(&mut self, bus: &mut impl Bus, d: u8, count: u8, to: u32) -> Result<(), Fault> {
        for index in 0..count {
            let value = self.s[usize::from(d + index)];
            put(bus, to.wrapping_add(4 * u32::from(index)), value)?;
        }
        Ok(())
    }

    /// First address of an access to several words, and the new value of the base.
    fn range(&self, base: u8, count: u32, down: bool) -> (u32, u32) {
        let from = self.get(base);
        if down {
            let low = from.wrapping_sub(4 * count);
            (low, low)
        } else {
            (from, from.wrapping_add(4 * count))
        }
    }

    fn load_many(
        &mut self,
        bus: &mut impl Bus,
        base: u8,
        list: u16,
        down: bool,
        goes_on: bool,
    ) -> Result<u32, Fault> {
        let (mut at, after) = self.range(base, list.count_ones(), down);
        let mut loaded = self.r;
        let mut left = list;
        while left != 0 {
            let number = left.trailing_zeros() as usize;
            left &= left - 1;
            loaded[number] = word(bus, at)?;
            at = at.wrapping_add(4);
        }
        let mut cycles = 1 + list.count_ones();
        if list >> COUNTER & 1 == 1 {
            let to = std::mem::replace(&mut loaded[COUNTER], self.r[COUNTER]);
            if goes_on {
                loaded[usize::from(base)] = after;
            }
            self.exchange(to)?;
            self.r = loaded;
            cycles += REFILL;
        } else {
            self.r = loaded;
            if goes_on && list >> base & 1 == 0 {
                self.r[usize::from(base)] = after;
            }
        }
        Ok(cycles)
    }

    fn store_many(
        &mut self,
        bus: &mut impl Bus,
        base: u8,
        list: u16,
        down: bool,
        goes_on: bool,
    ) -> Result<u32, Fault> {
        let (mut at, after) = self.range(base, list.count_ones(), down);
        let mut left = list;
        while left != 0 {
            let number = left.trailing_zeros() as usize;
            left &= left - 1;
            put(bus, at, self.r[number])?;
            at = at.wrapping_add(4);
        }
        self.back(base, goes_on.then_some(after));
        Ok(1 + list.count_ones())
    }

    fn product(&mut self, kind: Product, d: u8, n: u8, m: u8, a: u8) -> u32 {
        let (one, two) = (self.get(n), self.get(m));
        let added = if usize::from(a) == COUNTER {
            0
        } else {
            self.get(a)
        };
        let value = match kind {
            Product::Halves(first, second) => {
                let total = half(one, first) * half(two, second) + i64::from(added as i32);
                self.saturated |= i64::from(total as i32) != total;
                total as u32
            }
            Product::Top(round) => {
                let words = i64::from(one as i32) * i64::from(two as i32);
                let rounding = if round { 0x8000_0000 } else { 0 };
                let base = i64::from(added as i32) << 32;
                (base.wrapping_add(words).wrapping_add(rounding) >> 32) as u32
            }
        };
        self.set(d, value)
    }

    fn long(&mut self, kind: Long, low: u8, high: u8, n: u8, m: u8) -> u32 {
        let (one, two) = (self.get(n), self.get(m));
        let target = u64::from(self.get(high)) << 32 | u64::from(self.get(low));
        let unsigned = u64::from(one) * u64::from(two);
        let signed = (i64::from(one as i32) * i64::from(two as i32)) as u64;
        let value = match kind {
            Long::Unsigned => unsigned,
            Long::Signed => signed,
            Long::UnsignedAdd => target.wrapping_add(unsigned),
            Long::SignedAdd => target.wrapping_add(signed),
            Long::AddBoth => unsigned + u64::from(self.get(low)) + u64::from(self.get(high)),
        };
        self.set(low, value as u32);
        self.set(high, (value >> 32) as u32);
        1
    }

    /// Saturates to `bits` bits and sets the saturation flag.
    fn saturate(&mut self, signed: bool, bits: u8, value: i64) -> u32 {
        let (low, high) = if signed {
            (-(1_i64 << (bits - 1)), (1_i64 << (bits - 1)) - 1)
        } else {
            (0, (1_i64 << bits) - 1)
        };
        self.saturated |= !(low..=high).contains(&value);
        value.clamp(low, high) as u32
    }

    fn saturate_lanes(&self, bytes: bool, subtracted: bool, n: u8, m: u8) -> u32 {
        let width = if bytes { 8 } else { 16 };
        let largest = ones(width);
        (0..32).step_by(width.into()).fold(0, |value, low| {
            let (one, two) = (self.get(n) >> low & largest, self.get(m) >> low & largest);
            let lane = if subtracted {
                one.saturating_sub(two)
            } else {
                (one + two).min(largest)
            };
            value | lane << low
        })
    }
}

/// A mask of `count` ones.
fn ones(count: u8) -> u32 {
    if count >= 32 {
        u32::MAX
    } else {
        (1 << count) - 1
    }
}

#[inline(always)]
fn load(bus: &mut impl Bus, width: Width, at: u32) -> Result<u32, Fault> {
    let size = match width {
        Width::Word => 4,
        Width::Half | Width::SignedHalf => 2,
        Width::Byte | Width::SignedByte => 1,
    };
    let value = bus.load(at, size).ok_or(Fault::Access(at))?;
    Ok(match width {
        Width::SignedHalf => i32::from(value as i16) as u32,
        Width::SignedByte => i32::from(value as i8) as u32,
        _ => value,
    })
}

#[inline]
fn store(bus: &mut impl Bus, width: Width, at: u32, value: u32) -> Result<(), Fault> {
    let (size, value) = match width {
        Width::Word => (4, value),
        Width::Half | Width::SignedHalf => (2, value & 0xffff),
        Width::Byte | Width::SignedByte => (1, value & 0xff),
    };
    bus.store(at, size, value).ok_or(Fault::Access(at))
}

/// Reads a word from an address that must be aligned.
#[inline]
fn word(bus: &mut impl Bus, at: u32) -> Result<u32, Fault> {
    if !at.is_multiple_of(4) {
        return Err(Fault::Unaligned);
    }
    bus.load(at, 4).ok_or(Fault::Access(at))
}

#[inline]
fn put(bus: &mut impl Bus, at: u32, value: u32) -> Result<(), Fault> {
    if !at.is_multiple_of(4) {
        return Err(Fault::Unaligned);
    }
    bus.store(at, 4, value).ok_or(Fault::Access(at))
}
