//! Signal path and controller allocate nothing after their creation, and give the closed loop's bits.
#![allow(unsafe_code)]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::ptr::null_mut;

use kband_c::failure::Code;
use kband_c::feeder::*;
use kband_plant::ClosedLoop;
use kband_scene::SceneFile;

thread_local! {
    static ALLOCATIONS: Cell<usize> = const { Cell::new(0) };
}

struct Counting;

// SAFETY: it does what the system's allocator does, and counts.
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

fn done(code: Code) {
    assert_eq!(code, Code::Ok);
}

#[test]
fn controller_allocates_nothing_and_gives_the_loops_bits() {
    let text = kband_scene::DEFAULT;
    let mut closed = ClosedLoop::build(&SceneFile::parse(text).unwrap().scene).unwrap();
    let (mut scene, mut plant) = (null_mut(), null_mut());
    let (mut signal, mut controller) = (null_mut(), null_mut());
    // SAFETY: every pointer is that of a local, or of a handle created here and freed at the end.
    unsafe {
        done(kband_scene_parse(
            text.as_ptr().cast(),
            text.len(),
            &mut scene,
        ));
        done(kband_plant_new(scene, &mut plant));
        done(kband_signal_new(scene, &mut signal));
        done(kband_controller_new(scene, &mut controller));
        let mut cycles = 0;
        while cycles < 120 {
            let (mut code, mut current) = (0, 0);
            done(kband_plant_sample(plant, &mut code, &mut current));
            let mut output = SignalOutput::default();
            let before = ALLOCATIONS.get();
            done(kband_signal_sample(signal, code, current, &mut output));
            assert_eq!(ALLOCATIONS.get(), before);
            done(kband_plant_hold(plant, output.output, output.step));
            if !output.wrapped {
                continue;
            }
            cycles += 1;
            let (mut inputs, mut report) = (BoardInputs::default(), CycleReport::default());
            done(kband_plant_inputs(plant, &mut inputs));
            let before = ALLOCATIONS.get();
            done(kband_controller_cycle(
                controller,
                signal,
                &inputs,
                &mut report,
            ));
            let mut more = true;
            for _ in 0..PLAN_SLICES {
                if more {
                    done(kband_controller_plan(controller, &mut more));
                }
            }
            assert_eq!(ALLOCATIONS.get(), before);
            let expected = closed.cycle().report;
            assert_eq!(
                [report.amplitude, report.k, report.in_gear, report.output].map(f32::to_bits),
                [
                    expected.amplitude,
                    expected.k,
                    expected.in_gear,
                    expected.command.amplitude
                ]
                .map(f32::to_bits),
                "cycle {cycles}"
            );
            assert_eq!(report.state, expected.state.number());
        }
        kband_controller_free(controller);
        kband_signal_free(signal);
        kband_plant_free(plant);
        kband_scene_free(scene);
    }
}
