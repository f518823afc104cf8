//! Options that were given and would do nothing: refused, for whoever gives one expects something of it.

use std::path::PathBuf;

use clap::ArgMatches;
use clap::parser::ValueSource;

use crate::refusal::Refusal;

/// Options of a verb that do nothing in a case.
struct Idle {
    verb: &'static str,
    /// The case.
    case: fn(&Given) -> bool,
    /// What the case is, as the user said it.
    said: &'static str,
    /// The options, by their long names.
    options: &'static [&'static str],
    /// Why they do nothing then.
    why: &'static str,
}

/// What turns an amplitude into k, of a verb that was given none.
const fn without_amplitude(verb: &'static str) -> Idle {
    Idle {
        verb,
        case: |given| !given.has("b"),
        said: "without --b",
        options: &["frequency", "incline"],
        why: "k holds both already",
    }
}

const IDLE: &[Idle] = &[
    Idle {
        verb: "bench",
        case: |given| given.is("on", "qemu"),
        said: "with --on qemu",
        options: &["rounds", "launches", "out", "theme", "width", "font-size"],
        why: "instructions are counted once, and have no picture",
    },
    Idle {
        verb: "bench",
        case: |given| {
            ["chains", "verbs", "scaling"]
                .iter()
                .any(|of| given.is("show", of))
        },
        said: "with --show chains, --show verbs and --show scaling",
        options: &["on", "launches"],
        why: "they are of --show kernels",
    },
    Idle {
        verb: "bench",
        case: |given| given.is("show", "verbs") || given.is("show", "chains"),
        said: "with --show verbs and --show chains",
        options: &["out", "theme", "width", "font-size"],
        why: "what is timed there has no picture",
    },
    Idle {
        verb: "bench",
        case: |given| !given.is("show", "verbs"),
        said: "without --show verbs",
        options: &["only"],
        why: "nothing else runs whole commands",
    },
    Idle {
        verb: "bench",
        case: |given| !given.is("show", "scaling"),
        said: "without --show scaling",
        options: &["impacts"],
        why: "nothing else goes by how many impacts are made",
    },
    Idle {
        verb: "transport",
        case: |given| given.is("show", "return"),
        said: "with --show return",
        options: &[
            "restitution",
            "tangential-restitution",
            "phase-lead",
            "starts",
            "impacts",
            "settle",
            "part-length",
        ],
        why: "it is the map of dead parts, in closed form",
    },
    Idle {
        verb: "transport",
        case: |given| given.is("show", "intervals"),
        said: "with --show intervals",
        options: &["part-length"],
        why: "it tells times between impacts, no speed",
    },
    Idle {
        verb: "transport",
        case: |given| given.has("friction"),
        said: "with --friction",
        options: &["starts", "part-length"],
        why: "each speed is that of a part from rest",
    },
    Idle {
        verb: "gear",
        case: |given| given.has("table"),
        said: "with --table",
        options: &["frequency", "incline", "out", "theme", "width", "font-size"],
        why: "it runs the built-in feeder, and prints its table alone",
    },
    Idle {
        verb: "gear",
        case: |given| given.has("second_tone"),
        said: "with --second-tone",
        options: &["largest-second-tone"],
        why: "no other second tone is tried",
    },
    Idle {
        verb: "diagram",
        case: |given| given.is("show", "regimes"),
        said: "with --show regimes",
        options: &["starts", "impacts", "settle"],
        why: "it is a map over k and restitution, from rest and from next to the lock",
    },
    without_amplitude("basins"),
    without_amplitude("capture"),
    without_amplitude("diagram"),
    without_amplitude("exponent"),
    without_amplitude("impacts"),
    Idle {
        verb: "exponent",
        case: |given| given.has("phase") && !given.has("band"),
        said: "with --phase and --velocity",
        options: &["order"],
        why: "the orbit starts where they say, not near a lock",
    },
    Idle {
        verb: "simulate",
        case: |given| given.has("print_scene") || given.has("schema"),
        said: "with --print-scene and --schema",
        options: &[
            "fidelity",
            "restitution",
            "duration",
            "runs",
            "seed",
            "sweep",
            "compare-second-tone",
            "image",
            "on",
            "out",
            "trace",
            "scope",
            "theme",
            "width",
            "font-size",
            "format",
        ],
        why: "nothing is run",
    },
    Idle {
        verb: "simulate",
        case: |given| given.has("on"),
        said: "with --on",
        options: &["fidelity"],
        why: "a board gets every sample",
    },
];

/// Verbs whose `--seed` is that of a scatter alone.
const SCATTERED: [&str; 5] = ["diagram", "exponent", "gear", "impacts", "transport"];
/// The verb that draws whether or not it is told a file.
const DRAWS: &str = "simulate";

/// What the user gave to a verb.
struct Given<'a>(&'a ArgMatches);

impl Given<'_> {
    /// Whether an option was given on the command line; a flag, that it was set there.
    fn has(&self, id: &str) -> bool {
        self.0.try_contains_id(id).is_ok()
            && self.0.value_source(id) == Some(ValueSource::CommandLine)
    }

    /// Whether an option was given as this word.
    fn is(&self, id: &str, word: &str) -> bool {
        let mut words = self.0.try_get_raw(id).ok().flatten().into_iter().flatten();
        self.has(id) && words.any(|given| given == word)
    }

    /// Whether a picture is written.
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

