//! The estimated margin of gear against the plant's own.

use core::f64::consts::TAU;

use kband::regime::gear::{GearWatch, is_in_gear};
use kband_control::{GearMargin, Shape, Target, UpperTone};
use kband_plant::{EnvelopeLoop, Scene};

/// Parts evenly over a lot, at a fixed k, with a second tone of ratio e and angle th.
struct Lot {
    restitution: [f32; 2],
    scatter: f32,
    parts: usize,
    k: f32,
    tone: [f32; 2],
}

/// True values of the plant from 5 s to 60 s, over flights in gear from the eighth in a row on.
///
/// Also the drive cycles in gear, and the losses.
#[derive(Debug)]
struct Truth {
    trace: f64,
    restitution: f64,
    cycles: f64,
    losses: f64,
}

const CYCLES: usize = 3000;
const SETTLED: usize = 250;

fn scene(lot: &Lot, seed: u64) -> Scene {
    let [low, high] = lot.restitution;
    let part = |n: usize| low + (high - low) * (n as f32 + 0.5) / lot.parts as f32;
    let [ratio, phase] = lot.tone;
    let mut scene = Scene {
        target: Target::K(lot.k),
        seed,
        parts: (0..lot.parts).map(part).collect(),
        scatter: core::iter::repeat_n(lot.scatter, lot.parts).collect(),
        ..Scene::default()
    };
    let settings = &mut scene.settings;
    settings.scatter = lot.scatter;
    (settings.restitution_low, settings.restitution_high) = (low, high);
    if ratio > 0.0 {
        settings.second_tone = ratio;
        scene.drive.second_gain = settings.second_gain;
        scene.drive.second_lag = settings.second_lag;
        scene.target = Target::Tones {
            k: lot.k,
            shape: Shape {
                second: UpperTone { ratio, phase },
                ..Shape::default()
            },
        };
    }
    scene
}

/// True values, last estimate, and number of cycles after 10 s with an estimate.
fn listen(lot: &Lot, seed: u64) -> (Truth, GearMargin, usize) {
    let scene = scene(lot, seed);
    let mut closed = EnvelopeLoop::build(&scene).unwrap();
    let mut watches = std::vec![(GearWatch::build(1).unwrap(), 0, 0.0); lot.parts];
    let [ratio, angle] = lot.tone.map(f64::from);
    let (mut told, mut last) = (0, GearMargin::default());
    let (mut traces, mut restitutions, mut count) = (0.0, 0.0, 0.0);
    for cycle in 0..CYCLES {
        if cycle == SETTLED {
            for (watch, ..) in &mut watches {
                watch.begin(cycle as f64 * TAU);
            }
        }
        let report = closed.cycle().report;
        for strike in closed.strikes() {
            let landed = strike.time as f64 / 4_294_967_296.0 * TAU;
            let flight = f64::from(strike.flight) * TAU;
            let (watch, row, launched) = &mut watches[usize::from(strike.part)];
            if strike.rested {
                watch.add_rest(landed - flight);
            }
            watch.add_landing(landed, flight);
            let geared = is_in_gear(flight, TAU) && !strike.rested;
            *row = if geared { *row + 1 } else { 0 };
            let restitution = f64::from(scene.parts[usize::from(strike.part)]);
            // Of the impact that began this flight in gear.
            if *row >= 8 && cycle >= SETTLED {
                traces += *launched;
                restitutions += restitution;
                count += 1.0;
            }
            let bend = strike.phase.sin() + 4.0 * ratio * (2.0 * strike.phase + angle).sin();
            let squeezed = (1.0 + restitution) * (1.0 + restitution);
            *launched = 1.0 + restitution * restitution - squeezed * bend / f64::from(report.k);
        }
        if cycle >= 500
            && let Some(margin) = report.margin
        {
            told += 1;
            last = margin;
        }
    }
    let shares = watches
        .iter()
        .map(|(watch, ..)| watch.share(CYCLES as f64 * TAU));
    let all = shares.reduce(|one, other| one.plus(&other)).unwrap();
    let cycles = all.share() * (lot.parts * (CYCLES - SETTLED)) as f64;
    let truth = Truth {
        trace: traces / count,
        restitution: restitutions / count,
        cycles,
        losses: all
            .time_to_loss()
            .map_or(0.0, |cycles_each| cycles / cycles_each),
    };
    (truth, last, told)
}

