//! The recipes of a board as they are stored.
//!
//! | bytes of a recipe | content |
//! |---|---|
//! | 14 | its name, padded with zeros; no name: no recipe |
//! | 1 | kind of the target |
//! | 1 | number of settings |
//! | 4 | number of the target |
//! | 16 | ratio and phase of the target's upper tones |
//! | 6 each | hash of a key, and its value |
//!
//! The keys follow the rules of [`crate::storage::store`]: a missing key gets its default. A recipe
//! with a key unknown to this firmware stays unchanged and is not used.

use crate::storage::store::encoding::{PAIR, Words, hash, pairs, put, put_pairs, target_words};
use kband_control::wire::Stored;
use kband_control::{Recipe, RecipeName, Settings};

const COUNT: usize = Recipe::COUNT as usize;
/// Size of a recipe's name, bytes.
const NAME: usize = 14;
/// Size of a recipe before its settings, bytes.
const HEAD: usize = NAME + 22;
/// Number of settings that fit in a recipe.
const ROOM: usize = 8;
const RECIPE: usize = HEAD + ROOM * PAIR;
/// Size of all recipes, bytes.
pub const SIZE: usize = COUNT * RECIPE;

const _: () = assert!(Recipe::KEYS.len() <= ROOM);

/// The recipes of a board, numbered from 1.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Recipes([[u8; RECIPE]; COUNT]);

impl Default for Recipes {
    fn default() -> Self {
        Self([[0; RECIPE]; COUNT])
    }
}

impl Recipes {
    /// The recipes in these bytes.
    pub fn of(bytes: &[u8]) -> Self {
        let mut recipes = Self::default();
        let (stored, _) = bytes.as_chunks();
        for (recipe, stored) in recipes.0.iter_mut().zip(stored) {
            *recipe = *stored;
        }
        recipes
    }

    /// Their bytes, [`SIZE`] of them.
    pub fn bytes(&self) -> &[u8] {
        self.0.as_flattened()
    }

    /// The recipe of this number.
    pub fn get(&self, number: u8) -> Stored {
        match self.0.get(usize::from(number).wrapping_sub(1)) {
            Some([0, ..]) | None => Stored::None,
            Some(bytes) => {
                decode(bytes).map_or(Stored::Newer, |(name, recipe)| Stored::Recipe(name, recipe))
            }
        }
    }

    /// Changes or deletes the recipe of this number; returns whether there is such a number.
    pub fn set(&mut self, number: u8, recipe: Option<&(RecipeName, Recipe)>) -> bool {
        let place = self.0.get_mut(usize::from(number).wrapping_sub(1));
        let set = place.map(|place| *place = recipe.map_or([0; RECIPE], encode));
        set.is_some()
    }
}

fn encode((name, recipe): &(RecipeName, Recipe)) -> [u8; RECIPE] {
    let mut bytes = [0; RECIPE];
    let mut words = target_words(recipe.target);
    let kind = words.next().unwrap_or_default();
    let (head, settings) = bytes.split_at_mut(HEAD);
    let (named, target) = head.split_at_mut(NAME);
    named.copy_from_slice(&<[u8; NAME]>::from(*name));
    (target[0], target[1]) = (kind as u8, recipe.values.len() as u8);
    put(&mut target[2..], words);
    let hashes = Recipe::KEYS.map(|key| hash(key.as_bytes()));
    put_pairs(settings, hashes.into_iter().zip(recipe.values));
    bytes
}

/// Decodes a recipe; `None` if a newer firmware saved it.
fn decode(bytes: &[u8; RECIPE]) -> Option<(RecipeName, Recipe)> {
    let (name, rest) = bytes.split_first_chunk::<NAME>()?;
    let (head, settings) = rest.split_at_checked(HEAD - NAME)?;
    let [kind, count, target @ ..] = head else {
        return None;
    };
    let mut words = [0; 24];
    words[0] = *kind;
    words[4..].copy_from_slice(target);
    let target = Words(&words).target()?;
    let mut recipe = Recipe::of(target, &Settings::default());
    for (key_hash, value) in pairs(settings, usize::from(*count))? {
        let at = (Recipe::KEYS.into_iter()).position(|key| hash(key.as_bytes()) == key_hash)?;
        *recipe.values.get_mut(at)? = value;
    }
    Some((RecipeName::try_from(*name).ok()?, recipe))
}

#[cfg(test)]
mod tests {
    use super::*;
    use kband_control::{Shape, Target, UpperTone};

    fn some(number: u8) -> (RecipeName, Recipe) {
        let targets = [
            Target::Gear { order: 2 },
            Target::K(0.41),
            Target::Tones {
                k: 0.35,
                shape: Shape::new(UpperTone::new(0.15, 2.356), UpperTone::new(0.05, -1.0)),
            },
        ];
        let settings = Settings {
            restitution_low: 0.01 * f32::from(number),
            contact: 1.0 + f32::from(number),
            ..Settings::default()
        };
        let name = RecipeName::parse(["caps", "12345678901234", "a"][usize::from(number) % 3]);
        let target = targets[usize::from(number) % 3];
        (name.unwrap(), Recipe::of(target, &settings))
    }

    #[test]
    fn each_recipe_comes_back_as_it_was_set() {
        let mut recipes = Recipes::default();
        for number in 0..=u8::MAX {
            assert_eq!(recipes.get(number), Stored::None);
            let exists = (1..=Recipe::COUNT).contains(&number);
            assert_eq!(recipes.set(number, Some(&some(number))), exists);
        }
        let mut reloaded = Recipes::of(recipes.bytes());
        assert_eq!(reloaded, recipes);
        for number in 1..=Recipe::COUNT {
            let (name, recipe) = some(number);
            assert_eq!(reloaded.get(number), Stored::Recipe(name, recipe));
        }
        reloaded.set(3, None);
        assert_eq!(reloaded.get(3), Stored::None);
        assert_ne!(reloaded.get(4), Stored::None);
    }

    #[test]
    fn a_key_that_a_recipe_lacks_gets_its_default() {
        let mut recipes = Recipes::default();
        recipes.set(1, Some(&some(1)));
        recipes.0[0][NAME + 1] -= 1;
        let (name, mut recipe) = some(1);
        recipe.values[7] = Settings::default().contact;
        assert_eq!(recipes.get(1), Stored::Recipe(name, recipe));
    }

    #[test]
    fn a_recipe_of_a_newer_firmware_is_detected_and_kept() {
        let mut recipes = Recipes::default();
        recipes.set(1, Some(&some(1)));
        for (at, value) in [(NAME, 10), (NAME + 1, 9), (HEAD, 0), (0, 7)] {
            let mut newer = recipes.clone();
            newer.0[0][at] = value;
            assert_eq!(newer.get(1), Stored::Newer, "{at}");
            newer.set(2, Some(&some(2)));
            assert_eq!(newer.bytes()[at], value);
        }
    }
}
