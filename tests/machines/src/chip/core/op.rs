//! Decoded instructions (ARM DDI 0403E, chapter A7).

/// Whether an instruction sets the condition flags.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Flags {
    Keep,
    Set,
    /// Outside an IT block.
    Outside,
}

/// Kinds of shift.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shift {
    Left,
    Right,
    /// Right with the sign.
    Signed,
    /// Rotation to the right; by 0: by one bit through the carry.
    Round,
}

/// Second operand of a data instruction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Operand {
    /// A number that leaves the carry unchanged.
    Number(u32),
    /// A number whose top bit sets the carry.
    Turned(u32),
    Register(u8),
    /// A shifted register.
    Shifted(u8, Shift, u8),
}

/// Arithmetic and logic.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Alu {
    /// And; without a target: a test.
    And,
    Clear,
    Or,
    OrNot,
    /// Exclusive or; without a target: a test.
    Exclusive,
    Move,
    Not,
    /// Sum; without a target: a comparison.
    Add,
    /// Sum with carry.
    AddCarry,
    /// Difference with carry.
    SubtractCarry,
    /// Difference; without a target: a comparison.
    Subtract,
    /// Difference the other way round.
    Reverse,
}

/// Width and sign of an access.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Width {
    Word,
    Half,
    Byte,
    SignedHalf,
    SignedByte,
}

/// Address of an access.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Place {
    /// At an offset from the base.
    Offset(i32),
    /// At an offset from the base, which is set to that address.
    Before(i32),
    /// At the base, which is then increased by the offset.
    After(i32),
    /// At a register, shifted left, from the base.
    Indexed(u8, u8),
    /// At an offset from the instruction.
    Literal(i32),
}

/// Bytes and halves of a register.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Extension {
    SignedByte,
    Byte,
    SignedHalf,
    Half,
    Bytes,
}

/// Products beyond the plain one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Product {
    /// Of halves: of the first's upper, of the second's upper.
    Halves(bool, bool),
    /// Upper half of the product of words; rounded.
    Top(bool),
}

/// Products of 64 bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Long {
    Unsigned,
    Signed,
    UnsignedAdd,
    SignedAdd,
    /// Without sign, both halves of the target added.
    AddBoth,
}

/// Changes of a register's bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Turn {
    Bytes,
    HalfBytes,
    Bits,
    /// Bytes of the lower half, with its sign.
    SignedHalf,
    /// Zeros at the top are counted.
    Zeros,
}

/// Operations in single precision (A7.5).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Single {
    Add,
    Subtract,
    Multiply,
    NegativeMultiply,
    Divide,
    /// Product rounded, then added.
    MultiplyAdd,
    /// Product rounded, then subtracted.
    MultiplySubtract,
    /// Product less the target.
    NegativeMultiplySubtract,
    /// Negative product less the target.
    NegativeMultiplyAdd,
}

/// Operations on one number in single precision.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unary {
    Move,
    Absolute,
    Negate,
    Root,
    FromSigned,
    FromUnsigned,
    /// To an integer with sign, towards zero.
    ToSigned,
    ToUnsigned,
}

/// One instruction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Op {
    Undefined,
    /// `d = n op operand`; `d` of 16 is none.
    Data(Alu, Flags, u8, u8, Operand),
    /// `d = n` shifted by `m`.
    ShiftBy(Shift, Flags, u8, u8, u8),
    /// Upper half of `d`.
    MoveTop(u8, u16),
    /// Address relative to the instruction.
    Near(u8, i32),
    /// `d = n m`.
    Multiply(Flags, u8, u8, u8),
    /// `d = a + n m`: d, n, m, a.
    MultiplyAdd(u8, u8, u8, u8),
    /// `d = a - n m`.
    MultiplySubtract(u8, u8, u8, u8),
    /// d, n, m, a (15: none).
    Product(Product, u8, u8, u8, u8),
    /// low, high, n, m.
    Long(Long, u8, u8, u8, u8),
    /// Signed, d, n, m.
    Divide(bool, u8, u8, u8),
    /// d, n (15: none), m, turned right by.
    Extend(Extension, u8, u8, u8, u8),
    /// Signed, d, bits, n, shift, by.
    Saturate(bool, u8, u8, u8, Shift, u8),
    /// Saturating sum of bytes or halves without sign: bytes, subtracted, d, n, m.
    SaturateLanes(bool, bool, u8, u8, u8),
    /// Saturating sum of words with sign: subtracted, d, n, m.
    Saturating(bool, u8, u8, u8),
    /// d, n, m, by; true: upper half from the second.
    Pack(bool, u8, u8, u8, u8),
    /// d, m.
    Turn(Turn, u8, u8),
    /// d, n (15: zeros), lowest bit, bits.
    Insert(u8, u8, u8, u8),
    /// Signed, d, n, lowest bit, bits.
    Extract(bool, u8, u8, u8, u8),
    /// Target, base.
    Load(Width, u8, u8, Place),
    /// Source, base.
    Store(Width, u8, u8, Place),
    /// Two words: first, second, base.
    LoadPair(u8, u8, u8, Place),
    /// Two words: first, second, base.
    StorePair(u8, u8, u8, Place),
    /// Base, registers, downwards, base updated.
    LoadMany(u8, u16, bool, bool),
    /// Base, registers, downwards, base updated.
    StoreMany(u8, u16, bool, bool),
    /// Target, base, offset.
    LoadExclusive(Width, u8, u8, u16),
    /// Whether it failed, source, base, offset.
    StoreExclusive(Width, u8, u8, u8, u16),
    ClearExclusive,
    Branch(i32),
    BranchIf(u8, i32),
    Call(i32),
    Exchange(u8),
    CallRegister(u8),
    /// Branch where a register is (not) zero.
    CompareBranch(bool, u8, i32),
    /// Branch by a table of halves or bytes.
    Table(bool, u8, u8),
    IfThen(u8),
    Nothing,
    Barrier,
    WaitEvent,
    WaitInterrupt,
    SendEvent,
    Breakpoint(u8),
    /// Sets (`true`) PRIMASK, FAULTMASK.
    Mask(bool, bool, bool),
    /// From a special register: d, which.
    FromSpecial(u8, u8),
    /// To it: n, which.
    ToSpecial(u8, u8),
    /// Single precision: d, n, m.
    Single(Single, u8, u8, u8),
    /// Single precision: d, m.
    Unary(Unary, u8, u8),
    SingleNumber(u8, u32),
    /// d, m (32: zero).
    SingleCompare(u8, u8),
    /// Whether to the core: t, n.
    SingleMove(bool, u8, u8),
    /// Two of them: whether to the core, t, t2, m.
    SingleMovePair(bool, u8, u8, u8),
    /// From FPSCR: t (15: flags).
    FromStatus(u8),
    ToStatus(u8),
    /// d, base, offset, number.
    SingleLoad(u8, u8, i32, u8),
    /// d, base, offset, number.
    SingleStore(u8, u8, i32, u8),
    /// d, base, number, downwards, base updated.
    SingleLoadMany(u8, u8, u8, bool, bool),
    /// d, base, number, downwards, base updated.
    SingleStoreMany(u8, u8, u8, bool, bool),
}
