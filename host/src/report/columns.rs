//! Every column and field of kband's outputs, with its unit: the rows of `columns.tsv`. One
//! quantity has one name in all verbs, without its unit.

use serde_json::{Map, Value as Json};

use super::table::Column;

// build/columns.rs generates a constant for each column, with the column's name, and the list of
// all.
include!(concat!(env!("OUT_DIR"), "/columns.rs"));

/// Units of a document's fields, by name.
pub(super) fn units_of(document: &Json) -> Map<String, Json> {
    let mut units = Map::new();
    collect(document, &mut units);
    units.sort_keys();
    units
}

fn collect(document: &Json, units: &mut Map<String, Json>) {
    match document {
        Json::Object(fields) => {
            for (name, value) in fields {
                if !units.contains_key(name)
                    && let Some((_, unit, _)) = entry(name)
                    && !unit.is_empty()
                {
                    units.insert(name.clone(), (*unit).into());
                }
                collect(value, units);
            }
        }
        Json::Array(values) => values.iter().for_each(|value| collect(value, units)),
        _ => {}
    }
}

/// Name, unit and meaning of a column or a field.
pub fn entry(name: &str) -> Option<&'static (&'static str, &'static str, &'static str)> {
    ENTRIES.iter().find(|(key, ..)| *key == name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quantity_has_one_name_and_the_name_no_unit() {
        for (n, (name, _, meaning)) in ENTRIES.iter().enumerate() {
            let mut others = ENTRIES[..n].iter().map(|(other, ..)| other);
            assert!(others.all(|other| other != name), "{name} is there twice");
            let letters = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_';
            assert!(name.chars().all(letters), "{name}");
            assert!(meaning.ends_with('.'), "{name}");
            for unit in [
                "_mm", "_mm_s", "_percent", "_rad", "_hz", "_g", "_ms", "_mv", "_degrees",
            ] {
                assert!(!name.ends_with(unit), "{name}");
            }
        }
    }

    #[test]
    fn a_document_lists_the_units_of_its_quantities() {
        let document = serde_json::json!({"rows": [{"b": 0.2, "k": 0.4, "kick": {"hold": 3}}]});
        let units = serde_json::json!({"b": "mm", "hold": "cycles"});
        assert_eq!(Json::Object(units_of(&document)), units);
    }
}
