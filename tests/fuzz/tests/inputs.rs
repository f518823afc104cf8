//! Every fuzz target, with its corpus and mutations from a seeded mutator.
//!
//! `KBAND_FUZZED` sets the number of inputs per target (default some thousand), `KBAND_SEED` the
//! seed, `KBAND_TARGETS` the targets. `tests/run.sh --soak` makes a million frames for link and
//! fieldbus.

use kband_fuzz::{Mutator, TARGETS, Target};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::time::Instant;

fn number(variable: &str) -> Option<u64> {
    let text = std::env::var(variable).ok()?;
    let number = text.parse();
    Some(number.unwrap_or_else(|_| panic!("{variable} = {text}")))
}

/// Runs an input; a failing one is stored in the build folder.
fn run(target: &Target, input: &[u8]) -> bool {
    let outcome = catch_unwind(AssertUnwindSafe(|| (target.run)(input)));
    outcome.unwrap_or_else(|_| {
        let file = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("{}.input", target.name));
        std::fs::write(&file, input).expect("the input is kept");
        panic!("{}: {} fails", target.name, file.display())
    })
}

#[test]
fn no_input_is_more_than_refused() {
    let seed = number("KBAND_SEED").unwrap_or(1);
    let chosen = std::env::var("KBAND_TARGETS").ok();
    let is_chosen = |target: &&Target| {
        let names = chosen.as_deref().map(|names| names.split(' '));
        names.is_none_or(|mut names| names.any(|name| name == target.name))
    };
    let targets: Vec<_> = TARGETS.iter().filter(is_chosen).collect();
    assert!(!targets.is_empty(), "{chosen:?} names no target");
    for target in targets {
        let (name, began) = (target.name, Instant::now());
        let (corpus, saved) = (target.corpus(), target.saved_inputs());
        let valid = |inputs: &[Vec<u8>]| inputs.iter().filter(|input| run(target, input)).count();
        let sensible = valid(&corpus);
        assert!(sensible > 0, "{name}: the corpus makes no sense");
        // Coverage-guided fuzzing has not been run on recipes yet.
        let is_searched = name != "recipes";
        assert_eq!(!saved.is_empty(), is_searched, "{name}: what was found");
        let sense = valid(&saved);
        let count = number("KBAND_FUZZED").unwrap_or(target.short.into());
        // Half of the inputs are near the corpus, half near results of coverage-guided fuzzing.
        let second = if is_searched { &saved } else { &corpus };
        let mut near = [&corpus, second].map(|inputs| Mutator::new(inputs, target.words, seed));
        let mut make = |n: &u64| run(target, &near[(n % 2) as usize].make());
        let made = (0..count).filter(&mut make).count();
        let (all, found, seconds) = (corpus.len(), saved.len(), began.elapsed().as_secs_f64());
        println!(
            "fuzz: {name:8} {sensible} of {all} of the corpus, {sense} of {found} found and {made} of {count} mutated made sense, {seconds:.1} s"
        );
        assert!((made as u64) < count, "{name}: nothing is refused");
    }
}
