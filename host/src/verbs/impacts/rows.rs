//! Launches from a file, one in each row.

use std::path::Path;

use kband::feeder::OutOfRange;
use kband::impact::{Kernel, Map};

use crate::refusal::Refusal;

/// A map and the state it is applied to.
pub struct Row<K: Kernel> {
    /// The map.
    pub kernel: K,
    /// The launch.
    pub state: K::State,
}

/// The rows of a file.
pub struct Rows<K: Kernel> {
    /// Those that the arithmetic holds.
    pub held: Vec<Row<K>>,
    /// For each row its place among those, if it is one of them.
    pub places: Vec<Option<usize>>,
    /// How many it does not hold, and what it says of the first.
    pub left: Option<(usize, Refusal)>,
}

/// A launch that an arithmetic cannot hold; `next` is what to do instead of choosing another.
pub(super) fn not_held<K: Kernel>(refused: OutOfRange, next: &str) -> Refusal {
    Refusal::value(
        refused.parameter,
        refused.value,
        format!("{} (arithmetic {})", refused.accepted, K::NAME),
        format!("{next}, or choose another --arithmetic"),
    )
}

/// All rows of the file. The first that is no launch at all is refused with its line and column, before
/// anything is printed; a launch that only this arithmetic cannot hold is left out.
pub fn read_rows<K: Kernel>(
    path: &Path,
    text: &str,
    build: impl Fn(f64, f64) -> Result<K, OutOfRange>,
) -> Result<Rows<K>, Refusal> {
    const COLUMNS: [&str; 4] = ["k", "restitution", "phase", "velocity"];
    let name = path.display();
    let mut lines = text
        .trim_start_matches('\u{feff}')
        .lines()
        .enumerate()
        .map(|(n, line)| (n + 1, line.trim()))
        .filter(|(_, line)| !line.is_empty() && !line.starts_with('#'));
    let header = lines.next().map_or("", |(_, line)| line);
    let names: Vec<&str> = header
        .split(',')
        .map(|name| name.trim().trim_matches('"'))
        .collect();
    let mut places = [0; 4];
    for (place, column) in places.iter_mut().zip(COLUMNS) {
        *place = names
            .iter()
            .position(|name| *name == column)
            .ok_or_else(|| {
                Refusal::value(
                    format!("header of {name}"),
                    format!("'{header}'"),
                    "the columns k,restitution,phase,velocity in any order",
                    format!("add the column {column}"),
                )
            })?;
    }
    let mut rows = Rows {
        held: Vec::new(),
        places: Vec::new(),
        left: None,
    };
    for (line, text) in lines {
        let fields: Vec<&str> = text.split(',').map(str::trim).collect();
        let mut values = [0.0; 4];
        for ((value, place), column) in values.iter_mut().zip(places).zip(COLUMNS) {
            let field = fields.get(place).copied().unwrap_or("");
            *value = field.parse().map_err(|_| {
                Refusal::value(column, format!("'{field}'"), "a number", "correct this row")
                    .at(format!("{name}, line {line}"))
            })?;
        }
        let [k, restitution, phase, velocity] = values;
        let launch = build(k, restitution)
            .and_then(|kernel| K::state(phase, velocity).map(|state| Row { kernel, state }));
        match launch {
            Ok(row) => {
                rows.places.push(Some(rows.held.len()));
                rows.held.push(row);
            }
            Err(cause) => {
                const NEXT: &str = "correct or remove this row";
                let place = format!("{name}, line {line}");
                // No arithmetic has a wider range than f64.
                let wide = Map::build(k, restitution).and(Map::state(phase, velocity));
                if let Err(cause) = wide {
                    return Err(Refusal::from(cause).then(NEXT).at(place));
                }
                let cause = not_held::<K>(cause, NEXT).at(place);
                rows.places.push(None);
                let (count, first) = rows.left.take().unwrap_or((0, cause));
                rows.left = Some((count + 1, first));
            }
        }
    }
    if let (true, Some((_, first))) = (rows.held.is_empty(), &rows.left) {
        return Err(first.clone());
    }
    if rows.held.is_empty() {
        return Err(Refusal::new(
            format!("{name} has no rows"),
            "give at least one row below the header k,restitution,phase,velocity",
        ));
    }
    Ok(rows)
}

#[cfg(test)]
mod tests {
    use kband::impact::Hybrid;

    use super::*;

    #[test]
    fn a_row_that_only_the_arithmetic_cannot_hold_is_left_out() {
        let text = "k,restitution,phase,velocity\n0.4,0.2,1,70\n0.4,0.2,1,2\n0.4,0.2,1,80\n";
        let rows = read_rows(Path::new("a.csv"), text, Hybrid::build).unwrap();
        assert_eq!(rows.places, [None, Some(0), None]);
        let (count, first) = rows.left.unwrap();
        assert_eq!(count, 2);
        assert!(
            first.to_string().contains("line 2: velocity = 70"),
            "{first}"
        );
        // Where nothing is left, it is refused.
        let text = "k,restitution,phase,velocity\n0.4,0.2,1,70\n";
        let none = read_rows(Path::new("a.csv"), text, Hybrid::build);
        assert!(none.is_err_and(|refusal| refusal.to_string().contains("0..60")));
        // A k that no arithmetic takes: the widest range, and no other arithmetic to choose.
        for (k, expected) in [
            (
                0.0005,
                "accepted: 0.001..1000\n  next: correct or remove this row",
            ),
            (
                0.002,
                "next: correct or remove this row, or choose another --arithmetic",
            ),
        ] {
            let text = format!("k,restitution,phase,velocity\n{k},0.2,1,1\n");
            let refused = read_rows(Path::new("a.csv"), &text, Hybrid::build);
            let message = refused.err().map(|refusal| refusal.to_string());
            assert!(message.is_some_and(|message| message.ends_with(expected)));
        }
    }

    #[test]
    fn columns_may_come_in_any_order_among_others() {
        let text = "class,velocity,phase,restitution,k\r\nhigh,2,1,0.5,0.4\r\n";
        let rows = read_rows(Path::new("a.csv"), text, Map::build)
            .unwrap()
            .held;
        assert_eq!(
            (rows.len(), rows[0].kernel.k(), rows[0].state.velocity),
            (1, 0.4, 2.0)
        );
    }
}
