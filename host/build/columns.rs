//! Generates the constants of `report::columns` from the table of columns.

use std::fmt::Write;

/// Constants for the columns above the empty line, and the list of all rows.
pub fn source(table: &str) -> String {
    let (mut constants, mut entries, mut column) = (String::new(), String::new(), true);
    for line in table.lines().filter(|line| !line.starts_with('#')) {
        if line.is_empty() {
            column = false;
            continue;
        }
        let [name, unit, meaning] = line.split('\t').collect::<Vec<_>>()[..] else {
            panic!("not a name, a unit and a meaning: {line}");
        };
        // Writing to a String cannot fail.
        let _ = writeln!(entries, "({name:?}, {unit:?}, {meaning:?}),");
        if column {
            let constant = name.to_uppercase();
            let _ = writeln!(
                constants,
                "/// {meaning}\npub(crate) const {constant}: Column = Column::new({name:?}, {unit:?});"
            );
        }
    }
    format!(
        "{constants}/// Name, unit and meaning of every column and field.\n\
         pub const ENTRIES: &[(&str, &str, &str)] = &[{entries}];\n"
    )
}
