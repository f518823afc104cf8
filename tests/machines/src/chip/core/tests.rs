//! Faults and exceptions of the core, which QEMU does not show instruction by instruction.

use super::*;

#[test]
fn missing_memory_and_undefined_instructions_fault() {
    for (code, fault) in [
        (0x6808_u16, Fault::Access(0x1000_0000)),
        (0xde00, Fault::Undefined),
    ] {
        let mut bus = Flat::new(0, code.to_le_bytes().repeat(32));
        let mut core = Core::default();
        core.r[1] = 0x1000_0000;
        assert_eq!(
            core.step(&mut Code::default(), &mut bus),
            Err(fault),
            "{code:#x}"
        );
        assert_eq!(core.r[COUNTER], 0);
    }
}

#[test]
fn an_exception_comes_back_to_where_it_was() {
    // bx lr at 0x40; the thread increments r0.
    let mut bus = Flat::new(0, vec![0; 1024]);
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
