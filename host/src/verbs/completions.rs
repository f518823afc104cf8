//! `kband completions`: shell completions, with the keys of settings and scenes.

use std::sync::LazyLock;

use clap::builder::PossibleValuesParser;
use clap_complete::Shell;
use kband_control::Settings;

use crate::desk::Desk;
use crate::refusal::{Exit, Refusal};
use crate::report;
use crate::simulate::schema;

/// Print the completion script for a shell.
#[derive(Clone, Debug, clap::Args)]
#[command(
    after_help = "Example:\n  kband completions bash > ~/.local/share/bash-completion/completions/kband"
)]
pub struct Arguments {
    /// The shell.
    #[arg(value_enum)]
    shell: Shell,
}

/// Prints the script.
pub fn run(arguments: &Arguments, _desk: &Desk) -> Result<Exit, Refusal> {
    report::print(&script(arguments.shell))?;
    Ok(Exit::Done)
}

/// Keys of scenes for `--sweep`.
static SCENE_KEYS: LazyLock<Vec<String>> =
    LazyLock::new(|| schema::keys().into_iter().map(|key| key + "=").collect());

fn script(shell: Shell) -> String {
    let mut script = Vec::new();
    clap_complete::generate(shell, &mut with_keys(), "kband", &mut script);
    let mut script = String::from_utf8_lossy(&script).into_owned();
    if shell == Shell::Fish {
        // The script of clap for this shell completes only the values of options.
        let keys: Vec<&str> = Settings::KEYS.iter().map(|key| key.name).collect();
        script += &format!(
            "complete -c kband -n \"__fish_seen_subcommand_from settings; and __fish_seen_subcommand_from get set\" -f -a \"{}\"\n",
            keys.join(" ")
        );
    }
    script
}

/// The command line with the keys, for completion only. The verbs parse the keys themselves,
/// because their messages on unknown keys say more.
fn with_keys() -> clap::Command {
    let settings = || PossibleValuesParser::new(Settings::KEYS.iter().map(|key| key.name));
    let scenes = SCENE_KEYS.iter().map(String::as_str);
    super::command()
        .mut_subcommand("settings", |verb| {
            ["get", "set"].into_iter().fold(verb, |verb, action| {
                verb.mut_subcommand(action, |action| {
                    action.mut_arg("key", |key| key.value_parser(settings()))
                })
            })
        })
        .mut_subcommand("simulate", |verb| {
            verb.mut_arg("sweep", |sweep| {
                sweep.value_parser(PossibleValuesParser::new(scenes))
            })
        })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_shell_completes_keys_of_settings_and_scenes() {
        for shell in [Shell::Bash, Shell::Zsh, Shell::Fish] {
            let script = script(shell);
            for key in ["restitution_low", "soft_start", "third_lag"] {
                assert!(script.contains(key), "{shell} has no {key}");
            }
            for key in ["part.restitution=", "drive.gain=", "plant.mains=", "seed="] {
                assert!(script.contains(key), "{shell} has no {key}");
            }
        }
    }
}
