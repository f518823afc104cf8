//! Decoder from halfwords to instructions (ARM DDI 0403E, A5 and A6).

use super::op::{
    Alu, Extension, Flags, Long, Op, Operand, Place, Product, Shift, Single, Turn, Unary, Width,
};

const STACK: u8 = 13;
const COUNTER: u8 = 15;
/// Register number for "no target".
const NONE: u8 = 16;

/// Whether this halfword begins an instruction of two (A5.1).
pub fn is_wide(first: u16) -> bool {
    first >= 0xe800
}

/// Bits of a halfword: `count` from `low` on.
fn bits(code: u16, low: u32, count: u32) -> u8 {
    (code >> low & ((1 << count) - 1)) as u8
}

fn bit(code: u16, at: u32) -> bool {
    code >> at & 1 == 1
}

/// Sign-extends a number of `count` bits.
fn signed(value: u32, count: u32) -> i32 {
    (value << (32 - count)) as i32 >> (32 - count)
}

/// The instruction of one or two halfwords.
pub fn decode(first: u16, second: u16) -> Op {
    if is_wide(first) {
        wide(first, second)
    } else {
        narrow(first)
    }
}

fn shift(kind: u8) -> Shift {
    [Shift::Left, Shift::Right, Shift::Signed, Shift::Round][usize::from(kind & 3)]
}

/// A register shifted by a number (A7.4.2).
fn shifted(register: u8, kind: u8, by: u8) -> Operand {
    match (shift(kind), by) {
        (Shift::Left, 0) => Operand::Register(register),
        (kind @ (Shift::Right | Shift::Signed), 0) => Operand::Shifted(register, kind, 32),
        (kind, by) => Operand::Shifted(register, kind, by),
    }
}

fn narrow(code: u16) -> Op {
    use Flags::{Keep, Outside, Set};
    let (target, source, third) = (bits(code, 0, 3), bits(code, 3, 3), bits(code, 6, 3));
    let upper = bits(code, 8, 3);
    let byte = u32::from(code & 0xff);
    let small = bits(code, 6, 5);
    let word = |op: fn(Width, u8, u8, Place) -> Op, width, scale: i32| {
        op(
            width,
            target,
            source,
            Place::Offset(i32::from(small) * scale),
        )
    };
    match code >> 11 {
        kind @ 0b00000..=0b00010 => {
            let operand = shifted(source, kind as u8, small);
            Op::Data(Alu::Move, Outside, target, NONE, operand)
        }
        0b00011 => {
            let alu = if bit(code, 9) {
                Alu::Subtract
            } else {
                Alu::Add
            };
            let operand = if bit(code, 10) {
                Operand::Number(third.into())
            } else {
                Operand::Register(third)
            };
            Op::Data(alu, Outside, target, source, operand)
        }
        0b00100 => Op::Data(Alu::Move, Outside, upper, NONE, Operand::Number(byte)),
        0b00101 => Op::Data(Alu::Subtract, Set, NONE, upper, Operand::Number(byte)),
        0b00110 => Op::Data(Alu::Add, Outside, upper, upper, Operand::Number(byte)),
        0b00111 => Op::Data(Alu::Subtract, Outside, upper, upper, Operand::Number(byte)),
        0b01000 if !bit(code, 10) => combined(bits(code, 6, 4), target, source),
        0b01000 => {
            let (target, source) = (target | bits(code, 7, 1) << 3, bits(code, 3, 4));
            let operand = Operand::Register(source);
            match bits(code, 8, 2) {
                0 => Op::Data(Alu::Add, Keep, target, target, operand),
                1 => Op::Data(Alu::Subtract, Set, NONE, target, operand),
                2 => Op::Data(Alu::Move, Keep, target, NONE, operand),
                _ if bit(code, 7) => Op::CallRegister(source),
                _ => Op::Exchange(source),
            }
        }
        0b01001 => Op::Load(Width::Word, upper, COUNTER, Place::Literal(byte as i32 * 4)),
        0b01010 | 0b01011 => {
            let place = Place::Indexed(third, 0);
            match bits(code, 9, 3) {
                0 => Op::Store(Width::Word, target, source, place),
                1 => Op::Store(Width::Half, target, source, place),
                2 => Op::Store(Width::Byte, target, source, place),
                3 => Op::Load(Width::SignedByte, target, source, place),
                4 => Op::Load(Width::Word, target, source, place),
                5 => Op::Load(Width::Half, target, source, place),
                6 => Op::Load(Width::Byte, target, source, place),
                _ => Op::Load(Width::SignedHalf, target, source, place),
            }
        }
        0b01100 => word(Op::Store, Width::Word, 4),
        0b01101 => word(Op::Load, Width::Word, 4),
        0b01110 => word(Op::Store, Width::Byte, 1),
        0b01111 => word(Op::Load, Width::Byte, 1),
        0b10000 => word(Op::Store, Width::Half, 2),
        0b10001 => word(Op::Load, Width::Half, 2),
        0b10010 => Op::Store(Width::Word, upper, STACK, Place::Offset(byte as i32 * 4)),
        0b10011 => Op::Load(Width::Word, upper, STACK, Place::Offset(byte as i32 * 4)),
        0b10100 => Op::Near(upper, byte as i32 * 4),
        0b10101 => Op::Data(Alu::Add, Keep, upper, STACK, Operand::Number(byte * 4)),
        0b10110 | 0b10111 => others(code),
        0b11000 => Op::StoreMany(upper, byte as u16, false, true),
        0b11001 => Op::LoadMany(upper, byte as u16, false, byte >> upper & 1 == 0),
        0b11010 | 0b11011 => match bits(code, 8, 4) {
            14 | 15 => Op::Undefined,
            condition => Op::BranchIf(condition, signed(byte, 8) * 2),
        },
        0b11100 => Op::Branch(signed(u32::from(code & 0x7ff), 11) * 2),
        _ => Op::Undefined,
    }
}

