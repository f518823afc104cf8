//! The scenarios of `docs/safety.md` on any image of the STM32F405, an older one too: what the table's "before" is.

use std::path::Path;
use std::process::ExitCode;

use kband_machines::hazards::{Hazard, bands, of_the_sensor, of_the_setpoint};

const USAGE: &str = "usage: replay IMAGE [SCHEMA [NAME]]
       IMAGE   the file that cargo feeder builds
       SCHEMA  what it speaks, where it is not what this desk does: 0xc905e82a for commit 116d3e225212
       NAME    part of the names of the scenarios that are played";

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
        Some((_, Some(schema))) => Some(schema as u16),
        Some((text, None)) => {
            eprintln!("replay: {text} is no schema\n{USAGE}");
            return ExitCode::from(2);
        }
    };
    let all = of_the_sensor().into_iter().chain(of_the_setpoint());
    for hazard in all.chain(bands()).filter(|one| one.name.contains(name)) {
        play(&hazard, Path::new(image), schema);
    }
    ExitCode::SUCCESS
}

fn play(hazard: &Hazard, image: &Path, schema: Option<u16>) {
    let outcome = hazard.play(hazard.commission(image, schema));
    let time = |time: Option<f64>| time.map_or("never".to_owned(), |time| format!("{time:.4} s"));
    println!(
        "{}: {:.4} mm before, {:.4} mm at most, {:.4} mm after (limit {:.4}); bridge opens {}, FAULT {}, READY {}, resets {}",
        hazard.name,
        outcome.before,
        outcome.largest,
        outcome.after,
        hazard.limit(),
        time(outcome.opens),
        time(outcome.fault),
        time(outcome.ready),
        outcome.rig.resets().len() - 1,
    );
}
