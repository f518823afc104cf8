//! `kband registers`: Modbus registers of a board.

use kband_bus::registers::{self, Access, Form, Register, Words};

use crate::arguments::FormatArguments;
use crate::desk::Desk;
use crate::refusal::{Exit, Result};
use crate::report::fields;

/// Print the registers of a board on its fieldbus, Modbus RTU.
///
/// Functions 3 and 4 read them, 6 and 16 write them. Addresses are those in the frame, from 0; many
/// masters add 1 or 40001.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:
  kband registers
  kband registers --format csv
  kband registers --format json")]
pub struct Arguments {
    #[command(flatten)]
    printed: FormatArguments,
}

pub fn run(arguments: &Arguments, _desk: &Desk) -> Result<Exit> {
    let all: Vec<_> = registers::all().collect();
    let report = rows().printout(&all).folded();
    report.print(arguments.printed.format).map(|()| Exit::Done)
}

fields! {
    fn rows(row: (Register, Words)) {
        all REGISTER => u64::from(row.0.address);
        all QUANTITY.text() => row.1.name;
        all UNIT.text() => row.1.unit;
        all FORM.text() => form(&row.0);
        all WRITABLE.text() => written(&row.0);
        all MEANING.text() => meaning(&row.1);
    }
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

fn meaning(texts: &Words) -> String {
    let meaning = texts.meaning.trim();
    match texts.accepted.trim() {
        "" => meaning.to_owned(),
        accepted => format!("{meaning} {accepted}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fmt::Write as _;
    use std::fs;

    /// `KBAND_ACCEPT=1` writes the table into the page.
    #[test]
    fn the_table_of_registers_is_that_of_the_bus() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/registers.md");
        let page = fs::read_to_string(path).unwrap();
        let (before, rest) = page.split_once("| register |").unwrap();
        let after = rest.split_once("\n\n").map_or("", |(_, after)| after);
        let mut made = format!(
            "{before}| register | quantity | unit | form | written | meaning |\n|---|---|---|---|---|---|\n"
        );
        for (register, texts) in registers::all() {
            let (address, name, unit) = (register.address, texts.name, texts.unit);
            let (form, written) = (form(&register), written(&register));
            let meaning = meaning(&texts);
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
