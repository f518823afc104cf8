//! What users wait for: the table of whole commands.

use super::Arguments;
use crate::bench::verbs;
use crate::desk::Desk;
use crate::refusal::{Exit, Refusal};
use crate::report::{Printout, Table, columns};

/// Measures and prints.
pub(super) fn run(arguments: &Arguments, desk: &Desk) -> Result<Exit, Refusal> {
    let mut table = Table::new(&[
        columns::COMMAND,
        columns::TIME_ON_ONE_THREAD.digits(3),
        columns::TIME_ON_TWO_THREADS.digits(3),
        columns::SPEED_UP.digits(3),
        columns::ITEMS,
        columns::ITEM_COUNT,
        columns::ITEM_TIME.digits(4),
    ]);
    let works = match &arguments.only {
        Some(verb) => chosen(verb)?,
        None => verbs::WORKS.to_vec(),
    };
    for one in verbs::waited(&works, arguments.rounds(3), desk)? {
        let ([alone, two], (makes, count)) = (one.seconds, one.work.makes);
        table.push([
            one.work.words.into(),
            alone.into(),
            two.into(),
            (alone / two).into(),
            makes.into(),
            u64::from(count).into(),
            (1e6 * alone / f64::from(count)).into(),
        ]);
    }
    Printout::new(table)
        .heading("What users wait for: time from start to end of a command")
        .print(arguments.printed.format)?;
    Ok(Exit::Done)
}

/// The commands of a verb.
fn chosen(verb: &str) -> Result<Vec<verbs::Work>, Refusal> {
    let works: Vec<_> = verbs::WORKS
        .into_iter()
        .filter(|work| work.verb() == verb)
        .collect();
    if works.is_empty() {
        let mut known: Vec<&str> = verbs::WORKS.iter().map(verbs::Work::verb).collect();
        known.sort_unstable();
        known.dedup();
        return Err(Refusal::value(
            "--only",
            verb,
            known.join(", "),
            "name one of them, or leave it out",
        ));
    }
    Ok(works)
}
