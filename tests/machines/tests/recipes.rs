//! Three inputs of the flashed image select recipes while the drive runs.

use kband_control::wire::Request;
use kband_control::{Recipe, RecipeName, Settings, Target};
use kband_machines::chip::gpio::Wire;
use kband_machines::chip::kind::Kind;
use kband_machines::chip::world::Event;
use kband_machines::hazards::Hazard;
use kband_machines::rig::{Act, Rig};

/// Amplitudes of the saved target and of the recipes 1 to 3, mm.
const AMPLITUDES: [f32; 4] = [0.2, 0.1, 0.3, 0.15];

fn board() -> Rig {
    let hazard = Hazard::new("recipes", 50.0, Target::Amplitude(0.2));
    let mut rig = hazard.commissioned(Kind::Stm32f405);
    let settings = Settings {
        soft_start: 0.3,
        restitution_high: 0.25,
        ..Settings::default()
    };
    for (number, amplitude) in (1..).zip(&AMPLITUDES[1..]) {
        let recipe = Recipe::of(Target::Amplitude(*amplitude), &settings);
        let recipe = RecipeName::parse("parts").map(|name| (name, recipe));
        rig.request_done(&Request::SetRecipe { number, recipe });
    }
    rig.request_done(&Request::SaveRecipes)
        .power_cycle(0.3, 0.4);
    rig
}

/// Wires the inputs for this recipe: PC6 has the weight 1, PC7 2, PC8 4.
fn select(rig: &mut Rig, number: usize) {
    for bit in 0..3 {
        let level = [Wire::Open, Wire::Low][number >> bit & 1];
        rig.act(&Act::Wire(2, 6 + bit, level));
    }
}

fn in_use(rig: &mut Rig) -> usize {
    rig.status().recipe.into()
}

/// Runs the drive for some time, s, with the desk on the link. Returns the last time at which the
/// amplitude differed from `expected` mm by more than 2 %.
fn run(rig: &mut Rig, seconds: f64, expected: f64) -> f64 {
    let (end, mut away) = (rig.time() + seconds, rig.time());
    while rig.time() < end {
        rig.request_done(&Request::Alive).run_for(0.02);
        if (rig.amplitude() / expected - 1.0).abs() > 0.02 {
            away = rig.time();
        }
    }
    away
}

#[test]
fn inputs_select_recipes_while_the_drive_runs() {
    let mut rig = board();
    rig.act(&Act::Enable(true));
    let away = run(&mut rig, 2.0, 0.2);
    assert!(away < rig.time() - 0.5, "it runs");
    let mut before = 0;
    for number in [1, 2, 3, 0] {
        let start = rig.time();
        select(&mut rig, number);
        // The inputs must be constant for 50 ms.
        rig.run(start + 0.045);
        assert_eq!(in_use(&mut rig), before);
        rig.peak();
        // Two drive cycles later the recipe is in use.
        rig.run(start + 0.05 + 0.04);
        assert_eq!(in_use(&mut rig), number);
        let [from, to] = [before, number].map(|number| f64::from(AMPLITUDES[number]));
        let reached = run(&mut rig, 1.4, to) - start;
        let largest = rig.peak();
        assert!(reached < 0.8, "{number}: {reached}");
        assert!(largest < 1.02 * from.max(to), "{number}: {largest}");
        before = number;
    }
    // Recipe 5 does not exist: READY turns off, and the drive continues.
    let start = rig.time();
    select(&mut rig, 5);
    let away = run(&mut rig, 0.5, f64::from(AMPLITUDES[0]));
    assert!(away <= start, "the amplitude is kept");
    let dark = rig.find_time(start, &Event::Ready(false));
    assert!(dark.is_some_and(|time| time - start < 0.1), "{dark:?}");
    assert_eq!(rig.find_time(1.5, &Event::Fault(true)), None);
}

#[test]
fn inputs_that_are_wired_at_power_on_select_before_the_start() {
    let mut rig = board();
    rig.act(&Act::Volts(0.0));
    select(&mut rig, 2);
    rig.run_for(0.3);
    rig.act(&Act::Volts(3.3)).run_for(0.3);
    assert_eq!(in_use(&mut rig), 2);
    let since = rig.time();
    rig.act(&Act::Enable(true));
    rig.peak();
    let away = run(&mut rig, 2.0, 0.3);
    assert!(away < since + 1.5, "it holds the recipe's amplitude");
    let largest = rig.peak();
    assert!(largest < 1.02 * 0.3, "{largest}");
}
