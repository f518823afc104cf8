//! Backup of a board's settings, target and recipes before a change of its firmware, and comparison
//! after it.

use std::path::{Path, PathBuf};

use kband_control::wire::Stored;
use kband_control::{Recipe, Target};

use crate::board::{Address, BoardSettings, Emulated, Link};
use crate::file::Destination;
use crate::refusal::Refusal;
use crate::simulate::describe;
use crate::verbs::{recipe, settings};

/// Settings, target and recipes of a board before the change, with its link.
pub struct Backup {
    link: Link,
    held: Held,
}

/// Settings, target and recipes of a board.
struct Held {
    settings: BoardSettings,
    target: Target,
    recipes: Vec<Stored>,
}

impl Held {
    fn read(link: &mut Link) -> Result<Self, Refusal> {
        let settings = BoardSettings::read(link)?;
        let target = link.held()?;
        let recipes = (1..=Recipe::COUNT).map(|number| recipe::stored(link, number));
        Ok(Self {
            settings,
            target,
            recipes: recipes.collect::<Result<_, _>>()?,
        })
    }

    /// Differences of `self` from `before`, in words.
    fn differences(&self, before: &Self) -> Vec<String> {
        let mut found = Vec::new();
        for old in before.settings.iter() {
            match self.settings.iter().find(|now| now.key == old.key) {
                Some(now) if now.value.to_bits() == old.value.to_bits() => {}
                Some(now) => found.push(format!("{} was {}, is {}", old.key, old.value, now.value)),
                None => found.push(format!("{} is gone", old.key)),
            }
        }
        if self.target != before.target {
            let [was, is] = [before.target, self.target].map(describe);
            found.push(format!("the target was {was}, is {is}"));
        }
        for (number, (old, now)) in (1..).zip(before.recipes.iter().zip(&self.recipes)) {
            if old != now {
                found.push(format!("recipe {number} differs"));
            }
        }
        found
    }
}

impl Backup {
    /// Reads a board.
    ///
    /// # Errors
    /// No board of this desk's version and schema answers.
    pub fn read(address: &Address) -> Result<Self, Refusal> {
        let mut link = address.open(Emulated::AtRest)?;
        let held = Held::read(&mut link)?;
        Ok(Self { link, held })
    }

    /// Writes the files of settings and of recipes to `folder`, for `kband settings import` and
    /// `kband recipe import`. None overwrites another.
    ///
    /// # Errors
    /// The folder cannot be written to.
    pub fn write(&self, folder: &Path) -> Result<Vec<PathBuf>, Refusal> {
        let recipes: Vec<_> = (1..)
            .zip(&self.held.recipes)
            .filter_map(|(number, stored)| match stored {
                Stored::Recipe(name, recipe) => Some((number, *name, *recipe)),
                Stored::None | Stored::Newer => None,
            })
            .collect();
        let mut texts = vec![(
            "settings",
            settings::export(&self.held.settings, &self.link),
        )];
        if !recipes.is_empty() {
            texts.push(("recipes", recipe::export(&recipes, self.link.image())));
        }
        texts
            .iter()
            .map(|(name, text)| {
                let path = unused(folder, name);
                Destination::check(&path)?.write_bytes(text.as_bytes())?;
                Ok(path)
            })
            .collect()
    }

    /// Differences of the board from its backup, in words; empty if it is unchanged.
    ///
    /// # Errors
    /// The board does not answer, or has another version or schema.
    pub fn differences(&mut self) -> Result<Vec<String>, Refusal> {
        self.link.identify()?;
        self.link.speaks_the_same()?;
        let now = Held::read(&mut self.link)?;
        Ok(now.differences(&self.held))
    }
}

/// An unused name in `folder`.
fn unused(folder: &Path, name: &str) -> PathBuf {
    let path = |number: u32| match number {
        1 => folder.join(format!("{name}_before_flash.toml")),
        _ => folder.join(format!("{name}_before_flash_{number}.toml")),
    };
    (1..)
        .map(path)
        .find(|path| !path.exists())
        .unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use kband_control::wire::Request;
    use kband_control::{RecipeName, Settings};
    use kband_machines::emulator::Machine;
    use kband_machines::images;

    use super::*;

    #[test]
    fn a_board_is_compared_with_what_it_held_before() {
        let folder = tempfile::tempdir().unwrap();
        let image = images::build("kband-firmware", "virtual_feeder", Machine::CortexM4F);
        let mut backup = Backup::read(&Address::of("qemu", Some(&image))).unwrap();
        let written = backup.write(folder.path()).unwrap();
        let text = std::fs::read_to_string(&written[0]).unwrap();
        assert!(text.contains("frequency = 50"), "{text}");
        assert_eq!(written.len(), 1, "it has no recipes");
        assert_eq!(backup.differences(), Ok(vec![]));
        let parts = RecipeName::parse("parts").unwrap();
        let recipe = Recipe::of(Target::K(0.5), &Settings::default());
        for request in [
            Request::set("gain", 2.0),
            Request::Target(Target::K(0.5)),
            Request::SetRecipe {
                number: 3,
                recipe: Some((parts, recipe)),
            },
        ] {
            backup.link.tell(&request).unwrap();
        }
        let unlike = backup.differences().unwrap();
        assert_eq!(unlike[0], "gain was 1, is 2");
        assert!(unlike[1].ends_with("is k = 0.5"), "{unlike:?}");
        assert_eq!(unlike[2..], ["recipe 3 differs"]);
    }

    #[test]
    fn no_file_is_overwritten() {
        let folder = tempfile::tempdir().unwrap();
        let first = unused(folder.path(), "settings");
        assert!(first.ends_with("settings_before_flash.toml"));
        std::fs::write(&first, "").unwrap();
        let second = unused(folder.path(), "settings");
        assert!(second.ends_with("settings_before_flash_2.toml"));
    }
}