/// Row of the manual's table: true and estimated values of one part and of six.
fn row(lot: &Lot, found: &[(Truth, GearMargin); 2]) -> String {
    let [low, high] = lot.restitution;
    let restitution = if low == high {
        std::format!("{low}")
    } else {
        std::format!("{low}..{high}")
    };
    let [ratio, angle] = lot.tone;
    let tone = if ratio > 0.0 {
        std::format!("{ratio}, {angle}")
    } else {
        "-".into()
    };
    let each = |of: &dyn Fn(&Truth, &GearMargin) -> std::string::String| {
        found
            .each_ref()
            .map(|(truth, told)| of(truth, told))
            .join(" | ")
    };
    // No sign before a zero.
    let signed = |value: f64, digits: usize| {
        let shown = std::format!("{value:+.digits$}");
        let is_zero = shown.trim_start_matches(['+', '-', '0', '.']).is_empty();
        if is_zero { shown[1..].into() } else { shown }
    };
    std::format!(
        "| {restitution} | {:.2} | {} | {tone} | {} | {:.2} | {} | {:.3} | {} |",
        lot.scatter,
        lot.k,
        each(&|truth, told| std::format!(
            "{} ({:.3})",
            signed(f64::from(told.restitution) - truth.restitution, 3),
            told.error
        )),
        found[0].0.trace,
        each(&|truth, told| signed(f64::from(told.trace) - truth.trace, 2)),
        found[0].1.scatter,
        each(&|truth, told| std::format!(
            "{:.0} of {:.0}",
            told.to_loss,
            truth.cycles / truth.losses.max(1.0)
        )),
    )
}

/// Compares the rows with the table of tests/real_parts.md; `KBAND_ACCEPT=1` writes it.
fn print(rows: &[String]) {
    const MARKER: &str = "<!-- test: estimated_margin_matches_the_plant -->\n";
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/real_parts.md");
    let page = std::fs::read_to_string(path).unwrap();
    let (before, after) = page.split_once(MARKER).unwrap();
    let mut lines = after.split_inclusive('\n');
    let head: String = lines.by_ref().take(2).collect();
    let printed = lines.take_while(|line| line.starts_with('|'));
    let printed: String = printed.collect();
    let made = rows.join("\n") + "\n";
    if printed != made && std::env::var_os("KBAND_ACCEPT").is_some_and(|accept| accept == "1") {
        let rest = &after[head.len() + printed.len()..];
        std::fs::write(path, [before, MARKER, &head, &made, rest].concat()).unwrap();
    } else {
        assert_eq!(printed, made);
    }
}

#[test]
fn estimated_margin_matches_the_plant() {
    let mut rows = std::vec::Vec::new();
    for (restitution, scatter, k, tone) in [
        ([0.2, 0.2], 0.05, 0.403, [0.0, 0.0]),
        ([0.3, 0.3], 0.05, 0.4438, [0.0, 0.0]),
        ([0.4, 0.4], 0.05, 0.5, [0.0, 0.0]),
        ([0.25, 0.25], 0.04, 0.42, [0.0, 0.0]),
        ([0.3, 0.3], 0.10, 0.4438, [0.0, 0.0]),
        ([0.1, 0.3], 0.03, 0.383, [0.0, 0.0]),
        ([0.2, 0.2], 0.05, 0.32, [0.14, 2.5]),
        ([0.3, 0.3], 0.05, 0.402, [0.15, 2.48]),
        ([0.3, 0.3], 0.10, 0.39, [0.17, 2.65]),
        ([0.5, 0.5], 0.10, 0.59, [0.23, 2.65]),
    ] {
        let lot = |parts| Lot {
            restitution,
            scatter,
            parts,
            k,
            tone,
        };
        let found = [1, 6].map(|parts| {
            let (truth, told, cycles) = listen(&lot(parts), 3);
            let what =
                std::format!("{restitution:?} {scatter} {tone:?} {parts}: {truth:?} {told:?}");
            assert!(cycles > 2400, "{what}: told in {cycles} cycles");
            let apart = (f64::from(told.restitution) - truth.restitution).abs();
            assert!(apart < 3.0 * f64::from(told.error), "{what}");
            assert!(told.error < 0.02, "{what}");
            assert!((told.scatter / scatter - 1.0).abs() < 0.15, "{what}");
            let longest = truth.cycles / truth.losses.max(1.0);
            // In gear for a dozen flights a row, one part has few of them in a minute, unlike
            // many parts.
            let within = if longest > 15.0 { 0.12 } else { 0.35 };
            assert!(
                (f64::from(told.trace) - truth.trace).abs() < within,
                "{what}"
            );
            let determinant = told.restitution * told.restitution;
            assert!(
                (told.flip - 1.0 - determinant - told.trace).abs() < 1e-5,
                "{what}"
            );
            // Three standard errors of the counted losses, and a tenth.
            let to_loss = f64::from(told.to_loss);
            let most = 1.1 + 3.0 / truth.losses.max(1.0).sqrt();
            assert!(
                truth.losses < 10.0 && to_loss > 500.0
                    || to_loss < longest * most && longest < to_loss * most,
                "{what}"
            );
            (truth, told)
        });
        rows.push(row(&lot(1), &found));
    }
    print(&rows);
}
