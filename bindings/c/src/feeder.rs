//! Scene, plant, signal path and controller as opaque handles.

use std::collections::BTreeMap;
use std::ffi::{CString, c_char};
use std::mem::MaybeUninit;
use std::ptr::NonNull;
use std::slice;
use std::sync::OnceLock;

use kband_control::{AdcCode, Controller, Fault, Inputs, Signal, State, Target};
use kband_plant::Bench;
use kband_scene::SceneFile;

use crate::failure::{Code, Failure, call, put, require};

/// Samples a second.
pub const SAMPLE_RATE: u32 = 20_000;
/// Slices of the plan in each drive cycle.
pub const PLAN_SLICES: usize = 16;

const _: () = assert!(SAMPLE_RATE == kband_control::SAMPLE_RATE);
const _: () = assert!(PLAN_SLICES == kband_control::PLAN_SLICES);

/// A scene: one feeder, its target, and its disturbances over time.
pub struct SceneHandle(SceneFile);

/// The simulated feeder of a scene: a converter code for each output.
pub struct PlantHandle(Bench);

/// The firmware's signal path: drive phase, demodulation, impacts.
pub struct SignalHandle(Signal);

/// The firmware's controller.
pub struct ControllerHandle(Controller);

/// Inputs of the board in a drive cycle.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BoardInputs {
    /// The enable input.
    pub enable: bool,
    /// The over-temperature input.
    pub over_temperature: bool,
    /// Whether the link received a frame since the last cycle.
    pub link_heard: bool,
    /// Whether the stack came close to its end.
    pub stack_low: bool,
    /// The over-current input.
    pub over_current: bool,
    /// Whether the supply is below what the chip needs.
    pub supply_low: bool,
    /// Whether the clock is another than the crystal's.
    pub clock_failed: bool,
}

/// Conversions between the inputs of the board here and in the controller, by their equal names.
macro_rules! same_inputs {
    ($($name:ident),+) => {
        impl From<Inputs> for BoardInputs {
            fn from(inputs: Inputs) -> Self {
                Self { $($name: inputs.$name),+ }
            }
        }

        impl From<BoardInputs> for Inputs {
            fn from(inputs: BoardInputs) -> Self {
                Self { $($name: inputs.$name,)+ ..Self::default() }
            }
        }
    };
}
same_inputs!(
    enable,
    over_temperature,
    link_heard,
    stack_low,
    over_current,
    supply_low,
    clock_failed
);

/// Answer of the signal path to a sample.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SignalOutput {
    /// Output of the drive until the next sample, -1..1.
    pub output: f32,
    /// Advance of the drive's phase in 2^-32 turns.
    pub step: u32,
    /// Whether a drive cycle ended: `kband_controller_cycle` is due.
    pub wrapped: bool,
}

/// What the controller reports of a drive cycle.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CycleReport {
    /// Number of the cycle.
    pub cycle: u32,
    /// Measured amplitude (b) in m.
    pub amplitude: f32,
    /// Reference of the amplitude in m.
    pub reference: f32,
    /// Amplitude of the target in m; 0 where it has none.
    pub setpoint: f32,
    /// Measured k.
    pub k: f32,
    /// Estimated share of time in gear, 0..1.
    pub in_gear: f32,
    /// Its standard error; infinite for a lower bound.
    pub in_gear_error: f32,
    /// Amplitude of the output, 0..1.
    pub output: f32,
    /// Number of the controller's state (`kband_state_name`).
    pub state: u8,
    /// Number of the fault that stopped the drive (`kband_fault_name`); 0 without one.
    pub fault: u8,
}

/// What a controller is to reach.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TargetKind {
    /// Gear of the order `value`, 1..8.
    Gear = 0,
    /// Lock of the order `value`, 1..8.
    Locked = 1,
    /// k = `value`, 0.02..10.
    K = 2,
    /// Amplitude `value` in mm, 0..100.
    Amplitude = 3,
    /// Speed `value` in mm/s.
    Speed = 4,
}

/// A scene from its text in TOML, of `length` bytes. Free it with `kband_scene_free`.
///
/// # Safety
/// `text` has `length` bytes; `scene` may be written to.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kband_scene_parse(
    text: *const c_char,
    length: usize,
    scene: Option<&mut MaybeUninit<Box<SceneHandle>>>,
) -> Code {
    call(|| {
        let text = require(NonNull::new(text.cast_mut()), "text")?;
        // SAFETY: as the caller says.
        let bytes = unsafe { slice::from_raw_parts(text.as_ptr().cast::<u8>(), length) };
        let text = str::from_utf8(bytes)
            .map_err(|error| Failure::new(Code::Scene, format_args!("the text: {error}")))?;
        create(scene, SceneHandle(SceneFile::parse(text)?))
    })
}

