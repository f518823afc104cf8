//! The parts of a scene: a list, or drawn from a distribution.

use kband::arithmetic::Noise;
use kband::feeder::Restitution;
use kband_plant::{PARTS, Scene};
use toml::Value;

use super::fields::{ACTUAL_RESTITUTION, Field};
use super::section::{Section, pair};
use crate::refusal::Refusal;

/// A distribution of restitution.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Distribution {
    /// Uniform between two bounds.
    Uniform {
        /// Low bound.
        low: f32,
        /// High bound.
        high: f32,
    },
    /// Normal; values outside 0..1 are drawn again.
    Normal {
        /// Mean.
        mean: f32,
        /// Standard deviation.
        deviation: f32,
    },
}

impl Distribution {
    fn draw(self, noise: &mut Noise) -> f32 {
        match self {
            Self::Uniform { low, high } => low + (high - low) * noise.uniform(),
            Self::Normal { mean, deviation } => {
                for _ in 0..64 {
                    // Box and Muller (1958); the uniform number is below 1.
                    let radius = (-2.0 * f64::from(1.0 - noise.uniform()).ln()).sqrt();
                    let angle = std::f64::consts::TAU * f64::from(noise.uniform());
                    let drawn = mean + deviation * (radius * angle.cos()) as f32;
                    if (0.0..=1.0).contains(&drawn) {
                        return drawn;
                    }
                }
                mean
            }
        }
    }

    /// Draws the parts of a scene.
    pub fn draw_parts(self, scene: &mut Scene, noise: &mut Noise) {
        for part in &mut scene.parts {
            *part = self.draw(noise);
        }
    }
}

/// Restitutions spread evenly over a lot, its ends included; one if they are equal.
pub fn restitutions(lot: Restitution, count: usize) -> Vec<f64> {
    let (low, high) = (lot.low(), lot.high());
    if low == high {
        return vec![low];
    }
    let last = count.saturating_sub(1) as f64;
    let part = |n: usize| low + (high - low) * n as f64 / last;
    (0..count).map(part).collect()
}

/// Parts with the same colour in a picture.
#[derive(Clone, Debug, PartialEq)]
pub struct PartGroup {
    /// Name in the legend.
    pub name: String,
    /// Numbers of the parts, from 0.
    pub parts: Vec<u8>,
}

const MAX_COLOURED_KINDS: usize = 4;

/// Groups of parts for a picture, by ascending restitution. A few parts have a group each.
pub fn part_group(restitutions: &[f32]) -> Vec<PartGroup> {
    let mut numbers: Vec<u8> = (0..restitutions.len() as u8).collect();
    let value = |part: u8| restitutions[usize::from(part)];
    if restitutions.len() < 2 {
        let (name, parts) = ("impacts of the part".into(), numbers);
        return vec![PartGroup { name, parts }];
    }
    numbers.sort_by(|&a, &b| value(a).total_cmp(&value(b)));
    let group = |parts: &[u8]| {
        let (low, high) = (value(parts[0]), value(parts[parts.len() - 1]));
        let name = match parts {
            [part] => format!("part {}, R {low}", part + 1),
            _ if low == high => format!("{} parts, R {low}", parts.len()),
            _ => format!("{} parts, R {low}..{high}", parts.len()),
        };
        let parts = parts.into();
        PartGroup { name, parts }
    };
    let size = numbers.len().div_ceil(MAX_COLOURED_KINDS);
    numbers.chunks(size).map(group).collect()
}

/// Random stream for drawing the parts, separate from the scene's noise.
const PARTS_RANDOM_STREAM: u64 = 0x7061_7274;

/// Reads `part.actual` into the scene; returns the distribution, if it is one.
pub(crate) fn read(
    part: &Section,
    value: &Value,
    scene: &mut Scene,
) -> Result<Option<Distribution>, Refusal> {
    let [low, high] = ACTUAL_RESTITUTION;
    let accepted = format!(
        "1 to {PARTS} restitutions, each {low}..{high}, such as [0.19, 0.21], or a distribution such as \
         {{ count = 20, distribution = \"normal\", mean = 0.2, deviation = 0.01 }}"
    );
    let list = match value {
        Value::Array(list) if (1..=PARTS).contains(&list.len()) => list.clone(),
        Value::Float(_) | Value::Integer(_) => vec![value.clone()],
        Value::Table(table) => {
            let mut section = Section::new("part.actual", table.clone());
            let distribution = distribution(&mut section, scene)?;
            distribution.draw_parts(scene, &mut Noise::new(scene.seed ^ PARTS_RANDOM_STREAM));
            return Ok(Some(distribution));
        }
        _ => return Err(part.refuse("actual", value, &accepted)),
    };
    let restitution = |item| part.within("actual", item, low..=high, &accepted);
    scene.parts = list.iter().map(restitution).collect::<Result<_, _>>()?;
    Ok(None)
}