fn combined(operation: u8, target: u8, source: u8) -> Op {
    use Flags::{Outside, Set};
    let operand = Operand::Register(source);
    let data = |alu| Op::Data(alu, Outside, target, target, operand);
    let by = |kind| Op::ShiftBy(kind, Outside, target, target, source);
    match operation {
        0x0 => data(Alu::And),
        0x1 => data(Alu::Exclusive),
        0x2 => by(Shift::Left),
        0x3 => by(Shift::Right),
        0x4 => by(Shift::Signed),
        0x5 => data(Alu::AddCarry),
        0x6 => data(Alu::SubtractCarry),
        0x7 => by(Shift::Round),
        0x8 => Op::Data(Alu::And, Set, NONE, target, operand),
        0x9 => Op::Data(Alu::Reverse, Outside, target, source, Operand::Number(0)),
        0xa => Op::Data(Alu::Subtract, Set, NONE, target, operand),
        0xb => Op::Data(Alu::Add, Set, NONE, target, operand),
        0xc => data(Alu::Or),
        0xd => Op::Multiply(Outside, target, source, target),
        0xe => data(Alu::Clear),
        _ => Op::Data(Alu::Not, Outside, target, NONE, operand),
    }
}

/// Stack, extension, hints and the like (A5.2.5).
fn others(code: u16) -> Op {
    use Flags::Keep;
    let (target, source) = (bits(code, 0, 3), bits(code, 3, 3));
    let listed = code & 0xff;
    match bits(code, 8, 4) {
        0x0 => {
            let alu = if bit(code, 7) {
                Alu::Subtract
            } else {
                Alu::Add
            };
            let by = Operand::Number(u32::from(code & 0x7f) * 4);
            Op::Data(alu, Keep, STACK, STACK, by)
        }
        0x1 | 0x3 | 0x9 | 0xb => {
            let offset = i32::from(bits(code, 9, 1)) << 6 | i32::from(bits(code, 3, 5)) << 1;
            Op::CompareBranch(bit(code, 11), target, offset)
        }
        0x2 => {
            let kinds = [
                Extension::SignedHalf,
                Extension::SignedByte,
                Extension::Half,
                Extension::Byte,
            ];
            let kind = kinds[usize::from(bits(code, 6, 2))];
            Op::Extend(kind, target, COUNTER, source, 0)
        }
        0x4 => Op::StoreMany(STACK, listed, true, true),
        0x5 => Op::StoreMany(STACK, listed | 1 << 14, true, true),
        0xc => Op::LoadMany(STACK, listed, false, true),
        0xd => Op::LoadMany(STACK, listed | 1 << 15, false, true),
        0x6 if bits(code, 5, 3) == 0b011 => Op::Mask(bit(code, 4), bit(code, 1), bit(code, 0)),
        0xa => match bits(code, 6, 2) {
            0 => Op::Turn(Turn::Bytes, target, source),
            1 => Op::Turn(Turn::HalfBytes, target, source),
            3 => Op::Turn(Turn::SignedHalf, target, source),
            _ => Op::Undefined,
        },
        0xe => Op::Breakpoint(listed as u8),
        0xf if code & 0xf != 0 => Op::IfThen(listed as u8),
        0xf => match bits(code, 4, 4) {
            2 => Op::WaitEvent,
            3 => Op::WaitInterrupt,
            4 => Op::SendEvent,
            _ => Op::Nothing,
        },
        _ => Op::Undefined,
    }
}

