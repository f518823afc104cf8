//! The scene that the user names.

use std::path::Path;

use kband_scene::{DEFAULT, SceneFile, at_line, table};
use toml::Table;

use super::schema;
use crate::file;
use crate::provenance;
use crate::refusal::Refusal;

pub(crate) struct SceneText {
    /// Name of its file.
    pub name: String,
    text: String,
    pub table: Table,
}

impl SceneText {
    /// Reads a file; without one it is the default scene.
    pub fn read(path: Option<&Path>) -> Result<Self, Refusal> {
        let (name, text) = match path {
            Some(path) => (path.display().to_string(), file::read_text(path)?),
            None => ("the default scene".into(), DEFAULT.into()),
        };
        let table = table(&text).map_err(|refusal| refusal.at(&name))?;
        Ok(Self { name, text, table })
    }

    /// The scene of its table with changes. The provenance of what comes of it names its values.
    pub fn scene(&self, table: &Table) -> Result<SceneFile, Refusal> {
        provenance::scene(table, |section, key| schema::unit(section, key).into());
        SceneFile::from_table(table.clone())
            .map_err(|refusal| at_line(refusal, &self.text).at(&self.name))
    }
}