/// Refuses the first option of a verb's that would do nothing.
pub fn check(verb: &str, matches: &ArgMatches) -> Result<(), Refusal> {
    let given = Given(matches);
    let refuse = |option: &str, said: &str, why: &str| {
        Err(Refusal::new(
            format!("--{option} does nothing {said}: {why}"),
            match said.strip_prefix("without ") {
                Some(missing) => format!("give {missing}, or leave out --{option}"),
                None => format!("leave out --{option}, or what it does nothing with"),
            },
        ))
    };
    for idle in IDLE
        .iter()
        .filter(|idle| idle.verb == verb && (idle.case)(&given))
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
    // Who says --scatter 0 knows that nothing is drawn.
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

    /// Every option of the table is one of its verb, and is refused in its case and taken without.
    #[test]
    fn what_would_do_nothing_is_refused_and_what_does_something_is_not() {
        let example = |verb: &str, option: &str| {
            let command = command();
            let verb = command.find_subcommand(verb).unwrap();
            let of = verb
                .get_arguments()
                .find(|arg| arg.get_long() == Some(option));
            let of = of.unwrap_or_else(|| panic!("{} has no --{option}", verb.get_name()));
            match option {
                "starts" if verb.get_name() == "diagram" => "rest",
                "starts" | "impacts" => "5000",
                "launches" => "1000",
                "phase-lead" | "incline" => "2",
                "restitution"
                | "tangential-restitution"
                | "largest-second-tone"
                | "compare-second-tone" => "0.25",
                "sweep" => "part.restitution=0.1..0.2:2",
                "fidelity" => "envelope",
                "theme" => "dark",
                "font-size" => "9",
                "format" => "json",
                "out" => "a.svg",
                "trace" | "scope" => "a.csv",
                "on" => "qemu",
                "image" => "a.elf --on qemu",
                _ if of.get_action().takes_values() => "50",
                _ => "",
            }
        };
        for idle in IDLE {
            let cases: &[&str] = match idle.said {
                "with --show regimes" => &["--show regimes --k 0.1..0.8:9 --restitution 0..0.9:9"],
                "with --show return" => &["--show return --k 0.2"],
                "with --show intervals" => &["--show intervals --k 0.2"],
                "with --friction" => &["--friction 0.3"],
                "with --table" => &["--table"],
                "with --second-tone" => &["--second-tone 0.1,2.4"],
                "with --phase and --velocity" => &["--phase 0.5 --velocity 0.4"],
                "with --print-scene and --schema" => &["--print-scene", "--schema"],
                "with --on" | "with --on qemu" => &["--on qemu"],
                "with --show chains, --show verbs and --show scaling" => {
                    &["--show chains", "--show verbs", "--show scaling"]
                }
                "with --show verbs and --show chains" => &["--show verbs", "--show chains"],
                "without --show scaling" => &["--show verbs"],
                "without --show verbs" => &["--show scaling"],
                "without --b" => &["--k 0.4"],
                other => panic!("no example of {other}"),
            };
            let needed = match idle.verb {
                _ if idle.said != "without --b" => "",
                "basins" => " --restitution 0.2",
                "impacts" => " --restitution 0.2 --phase 1 --velocity 0.5",
                _ => "",
            };
            let otherwise = match idle.said {
                "without --b" => " --b 0.2",
                "without --show verbs" => " --show verbs",
                "without --show scaling" => " --show scaling",
                _ => "",
            };
            for option in idle.options {
                let given = format!("--{option} {}", example(idle.verb, option));
                let given = given.trim_end();
                for case in cases {
                    let line = format!("{} {given} {case}{needed}", idle.verb);
                    let refusal = refused(&line).unwrap_or_else(|| panic!("kband {line} is taken"));
                    assert!(
                        refusal.contains(&format!("--{option} does nothing {}", idle.said)),
                        "{refusal}"
                    );
                }
                let line = format!("{} {given}{otherwise}{needed}", idle.verb);
                let other = ["theme", "width", "font-size", "on"];
                let other = other.contains(option);
                assert!(other || refused(&line).is_none(), "kband {line} is refused");
            }
        }
        for line in [
            "cascade --theme dark",
            "cascade --theme dark --out a.csv",
            "cascade --width column",
            "cascade --font-size 7 --out a.json",
            "capture --incline 4",
            "diagram --seed 3",
            "transport --seed 3",
        ] {
            assert!(refused(line).is_some(), "kband {line} is taken");
        }
        for line in [
            "cascade --theme dark --out a.svg",
            "cascade --width column --font-size 7 --out a.pdf",
            "diagram --scatter 0.05 --seed 3",
            "gear --seed 3",
            "gear --scatter 0 --seed 3",
            "simulate --theme dark",
            "simulate --seed 3",
            "capture --restitution 0.3 --seed 3",
            "exponent --phase 0.5 --velocity 0.4 --order 2 --band",
        ] {
            assert_eq!(refused(line), None, "kband {line}");
        }
    }
}