/// Reads `part.friction`: one coefficient, or those of sliding and static friction.
pub(crate) fn read_friction(part: &Section, value: &Value) -> Result<[f32; 2], Refusal> {
    let accepted =
        "0..10, or [sliding, sticking] with the second at least the first, as 0.3 or [0.3, 0.35]";
    let pair = pair(value).map(|(sliding, sticking)| [sliding as f32, sticking as f32]);
    pair.filter(|[sliding, sticking]| *sliding >= 0.0 && (*sliding..=10.0).contains(sticking))
        .ok_or_else(|| part.refuse("friction", value, accepted))
}

/// One number for all parts, or a list with one for each; two phrases complete a refusal.
pub(crate) fn one_or_each<T: FromIterator<f32>>(
    part: &Section,
    field: &Field,
    value: &Value,
    scene: &Scene,
    [behind, end]: [&str; 2],
) -> Result<T, Refusal> {
    let ([low, high], parts) = (field.range, scene.parts.len());
    let accepted =
        format!("{low}..{high}{behind} or a list of one for each of the {parts} parts{end}");
    let read = |item| part.within(field.key, item, low..=high, &accepted);
    match value {
        Value::Array(list) if list.len() == parts => list.iter().map(read).collect(),
        Value::Array(_) => Err(part.refuse(field.key, value, &accepted)),
        one => {
            let one = read(one)?;
            Ok((0..parts).map(|_| one).collect())
        }
    }
}

/// Reads `part.hopper` into the scene: the number of parts that wait in the hopper.
pub(crate) fn read_hopper(part: &Section, value: &Value, scene: &mut Scene) -> Result<(), Refusal> {
    let all = scene.parts.len();
    let accepted = format!("0..{all}, how many of the {all} parts wait for a disturbance \"dump\"");
    let count = value.as_integer().and_then(|n| u8::try_from(n).ok());
    let count = count.filter(|count| usize::from(*count) <= all);
    scene.waiting = count.ok_or_else(|| part.refuse("hopper", value, &accepted))?;
    Ok(())
}

fn distribution(section: &mut Section, scene: &mut Scene) -> Result<Distribution, Refusal> {
    let max_count = PARTS as f32;
    let count = section.number("count", 1.0..=max_count, &format!("1..{PARTS} parts"))?;
    scene.parts = core::iter::repeat_n(0.0, count as usize).collect();
    let kinds = "\"uniform\" with low and high, or \"normal\" with mean and deviation";
    let kind = section.take("distribution");
    let kind = kind.ok_or_else(|| section.missing("distribution", kinds))?;
    let unit = "0..1";
    let distribution = match kind.as_str() {
        Some("uniform") => Distribution::Uniform {
            low: section.number("low", 0.0..=1.0, unit)?,
            high: section.number("high", 0.0..=1.0, unit)?,
        },
        Some("normal") => Distribution::Normal {
            mean: section.number("mean", 0.0..=1.0, unit)?,
            deviation: section.number("deviation", 0.0..=0.5, "0..0.5")?,
        },
        _ => return Err(section.refuse("distribution", &kind, kinds)),
    };
    section.finish()?;
    Ok(distribution)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The pictures of the manual have the groups of many parts.
    #[test]
    fn a_few_parts_have_own_names_by_restitution() {
        let [first, second] = &part_group(&[0.22, 0.18])[..] else {
            panic!("two groups");
        };
        assert_eq!(first.name, "part 2, R 0.18");
        assert_eq!(second.name, "part 1, R 0.22");
    }

    #[test]
    fn a_normal_draw_has_its_moments_and_stays_within_0_and_1() {
        let normal = Distribution::Normal {
            mean: 0.2,
            deviation: 0.02,
        };
        let mut noise = Noise::new(3);
        let drawn = (0..20_000).map(|_| normal.draw(&mut noise).into());
        let drawn: Vec<f64> = drawn.collect();
        let mean = drawn.iter().sum::<f64>() / 2e4;
        let square = drawn.iter().map(|r| (r - mean).powi(2)).sum::<f64>() / 2e4;
        // The tolerances are five standard errors: 1.4e-4 of the mean, 0.5 % of the deviation.
        assert!((mean - 0.2).abs() < 7e-4, "{mean}");
        assert!((square.sqrt() - 0.02).abs() < 5e-4);
        let edge = Distribution::Normal {
            mean: 0.0,
            deviation: 0.5,
        };
        assert!((0..1000).all(|_| (0.0..=1.0).contains(&edge.draw(&mut noise))));
    }
}
