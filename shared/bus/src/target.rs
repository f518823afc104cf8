//! A target as two registers' content: its kind and its number.

use kband_control::Target;

/// Largest order of a gear or a lock.
const MAX_ORDER: u16 = 8;
/// Kind of gear of order 0; the order is added.
const GEAR: u16 = 0;
/// Kind of a lock of order 0; the order is added.
const LOCK: u16 = 16;
const K: u16 = 32;
/// Kind of a target amplitude in mm.
const AMPLITUDE: u16 = 33;
/// Kind of a target speed in mm/s.
const SPEED: u16 = 34;
/// Kind of a target flow in g/s.
const FLOW: u16 = 35;
/// Kind of a target in parts a minute.
const PARTS: u16 = 36;
const CHAOS: u16 = 48;

/// Kind and number of a target. Targets that only the desk sets are of kind 0.
pub fn encode(target: Target) -> (u16, f32) {
    match target {
        Target::Gear { order } => (GEAR + u16::from(order), 0.0),
        Target::Locked { order } => (LOCK + u16::from(order), 0.0),
        Target::K(k) => (K, k),
        Target::Amplitude(amplitude) => (AMPLITUDE, amplitude),
        Target::Speed(speed) => (SPEED, speed),
        Target::Flow(flow) => (FLOW, flow),
        Target::PartsPerMinute(rate) => (PARTS, rate),
        Target::Chaotic => (CHAOS, 0.0),
        Target::Identify | Target::Tones { .. } => (0, 0.0),
    }
}

/// Whether targets of this kind have a number.
pub fn has_number(kind: u16) -> bool {
    (K..CHAOS).contains(&kind)
}

/// The target of this kind and number; `None` without one. Some kinds ignore the number.
pub fn decode(kind: u16, number: f32) -> Option<Target> {
    let order = |base: u16| {
        let order = kind.checked_sub(base)?;
        (1..=MAX_ORDER).contains(&order).then_some(order as u8)
    };
    if let Some(order) = order(GEAR) {
        return Some(Target::Gear { order });
    }
    if let Some(order) = order(LOCK) {
        return Some(Target::Locked { order });
    }
    match kind {
        CHAOS => Some(Target::Chaotic),
        _ if !number.is_finite() => None,
        K => Some(Target::K(number)),
        AMPLITUDE => Some(Target::Amplitude(number)),
        SPEED => Some(Target::Speed(number)),
        FLOW => Some(Target::Flow(number)),
        PARTS => Some(Target::PartsPerMinute(number)),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kind_comes_back() {
        let mut known = 0;
        for kind in 0..=u16::MAX {
            if let Some(target) = decode(kind, 0.5) {
                known += 1;
                let number = if has_number(kind) { 0.5 } else { 0.0 };
                assert_eq!(encode(target), (kind, number));
            }
        }
        assert_eq!(known, 8 + 8 + 5 + 1);
        for invalid in [f32::NAN, f32::INFINITY] {
            assert!((32..48).all(|kind| decode(kind, invalid).is_none()));
        }
    }
}
