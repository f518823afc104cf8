//! A target as two registers' content: its kind and its number.

use kband_control::Target;

// Kinds of targets: the order of a gear, this plus the order of a lock, or one of these.
const LOCK: u16 = 16;
const K: u16 = 32;
const AMPLITUDE: u16 = 33;
const SPEED: u16 = 34;
const FLOW: u16 = 35;
const PARTS: u16 = 36;
const CHAOS: u16 = 48;

/// Kind and number of a target. Targets that only the desk sets are of kind 0.
pub fn encode(target: Target) -> (u16, f32) {
    match target {
        Target::Gear { order } => (order.into(), 0.0),
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
    match kind {
        1..=8 => Some(Target::Gear { order: kind as u8 }),
        17..=24 => Some(Target::Locked {
            order: (kind - LOCK) as u8,
        }),
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
