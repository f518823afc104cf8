//! `kband registers`: the registers of a board on Modbus.

use kband_bus::registers::{self, Access, Form, Register, Words};

use crate::arguments::Printed;
use crate::desk::Desk;
use crate::refusal::{Exit, Refusal};
use crate::report::{Printout, Table, columns};

/// The registers of a board on its fieldbus, Modbus RTU.
///
/// Functions 3 and 4 read them, 6 and 16 write them. Addresses are those in the frame, from 0: many
/// masters add 1, or 40001.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:
  kband registers
  kband registers --format csv
  kband registers --format json")]
pub struct Arguments {
    #[command(flatten)]
    printed: Printed,
}

/// Prints the table.
pub fn run(arguments: &Arguments, _desk: &Desk) -> Result<Exit, Refusal> {
    let mut table = Table::new(&[
        columns::REGISTER,
        columns::QUANTITY.words(),
        columns::UNIT.words(),
        columns::FORM.words(),
        columns::WRITABLE.words(),
        columns::MEANING.words(),
    ])
    .folded();
    for (register, words) in registers::all() {
        table.push([
            u64::from(register.address).into(),
            words.name.into(),
            words.unit.into(),
            form(&register).into(),
            written(&register).into(),
            meaning(&words).into(),
        ]);
    }
    Printout::new(table).print(arguments.printed.format)?;
    Ok(Exit::Done)
}

fn form(register: &Register) -> String {
    match register.form {
        Form::Word => "u16".to_owned(),
        Form::Scaled(unit) => format!("i16 x {unit}"),
        Form::Long => "u32".to_owned(),
        Form::Float => "f32".to_owned(),
        Form::Text(registers) => format!("text of {}", 2 * registers),
    }
}

fn written(register: &Register) -> &'static str {
    match register.access {
        Access::Read => "",
        Access::Write => "always",
        Access::AtRest => "at rest",
    }
}

fn meaning(words: &Words) -> String {
    let meaning = words.meaning.trim();
    match words.accepted.trim() {
        "" => meaning.to_owned(),
        accepted => format!("{meaning} {accepted}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fmt::Write as _;
    use std::fs;

    /// `KBAND_ACCEPT=1` writes the page's table.
    #[test]
    fn the_table_of_registers_is_that_of_the_bus() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/registers.md");
        let page = fs::read_to_string(path).unwrap();
        let (before, rest) = page.split_once("| register |").unwrap();
        let after = rest.split_once("\n\n").map_or("", |(_, after)| after);
        let mut made = format!(
            "{before}| register | quantity | unit | form | written | meaning |\n|---|---|---|---|---|---|\n"
        );
        for (register, words) in registers::all() {
            let (address, name, unit) = (register.address, words.name, words.unit);
            let (form, written) = (form(&register), written(&register));
            let meaning = meaning(&words);
            writeln!(
                made,
                "| {address} | {name} | {unit} | {form} | {written} | {meaning} |"
            )
            .unwrap();
        }
        write!(made, "\n{after}").unwrap();
        if made != page && std::env::var_os("KBAND_ACCEPT").is_some_and(|accept| accept == "1") {
            fs::write(path, &made).unwrap();
        }
        let page = fs::read_to_string(path).unwrap();
        assert_eq!(page, made, "KBAND_ACCEPT=1 writes docs/registers.md");
    }
}