fn wide(first: u16, second: u16) -> Op {
    match (bits(first, 11, 2), bits(first, 4, 7), bit(second, 15)) {
        (0b01, kind, _) if kind & 0b110_0100 == 0 => many(first, second),
        (0b01, kind, _) if kind & 0b110_0100 == 0b000_0100 => pair(first, second),
        (0b01, kind, _) if kind & 0b110_0000 == 0b010_0000 => data_shifted(first, second),
        (0b01 | 0b11, kind, _) if kind & 0b100_0000 != 0 => coprocessor(first, second),
        (0b10, kind, false) if kind & 0b010_0000 == 0 => data_number(first, second),
        (0b10, _, false) => plain_number(first, second),
        (0b10, _, true) => branches(first, second),
        (0b11, kind, _) if kind & 0b111_0001 == 0 => single_store(first, second),
        (0b11, kind, _) if kind & 0b110_0001 == 0b000_0001 => single_load(first, second),
        (0b11, kind, _) if kind & 0b111_0000 == 0b010_0000 => data_register(first, second),
        (0b11, kind, _) if kind & 0b111_1000 == 0b011_0000 => product(first, second),
        (0b11, kind, _) if kind & 0b111_1000 == 0b011_1000 => long(first, second),
        _ => Op::Undefined,
    }
}

fn many(first: u16, second: u16) -> Op {
    let (base, goes_on) = (bits(first, 0, 4), bit(first, 5));
    let down = match bits(first, 7, 2) {
        0b01 => false,
        0b10 => true,
        _ => return Op::Undefined,
    };
    if bit(first, 4) {
        Op::LoadMany(base, second, down, goes_on)
    } else {
        Op::StoreMany(base, second, down, goes_on)
    }
}

/// Two words, exclusive accesses, tables (A5.3.6).
fn pair(first: u16, second: u16) -> Op {
    let base = bits(first, 0, 4);
    let (before, up, back, load) = (bit(first, 8), bit(first, 7), bit(first, 5), bit(first, 4));
    let (target, further) = (bits(second, 12, 4), bits(second, 8, 4));
    let offset = (second & 0xff) * 4;
    if before || back {
        let by = if up {
            i32::from(offset)
        } else {
            -i32::from(offset)
        };
        let place = match (before, back, base) {
            (true, false, COUNTER) => Place::Literal(by),
            (true, false, _) => Place::Offset(by),
            (true, true, _) => Place::Before(by),
            _ => Place::After(by),
        };
        return if load {
            Op::LoadPair(target, further, base, place)
        } else {
            Op::StorePair(target, further, base, place)
        };
    }
    let last = bits(second, 0, 4);
    match (up, load, bits(second, 4, 4)) {
        (false, false, _) => Op::StoreExclusive(Width::Word, further, target, base, offset),
        (false, true, _) => Op::LoadExclusive(Width::Word, target, base, offset),
        (true, false, 0b0100) => Op::StoreExclusive(Width::Byte, last, target, base, 0),
        (true, false, 0b0101) => Op::StoreExclusive(Width::Half, last, target, base, 0),
        (true, true, 0b0000) => Op::Table(false, base, last),
        (true, true, 0b0001) => Op::Table(true, base, last),
        (true, true, 0b0100) => Op::LoadExclusive(Width::Byte, target, base, 0),
        (true, true, 0b0101) => Op::LoadExclusive(Width::Half, target, base, 0),
        _ => Op::Undefined,
    }
}