/// Moves a new object to the caller.
fn create<T>(place: Option<&mut MaybeUninit<Box<T>>>, object: T) -> Result<(), Failure> {
    put(place, "the place for the handle", Box::new(object))
}

/// Frees a scene; null is ignored.
#[unsafe(no_mangle)]
pub extern "C" fn kband_scene_free(scene: Option<Box<SceneHandle>>) {
    drop(scene);
}

/// Duration of a scene in s.
#[unsafe(no_mangle)]
pub extern "C" fn kband_scene_duration(
    scene: Option<&SceneHandle>,
    duration: Option<&mut MaybeUninit<f64>>,
) -> Code {
    call(|| {
        let scene = require(scene, "scene")?;
        put(duration, "duration", scene.0.duration)
    })
}

/// The plant of a scene at time 0: parts at rest, drive off. Free it with `kband_plant_free`.
#[unsafe(no_mangle)]
pub extern "C" fn kband_plant_new(
    scene: Option<&SceneHandle>,
    plant: Option<&mut MaybeUninit<Box<PlantHandle>>>,
) -> Code {
    call(|| {
        let scene = &require(scene, "scene")?.0.scene;
        create(plant, PlantHandle(Bench::build(scene)?))
    })
}

/// Frees a plant; null is ignored.
#[unsafe(no_mangle)]
pub extern "C" fn kband_plant_free(plant: Option<Box<PlantHandle>>) {
    drop(plant);
}

/// Converter codes of the accelerometer and of the current sensor at the next sample; `current` may
/// be null.
#[unsafe(no_mangle)]
pub extern "C" fn kband_plant_sample(
    plant: Option<&mut PlantHandle>,
    accelerometer: Option<&mut MaybeUninit<u16>>,
    current: Option<&mut MaybeUninit<u16>>,
) -> Code {
    call(|| {
        let plant = &mut require(plant, "plant")?.0;
        require(accelerometer, "accelerometer")?.write(plant.sample().0);
        if let Some(current) = current {
            current.write(plant.current().0);
        }
        Ok(())
    })
}

/// Holds an output (-1..1) until the next sample, while the drive's phase advances by `step`.
#[unsafe(no_mangle)]
pub extern "C" fn kband_plant_hold(
    plant: Option<&mut PlantHandle>,
    output: f32,
    step: u32,
) -> Code {
    call(|| {
        let plant = require(plant, "plant")?;
        if !(-1.0..=1.0).contains(&output) {
            let message = format_args!("output = {output} is refused; accepted: -1..1");
            return Err(Failure::new(Code::OutOfRange, message));
        }
        plant.0.hold(output, step);
        Ok(())
    })
}

/// Inputs of the board at this time of the scene.
#[unsafe(no_mangle)]
pub extern "C" fn kband_plant_inputs(
    plant: Option<&PlantHandle>,
    inputs: Option<&mut MaybeUninit<BoardInputs>>,
) -> Code {
    call(|| {
        let plant = require(plant, "plant")?;
        put(inputs, "inputs", plant.0.inputs().into())
    })
}

/// Mean displacement of the parts along the track in m.
#[unsafe(no_mangle)]
pub extern "C" fn kband_plant_displacement(
    plant: Option<&PlantHandle>,
    displacement: Option<&mut MaybeUninit<f64>>,
) -> Code {
    call(|| {
        let plant = require(plant, "plant")?;
        put(displacement, "displacement", plant.0.displacement())
    })
}

/// The signal path with the settings of a scene. Free it with `kband_signal_free`.
#[unsafe(no_mangle)]
pub extern "C" fn kband_signal_new(
    scene: Option<&SceneHandle>,
    signal: Option<&mut MaybeUninit<Box<SignalHandle>>>,
) -> Code {
    call(|| {
        let scene = &require(scene, "scene")?.0.scene;
        create(signal, SignalHandle(Signal::build(&scene.settings)?))
    })
}

/// Frees a signal path; null is ignored.
#[unsafe(no_mangle)]
pub extern "C" fn kband_signal_free(signal: Option<Box<SignalHandle>>) {
    drop(signal);
}

/// Takes the converter codes of a sample; gives the output until the next. It allocates nothing.
#[unsafe(no_mangle)]
pub extern "C" fn kband_signal_sample(
    signal: Option<&mut SignalHandle>,
    accelerometer: u16,
    current: u16,
    output: Option<&mut MaybeUninit<SignalOutput>>,
) -> Code {
    call(|| {
        let signal = &mut require(signal, "signal")?.0;
        let output = require(output, "output")?;
        let before = signal.phase();
        let sampled = signal.sample_with(AdcCode(accelerometer), || AdcCode(current));
        output.write(SignalOutput {
            output: sampled.output,
            step: (signal.phase() - before).bits(),
            wrapped: sampled.wrapped,
        });
        Ok(())
    })
}

