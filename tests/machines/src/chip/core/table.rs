//! Functions of the instructions by the upper twelve bits of their first halfword, in which the
//! compiler has decoded these bits.

use super::{Board, COUNTER, Core, Cycles};

type Run = fn(&mut Core, u32, &mut Board) -> Cycles;

/// Executes an instruction of one halfword with this upper byte.
fn narrow<const UPPER: u16>(core: &mut Core, code: u32, bus: &mut Board) -> Cycles {
    core.r[COUNTER] = core.r[COUNTER].wrapping_add(2);
    core.narrow(UPPER << 8 | code as u16 & 0xff, bus)
}

/// Executes an instruction of two halfwords with these upper twelve bits.
fn wide<const UPPER: u16>(core: &mut Core, code: u32, bus: &mut Board) -> Cycles {
    core.r[COUNTER] = core.r[COUNTER].wrapping_add(4);
    core.wide(UPPER << 4 | code as u16 & 0xf, (code >> 16) as u16, bus)
}

macro_rules! row {
    ($run:ident, $row:expr, $($column:literal)*) => {
        [$($run::<{ 16 * $row + $column }>),*]
    };
}

macro_rules! rows {
    ($run:ident, $from:literal, $($row:literal)*) => {
        [$(row!($run, $from + $row, 0 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15)),*]
    };
}

const NARROW: [[Run; 16]; 16] = rows!(narrow, 0, 0 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15);

const WIDE: [[Run; 16]; 24] =
    rows!(wide, 0xe8, 0 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16 17 18 19 20 21 22 23);

pub(super) static RUN: [Run; 4096] = {
    let mut run = [NARROW[0][0]; 4096];
    let mut upper = 0;
    while upper < run.len() {
        run[upper] = match upper.checked_sub(0xe80) {
            None => NARROW[upper >> 8][upper >> 4 & 0xf],
            Some(wide) => WIDE[wide >> 4][wide & 0xf],
        };
        upper += 1;
    }
    run
};
