//! The list of mutants matches the sources: each place occurs in its file exactly once.

use std::path::Path;

use toml::{Table, Value};

fn strings(value: &Value) -> Vec<&str> {
    let words = value.as_array().into_iter().flatten();
    words.filter_map(Value::as_str).collect()
}

#[test]
fn each_mutant_is_at_its_place() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let list = std::fs::read_to_string(root.join("tests/mutants/mutants.toml")).unwrap();
    let list: Table = list.parse().unwrap();
    let mut count = 0;
    for (kind, least) in [("file", 100), ("equivalent", 1)] {
        let before = count;
        for file in list[kind].as_array().unwrap() {
            let path = file["path"].as_str().unwrap();
            let text = std::fs::read_to_string(root.join(path)).unwrap();
            for mutant in file["mutants"].as_array().unwrap() {
                let [place, expression, becomes, ..] = strings(mutant)[..] else {
                    panic!("{path}: {mutant}");
                };
                assert_eq!(place.matches('@').count(), 1, "{path}: {place}");
                assert_ne!(expression, becomes, "{path}: {place}");
                let context = place.replace('@', expression);
                assert_eq!(text.matches(&context).count(), 1, "{path}: {context}");
                count += 1;
            }
        }
        assert!(count - before >= least, "{kind}: {count}");
    }
    println!("mutants: {count} listed");
}