/// The controller with the settings and the target of a scene. Free it with
/// `kband_controller_free`.
#[unsafe(no_mangle)]
pub extern "C" fn kband_controller_new(
    scene: Option<&SceneHandle>,
    controller: Option<&mut MaybeUninit<Box<ControllerHandle>>>,
) -> Code {
    call(|| {
        let scene = &require(scene, "scene")?.0.scene;
        let built = Controller::build(&scene.settings, scene.target, scene.start)?;
        create(controller, ControllerHandle(built))
    })
}

/// Frees a controller; null is ignored.
#[unsafe(no_mangle)]
pub extern "C" fn kband_controller_free(controller: Option<Box<ControllerHandle>>) {
    drop(controller);
}

/// Ends a drive cycle: takes the measurements of the signal path and the inputs of the board, and
/// gives the signal path its next command. `report` may be null. It allocates nothing.
#[unsafe(no_mangle)]
pub extern "C" fn kband_controller_cycle(
    controller: Option<&mut ControllerHandle>,
    signal: Option<&mut SignalHandle>,
    inputs: Option<&BoardInputs>,
    report: Option<&mut MaybeUninit<CycleReport>>,
) -> Code {
    call(|| {
        let controller = &mut require(controller, "controller")?.0;
        let signal = &mut require(signal, "signal")?.0;
        let inputs = Inputs::from(*require(inputs, "inputs")?);
        let reported = controller.cycle(signal.cycle(), &inputs);
        signal.command(reported.command);
        if let Some(report) = report {
            report.write(CycleReport {
                cycle: reported.cycle,
                amplitude: reported.amplitude,
                reference: reported.reference,
                setpoint: reported.setpoint,
                k: reported.k,
                in_gear: reported.in_gear,
                in_gear_error: reported.in_gear_error,
                output: reported.command.amplitude,
                state: reported.state.number(),
                fault: reported.fault.map_or(0, Fault::number),
            });
        }
        Ok(())
    })
}

/// Computes one slice of what the controller plans, in the time left of a drive cycle; at most
/// `KBAND_PLAN_SLICES` a cycle. `more` tells whether more remain. It allocates nothing.
#[unsafe(no_mangle)]
pub extern "C" fn kband_controller_plan(
    controller: Option<&mut ControllerHandle>,
    more: Option<&mut MaybeUninit<bool>>,
) -> Code {
    call(|| {
        let controller = require(controller, "controller")?;
        put(more, "more", controller.0.plan_step())
    })
}

/// Asks for another target: `kind` is a `kband_target`, `value` what it says of it.
#[unsafe(no_mangle)]
pub extern "C" fn kband_controller_set_target(
    controller: Option<&mut ControllerHandle>,
    kind: i32,
    value: f32,
) -> Code {
    call(|| {
        let controller = &mut require(controller, "controller")?.0;
        let order = value as u8;
        let is_integer = f32::from(order) == value;
        let target = match kind {
            kind if kind == TargetKind::Gear as i32 && is_integer => Target::Gear { order },
            kind if kind == TargetKind::Locked as i32 && is_integer => Target::Locked { order },
            kind if kind == TargetKind::K as i32 => Target::K(value),
            kind if kind == TargetKind::Amplitude as i32 => Target::Amplitude(value),
            kind if kind == TargetKind::Speed as i32 => Target::Speed(value),
            _ => {
                return Err(Failure::new(
                    Code::OutOfRange,
                    format_args!(
                        "target {kind} of {value} is refused; accepted: a kband_target, orders whole"
                    ),
                ));
            }
        };
        Ok(controller.set_target(target)?)
    })
}

/// Name of a number, with a terminating zero.
macro_rules! name {
    ($number:ident, $type:ident, $other:literal) => {{
        static NAMES: OnceLock<BTreeMap<u8, CString>> = OnceLock::new();
        let names = NAMES.get_or_init(|| {
            let named = |item: &$type| Some((item.number(), CString::new(item.name()).ok()?));
            $type::ALL.iter().filter_map(named).collect()
        });
        let name = names.get(&$number);
        name.map_or($other, CString::as_c_str).as_ptr()
    }};
}

/// Name of a state, by its number; "unknown" for another number.
#[unsafe(no_mangle)]
pub extern "C" fn kband_state_name(number: u8) -> *const c_char {
    name!(number, State, c"unknown")
}

/// Name of a fault, by its number; "none" for another number.
#[unsafe(no_mangle)]
pub extern "C" fn kband_fault_name(number: u8) -> *const c_char {
    name!(number, Fault, c"none")
}
