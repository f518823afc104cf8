//! Runs the scenarios of `docs/safety.md` on any image of the STM32F405, also an older one: the
//! table's column "before".

use std::path::Path;
use std::process::ExitCode;

use kband_machines::chip::world::Seen;
use kband_machines::draw::Draw;
use kband_machines::hazards::{
    Hazard, bands, bounce, of_any_sensor, of_gear, of_the_program, of_the_sensor, of_the_setpoint,
    over_current,
};
use kband_machines::images;

const USAGE: &str = "usage: replay IMAGE [SCHEMA [NAME]]
       IMAGE   the file that cargo feeder builds
       SCHEMA  what it speaks, where it is not what this desk does: 0xc905e82a for commit 116d3e225212
       NAME    part of the names of the scenarios that are played; slow: six machines at random that take 20 to 120 s each, which
               are played where they are asked for";

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (image, schema, name) = match &arguments[..] {
        [image] => (image, None, ""),
        [image, schema] => (image, Some(schema), ""),
        [image, schema, name] => (image, Some(schema), name.as_str()),
        _ => {
            eprintln!("{USAGE}");
            return ExitCode::from(2);
        }
    };
    let read = |text: &String| u32::from_str_radix(text.strip_prefix("0x")?, 16).ok();
    let schema = match schema.map(|text| (text, read(text))) {
        None => None,
        // An image with this desk's schema is not an older one.
        Some((_, Some(schema))) => {
            Some(schema as u16).filter(|low| *low != kband::wire::SCHEMA as u16)
        }
        Some((text, None)) => {
            eprintln!("replay: {text} is no schema\n{USAGE}");
            return ExitCode::from(2);
        }
    };
    let all = of_the_sensor().into_iter().chain(of_the_setpoint());
    let image = Path::new(image);
    let [panics, stack] = ["_defmt_panic", "_stack_end"].map(|name| images::symbol(image, name));
    let mut draw = Draw::new(21);
    let drawn: Vec<_> = std::iter::repeat_with(|| of_any_sensor(&mut draw, 5.0))
        .flatten()
        .take(6)
        .collect();
    let mut draw = Draw::new(22);
    let slow = std::iter::repeat_with(|| of_any_sensor(&mut draw, 120.0))
        .flatten()
        .filter(|one| name == "slow" && one.until > 20.0)
        .map(|one| Hazard {
            name: "a slow machine at random",
            ..one
        });
    let slow: Vec<_> = slow.take(if name == "slow" { 6 } else { 0 }).collect();
    let all = all
        .chain(slow)
        .chain(bands())
        .chain(of_gear())
        .chain([bounce(), over_current()]);
    let all = all.chain(of_the_program(panics, stack)).chain(drawn);
    for hazard in all.filter(|one| one.name.contains(name)) {
        play(&hazard, image, schema);
    }
    ExitCode::SUCCESS
}

fn play(hazard: &Hazard, image: &Path, schema: Option<u16>) {
    let mut rig = hazard.commission(image, schema);
    rig.tolerant = true;
    let outcome = hazard.play(rig);
    let time = |time: Option<f64>| time.map_or("never".to_owned(), |time| format!("{time:.4} s"));
    let closes = outcome
        .rig
        .seen_after(hazard.from + 0.2, &Seen::Bridge(true));
    println!(
        "{}: {:.4} mm before, {:.4} mm at most, {:.4} mm after (limit {:.4}); bridge opens {}, FAULT {}, READY {}, closes again at {}, resets {}",
        hazard.name,
        outcome.before,
        outcome.largest,
        outcome.after,
        hazard.limit(),
        time(outcome.opens),
        time(outcome.fault),
        time(outcome.ready),
        time(closes),
        outcome.rig.resets().len() - 1,
    );
}
