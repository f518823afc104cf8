//! Bisection for the edge of an interval in which a condition holds.

/// Halves the interval between a place where `holds` is true and one where it is not.
pub(crate) fn bisect(
    inside: f64,
    outside: f64,
    halvings: u32,
    holds: impl Fn(f64) -> bool,
) -> [f64; 2] {
    let (mut inside, mut outside) = (inside, outside);
    for _ in 0..halvings {
        let middle = 0.5 * (inside + outside);
        let end = if holds(middle) {
            &mut inside
        } else {
            &mut outside
        };
        *end = middle;
    }
    [inside, outside]
}
