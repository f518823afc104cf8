//! Turns the table of columns into the constants of `report::columns`.

use std::fmt::Write;

/// A constant for each row, and the list of all rows.
pub fn source(table: &str) -> String {
    let (mut constants, mut entries) = (String::new(), String::new());
    for line in table
        .lines()
        .filter(|line| !line.is_empty() && !line.starts_with('#'))
    {
        let [name, unit, meaning] = line.split('\t').collect::<Vec<_>>()[..] else {
            panic!("not a name, a unit and a meaning: {line}");
        };
        // Writing to a String cannot fail.
        let _ = writeln!(entries, "({name:?}, {unit:?}, {meaning:?}),");
        let constant = name.to_uppercase();
        let _ = writeln!(
            constants,
            "/// {meaning}\npub const {constant}: Column = Column::new({name:?}, {unit:?});"
        );
    }
    format!(
        "{constants}/// Name, unit and meaning of every column and field.\n\
         pub const ENTRIES: &[(&str, &str, &str)] = &[{entries}];\n"
    )
}
