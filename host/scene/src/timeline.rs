//! Targets of a feeder and disturbances, over time.

use kband_control::{Shape, Target, UpperTone};
use kband_plant::{Change, DISTURBANCES, Disturbance, Disturbances, PARTS};
use toml::{Table, Value};

use super::fields::{CHANGES, FLAGS};
use super::section::{Section, number};
use crate::refusal::Refusal;

/// Name of the band of a target of gear or chaos ([`kband_control::Report::target_band`]).
pub fn band_name(target: Target) -> &'static str {
    match target {
        Target::Chaotic => "chaotic band",
        _ => "gear band",
    }
}

/// A target in words.
pub fn describe(target: Target) -> String {
    match target {
        Target::Locked { order } => format!("lock of order {order}"),
        Target::Gear { order } => format!("gear of order {order}"),
        Target::Chaotic => "chaos".into(),
        Target::K(k) => format!("k = {k}"),
        Target::Amplitude(b) => format!("amplitude {b} mm"),
        Target::Speed(v) => format!("speed {v} mm/s"),
        Target::Flow(flow) => format!("flow {flow} g/s"),
        Target::PartsPerMinute(rate) => format!("{rate} parts a minute"),
        Target::Identify => "identification".into(),
        Target::Tones { k, shape } => {
            let describe_tone = |name: &str, tone: UpperTone| {
                let degrees = tone.phase.to_degrees();
                format!("a {name} tone of {} at {degrees:.1} degrees", tone.ratio)
            };
            let mut all = format!("k = {k} with {}", describe_tone("second", shape.second));
            if shape.third.ratio > 0.0 {
                all += &format!(" and {}", describe_tone("third", shape.third));
            }
            all
        }
    }
}

const TARGETS: &str = "exactly one of gear = 1..8, locked = 1..8, chaotic = true, k = 0.02..10, amplitude = mm, speed = mm/s, flow = g/s, identify = true, \
                       tones = [k, e, degrees]";

const KEYS: &str = "gear locked chaotic k amplitude speed flow identify tones";

pub(crate) fn read_target(section: &mut Section) -> Result<Target, Refusal> {
    let mut target = None;
    for key in KEYS.split(' ') {
        let Some(value) = section.take(key) else {
            continue;
        };
        if target.is_some() {
            return Err(section.refuse(key, &value, TARGETS));
        }
        let refused = |accepted: &str| section.refuse(key, &value, accepted);
        target = Some(match (key, &value) {
            ("locked", Value::Integer(order @ 1..=8)) => Target::Locked {
                order: *order as u8,
            },
            ("gear", Value::Integer(order @ 1..=8)) => Target::Gear {
                order: *order as u8,
            },
            ("locked" | "gear", _) => return Err(refused("a whole number of drive cycles, 1..8")),
            ("chaotic", Value::Boolean(true)) => Target::Chaotic,
            ("identify", Value::Boolean(true)) => Target::Identify,
            ("tones", value) => read_tones(value).map_err(|accepted| refused(&accepted))?,
            ("chaotic" | "identify", _) => return Err(refused("true, or leave it out")),
            (_, value) => {
                let number = number(value).ok_or_else(|| refused("a number"))? as f32;
                match key {
                    "k" if (0.02..=10.0).contains(&number) => Target::K(number),
                    "k" => return Err(refused("0.02..10")),
                    "amplitude" if (0.0..=100.0).contains(&number) => Target::Amplitude(number),
                    "amplitude" => return Err(refused("0..100 mm")),
                    "flow" if number > 0.0 && number <= 1e6 => Target::Flow(number),
                    "flow" => return Err(refused("above 0 to 1000000 g/s")),
                    _ if number.is_finite() => Target::Speed(number),
                    _ => return Err(refused("a finite speed in mm/s")),
                }
            }
        });
    }
    target.ok_or_else(|| {
        let misspelt = |key| section.misspelt(key, TARGETS);
        if let Some(refusal) = KEYS.split(' ').find_map(misspelt) {
            return refusal;
        }
        let cause = format!("{} says nothing", section.path(""));
        Refusal::new(cause, format!("give {TARGETS}"))
    })
}