/// The operation that a number and a shifted register share (A5.3.1, A5.3.11).
fn data(first: u16, target: u8, operand: Operand) -> Op {
    let set = bit(first, 4);
    let flags = if set { Flags::Set } else { Flags::Keep };
    let base = bits(first, 0, 4);
    let tests = set && target == COUNTER;
    let onto = if tests { NONE } else { target };
    let alu = match bits(first, 5, 4) {
        0b0000 => Alu::And,
        0b0001 => Alu::Clear,
        0b0010 if base == COUNTER => Alu::Move,
        0b0010 => Alu::Or,
        0b0011 if base == COUNTER => Alu::Not,
        0b0011 => Alu::OrNot,
        0b0100 => Alu::Exclusive,
        0b1000 => Alu::Add,
        0b1010 => Alu::AddCarry,
        0b1011 => Alu::SubtractCarry,
        0b1101 => Alu::Subtract,
        0b1110 => Alu::Reverse,
        _ => return Op::Undefined,
    };
    let base = if matches!(alu, Alu::Move | Alu::Not) {
        NONE
    } else {
        base
    };
    Op::Data(alu, flags, onto, base, operand)
}

fn data_shifted(first: u16, second: u16) -> Op {
    let by = bits(second, 12, 3) << 2 | bits(second, 6, 2);
    let (target, register) = (bits(second, 8, 4), bits(second, 0, 4));
    if bits(first, 5, 4) == 0b0110 {
        let top = bit(second, 5);
        let by = if top && by == 0 { 32 } else { by };
        return Op::Pack(top, target, bits(first, 0, 4), register, by);
    }
    data(first, target, shifted(register, bits(second, 4, 2), by))
}

/// Twelve bits of a number: i, imm3, imm8.
fn twelve(first: u16, second: u16) -> u32 {
    u32::from(bits(first, 10, 1)) << 11
        | u32::from(bits(second, 12, 3)) << 8
        | u32::from(second & 0xff)
}

fn data_number(first: u16, second: u16) -> Op {
    let code = twelve(first, second);
    let byte = code & 0xff;
    let operand = match code >> 8 {
        0 => Operand::Number(byte),
        1 => Operand::Number(byte << 16 | byte),
        2 => Operand::Number(byte << 24 | byte << 8),
        3 => Operand::Number(byte << 24 | byte << 16 | byte << 8 | byte),
        _ => Operand::Turned((0x80 | code & 0x7f).rotate_right(code >> 7)),
    };
    data(first, bits(second, 8, 4), operand)
}

/// Plain immediate numbers (A5.3.3).
fn plain_number(first: u16, second: u16) -> Op {
    let (base, target) = (bits(first, 0, 4), bits(second, 8, 4));
    let number = twelve(first, second);
    let low = bits(second, 12, 3) << 2 | bits(second, 6, 2);
    let last = bits(second, 0, 5);
    match bits(first, 4, 5) {
        0b00000 if base == COUNTER => Op::Near(target, number as i32),
        0b01010 if base == COUNTER => Op::Near(target, -(number as i32)),
        0b00000 => Op::Data(Alu::Add, Flags::Keep, target, base, Operand::Number(number)),
        0b01010 => Op::Data(
            Alu::Subtract,
            Flags::Keep,
            target,
            base,
            Operand::Number(number),
        ),
        0b00100 => {
            let value = u32::from(base) << 12 | number;
            Op::Data(Alu::Move, Flags::Keep, target, NONE, Operand::Number(value))
        }
        0b01100 => Op::MoveTop(target, u16::from(base) << 12 | number as u16),
        // Saturation of both halves.
        0b10010 | 0b11010 if low == 0 => Op::Undefined,
        kind @ (0b10000 | 0b10010 | 0b11000 | 0b11010) => {
            let signed = kind < 0b11000;
            let how = if kind & 0b10 == 0 {
                Shift::Left
            } else {
                Shift::Signed
            };
            Op::Saturate(signed, target, last + u8::from(signed), base, how, low)
        }
        0b10100 => Op::Extract(true, target, base, low, last + 1),
        0b11100 => Op::Extract(false, target, base, low, last + 1),
        0b10110 if last >= low => Op::Insert(target, base, low, last - low + 1),
        _ => Op::Undefined,
    }
}

