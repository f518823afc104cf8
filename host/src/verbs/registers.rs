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
