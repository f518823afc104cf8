//! Random requests.

use super::*;
use kband::arithmetic::Noise;

pub fn below(noise: &mut Noise, limit: u32) -> u32 {
    noise.bits() % limit
}

pub fn choose<T: Copy>(noise: &mut Noise, from: &[T]) -> T {
    from[below(noise, from.len() as u32) as usize]
}

pub fn value(noise: &mut Noise, low: f32, high: f32) -> f32 {
    low + (high - low) * (below(noise, 1001) as f32 / 1000.0)
}

fn target(noise: &mut Noise) -> Target {
    match below(noise, 8) {
        0 => Target::Locked {
            order: 1 + below(noise, 9) as u8,
        },
        1 => Target::Gear { order: 1 },
        2 => Target::Amplitude(value(noise, 0.0, 0.9)),
        3 => Target::Speed(value(noise, 10.0, 100.0)),
        4 => Target::Identify,
        5 => Target::Chaotic,
        _ => Target::K(value(noise, 0.2, 1.5)),
    }
}

/// A request with this setting. Kinds that keep the drive off for long are `rarity` times rarer.
pub fn request(
    noise: &mut Noise,
    (key, value): (&'static str, f32),
    rarity: u32,
) -> Request<'static> {
    const BUS: [&[u8]; 5] = [
        &[1, 3, 0, 0, 0, 8],
        &[1, 4, 0, 0, 0, 20],
        &[1, 6, 0, 0, 0, 1],
        &[1, 6, 0, 1, 0, 0],
        &[1, 99],
    ];
    let pin = Pin::parse(choose(noise, &["1234", "0000"])).unwrap();
    let number = below(noise, 9) as u8;
    let recipe = Recipe::of(target(noise), &Settings::default());
    let recipe = (RecipeName::parse("caps").unwrap(), recipe);
    let is_due = below(noise, rarity) == 0;
    match below(noise, 32) {
        0 => Request::Setting(10 * number),
        1 => Request::Get(key),
        2..6 => Request::set(key, value),
        6 | 7 => Request::Save,
        8 if is_due => Request::Defaults,
        9 => Request::Target(target(noise)),
        10..13 => Request::Enable(below(noise, 4) > 0),
        13 => Request::Telemetry(u16::from(number)),
        14 => Request::Event(u32::from(number)),
        15 => Request::SelfTest,
        16 => Request::Counters,
        17 => Request::Alive,
        18 | 19 if is_due => simulate(target(noise)),
        20 => Request::Samples {
            codes: &[0; 150],
            end: None,
        },
        21 => Request::Held,
        22 => Request::Fault(number),
        23 => Request::Status,
        24 if is_due => Request::Lock(Some(pin).filter(|_| below(noise, 2) == 0)),
        25 => Request::Unlock(pin),
        26 => Request::Recipe(number),
        27 => Request::SetRecipe {
            number,
            recipe: (below(noise, 3) > 0).then_some(recipe),
        },
        28 => Request::SaveRecipes,
        29 => Request::UseRecipe(number),
        30 => Request::Identification,
        _ => Request::Bus(choose(noise, &BUS)),
    }
}
