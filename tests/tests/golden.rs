//! Golden impacts and hops (25 digits), on one and on several tones, compared with the map in f64.

use kband::arithmetic::Twofold;
use kband::impact::{Impact, Kernel, Map, PartState, Tone, WaveKernel, WaveMap};
use kband_tests::exact;
use kband_tests::states::{Kind, Random};

struct Golden {
    k: f64,
    restitution: f64,
    state: PartState,
    flight: f64,
    next_phase: Option<&'static str>,
    next_velocity: f64,
    condition: f64,
}

impl Golden {
    /// Whether an impact has the right root; true if its digits were checked, too.
    fn check(&self, impact: Impact<PartState>) -> bool {
        let Self { flight, state, .. } = *self;
        // The right root at any condition number, because another one is at least 1e-3 away.
        let error = (impact.flight / flight - 1.0).abs();
        assert!(error < 1e-6, "{state:?}: {flight} {impact:?}");
        if self.condition >= 100.0 {
            return false;
        }
        // Six roundings of 1.1e-16, times a condition number of up to 100; 1e-12 includes a factor
        // of 10.
        assert!(error < 1e-12, "{state:?}: {flight} {impact:?}");
        let error = (impact.next.velocity - self.next_velocity).abs();
        let room = 1e-12 * self.next_velocity.max(1e-3 * flight);
        assert!(error <= room, "{state:?}: {impact:?}");
        if let Some(phase) = self.next_phase {
            let error = (impact.next.phase - number(phase)).abs();
            assert!(error < 1e-12 * flight.max(1.0), "{state:?}: {impact:?}");
        }
        true
    }
}

fn number(text: &str) -> f64 {
    text.parse().unwrap()
}

fn rows(table: &'static str) -> impl Iterator<Item = Vec<&'static str>> {
    let rows = table.lines().skip(1);
    rows.map(|line| line.split(',').skip(1).collect())
}

fn impact(field: Vec<&'static str>) -> Golden {
    Golden {
        k: number(field[0]),
        restitution: number(field[1]),
        state: Map::state(number(field[2]), number(field[3])).unwrap(),
        flight: number(field[4]),
        next_phase: Some(field[5]),
        next_velocity: number(field[6]),
        condition: number(field[7]),
    }
}

fn hops() -> impl Iterator<Item = Golden> {
    rows(include_str!("../reference/hops.csv")).map(|field| {
        let [k, restitution, phase, velocity, flight, next_velocity] =
            [0, 1, 2, 3, 4, 5].map(|n| number(field[n]));
        Golden {
            k,
            restitution,
            state: Map::state(phase, velocity).unwrap(),
            flight,
            next_phase: None,
            next_velocity,
            condition: flight * restitution / next_velocity,
        }
    })
}

#[test]
fn every_golden_impact_has_the_right_root() {
    let exact = |golden: &Golden| {
        let map = Map::build(golden.k, golden.restitution).unwrap();
        golden.check(map.impact(golden.state))
    };
    let impacts = rows(include_str!("../reference/impacts.csv")).map(impact);
    let counted = impacts.chain(hops()).filter(exact).count();
    assert!(counted > 2_500, "{counted}");
}

#[test]
fn every_golden_impact_on_tones_has_the_right_root() {
    let mut counted = 0;
    for mut field in rows(include_str!("../reference/tones.csv")) {
        let tones: Vec<f64> = field.drain(2..6).map(number).collect();
        let tones = [Tone::new(tones[0], tones[1]), Tone::new(tones[2], tones[3])];
        let golden = impact(field);
        let map = WaveMap::on_tones(tones, golden.k, golden.restitution).unwrap();
        counted += u32::from(golden.check(map.impact(golden.state)));
    }
    assert!(counted > 1_250, "{counted}");
}

/// Residual of the f64 map in roundings of the gap's terms, against 30 digits of the oracle.
#[test]
fn the_residual_of_f64_is_within_four_roundings() {
    for kind in [Kind::High, Kind::Low, Kind::Chatter, Kind::Edge] {
        let mut random = Random::new(77);
        let mut count = 0;
        for _ in 0..40_000 {
            let launch = kind.draw(&mut random);
            let map = Map::build(launch.track.k, 1.0).unwrap();
            let impact = map.impact(launch.state());
            if impact.grazes || impact.flight == 0.0 || impact.next.velocity == 0.0 {
                continue;
            }
            let Some(exact) = exact::refine(&map, launch.state()) else {
                continue;
            };
            let off = Twofold::from(impact.flight).minus(exact.flight).value();
            // Half an ulp of the flight, and of each term of the gap.
            let gap = launch.rounding(impact.flight);
            let rounding = gap + 0.5 * f64::EPSILON * impact.flight * exact.arrival;
            let roundings = off.abs() * exact.arrival / rounding;
            count += 1;
            let what = || format!("{kind:?} {roundings}: {launch:?} {impact:?} {exact:?}");
            assert!(roundings <= 4.0, "{}", what());
        }
        assert!(count > 20_000, "{kind:?}: {count}");
    }
}
