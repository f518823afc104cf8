//! Backup of settings, target and recipes before a change of firmware, and comparison after it.

use std::path::{Path, PathBuf};

use kband_control::wire::{Request, Stored};
use kband_control::{Recipe, Target};

use crate::board::{BoardSettings, Link};
use crate::file::Destination;
use crate::refusal::Result;
use crate::simulate::describe;
use crate::verbs::board::{recipe, settings};

pub struct Backup {
    image: String,
    settings: BoardSettings,
    target: Target,
    recipes: Vec<Stored>,
    /// Number of the recipe in use; 0 for none.
    recipe: u8,
}

impl Backup {
    /// Reads a board; refused if it does not answer, or has another version or schema.
    pub fn read(link: &mut Link) -> Result<Self> {
        link.check_protocol()?;
        let settings = BoardSettings::read(link)?;
        let target = link.target()?;
        let recipes = (1..=Recipe::COUNT).map(|number| recipe::stored(link, number));
        Ok(Self {
            settings,
            target,
            recipes: recipes.collect::<Result<_, _>>()?,
            recipe: link.status()?.map_or(0, |status| status.recipe),
            image: link.image().into(),
        })
    }

    /// Selects the former recipe, and compares a board with this backup; returns the differences.
    pub fn differences(&self, link: &mut Link) -> Result<Vec<String>> {
        if self.recipe > 0 {
            link.command(&Request::UseRecipe(self.recipe))?;
        }
        let board = Self::read(link)?;
        let mut changes = Vec::new();
        for old in self.settings.iter() {
            let (key, was) = (&old.key, old.value);
            match board.settings.iter().find(|now| now.key == *key) {
                Some(now) if now.value.to_bits() == was.to_bits() => {}
                Some(now) => changes.push(format!("{key} was {was}, is {}", now.value)),
                None => changes.push(format!("{key} is gone")),
            }
        }
        if board.target != self.target {
            let [was, is] = [self.target, board.target].map(describe);
            changes.push(format!("the target was {was}, is {is}"));
        }
        for (number, (old, now)) in (1..).zip(self.recipes.iter().zip(&board.recipes)) {
            if old != now {
                changes.push(format!("recipe {number} differs"));
            }
        }
        Ok(changes)
    }

    /// Writes files for `kband settings import` and `kband recipe import`; none is overwritten.
    pub fn write(&self, folder: &Path, change: &str) -> Result<Vec<PathBuf>> {
        let recipes = (1..).zip(&self.recipes);
        let recipes = recipes.filter_map(|(number, stored)| match stored {
            Stored::Recipe(name, recipe) => Some((number, *name, *recipe)),
            Stored::None | Stored::Newer => None,
        });
        let recipes: Vec<_> = recipes.collect();
        let mut texts = vec![("settings", settings::export(&self.settings, &self.image))];
        if !recipes.is_empty() {
            texts.push(("recipes", recipe::export(&recipes, &self.image)));
        }
        let write = |(name, text): (&str, String)| {
            let path = unused(folder, &format!("{name}_before_{change}"));
            let target = Destination::check(&path)?.durable();
            target.write_bytes(text.as_bytes())?;
            eprintln!("wrote {}", path.display());
            Ok(path)
        };
        texts.into_iter().map(write).collect()
    }
}

fn unused(folder: &Path, name: &str) -> PathBuf {
    let path = |number: u32| match number {
        1 => folder.join(format!("{name}.toml")),
        _ => folder.join(format!("{name}_{number}.toml")),
    };
    let path = (1..).map(path).find(|path| !path.exists());
    path.unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use kband_control::{RecipeName, Settings};
    use kband_machines::emulator::Machine;
    use kband_machines::images;

    use super::*;
    use crate::board::{Address, Emulated};

    #[test]
    fn a_board_is_compared_with_its_backup() {
        let folder = tempfile::tempdir().unwrap();
        let image = images::build("kband-firmware", "virtual_feeder", Machine::CortexM4F);
        let address = Address::new("qemu", Some(&image));
        let mut link = address.open(Emulated::AtRest).unwrap();
        let before = Backup::read(&mut link).unwrap();
        let written = before.write(folder.path(), "update").unwrap();
        assert!(written[0].ends_with("settings_before_update.toml"));
        let text = std::fs::read_to_string(&written[0]).unwrap();
        assert!(text.contains("frequency = 50"), "{text}");
        assert_eq!(written.len(), 1, "it has no recipes");
        assert_eq!(before.differences(&mut link), Ok(vec![]));
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
            link.command(&request).unwrap();
        }
        let unlike = before.differences(&mut link).unwrap();
        assert_eq!(unlike[0], "gain was 1, is 2");
        assert!(unlike[1].ends_with("is k = 0.5"), "{unlike:?}");
        assert_eq!(unlike[2..], ["recipe 3 differs"]);
    }

    #[test]
    fn no_file_is_overwritten() {
        let folder = tempfile::tempdir().unwrap();
        let first = unused(folder.path(), "settings");
        assert!(first.ends_with("settings.toml"));
        std::fs::write(&first, "").unwrap();
        let second = unused(folder.path(), "settings");
        assert!(second.ends_with("settings_2.toml"));
    }
}
