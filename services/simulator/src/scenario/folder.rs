//! A scenario as a folder: `scenario.toml` says what it was made from, `model.ply` and `lesion.ply`
//! are what the system is given. Everything else follows from the first two.

use std::path::Path;

use arthro_geometry::{Cloud, ply};
use serde::{Deserialize, Serialize};

use super::{Scenario, Source, Spec};
use crate::Error;

const SCENARIO: &str = "scenario.toml";
const MODEL: &str = "model.ply";
const LESION: &str = "lesion.ply";

/// What `scenario.toml` holds.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Written {
    source: Source,
    spec: Spec,
}

impl Scenario {
    /// Writes the case into `folder`, which is created where it is missing.
    ///
    /// # Errors
    /// When a file cannot be written.
    pub fn save(&self, folder: &Path) -> Result<(), Error> {
        let text = toml::to_string_pretty(&Written {
            source: self.source,
            spec: self.spec.clone(),
        })?;
        let lesion = Cloud::new(self.preoperative.lesion.clone());
        let cannot_write = |path: &Path| {
            let path = path.to_owned();
            move |source| Error::File { path, source }
        };
        std::fs::create_dir_all(folder).map_err(cannot_write(folder))?;
        for (name, bytes) in [
            (SCENARIO, text.into_bytes()),
            (MODEL, ply::write_mesh(&self.preoperative.model)),
            (LESION, ply::write_cloud(&lesion)),
        ] {
            let path = folder.join(name);
            std::fs::write(&path, bytes).map_err(cannot_write(&path))?;
        }
        Ok(())
    }

    /// Reads a case written by [`Scenario::save`]; the result equals what was saved.
    ///
    /// # Errors
    /// When a file is missing or refused.
    pub fn load(folder: &Path) -> Result<Self, Error> {
        let path = folder.join(SCENARIO);
        let bytes = read(&path)?;
        let written: Written = toml::from_slice(&bytes).map_err(|source| Error::ScenarioText {
            path,
            source: Box::new(source),
        })?;
        match written.source {
            Source::Phantom => Self::phantom(written.spec),
            Source::Mesh => {
                let path = folder.join(MODEL);
                let model = ply::read_mesh(&read(&path)?, None)
                    .map_err(|source| Error::Ply { path, source })?;
                Self::of_mesh(written.spec, model)
            }
        }
    }
}

fn read(path: &Path) -> Result<Vec<u8>, Error> {
    std::fs::read(path).map_err(|source| Error::File {
        path: path.to_owned(),
        source,
    })
}