/// Branches and control (A5.3.4).
fn branches(first: u16, second: u16) -> Op {
    let sign = u32::from(bits(first, 10, 1));
    let (j1, j2) = (
        u32::from(bits(second, 13, 1)),
        u32::from(bits(second, 11, 1)),
    );
    let low = u32::from(second & 0x7ff) << 1;
    let far = || {
        let upper = (1 ^ j1 ^ sign) << 23 | (1 ^ j2 ^ sign) << 22;
        signed(
            sign << 24 | upper | u32::from(first & 0x3ff) << 12 | low,
            25,
        )
    };
    match (bit(second, 14), bit(second, 12)) {
        (true, true) => return Op::Call(far()),
        (false, true) => return Op::Branch(far()),
        (true, false) => return Op::Undefined,
        _ => {}
    }
    let condition = bits(first, 6, 4);
    if condition < 14 {
        let offset = sign << 20 | j2 << 19 | j1 << 18 | u32::from(first & 0x3f) << 12 | low;
        return Op::BranchIf(condition, signed(offset, 21));
    }
    match bits(first, 4, 7) {
        0b011_1000 | 0b011_1001 => Op::ToSpecial(bits(first, 0, 4), second as u8),
        0b011_1010 if bits(second, 8, 3) == 0 => match second & 0xff {
            2 => Op::WaitEvent,
            3 => Op::WaitInterrupt,
            4 => Op::SendEvent,
            _ => Op::Nothing,
        },
        0b011_1011 => match bits(second, 4, 4) {
            2 => Op::ClearExclusive,
            4..=6 => Op::Barrier,
            _ => Op::Undefined,
        },
        0b011_1110 | 0b011_1111 => Op::FromSpecial(bits(second, 8, 4), second as u8),
        _ => Op::Undefined,
    }
}

/// Address of a single access (A7.7.43 and similar).
fn place(first: u16, second: u16) -> Option<Place> {
    let long = i32::from(second & 0xfff);
    let short = i32::from(second & 0xff);
    if bits(first, 0, 4) == COUNTER {
        return Some(Place::Literal(if bit(first, 7) { long } else { -long }));
    }
    if bit(first, 7) {
        return Some(Place::Offset(long));
    }
    if !bit(second, 11) {
        let indexed = Place::Indexed(bits(second, 0, 4), bits(second, 4, 2));
        return (bits(second, 6, 5) == 0).then_some(indexed);
    }
    let by = if bit(second, 9) { short } else { -short };
    match (bit(second, 10), bit(second, 8)) {
        (true, false) => Some(Place::Offset(by)),
        (true, true) => Some(Place::Before(by)),
        (false, true) => Some(Place::After(by)),
        _ => None,
    }
}

fn single_store(first: u16, second: u16) -> Op {
    let width = match bits(first, 5, 2) {
        0 => Width::Byte,
        1 => Width::Half,
        2 => Width::Word,
        _ => return Op::Undefined,
    };
    match place(first, second) {
        Some(Place::Literal(_)) | None => Op::Undefined,
        Some(place) => Op::Store(width, bits(second, 12, 4), bits(first, 0, 4), place),
    }
}

fn single_load(first: u16, second: u16) -> Op {
    let target = bits(second, 12, 4);
    let width = match (bits(first, 5, 2), bit(first, 8)) {
        (0, false) => Width::Byte,
        (0, true) => Width::SignedByte,
        (1, false) => Width::Half,
        (1, true) => Width::SignedHalf,
        (2, false) => Width::Word,
        _ => return Op::Undefined,
    };
    if target == COUNTER && width != Width::Word {
        // A hint to fetch ahead.
        return Op::Nothing;
    }
    match place(first, second) {
        None => Op::Undefined,
        Some(place) => Op::Load(width, target, bits(first, 0, 4), place),
    }
}

