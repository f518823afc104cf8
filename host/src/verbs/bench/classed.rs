//! Instructions of an impact by class: table.

use super::{Arguments, On};
use crate::bench::classes::{self, CLASSES};
use crate::bench::instructions;
use crate::refusal::{Exit, Refusal};
use crate::report::{Printout, Table, columns};

/// Counts and prints.
pub(super) fn run(arguments: &Arguments) -> Result<Exit, Refusal> {
    if arguments.on != On::Qemu {
        return Err(Refusal::value(
            "--show",
            "classes",
            "kernels, chains, verbs or scaling on this CPU",
            "add --on qemu: instructions are counted on the emulated microcontrollers",
        ));
    }
    let counts = classes::counts().map_err(|cause| Refusal::new(cause, instructions::NEXT))?;
    let mut table = Table::new(&[
        columns::KERNEL,
        columns::CPU,
        columns::CLASS,
        columns::INSTRUCTIONS.digits(4),
    ]);
    for of in &counts {
        let all = ("all", of.instructions.iter().sum());
        let classes = CLASSES.into_iter().zip(of.instructions);
        for (class, count) in classes.filter(|(_, count)| *count > 0.0).chain([all]) {
            table.push([
                of.kernel.as_str().into(),
                of.cpu.into(),
                class.into(),
                count.into(),
            ]);
        }
    }
    Printout::new(table)
        .heading("Instructions of an impact by class, in the mean of the orbits")
        .print(arguments.printed.format)?;
    Ok(Exit::Done)
}
