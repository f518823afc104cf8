//! Tests of the core on short programs in machine code.

use super::*;

struct Words(Vec<u8>);

impl Bus for Words {
    fn load(&mut self, address: u32, size: u32) -> Option<u32> {
        let bytes = self.0.get(address as usize..(address + size) as usize)?;
        Some(
            bytes
                .iter()
                .rev()
                .fold(0, |word, byte| word << 8 | u32::from(*byte)),
        )
    }

    fn store(&mut self, address: u32, size: u32, value: u32) -> Option<()> {
        let place = self
            .0
            .get_mut(address as usize..(address + size) as usize)?;
        place.copy_from_slice(&value.to_le_bytes()[..size as usize]);
        Some(())
    }
}

/// Runs code at 0, its stack at 256, up to its breakpoint.
fn run(code: &[u16], registers: &[u32]) -> Core {
    let mut bus = Words(vec![0; 256]);
    for (place, half) in bus.0.chunks_exact_mut(2).zip(code) {
        place.copy_from_slice(&half.to_le_bytes());
    }
    let mut core = Core::default();
    core.r[..registers.len()].copy_from_slice(registers);
    core.r[STACK] = 256;
    for _ in 0..1000 {
        if let Err(stop) = core.step(&mut Code::default(), &mut bus) {
            assert_eq!(stop, Fault::Breakpoint, "at {:#x}", core.r[COUNTER]);
            return core;
        }
    }
    panic!("no end");
}

#[test]
fn a_loop_with_a_call_gives_the_sum_of_squares() {
    // r1 = sum of r0^2 .. 1^2
    let code = [
        0x2100, // movs r1, #0
        0xf000, 0xf803, // bl square
        0x3801, // subs r0, #1
        0xd1fb, // bne -> bl
        0xbe00, // bkpt
        0xb510, // square: push {r4, lr}
        0x0004, // movs r4, r0
        0x4344, // muls r4, r0
        0x1909, // adds r1, r1, r4
        0xbd10, // pop {r4, pc}
    ];
    let core = run(&code, &[7, 0, 0, 0, 0x55]);
    assert_eq!(core.r[1], 140);
    assert_eq!((core.r[4], core.r[STACK]), (0x55, 256));
}

#[test]
fn flags_follow_the_manual_at_the_edges() {
    // (r0, r1) compared: eq, hs, mi, vs, hi, ge, gt
    let edges = [0, 1, 0x7fff_ffff, 0x8000_0000, 0xffff_ffff];
    for first in edges {
        for second in edges {
            let core = run(&[0x4288, 0xbe00], &[first, second]);
            let (left, right) = (first as i32, second as i32);
            let (difference, overflow) = left.overflowing_sub(right);
            let expected = [
                first == second,
                first >= second,
                difference < 0,
                overflow,
                first > second,
                left >= right,
                left > right,
            ];
            for (condition, expected) in (0_u8..).zip(expected) {
                let held = [core.holds(2 * condition), core.holds(2 * condition + 1)];
                assert_eq!(held, [expected, !expected]);
            }
        }
    }
}

#[test]
fn shifts_have_their_carries() {
    // lsrs r0, r0, #32; asrs; lsls #1
    for (code, value, result, carry) in [
        (0x0800, 0x8000_0000_u32, 0, true),
        (0x1000, 0x8000_0000, 0xffff_ffff, true),
        (0x0040, 0x8000_0001, 2, true),
        (0x0880, 0b110, 1, true),
        (0x0880, 0b101, 1, false),
    ] {
        let core = run(&[code, 0xbe00], &[value]);
        assert_eq!((core.r[0], core.carry), (result, carry), "{code:#x}");
    }
}

#[test]
fn what_is_no_memory_and_no_such_instruction_is_a_fault() {
    for (code, fault) in [
        (0x6808_u16, Fault::Access(0xffff_0000)),
        (0xde00, Fault::Undefined),
    ] {
        let mut bus = Words(vec![0; 64]);
        bus.0[..2].copy_from_slice(&code.to_le_bytes());
        let mut core = Core::default();
        core.r[1] = 0xffff_0000;
        assert_eq!(
            core.step(&mut Code::default(), &mut bus),
            Err(fault),
            "{code:#x}"
        );
        assert_eq!(core.r[COUNTER], 0);
    }
}

#[test]
fn an_it_block_executes_what_holds_and_sets_no_flags() {
    let code = [
        0x2800, // cmp r0, #0
        0xbf0c, // ite eq
        0x2101, // moveq r1, #1
        0x2102, // movne r1, #2
        0xd000, // beq +0: skips the next
        0x2203, // movs r2, #3
        0xbe00,
    ];
    assert_eq!(run(&code, &[0, 0, 7]).r[1..3], [1, 7]);
    assert_eq!(run(&code, &[5, 0, 7]).r[1..3], [2, 3]);
}

#[test]
fn an_exception_comes_back_to_where_it_was() {
    // bx lr at 0x40; the thread increments r0.
    let mut bus = Words(vec![0; 1024]);
    for at in (0..0x20).step_by(2) {
        bus.store(at, 2, 0x3001).unwrap();
    }
    bus.store(0x40, 2, 0x3101).unwrap();
    bus.store(0x42, 2, 0x4770).unwrap();
    let mut core = Core {
        float: true,
        ..Core::default()
    };
    core.r[STACK] = 1024 - 4;
    for float in [false, true] {
        core.r[..2].fill(0);
        core.r[COUNTER] = 0;
        if float {
            core.touch_float().unwrap();
            core.s[3] = 0x1234;
        }
        core.step(&mut Code::default(), &mut bus).unwrap();
        let (_, taken) = core.enter(&mut bus, 15, 0x41);
        assert!(taken && core.exception == 15);
        assert_eq!(core.r[LINK], if float { 0xffff_ffe9 } else { 0xffff_fff9 });
        assert_eq!(core.r[STACK] % 8, 0);
        core.s[3] = 0;
        core.step(&mut Code::default(), &mut bus).unwrap();
        core.step(&mut Code::default(), &mut bus).unwrap();
        let link = core.returning.take().unwrap();
        core.leave(&mut bus, link).unwrap();
        assert_eq!((core.r[0], core.r[COUNTER], core.r[STACK]), (1, 2, 1020));
        assert_eq!(core.s[3], if float { 0x1234 } else { 0 });
        assert_eq!(core.exception, 0);
    }
}
