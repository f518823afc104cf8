//! Three inputs select recipes on the flashed image while its drive runs.

use kband_control::wire::{Request, Response};
use kband_control::{Recipe, RecipeName, Settings, Target};
use kband_machines::chip::gpio::Wire;
use kband_machines::chip::kind::Kind;
use kband_machines::chip::world::Seen;
use kband_machines::hazards::Hazard;
use kband_machines::rig::{Act, Rig};

/// Amplitudes of the recipes 1 to 3, mm. The saved target has 0.2 mm.
const AMPLITUDES: [f32; 3] = [0.1, 0.3, 0.15];

/// A recipe of this amplitude in mm, with a soft start of 0.3 s.
fn recipe(amplitude: f32) -> Option<(RecipeName, Recipe)> {
    let settings = Settings {
        soft_start: 0.3,
        restitution_high: 0.25,
        ..Settings::default()
    };
    let name = RecipeName::parse("parts")?;
    Some((name, Recipe::of(Target::Amplitude(amplitude), &settings)))
}

/// A board whose flash holds the recipes, after a restart without supply in between.
fn board() -> Rig {
    let mut rig = Hazard::of("recipes", 50.0, Target::Amplitude(0.2)).commissioned(Kind::Stm32f405);
    for (number, amplitude) in (1..).zip(AMPLITUDES) {
        let recipe = recipe(amplitude);
        rig.request_done(&Request::SetRecipe { number, recipe });
    }
    rig.request_done(&Request::SaveRecipes);
    rig.act(&Act::Volts(0.0));
    rig.run(rig.time() + 0.3);
    rig.act(&Act::Volts(3.3));
    rig.run(rig.time() + 0.4);
    rig
}

/// Wires the inputs for this recipe: PC6 counts 1, PC7 2, PC8 4.
fn select(rig: &mut Rig, number: usize) {
    for bit in 0..3 {
        let level = if number >> bit & 1 == 1 {
            Wire::Low
        } else {
            Wire::Open
        };
        rig.act(&Act::Wire(2, 6 + bit, level));
    }
}

/// Number of the recipe in use.
fn in_use(rig: &mut Rig) -> u8 {
    rig.request(&Request::Status, |response| match response {
        Response::Status(status) => status.recipe,
        other => panic!("{other:?}"),
    })
}

/// Runs the drive for some seconds while the desk is on the link.
fn run(rig: &mut Rig, seconds: f64) {
    let begun = rig.time();
    for n in 0..(seconds / 0.3) as u32 {
        let frame = rig.frame(&Request::Alive);
        rig.at(begun + 0.3 * f64::from(n), Act::Link(frame));
    }
    rig.run(begun + seconds);
}

fn start(rig: &mut Rig) {
    rig.act(&Act::Enable(true));
    run(rig, 2.0);
    assert!(rig.chip.is_driven());
}

#[test]
fn inputs_select_recipes_while_the_drive_runs() {
    let mut rig = board();
    start(&mut rig);
    assert!((rig.amplitude() - 0.2).abs() < 0.01, "{}", rig.amplitude());
    let mut before = 0.2;
    for number in [1, 2, 3, 0] {
        let wanted = match number {
            0 => 0.2,
            number => f64::from(AMPLITUDES[number - 1]),
        };
        let last = in_use(&mut rig);
        let begun = rig.time();
        select(&mut rig, number);
        // The inputs must be constant for 50 ms.
        rig.run(begun + 0.045);
        assert_eq!(in_use(&mut rig), last);
        rig.peak();
        // Two drive cycles later it is in use.
        rig.run(begun + 0.05 + 0.04);
        assert_eq!(usize::from(in_use(&mut rig)), number);
        let mut reached = None;
        while rig.time() < begun + 1.5 {
            let frame = rig.frame(&Request::Alive);
            rig.act(&Act::Link(frame));
            rig.run(rig.time() + 0.02);
            let there = (rig.amplitude() / wanted - 1.0).abs() < 0.02;
            reached = if there {
                reached.or(Some(rig.time() - begun))
            } else {
                None
            };
        }
        let (reached, largest) = (reached.expect("it is reached"), rig.peak());
        println!(
            "recipe {number}: {before} to {wanted} mm in {reached:.2} s, largest {largest:.4} mm"
        );
        assert!(reached < 0.8, "{number}: {reached}");
        assert!(largest < 1.02 * wanted.max(before), "{number}: {largest}");
        before = wanted;
    }
    assert_eq!(rig.seen_after(1.5, &Seen::Fault(true)), None);
}
