//! Section `gateway.audit`: where the audit's key and heads are.

use std::path::{Path, PathBuf};
use std::time::Duration;

use serde::{Deserialize, Serialize};

use crate::audit;
use crate::audit::key::{KeyError, PublicKey, SigningKey};
use crate::journal::Place;

/// Section `gateway.audit`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct AuditConfig {
    /// File of the key that signs, PEM, which only its owner may read; made when absent, its public key beside it with
    /// `.pub`. Unset: the journal's file with `.audit-key`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub key: Option<PathBuf>,
    /// File of the heads, best on a disk that whoever can write the journal cannot; made when absent. Unset: the journal's
    /// file with `.audit-heads`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub heads: Option<PathBuf>,
    /// Public keys of the other gateways on the same journal, PEM.
    pub trusted: Vec<PathBuf>,
    /// How often the heads are put on the disk at the latest, s; with a decision, an approval or an end it is done at once.
    pub heads_sync_s: f64,
}

impl Default for AuditConfig {
    fn default() -> Self {
        Self {
            key: None,
            heads: None,
            trusted: Vec::new(),
            heads_sync_s: 1.0,
        }
    }
}

impl AuditConfig {
    /// Reads the keys, makes what is absent. The files lie beside the journal's file, or in the working folder where that is
    /// no file, unless they are configured.
    pub fn open(&self, journal: &Place) -> Result<audit::Options, KeyError> {
        let journal = match journal {
            Place::File(path) => path.as_path(),
            Place::Postgres(_) => Path::new("arthro-gateway"),
        };
        let beside = |configured: &Option<PathBuf>, ending: &str| {
            configured.clone().unwrap_or_else(|| {
                let mut path = journal.as_os_str().to_owned();
                path.push(ending);
                path.into()
            })
        };
        Ok(audit::Options {
            key: SigningKey::open_or_make(&beside(&self.key, ".audit-key"))?,
            trusted: self
                .trusted
                .iter()
                .map(|path| PublicKey::read(path))
                .collect::<Result<_, _>>()?,
            heads: beside(&self.heads, ".audit-heads"),
            heads_sync: Duration::from_secs_f64(self.heads_sync_s),
        })
    }
}
