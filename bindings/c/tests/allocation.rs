//! Signal path and controller allocate nothing after their creation, and give the closed loop's
//! bits.
#![allow(unsafe_code)]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::mem::MaybeUninit;

use kband_c::failure::Code;
use kband_c::feeder::*;
use kband_plant::ClosedLoop;
use kband_scene::SceneFile;

thread_local! {
    static ALLOCATIONS: Cell<usize> = const { Cell::new(0) };
}

struct Counting;

// SAFETY: every call goes to the system's allocator; it is only counted.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.set(ALLOCATIONS.get() + 1);
        // SAFETY: as the caller says.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: as the caller says.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

/// The object that a successful call writes.
fn created<T>(call: impl FnOnce(Option<&mut MaybeUninit<T>>) -> Code) -> T {
    let mut place = MaybeUninit::uninit();
    assert_eq!(call(Some(&mut place)), Code::Ok);
    // SAFETY: the call has written it.
    unsafe { place.assume_init() }
}

#[test]
fn controller_allocates_nothing_and_gives_the_loops_bits() {
    let text = kband_scene::DEFAULT;
    let mut closed = ClosedLoop::build(&SceneFile::parse(text).unwrap().scene).unwrap();
    // SAFETY: the text has this length.
    let scene = created(|to| unsafe { kband_scene_parse(text.as_ptr().cast(), text.len(), to) });
    let mut plant = created(|to| kband_plant_new(Some(&scene), to));
    let mut signal = created(|to| kband_signal_new(Some(&scene), to));
    let mut controller = created(|to| kband_controller_new(Some(&scene), to));
    let mut cycles = 0;
    while cycles < 120 {
        let mut current = MaybeUninit::uninit();
        let code = created(|to| kband_plant_sample(Some(&mut plant), to, Some(&mut current)));
        // SAFETY: the call has written it.
        let current = unsafe { current.assume_init() };
        let before = ALLOCATIONS.get();
        let output = created(|to| kband_signal_sample(Some(&mut signal), code, current, to));
        assert_eq!(ALLOCATIONS.get(), before);
        let held = kband_plant_hold(Some(&mut plant), output.output, output.step);
        assert_eq!(held, Code::Ok);
        if !output.wrapped {
            continue;
        }
        cycles += 1;
        let inputs = created(|to| kband_plant_inputs(Some(&plant), to));
        let before = ALLOCATIONS.get();
        let report = created(|to| {
            kband_controller_cycle(Some(&mut controller), Some(&mut signal), Some(&inputs), to)
        });
        (0..PLAN_SLICES).all(|_| created(|to| kband_controller_plan(Some(&mut controller), to)));
        assert_eq!(ALLOCATIONS.get(), before);
        let due = closed.cycle().report;
        assert_eq!(
            [report.amplitude, report.k, report.in_gear, report.output].map(f32::to_bits),
            [due.amplitude, due.k, due.in_gear, due.command.amplitude].map(f32::to_bits),
            "cycle {cycles}"
        );
        assert_eq!(report.state, due.state.number());
    }
    kband_controller_free(Some(controller));
    kband_signal_free(Some(signal));
    kband_plant_free(Some(plant));
    kband_scene_free(Some(scene));
}
