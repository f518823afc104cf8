//! What an impact of one orbit costs: table.

use super::Arguments;
use crate::bench::chains::{self, CHAINS, Timed};
use crate::desk::Desk;
use crate::refusal::{Exit, Refusal};
use crate::report::{Printout, Table, columns, number};

/// Measures and prints.
pub(super) fn run(arguments: &Arguments, desk: &Desk) -> Result<Exit, Refusal> {
    let lines = chains::timed(arguments.rounds(41), desk)?;
    let mut table = Table::new(&[
        columns::KERNEL,
        columns::WORKLOAD,
        columns::K,
        columns::RESTITUTION,
        columns::IMPACT_TIME.digits(4),
        columns::IMPACT_RATE.digits(3),
    ]);
    for Timed {
        kernel,
        chain,
        nanoseconds,
    } in &lines
    {
        table.push([
            (*kernel).into(),
            chain.name.into(),
            chain.k.into(),
            chain.restitution.into(),
            (*nanoseconds).into(),
            (1e9 / nanoseconds).into(),
        ]);
    }
    let mut report = Printout::new(table)
        .heading("Cost of an impact of one orbit, each from where the one before ended");
    for chain in CHAINS {
        let time = |kernel: &str| {
            let mut of = lines.iter().filter(|line| line.chain == chain);
            of.find(|line| line.kernel == kernel)
                .map(|line| line.nanoseconds)
        };
        if let (Some(textbook), Some(f64)) = (time("textbook"), time("f64")) {
            report = report.note(format!(
                "{}: f64 is {} times as fast as the textbook",
                chain.name,
                number(textbook / f64, 3),
            ));
        }
    }
    report.print(arguments.printed.format)?;
    Ok(Exit::Done)
}
