//! The parts of a scene, and their common quantities.

use super::part::Part;
use super::scene::{Change, PARTS, Scene};
use heapless::Vec;
use kband::arithmetic::Noise;
use kband::feeder::OutOfRange;
use kband::impact::Scatter;

/// Largest number of impacts stored per cycle.
pub(crate) const MAX_STRIKES: usize = 96;

/// Seed offset of the restitutions, which separates their streams from the noise.
const RESTITUTION_SEED: u64 = 0x7363_6174;

/// Parts of a scene, each with its own stream of restitutions.
pub(crate) fn all_at_rest(scene: &Scene) -> Result<Vec<Part, PARTS>, OutOfRange> {
    let parts = restitutions(scene).map(|drawn| Ok(Part::at_rest(drawn?)));
    parts.collect()
}

pub(crate) fn restitutions(scene: &Scene) -> impl Iterator<Item = Result<Scatter, OutOfRange>> {
    let mut seeds = Noise::new(scene.seed ^ RESTITUTION_SEED);
    let parts = scene.parts.iter().enumerate();
    parts.map(move |(n, &restitution)| {
        let deviation = scene.scatter.get(n).copied().unwrap_or(0.0);
        let seed = u64::from(seeds.bits()) << 32 | u64::from(seeds.bits());
        Scatter::build(restitution.into(), deviation.into(), seed)
    })
}

/// Applies a change to a part's restitution; a value out of range is rejected.
pub(crate) fn change_restitution(restitution: &mut Scatter, change: Change) {
    let changed = match change {
        Change::Restitution(mean) => restitution.with_mean(mean.into()),
        Change::Scatter(deviation) => restitution.with_deviation(deviation.into()),
        _ => return,
    };
    if let Ok(changed) = changed {
        *restitution = changed;
    }
}

pub(crate) fn mean(displacements: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = displacements.len().max(1);
    displacements.sum::<f64>() / count as f64
}
