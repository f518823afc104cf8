//! Decoded instructions (ARM DDI 0403E, chapter A7).

/// Whether an instruction sets the condition flags.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Flags {
    /// Never.
    Keep,
    /// Always.
    Set,
    /// Outside an IT block.
    Outside,
}

/// Kinds of shift.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shift {
    /// Left.
    Left,
    /// Right.
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
    /// A register.
    Register(u8),
    /// A shifted register.
    Shifted(u8, Shift, u8),
}

/// Arithmetic and logic.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Alu {
    /// And; without a target: a test.
    And,
    /// And not.
    Clear,
    /// Or.
    Or,
    /// Or not.
    OrNot,
    /// Exclusive or; without a target: a test.
    Exclusive,
    /// The operand.
    Move,
    /// Its complement.
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
    /// 32 bits.
    Word,
    /// 16 bits.
    Half,
    /// 8 bits.
    Byte,
    /// 16 bits with their sign.
    SignedHalf,
    /// 8 bits with their sign.
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
    /// Signed byte.
    SignedByte,
    /// Byte.
    Byte,
    /// Signed half.
    SignedHalf,
    /// Half.
    Half,
    /// Two signed bytes.
    SignedBytes,
    /// Two bytes.
    Bytes,
}

/// Handling of an overflow in a lane.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lane {
    /// It wraps, and sets the flags GE.
    Wraps,
    /// It saturates.
    Saturates,
    /// It is halved.
    Halved,
}

/// Which lanes a parallel sum has, and which of them are subtracted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lanes {
    /// Two sums.
    Add16,
    /// Exchanged: upper sum, lower difference.
    AddSubtract,
    /// Exchanged: upper difference, lower sum.
    SubtractAdd,
    /// Two differences.
    Subtract16,
    /// Four sums.
    Add8,
    /// Four differences.
    Subtract8,
}

/// Products beyond the plain one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Product {
    /// Of halves: of the first's upper, of the second's upper.
    Halves(bool, bool),
    /// Of a word and a half, its upper 32 bits.
    WordHalf(bool),
    /// Sum of two products of halves; the second's exchanged.
    Dual(bool),
    /// Difference of two.
    DualSubtract(bool),
    /// Upper half of the product of words; rounded.
    Top(bool),
    /// The same, subtracted.
    TopSubtract(bool),
    /// Sum of absolute differences of bytes.
    Differences,
}

/// Products of 64 bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Long {
    /// Without sign.
    Unsigned,
    /// With sign.
    Signed,
    /// Without sign, added to the target.
    UnsignedAdd,
    /// With sign, added.
    SignedAdd,
    /// Without sign, both halves of the target added.
    AddBoth,
    /// Of halves, added.
    Halves(bool, bool),
    /// Two products of halves, added.
    Dual(bool),
    /// Their difference, added.
    DualSubtract(bool),
}

/// Changes of a register's bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Turn {
    /// Bytes of the word.
    Bytes,
    /// Bytes of each half.
    HalfBytes,
    /// Bits of the word.
    Bits,
    /// Bytes of the lower half, with its sign.
    SignedHalf,
    /// Zeros at the top are counted.
    Zeros,
}

/// Operations in single precision (A7.5).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Single {
    /// Sum.
    Add,
    /// Difference.
    Subtract,
    /// Product.
    Multiply,
    /// Negative product.
    NegativeMultiply,
    /// Quotient.
    Divide,
    /// Product rounded, then added.
    MultiplyAdd,
    /// Product rounded, then subtracted.
    MultiplySubtract,
    /// Product less the target.
    NegativeMultiplySubtract,
    /// Negative product less the target.
    NegativeMultiplyAdd,
    /// One rounding.
    Fused,
    /// One rounding, product subtracted.
    FusedSubtract,
    /// One rounding, target subtracted.
    FusedNegativeSubtract,
    /// One rounding, both negative.
    FusedNegativeAdd,
}

/// Operations on one number in single precision.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unary {
    /// The number.
    Move,
    /// Without its sign.
    Absolute,
    /// With the other sign.
    Negate,
    /// Its root.
    Root,
    /// From an integer with sign.
    FromSigned,
    /// From an integer without.
    FromUnsigned,
    /// To an integer with sign, towards zero.
    ToSigned,
    /// To an integer without.
    ToUnsigned,
    /// To the nearest integer with sign.
    RoundSigned,
    /// To the nearest without.
    RoundUnsigned,
}

/// One instruction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Op {
    /// No valid instruction.
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
    /// Both halves: signed, d, bits, n.
    SaturateHalves(bool, u8, u8, u8),
    /// Signed, d, n, m.
    Parallel(Lanes, Lane, bool, u8, u8, u8),
    /// Saturating: doubled, subtracted, d, n, m.
    Saturating(bool, bool, u8, u8, u8),
    /// By the flags GE: d, n, m.
    Select(u8, u8, u8),
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
    /// Clears the exclusive access.
    ClearExclusive,
    /// Relative branch.
    Branch(i32),
    /// Relative branch under a condition.
    BranchIf(u8, i32),
    /// Relative call.
    Call(i32),
    /// Branch to a register.
    Exchange(u8),
    /// Call of a register.
    CallRegister(u8),
    /// Branch where a register is (not) zero.
    CompareBranch(bool, u8, i32),
    /// Branch by a table of halves or bytes.
    Table(bool, u8, u8),
    /// Makes the following instructions conditional.
    IfThen(u8),
    /// No operation.
    Nothing,
    /// Barrier.
    Barrier,
    /// Waits for an event.
    WaitEvent,
    /// Waits for an interrupt.
    WaitInterrupt,
    /// Sends an event.
    SendEvent,
    /// Stops for a debugger.
    Breakpoint(u8),
    /// Calls the supervisor.
    Supervisor(u8),
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
    /// Fixed point: d, to fixed, signed, of 16 bits, bits behind the point.
    Fixed(u8, bool, bool, bool, u8),
    /// A constant.
    SingleNumber(u8, u32),
    /// d, m (32: zero).
    SingleCompare(u8, u8),
    /// Whether to the core: t, n.
    SingleMove(bool, u8, u8),
    /// Two of them: whether to the core, t, t2, m.
    SingleMovePair(bool, u8, u8, u8),
    /// From FPSCR: t (15: flags).
    FromStatus(u8),
    /// To FPSCR.
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
