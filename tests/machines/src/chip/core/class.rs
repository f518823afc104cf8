//! Classes of instructions, for counting their cost.

use super::decode::decode;
use super::op::{Op, Single, Unary};

/// Class of an instruction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Class {
    /// Integer arithmetic, logic, shifts and moves.
    Integer,
    /// Integer products.
    Multiply,
    /// Integer quotients.
    Divide,
    /// Single precision but for quotients, roots and moves.
    Float,
    /// Quotients and roots in single precision.
    FloatDivide,
    /// Moves of single precision, constants among them, and between both kinds of registers.
    FloatMove,
    /// Loads.
    Load,
    /// Stores.
    Store,
    /// Branches, and instructions that make others conditional.
    Branch,
    /// All other instructions.
    Other,
}

impl Class {
    /// All of them, with their names.
    pub const ALL: [(Self, &'static str); 10] = [
        (Self::Integer, "integer"),
        (Self::Multiply, "multiply"),
        (Self::Divide, "divide"),
        (Self::Float, "float"),
        (Self::FloatDivide, "float divide, root"),
        (Self::FloatMove, "float move"),
        (Self::Load, "load"),
        (Self::Store, "store"),
        (Self::Branch, "branch"),
        (Self::Other, "other"),
    ];

    /// Class of an instruction of one or two halfwords.
    pub fn of(first: u16, second: u16) -> Self {
        match decode(first, second) {
            Op::Data(..)
            | Op::ShiftBy(..)
            | Op::MoveTop(..)
            | Op::Near(..)
            | Op::Extend(..)
            | Op::Saturate(..)
            | Op::SaturateLanes(..)
            | Op::Saturating(..)
            | Op::Pack(..)
            | Op::Turn(..)
            | Op::Insert(..)
            | Op::Extract(..) => Self::Integer,
            Op::Multiply(..)
            | Op::MultiplyAdd(..)
            | Op::MultiplySubtract(..)
            | Op::Product(..)
            | Op::Long(..) => Self::Multiply,
            Op::Divide(..) => Self::Divide,
            Op::Single(Single::Divide, ..) | Op::Unary(Unary::Root, ..) => Self::FloatDivide,
            Op::Unary(Unary::Move, ..)
            | Op::SingleNumber(..)
            | Op::SingleMove(..)
            | Op::SingleMovePair(..)
            | Op::FromStatus(..)
            | Op::ToStatus(..) => Self::FloatMove,
            Op::Single(..) | Op::Unary(..) | Op::SingleCompare(..) => Self::Float,
            Op::Load(..)
            | Op::LoadPair(..)
            | Op::LoadMany(..)
            | Op::LoadExclusive(..)
            | Op::SingleLoad(..)
            | Op::SingleLoadMany(..) => Self::Load,
            Op::Store(..)
            | Op::StorePair(..)
            | Op::StoreMany(..)
            | Op::StoreExclusive(..)
            | Op::SingleStore(..)
            | Op::SingleStoreMany(..) => Self::Store,
            Op::Branch(..)
            | Op::BranchIf(..)
            | Op::Call(..)
            | Op::Exchange(..)
            | Op::CallRegister(..)
            | Op::CompareBranch(..)
            | Op::Table(..)
            | Op::IfThen(..) => Self::Branch,
            _ => Self::Other,
        }
    }
}
