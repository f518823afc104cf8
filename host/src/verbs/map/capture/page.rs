//! Result of a plan, as table and JSON.

use kband::regime::capture::{KickSettings, Plan, ScoredKick};

use super::Task;
use super::draws::Rates;
use super::kicks::Kicks;
use crate::refusal::Refusal;
use crate::report::{Printout, columns, fields, number};

fn describe_kick(kick: KickSettings) -> String {
    let mut text = format!("factor {} for {} cycles", number(kick.factor, 4), kick.hold);
    if kick.descent > 0 {
        let (release, descent) = (number(kick.release, 4), kick.descent);
        text += &format!(", falling to {release} within {descent} more");
    }
    text
}

/// Name of a kick, the kick, and the share of parts captured by it or by earlier ones.
type Attempt = (String, KickSettings, f64);

fields! {
    fn attempt_view(row: Attempt) {
        read ATTEMPT => row.0.clone();
        all FACTOR.digits(4) => f64::from(row.1.factor);
        all HOLD => u32::from(row.1.hold);
        all DESCENT => u32::from(row.1.descent);
        all RELEASE.digits(4) => f64::from(row.1.release);
        read CAPTURED.titled("captured so far").digits(4) => row.2;
        data SHARE => row.2;
    }
}

pub(super) fn report(
    task: &Task<'_>,
    plan: &Plan,
    map: &Kicks,
    rates: &Rates,
) -> Result<Printout, Refusal> {
    let kicks = (0..task.arguments.attempts as u32).filter_map(|attempt| plan.attempt(attempt));
    let kicks: Vec<KickSettings> = kicks.map(|kick| kick.settings()).collect();
    let none = KickSettings {
        factor: 1.0,
        hold: 0,
        descent: 0,
        release: 1.0,
    };
    let mut attempts = vec![("band alone".to_string(), none, rates.alone)];
    for (n, (kick, rate)) in kicks.iter().zip(&rates.by_attempt).enumerate() {
        attempts.push(((n + 1).to_string(), *kick, *rate));
    }
    let mut report = attempt_view().printout(&attempts).heading(format!(
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
            describe_kick(best.kick.settings()),
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
    let kick_alone = attempt_view().without(columns::SHARE);
    let kick = |kick: KickSettings| kick_alone.object(&(String::new(), kick, 0.0));
    let cells: Vec<Attempt> = (map.cells().into_iter())
        .map(|(kick, share)| (String::new(), kick, share))
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
        "map": cells.iter().map(|cell| attempt_view().object(cell)).collect::<Vec<_>>(),
    }))?;
    Ok(report.csv_of(attempt_view().table_of(&cells)))
}