/// A track of two or three tones: k of the first, then amplitude (e) and phase (th) in degrees.
fn read_tones(value: &Value) -> Result<Target, String> {
    let accepted = "[k, e, degrees] or [k, e, degrees, e3, degrees]: k 0.02..10, e 0..0.5, and the tone's phase, -360..360 degrees";
    let list = value.as_array();
    let numbers: Option<Vec<f64>> = list.and_then(|list| list.iter().map(number).collect());
    let (k, tones) = match numbers.as_deref() {
        Some(&[k, e, th]) => (k, [[e, th], [0.0; 2]]),
        Some(&[k, e, th, e3, th3]) => (k, [[e, th], [e3, th3]]),
        _ => return Err(accepted.into()),
    };
    if !(0.02..=10.0).contains(&k) {
        return Err(accepted.into());
    }
    let tone = |[ratio, degrees]: [f64; 2]| {
        if !(0.0..=0.5).contains(&ratio) || !(-360.0..=360.0).contains(&degrees) {
            return Err(accepted.to_string());
        }
        if degrees != 0.0 && degrees.abs() < std::f64::consts::TAU {
            let meant = format!("{:.1} degrees", degrees.to_degrees());
            return Err(format!("{accepted}; {degrees} rad would be {meant}"));
        }
        Ok(UpperTone::new(ratio as f32, degrees.to_radians() as f32))
    };
    let [second, third] = tones;
    Ok(Target::Tones {
        k: k as f32,
        shape: Shape::new(tone(second)?, tone(third)?),
    })
}

pub(crate) fn read_disturbances(
    root: &mut Section,
    duration: f32,
) -> Result<Disturbances, Refusal> {
    let Some(value) = root.take("disturbance") else {
        return Ok(Disturbances::new());
    };
    let tables = match value {
        Value::Array(tables) if tables.len() <= DISTURBANCES => tables,
        other => {
            let accepted = format!("at most {DISTURBANCES} tables [[disturbance]]");
            return Err(root.refuse("disturbance", &other, &accepted));
        }
    };
    let mut read = Vec::new();
    for (n, table) in tables.into_iter().enumerate() {
        let Value::Table(table) = table else {
            return Err(root.refuse("disturbance", &table, "tables [[disturbance]]"));
        };
        let mut section = Section::new(&format!("disturbance {}", n + 1), table);
        read.push(read_disturbance(&mut section, duration)?);
    }
    read.sort_by(|a, b| a.at.total_cmp(&b.at));
    Ok(read.into_iter().collect())
}

/// The change of one key of a `[[disturbance]]`, without its time, such as `gain = 0.8`; refused
/// with the key, the value and the accepted range.
pub fn change(mut table: Table) -> Result<Change, Refusal> {
    table.insert("at".into(), Value::Float(0.0));
    let mut section = Section::new("change", table);
    Ok(read_disturbance(&mut section, 0.0)?.change)
}

fn read_disturbance(section: &mut Section, duration: f32) -> Result<Disturbance, Refusal> {
    let accepted = format!("0..{duration} s, which is the duration");
    let at = section.number("at", 0.0..=duration, &accepted)?;
    let mut changes = Vec::new();
    for (field, change) in CHANGES {
        if section.has(field.key) {
            let mut value = 0.0;
            section.field(field, &mut value)?;
            changes.push(change(value));
        }
    }
    if let Some(value) = section.take("parts") {
        let count = value.as_integer().and_then(|n| u8::try_from(n).ok());
        match count.filter(|count| usize::from(*count) <= PARTS) {
            Some(count) => changes.push(Change::Parts(count)),
            None => {
                let accepted = format!("0..{PARTS}, how many of the parts are on the track");
                return Err(section.refuse("parts", &value, &accepted));
            }
        }
    }
    for &(key, _, change) in FLAGS {
        match section.take(key) {
            Some(Value::Boolean(flag)) => changes.push(change(flag)),
            Some(other) => return Err(section.refuse(key, &other, "true or false")),
            None => {}
        }
    }
    if let Some(mut target) = section.optional("target")? {
        changes.push(Change::Target(read_target(&mut target)?));
        target.finish()?;
    }
    section.finish()?;
    let at = f64::from(at);
    if let [change] = changes[..] {
        return Ok(Disturbance { at, change });
    }
    let path = section.path("");
    let cause = format!("{path} has {} changes", changes.len());
    let next = format!("give exactly one of {}", section.requested[1..].join(", "));
    Err(Refusal::new(cause, next).of_key(path))
}
