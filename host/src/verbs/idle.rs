//! Refusal of options without effect: a user who gives one expects an effect.

use std::path::PathBuf;

use clap::ArgMatches;
use clap::parser::ValueSource;

use crate::refusal::Refusal;

/// Options that have no effect in a case.
struct Idle {
    verbs: &'static [&'static str],
    case: fn(&Given) -> bool,
    said: &'static str,
    /// The options, by their long names.
    options: &'static [&'static str],
    why: &'static str,
}

macro_rules! idle {
    ($($verbs:expr, $case:expr, $said:literal, $options:expr, $why:literal;)*) => {
        const IDLE: &[Idle] = &[
            $(Idle { verbs: &$verbs, case: $case, said: $said, options: &$options, why: $why }),*
        ];
    };
}

idle! {
    ["transport"], |given| given.has("friction"), "with --friction",
        ["starts", "part-length"], "each speed is that of a part from rest";
    ["bands"], |given| given.has("second_tone") || given.has("third_tone"), "with --second-tone",
        ["scatter"], "kband gear plans gear on tones";
    ["gear"], |given| given.has("second_tone"), "with --second-tone",
        ["largest-second-tone"], "no other second tone is tried";
    ["diagram"], |given| given.is("show", "regimes"), "with --show regimes",
        ["starts", "impacts", "settle"],
        "it is a map over k and restitution, from rest and from next to the lock";
    ["capture", "exponent"], |given| !given.has("b"), "without --b",
        ["frequency", "incline"], "k holds both already";
    ["basins", "diagram", "impacts"], |given| !given.has("b"), "without --b",
        ["incline"], "k holds it already";
    ["basins", "diagram", "impacts"], |given| !given.has("b") && !given.has("contact"),
        "without --b or --contact", ["frequency"], "k holds it already";
    ["exponent"], |given| given.has("phase") && !given.has("band"), "with --phase and --velocity",
        ["order"], "the orbit starts where they say, not near a lock";
    ["simulate"], |given| given.has("print_scene") || given.has("schema"), "with --print-scene and --schema",
        ["fidelity", "restitution", "duration", "runs", "seed", "sweep", "image", "on", "out", "trace", "scope",
         "theme", "width", "font-size", "format"],
        "nothing is run";
    ["simulate"], |given| given.has("on"), "with --on",
        ["fidelity"], "a board gets every sample";
}

/// Verbs whose `--seed` is that of a scatter alone.
const SCATTERED: [&str; 5] = ["diagram", "exponent", "gear", "impacts", "transport"];
/// Verb that draws also without the name of a file.
const DRAWS: &str = "simulate";

struct Given<'a>(&'a ArgMatches);

impl Given<'_> {
    /// Whether an option was given on the command line; a flag, that it was set there.
    fn has(&self, id: &str) -> bool {
        self.0.try_contains_id(id).is_ok()
            && self.0.value_source(id) == Some(ValueSource::CommandLine)
    }

    fn is(&self, id: &str, word: &str) -> bool {
        let mut words = self.0.try_get_raw(id).ok().flatten().into_iter().flatten();
        self.has(id) && words.any(|given| given == word)
    }

    fn draws(&self) -> bool {
        let out = self.0.try_get_one::<PathBuf>("out").ok().flatten();
        let ending = out.and_then(|out| out.extension());
        ending.is_some_and(|ending| {
            !["csv", "json"]
                .iter()
                .any(|text| ending.eq_ignore_ascii_case(text))
        })
    }
}

/// Refuses the first option of a verb without effect.
pub fn check(verb: &str, matches: &ArgMatches) -> Result<(), Refusal> {
    let given = Given(matches);
    let refuse = |option: &str, said: &str, why: &str| {
        Err(Refusal::new(
            format!("--{option} does nothing {said}: {why}"),
            match said.strip_prefix("without ") {
                Some(missing) => format!("give {missing}, or leave out --{option}"),
                None => format!("leave out --{option}, or the option that excludes it"),
            },
        ))
    };
    for idle in IDLE
        .iter()
        .filter(|idle| idle.verbs.contains(&verb) && (idle.case)(&given))
    {
        let mut options = idle.options.iter();
        if let Some(option) = options.find(|option| given.has(&option.replace('-', "_"))) {
            return refuse(option, idle.said, idle.why);
        }
    }
    let looks = [
        ("theme", "theme"),
        ("width", "width"),
        ("font_size", "font-size"),
    ];
    let unseen = looks.into_iter().find(|(id, _)| given.has(id));
    if let Some((_, option)) = unseen.filter(|_| verb != DRAWS && !given.draws()) {
        return refuse(
            option,
            "without a picture",
            "give --out FILE.svg, FILE.png or FILE.pdf",
        );
    }
    let scatter = matches.try_get_one::<f64>("scatter").ok().flatten();
    // An explicit --scatter 0 says that nothing is drawn at random.
    let drawn = given.has("scatter") || scatter != Some(&0.0);
    if SCATTERED.contains(&verb) && given.has("seed") && !drawn {
        return refuse("seed", "without --scatter", "nothing is drawn at random");
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::verbs::command;

    fn refused(line: &str) -> Option<String> {
        let words = std::iter::once("kband").chain(line.split(' '));
        let matches = command().try_get_matches_from(words).unwrap();
        let (verb, matches) = matches.subcommand().unwrap();
        check(verb, matches)
            .err()
            .map(|refusal| refusal.to_string())
    }

    /// tests/wrong_inputs.txt has the refused ones.
    #[test]
    fn options_that_do_something_are_taken() {
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
