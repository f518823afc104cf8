//! The golden impacts (25 digits) against the map in f64.

use kband::impact::{Kernel, Map};

#[test]
fn every_golden_impact_has_the_right_root() {
    let text = include_str!("../reference/impacts.csv");
    let mut worst = 0.0_f64;
    for line in text.lines().skip(1) {
        let fields: Vec<&str> = line.split(',').collect();
        let number = |n: usize| fields[n].parse::<f64>().unwrap();
        let map = Map::build(number(1), number(2)).unwrap();
        let impact = map.impact(Map::state(number(3), number(4)).unwrap());
        let error = (impact.flight / number(5) - 1.0).abs();
        if number(8) < 100.0 {
            worst = worst.max(error);
            assert!(error < 1e-12, "{line}: {}", impact.flight);
        }
    }
    println!("worst relative flight error {worst:e}");
}
