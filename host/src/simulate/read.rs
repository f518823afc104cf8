//! The scene named by the user.

use std::path::Path;

use kband_scene::{DEFAULT, SceneFile, at_line, table};
use toml::Table;

use super::schema;
use crate::file;
use crate::provenance;
use crate::refusal::Refusal;

pub(crate) struct SceneText {
    pub name: String,
    text: String,
    pub table: Table,
}

impl SceneText {
    /// Reads a file; without a path, the default scene.
    pub fn read(path: Option<&Path>) -> Result<Self, Refusal> {
        let (name, text) = match path {
            Some(path) => (path.display().to_string(), file::read_text(path)?),
            None => ("the default scene".into(), DEFAULT.into()),
        };
        let table = table(&text).map_err(|refusal| refusal.at(&name))?;
        Ok(Self { name, text, table })
    }

    /// The scene of the table with changes. The provenance of its results contains its values.
    pub fn scene(&self, table: &Table) -> Result<SceneFile, Refusal> {
        provenance::scene(table, schema::unit);
        SceneFile::from_table(table.clone())
            .map_err(|refusal| at_line(refusal, &self.text).at(&self.name))
    }
}