/// Registers only (A5.3.12 to A5.3.15).
fn data_register(first: u16, second: u16) -> Op {
    let (n, d, m) = (bits(first, 0, 4), bits(second, 8, 4), bits(second, 0, 4));
    let (kind, how) = (bits(first, 4, 4), bits(second, 4, 4));
    if bits(second, 12, 4) != 15 {
        return Op::Undefined;
    }
    match (kind, how) {
        (0..=7, 0) => {
            let flags = if bit(first, 4) {
                Flags::Set
            } else {
                Flags::Keep
            };
            Op::ShiftBy(shift(kind >> 1), flags, d, n, m)
        }
        (0 | 1 | 3..=5, 8..) => {
            let extension = match kind {
                0 => Extension::SignedHalf,
                1 => Extension::Half,
                3 => Extension::Bytes,
                4 => Extension::SignedByte,
                _ => Extension::Byte,
            };
            Op::Extend(extension, d, n, m, bits(second, 4, 2) * 8)
        }
        (8 | 9 | 12 | 13, 5) => Op::SaturateLanes(kind & 1 == 0, kind & 4 != 0, d, n, m),
        (8, 8 | 10) => Op::Saturating(how == 10, d, n, m),
        (9, 8) => Op::Turn(Turn::Bytes, d, m),
        (9, 9) => Op::Turn(Turn::HalfBytes, d, m),
        (9, 10) => Op::Turn(Turn::Bits, d, m),
        (9, 11) => Op::Turn(Turn::SignedHalf, d, m),
        (11, 8) => Op::Turn(Turn::Zeros, d, m),
        _ => Op::Undefined,
    }
}

fn product(first: u16, second: u16) -> Op {
    let (n, a, d, m) = (
        bits(first, 0, 4),
        bits(second, 12, 4),
        bits(second, 8, 4),
        bits(second, 0, 4),
    );
    let (one, other) = (bit(second, 5), bit(second, 4));
    let kind = match bits(first, 4, 3) {
        0 if other => return Op::MultiplySubtract(d, n, m, a),
        0 if a == COUNTER => return Op::Multiply(Flags::Keep, d, n, m),
        0 => return Op::MultiplyAdd(d, n, m, a),
        1 => Product::Halves(one, other),
        5 => Product::Top(other),
        _ => return Op::Undefined,
    };
    Op::Product(kind, d, n, m, a)
}

fn long(first: u16, second: u16) -> Op {
    let (n, low, high, m) = (
        bits(first, 0, 4),
        bits(second, 12, 4),
        bits(second, 8, 4),
        bits(second, 0, 4),
    );
    let kind = match (bits(first, 4, 3), bits(second, 4, 4)) {
        (0, 0) => Long::Signed,
        (1, 15) => return Op::Divide(true, high, n, m),
        (2, 0) => Long::Unsigned,
        (3, 15) => return Op::Divide(false, high, n, m),
        (4, 0) => Long::SignedAdd,
        (6, 0) => Long::UnsignedAdd,
        (6, 6) => Long::AddBoth,
        _ => return Op::Undefined,
    };
    Op::Long(kind, low, high, n, m)
}

/// Numbers of registers in single precision: field, and one bit below it.
fn register(field: u8, low: bool) -> u8 {
    field << 1 | u8::from(low)
}

/// The floating-point unit (A6.4 to A6.7).
fn coprocessor(first: u16, second: u16) -> Op {
    let double = match bits(second, 8, 4) {
        0b1010 => false,
        0b1011 => true,
        _ => return Op::Undefined,
    };
    match (bits(first, 8, 4), bit(second, 4)) {
        (0b1110, false) if !double && !bit(first, 12) => single(first, second),
        (0b1110, true) => single_transfer(first, second, double),
        (0b1100, true) if bits(first, 5, 3) == 0b010 => {
            let to_core = bit(first, 4);
            let m = if double {
                (bits(second, 5, 1) << 4 | bits(second, 0, 4)) << 1
            } else {
                register(bits(second, 0, 4), bit(second, 5))
            };
            if m > 30 {
                return Op::Undefined;
            }
            Op::SingleMovePair(to_core, bits(second, 12, 4), bits(first, 0, 4), m)
        }
        (0b1100 | 0b1101, _) => single_memory(first, second, double),
        _ => Op::Undefined,
    }
}

