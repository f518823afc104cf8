//! Refusal of options without effect, because a user expects an effect.

use std::path::PathBuf;

use clap::ArgMatches;
use clap::parser::ValueSource;

use crate::refusal::{Refusal, Result};

struct Idle {
    verbs: &'static [&'static str],
    case: fn(&Args) -> bool,
    condition: &'static str,
    options: &'static [&'static str],
    why: &'static str,
}

macro_rules! idle {
    ($($verbs:expr, $case:expr, $condition:literal, $options:expr, $why:literal;)*) => {
        const IDLE: &[Idle] = &[
            $(Idle { verbs: &$verbs, case: $case, condition: $condition, options: &$options, why: $why }),*
        ];
    };
}

idle! {
    ["transport"], |args| args.has("friction"), "with --friction",
        ["starts", "part-length"], "each speed is that of a part from rest";
    ["transport"], |args| !args.has("friction"), "without --friction",
        ["second-tone", "third-tone"], "the paper's model has one tone";
    ["bands"], |args| args.has("second_tone") || args.has("third_tone"), "with --second-tone",
        ["scatter"], "kband gear plans gear on tones";
    ["gear"], |args| args.has("second_tone"), "with --second-tone",
        ["largest-second-tone"], "no other second tone is tried";
    ["diagram"], |args| args.is("show", "regimes"), "with --show regimes",
        ["starts", "impacts", "settle"],
        "it is a map over k and restitution, from rest and from next to the lock";
    ["capture", "exponent"], |args| !args.has("b"), "without --b",
        ["frequency", "incline"], "k holds both already";
    ["basins", "diagram", "impacts"], |args| !args.has("b"), "without --b",
        ["incline"], "k holds it already";
    ["basins", "diagram", "impacts"], |args| !args.has("b") && !args.has("contact"),
        "without --b or --contact", ["frequency"], "k holds it already";
    ["exponent"], |args| args.has("phase") && !args.has("band"), "with --phase and --velocity",
        ["order"], "the orbit starts where they say, not near a lock";
    ["simulate"], |args| args.has("print_scene") || args.has("schema"), "with --print-scene and --schema",
        ["fidelity", "restitution", "duration", "runs", "seed", "sweep", "image", "on", "out", "trace", "scope",
         "theme", "width", "font-size", "format"],
        "nothing is run";
    ["simulate"], |args| args.has("on"), "with --on",
        ["fidelity"], "a board gets every sample";
}

/// Verbs whose `--seed` only affects the scatter.
const SCATTER_VERBS: [&str; 5] = ["diagram", "exponent", "gear", "impacts", "transport"];

struct Args<'a>(&'a ArgMatches);

impl Args<'_> {
    /// Whether an option is on the command line; for a flag, whether it is set there.
    fn has(&self, option: &str) -> bool {
        let id = option.replace('-', "_");
        self.0.try_contains_id(&id).is_ok()
            && self.0.value_source(&id) == Some(ValueSource::CommandLine)
    }

    fn is(&self, id: &str, word: &str) -> bool {
        let mut values = self.0.try_get_raw(id).ok().flatten().into_iter().flatten();
        self.has(id) && values.any(|value| value == word)
    }

    fn draws(&self) -> bool {
        let out = self.0.try_get_one::<PathBuf>("out").ok().flatten();
        let ending = out.and_then(|out| out.extension());
        let is = |text: &str| ending.is_some_and(|ending| ending.eq_ignore_ascii_case(text));
        ending.is_some() && !is("csv") && !is("json")
    }
}

/// Refuses the first option without effect.
pub fn check(verb: &str, matches: &ArgMatches) -> Result<()> {
    let args = Args(matches);
    let refuse = |option: &str, condition: &str, why: &str| {
        Err(Refusal::new(
            format!("--{option} does nothing {condition}: {why}"),
            match condition.strip_prefix("without ") {
                Some(missing) => format!("give {missing}, or leave out --{option}"),
                None => format!("leave out --{option}, or the option that excludes it"),
            },
        ))
    };
    let idle = IDLE.iter().filter(|idle| idle.verbs.contains(&verb));
    for idle in idle.filter(|idle| (idle.case)(&args)) {
        let mut options = idle.options.iter();
        if let Some(option) = options.find(|option| args.has(option)) {
            return refuse(option, idle.condition, idle.why);
        }
    }
    let look = ["theme", "width", "font-size"].into_iter();
    let mut given = look.filter(|option| args.has(option));
    if let Some(option) = given.next().filter(|_| verb != "simulate" && !args.draws()) {
        let why = "give --out FILE.svg, FILE.png or FILE.pdf";
        return refuse(option, "without a picture", why);
    }
    let scatter = matches.try_get_one::<f64>("scatter").ok().flatten();
    // An explicit --scatter 0 means that nothing is random.
    let drawn = args.has("scatter") || scatter != Some(&0.0);
    if SCATTER_VERBS.contains(&verb) && args.has("seed") && !drawn {
        return refuse("seed", "without --scatter", "nothing is drawn at random");
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::verbs::command;

    fn refused(line: &str) -> Option<String> {
        let args = std::iter::once("kband").chain(line.split(' '));
        let matches = command().try_get_matches_from(args).unwrap();
        let (verb, matches) = matches.subcommand().unwrap();
        let refusal = check(verb, matches).err();
        refusal.map(|refusal| refusal.to_string())
    }

    /// tests/wrong_inputs.txt has the refused options.
    #[test]
    fn effective_options_are_accepted() {
        for line in [
            "cascade --theme dark --out a.svg",
            "cascade --width column --font-size 7 --out a.png",
            "diagram --scatter 0.05 --seed 3",
            "diagram --b 0.1..0.2 --frequency 60",
            "diagram --contact 0.4 --frequency 60",
            "gear --seed 3",
            "gear --scatter 0 --seed 3",
            "gear --largest-second-tone 0.2",
            "simulate --theme dark",
            "simulate --seed 3",
            "capture --restitution 0.3 --seed 3",
            "capture --b 0.2 --incline 4",
            "exponent --k 0.4 --order 2",
            "exponent --phase 0.5 --velocity 0.4 --order 2 --band",
            "transport --starts 5 --part-length 20",
        ] {
            assert_eq!(refused(line), None, "kband {line}");
        }
    }
}
