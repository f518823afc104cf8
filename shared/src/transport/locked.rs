//! Conveying speed of locked parts in closed form (equations 20 to 23 and 37;
//! docs/theory-transport.md#t8.3).

use core::f64::consts::PI;

use crate::arithmetic::sine_cosine;
use crate::impact::TangentialSettings;
use crate::regime::Lock;

/// Velocity along the track of a locked part in units of `b w` (equation 20):
/// `W = eta cos(t0 + gamma) - pi r k tan(alpha) (1 + Rt)/(1 - Rt)`.
///
/// With a contact time (docs/theory-real-parts.md#t10.6) it is the mean over flight and contact.
/// The velocity relative to the track changes evenly during the contact. It grows if the track
/// accelerates the part along itself after the contact's force has ended.
pub fn velocity(lock: &Lock, k: f64, settings: &TangentialSettings) -> f64 {
    if !lock.contact.is_instant() {
        return velocity_with_contact(lock, k, settings);
    }
    let (_, cosine) = sine_cosine(lock.state().phase + settings.phase_lead);
    settings.amplitude_ratio * cosine - incline_loss(lock.order(), k, settings)
}

fn velocity_with_contact(lock: &Lock, k: f64, settings: &TangentialSettings) -> f64 {
    let (rt, eta) = (settings.restitution, settings.amplitude_ratio);
    let period = 2.0 * PI * f64::from(lock.order());
    let contact = lock.contact.radians();
    let flight = period - contact;
    let phases = [lock.state().phase, lock.strike_phase()];
    let [(s0, c0), (s1, c1)] = phases.map(|phase| sine_cosine(phase + settings.phase_lead));
    let down = k * settings.incline_tangent;
    let gain = lock.contact.gain_along(lock.restitution());
    let gained = gain * (eta * s0 - down);
    let change = eta * (c0 - c1) - down * flight;
    let arrival = (change + gained) / (1.0 - rt);
    let departure = rt * arrival + gained;
    let flown = (departure + eta * c0 - 0.5 * down * flight) * flight - eta * (s1 - s0);
    (flown + 0.5 * (arrival + departure) * contact) / period
}

/// Velocity at gamma = 0 without the phase (equation 21), in units of `b w`:
/// `W = pi r k { eta (1-R)/(1+R) - tan(alpha) (1+Rt)/(1-Rt) }`. Restitution 0..1.
///
/// It is proportional to k, so `W b w` does not depend on the amplitude.
pub fn velocity_in_phase(
    order: u32,
    k: f64,
    restitution: f64,
    settings: &TangentialSettings,
) -> f64 {
    let drive = settings.amplitude_ratio * (1.0 - restitution) / (1.0 + restitution);
    PI * f64::from(order) * k * drive - incline_loss(order, k, settings)
}

/// Tangent of the incline at which a locked part has speed 0 (equation 23; at gamma = 0 equation
/// 22): `eta cos(t0 + gamma) (1 - Rt) / (pi r k (1 + Rt))`.
///
/// With a contact time it is where [`velocity`], which is linear in the tangent, is 0.
pub fn critical_slope(lock: &Lock, k: f64, settings: &TangentialSettings) -> f64 {
    if !lock.contact.is_instant() {
        let [level, steep] = [0.0, 1.0].map(|incline_tangent| {
            let settings = TangentialSettings {
                incline_tangent,
                ..*settings
            };
            velocity(lock, k, &settings)
        });
        return level / (level - steep);
    }
    let rt = settings.restitution;
    let (_, cosine) = sine_cosine(lock.state().phase + settings.phase_lead);
    settings.amplitude_ratio * cosine * (1.0 - rt) / (PI * f64::from(lock.order()) * k * (1.0 + rt))
}

/// Tangent of the critical incline at gamma = 0 (equation 22): `eta (1-R)(1-Rt) / ((1+R)(1+Rt))`.
/// It is the same for each order and k. Restitution 0..1.
pub fn critical_slope_in_phase(restitution: f64, settings: &TangentialSettings) -> f64 {
    let rt = settings.restitution;
    settings.amplitude_ratio * (1.0 - restitution) * (1.0 - rt) / ((1.0 + restitution) * (1.0 + rt))
}

/// Largest impact mean at gamma = 0 in units of `b w` (equation 37):
/// `eta (1 - tan(alpha)/tan(alpha_c))`. A locked part reaches it at k1. Restitution 0..1, below 1.
///
/// It bounds locked velocity and impact mean; the time mean can exceed it.
pub fn bound(restitution: f64, settings: &TangentialSettings) -> f64 {
    let rt = settings.restitution;
    let loss = (1.0 + restitution) * (1.0 + rt) / ((1.0 - restitution) * (1.0 - rt));
    settings.amplitude_ratio - settings.incline_tangent * loss
}

/// Velocity lost to the incline: `pi r k tan(alpha) (1 + Rt)/(1 - Rt)`.
fn incline_loss(order: u32, k: f64, settings: &TangentialSettings) -> f64 {
    let rt = settings.restitution;
    PI * f64::from(order) * k * settings.incline_tangent * (1.0 + rt) / (1.0 - rt)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::impact::ContactTime;

    /// Velocities of integrated contacts with Coulomb's friction, after 40 periods
    /// (docs/theory-real-parts.md#t10.6). The track is level with friction 0.2, inclined with 0.3,
    /// or led and inclined with 0.5. Friction that holds the part leaves it no velocity: Rt is 0.
    #[test]
    fn velocity_with_contact_is_that_of_an_integrated_contact() {
        let cases = [
            (0.25, [0.0, 0.0], 5e-4),
            (1.0, [0.0, 0.05], 2e-3),
            (2.0, [0.3, -0.05], 5e-3),
        ];
        for (k, restitution, order, exact) in [
            (0.43, 0.2, 1, [1.346_505, 1.266_736, 1.111_701]),
            (0.46, 0.2, 1, [1.441_174, 1.357_646, 1.271_594]),
            (0.56, 0.35, 1, [1.264_325, 1.158_809, 0.994_153]),
            (0.7, 0.5, 1, [1.091_367, 0.958_589, 0.773_763]),
            (0.23, 0.2, 2, [1.442_638, 1.363_258, 1.294_896]),
        ] {
            for ((percent, [phase_lead, incline_tangent], bound), exact) in
                cases.into_iter().zip(exact)
            {
                let contact = ContactTime::build(percent * 0.02 * PI).unwrap();
                let lock = Lock::with_contact(k, restitution, order, contact);
                let along = TangentialSettings {
                    restitution: 0.0,
                    amplitude_ratio: 1.5,
                    phase_lead,
                    incline_tangent,
                };
                let error = velocity(&lock.unwrap().unwrap(), k, &along) / exact - 1.0;
                assert!(libm::fabs(error) < bound, "{k} {percent}: {error}");
            }
        }
    }
}