fn single_memory(first: u16, second: u16, double: bool) -> Op {
    let (before, up, back, load) = (bit(first, 8), bit(first, 7), bit(first, 5), bit(first, 4));
    let (base, field, number) = (bits(first, 0, 4), bits(second, 12, 4), second as u8);
    let d = if double {
        (bits(first, 6, 1) << 4 | field) << 1
    } else {
        register(field, bit(first, 6))
    };
    if before && !back {
        let offset = i32::from(number) * 4;
        let offset = if up { offset } else { -offset };
        let count = 1 + u8::from(double);
        if d + count > 32 {
            return Op::Undefined;
        }
        return if load {
            Op::SingleLoad(d, base, offset, count)
        } else {
            Op::SingleStore(d, base, offset, count)
        };
    }
    if before == up || u16::from(d) + u16::from(number) > 32 || number == 0 {
        return Op::Undefined;
    }
    if load {
        Op::SingleLoadMany(d, base, number, before, back)
    } else {
        Op::SingleStoreMany(d, base, number, before, back)
    }
}

fn single_transfer(first: u16, second: u16, double: bool) -> Op {
    let (to_core, kind) = (bit(first, 4), bits(first, 5, 3));
    let t = bits(second, 12, 4);
    match (double, kind) {
        (false, 0) => Op::SingleMove(to_core, t, register(bits(first, 0, 4), bit(second, 7))),
        (false, 7) if bits(first, 0, 4) == 1 && to_core => Op::FromStatus(t),
        (false, 7) if bits(first, 0, 4) == 1 => Op::ToStatus(t),
        (true, 0 | 1) => {
            let d = bits(second, 7, 1) << 4 | bits(first, 0, 4);
            let s = d << 1 | bits(first, 5, 1);
            if s > 31 {
                return Op::Undefined;
            }
            Op::SingleMove(to_core, t, s)
        }
        _ => Op::Undefined,
    }
}

fn single(first: u16, second: u16) -> Op {
    let d = register(bits(second, 12, 4), bit(first, 6));
    let n = register(bits(first, 0, 4), bit(second, 7));
    let m = register(bits(second, 0, 4), bit(second, 5));
    let other = bit(second, 6);
    let pick = |one, two| Op::Single(if other { two } else { one }, d, n, m);
    match (bit(first, 7), bits(first, 4, 2)) {
        (false, 0) => pick(Single::MultiplyAdd, Single::MultiplySubtract),
        (false, 1) => pick(
            Single::NegativeMultiplySubtract,
            Single::NegativeMultiplyAdd,
        ),
        (false, 2) => pick(Single::Multiply, Single::NegativeMultiply),
        (false, _) => pick(Single::Add, Single::Subtract),
        (true, 0) if !other => Op::Single(Single::Divide, d, n, m),
        (true, 3) if !other => {
            let byte = u32::from(bits(first, 0, 4)) << 4 | u32::from(second & 0xf);
            let exponent = if byte & 0x40 == 0 {
                0x4000_0000
            } else {
                0x3e00_0000
            };
            Op::SingleNumber(d, (byte & 0x80) << 24 | exponent | (byte & 0x3f) << 19)
        }
        (true, 3) => {
            let upper = bit(second, 7);
            let unary = match (bits(first, 0, 4), upper) {
                (0, false) => Unary::Move,
                (0, true) => Unary::Absolute,
                (1, false) => Unary::Negate,
                (1, true) => Unary::Root,
                (4, _) => return Op::SingleCompare(d, m),
                (5, _) => return Op::SingleCompare(d, 32),
                (8, true) => Unary::FromSigned,
                (8, false) => Unary::FromUnsigned,
                (12, true) => Unary::ToUnsigned,
                (13, true) => Unary::ToSigned,
                _ => return Op::Undefined,
            };
            Op::Unary(unary, d, m)
        }
        _ => Op::Undefined,
    }
}
