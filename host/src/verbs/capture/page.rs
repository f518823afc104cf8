//! What came of a plan, as table and JSON.

use kband::regime::capture::{KickSettings, Plan, ScoredKick};

use super::Task;
use super::draws::Rates;
use super::kicks::Kicks;
use crate::refusal::Refusal;
use crate::report::{Printout, columns, fields, number};

fn spelled(kick: KickSettings) -> String {
    let mut words = format!("factor {} for {} cycles", number(kick.factor, 4), kick.hold);
    if kick.descent > 0 {
        words.push_str(&format!(
            ", falling to {} within {} more",
            number(kick.release, 4),
            kick.descent
        ));
    }
    words
}

/// A kick, and the share of parts that it or those before it captured.
struct Tried {
    attempt: String,
    kick: KickSettings,
    share: f64,
}

impl Tried {
    fn of(attempt: impl Into<String>, kick: KickSettings, share: f64) -> Self {
        Self {
            attempt: attempt.into(),
            kick,
            share,
        }
    }
}

fields! {
    fn tried(of: Tried) {
        read ATTEMPT => of.attempt.clone();
        all FACTOR.digits(4) => f64::from(of.kick.factor);
        all HOLD => u32::from(of.kick.hold);
        all DESCENT => u32::from(of.kick.descent);
        all RELEASE.digits(4) => f64::from(of.kick.release);
        read CAPTURED.titled("captured so far").digits(4) => of.share;
        data SHARE => of.share;
    }
}

pub(super) fn report(
    task: &Task<'_>,
    plan: &Plan,
    map: &Kicks,
    rates: &Rates,
) -> Result<Printout, Refusal> {
    let kicks: Vec<KickSettings> = (0..task.arguments.attempts)
        .filter_map(|attempt| plan.attempt(attempt as u32))
        .map(|kick| kick.settings())
        .collect();
    let none = KickSettings {
        factor: 1.0,
        hold: 0,
        descent: 0,
        release: 1.0,
    };
    let mut attempts = vec![Tried::of("band alone", none, rates.alone)];
    for (n, (kick, rate)) in kicks.iter().zip(&rates.by_attempt).enumerate() {
        attempts.push(Tried::of((n + 1).to_string(), *kick, *rate));
    }
    let mut report = tried().printout(&attempts).heading(format!(
        "R = {}, order {}, k = {:.4} in the band {:.4}..{:.4}; {} runs, seed {}",
        task.restitution(),
        task.lot.order,
        task.lot.k,
        task.band.low(),
        task.band.high(),
        task.arguments.runs,
        task.arguments.seed
    ));
    report = match plan.best() {
        Some(best) => report.note(format!(
            "best planned kick: {}; it captured {} of {} parts",
            spelled(best.kick.settings()),
            best.locked,
            best.tried
        )),
        None if plan.effort() < task.arguments.effort as u32 => report.note(format!(
            "no kick of the plan captured a part, and every kick up to {} times the amplitude was tried: choose \
             another k or --order",
            task.arguments.limit
        )),
        None => report.note("no kick of the plan captured a part: raise --effort"),
    };
    report = report.note(format!(
        "the plan took {} impacts and {} set-ups of the map ({} of {} of effort), {} kicks tried",
        plan.impacts,
        plan.set_ups,
        plan.effort(),
        task.arguments.effort,
        plan.kicks
    ));
    let kick_alone = tried().without(columns::SHARE);
    let kick = |kick: KickSettings| kick_alone.object(&Tried::of("", kick, 0.0));
    let cells: Vec<Tried> = (map.cells().into_iter())
        .map(|(kick, share)| Tried::of("", kick, share))
        .collect();
    let report = report.json(&serde_json::json!({
        "restitution": [task.lot.restitution.low(), task.lot.restitution.high()],
        "order": task.lot.order,
        "k": task.lot.k,
        "band": [task.band.low(), task.band.high()],
        "best": plan.best().map(|best: ScoredKick| serde_json::json!({
            "kick": kick(best.kick.settings()),
            "tried": best.tried,
            "locked": best.locked,
        })),
        "plan": {
            "impacts": plan.impacts,
            "set_ups": plan.set_ups,
            "effort": plan.effort(),
            "kicks": plan.kicks,
            "attempts": kicks.into_iter().map(kick).collect::<Vec<_>>(),
        },
        "runs": task.arguments.runs,
        "seed": task.arguments.seed,
        "captured_alone": rates.alone,
        "captured": rates.by_attempt,
        "map": cells.iter().map(|cell| tried().object(cell)).collect::<Vec<_>>(),
    }))?;
    Ok(report.csv_of(tried().table_of(&cells)))
}
