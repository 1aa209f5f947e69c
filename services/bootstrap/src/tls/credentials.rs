//! The identity of a process, as its files stand now.
//!
//! The files may be replaced while the process runs. Whoever opens or accepts a connection takes what is in force; what is in
//! force changes when the files have changed and can be used. A damaged file changes nothing and is told once.

use std::error::Error as _;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, SystemTime};

use super::certificate::Certified;
use super::material::{Material, TlsError};
use crate::config::TlsConfig;

/// How often the files are looked at.
const LOOK_EVERY: Duration = Duration::from_secs(1);
/// How long before its end a certificate is spoken of, the last one first.
const WARN_BEFORE: [Duration; 4] = [
    Duration::from_secs(60 * 60),
    Duration::from_secs(24 * 60 * 60),
    Duration::from_secs(7 * 24 * 60 * 60),
    Duration::from_secs(30 * 24 * 60 * 60),
];

/// What a process shows and whom it believes. Clones are the same.
#[derive(Clone, Debug)]
pub struct Credentials(Arc<Shared>);

#[derive(Debug)]
struct Shared {
    files: TlsConfig,
    state: Mutex<State>,
}

#[derive(Debug)]
struct State {
    material: Arc<Material>,
    /// The files as they were when they were last tried.
    stamps: [Stamp; 3],
    /// Of [`WARN_BEFORE`], the nearest to the end that was spoken of.
    warned: usize,
}

/// Changes when a file is written or replaced.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Stamp {
    inode: u64,
    length: u64,
    modified: Option<SystemTime>,
}

/// What a look at the files has brought.
#[derive(Debug)]
pub enum Refreshed {
    /// They are as they were.
    Unchanged,
    /// New ones are in force.
    Renewed,
    /// New ones cannot be used; the old ones stay in force.
    Kept(TlsError),
}

// === impl Credentials ===

impl Credentials {
    /// Reads the files for the first time.
    ///
    /// # Errors
    /// Files that are missing, damaged, or do not go together.
    pub fn read(files: &TlsConfig) -> Result<Self, TlsError> {
        let stamps = stamps(files);
        let material = Arc::new(Material::read(files)?);
        Ok(Self(Arc::new(Shared {
            files: files.clone(),
            state: Mutex::new(State {
                material,
                stamps,
                warned: WARN_BEFORE.len(),
            }),
        })))
    }

    /// Whom the own certificate names.
    pub fn holder(&self) -> Certified {
        self.material().holder.clone()
    }

    /// Looks whether the files have changed and takes them if they can be used.
    pub fn refresh(&self) -> Refreshed {
        let now = stamps(&self.0.files);
        let mut state = self.state();
        if now == state.stamps {
            return Refreshed::Unchanged;
        }
        state.stamps = now;
        match Material::read(&self.0.files) {
            Ok(material) => {
                state.material = Arc::new(material);
                state.warned = WARN_BEFORE.len();
                Refreshed::Renewed
            }
            Err(error) => Refreshed::Kept(error),
        }
    }

    pub(crate) fn material(&self) -> Arc<Material> {
        self.state().material.clone()
    }

    /// Looks at the files for ever, and at once when `hangup` says so.
    pub(crate) async fn keep_fresh(self, mut hangup: tokio::signal::unix::Signal) {
        let mut looks = tokio::time::interval(LOOK_EVERY);
        looks.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
        loop {
            tokio::select! {
                _ = looks.tick() => {}
                _ = hangup.recv() => {}
            }
            match self.refresh() {
                Refreshed::Unchanged => {}
                Refreshed::Renewed => {
                    let holder = self.holder();
                    tracing::info!(name = holder.name, "the certificate was renewed");
                }
                Refreshed::Kept(error) => tracing::error!(
                    cause = error.source().map(tracing::field::display),
                    "new files of server.tls cannot be used, the old ones stay in force: {error}"
                ),
            }
            self.warn_of_the_end(SystemTime::now());
        }
    }

    fn warn_of_the_end(&self, now: SystemTime) {
        let mut state = self.state();
        let holder = &state.material.holder;
        let left = holder.not_after.duration_since(now).unwrap_or_default();
        let Some(near) = next_warning(left, state.warned) else {
            return;
        };
        tracing::warn!(
            name = holder.name,
            hours_left = left.as_secs() / 3600,
            certificate = %self.0.files.certificate.display(),
            "the own certificate ends soon; nobody will connect after that"
        );
        state.warned = near;
    }

    fn state(&self) -> std::sync::MutexGuard<'_, State> {
        // Nothing panics while it is held, and what it guards is whole at any time.
        self.0.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Which of [`WARN_BEFORE`] to speak of with so much left, `warned` being the last spoken of.
fn next_warning(left: Duration, warned: usize) -> Option<usize> {
    let near = WARN_BEFORE.iter().position(|before| left <= *before)?;
    (near < warned).then_some(near)
}

/// Taken before the files are read, so that what is written meanwhile is noticed the next time.
fn stamps(files: &TlsConfig) -> [Stamp; 3] {
    [&files.certificate, &files.key, &files.client_ca].map(|path| Stamp::of(path))
}

impl Stamp {
    fn of(path: &Path) -> Self {
        use std::os::unix::fs::MetadataExt as _;
        match std::fs::metadata(path) {
            Ok(metadata) => Self {
                inode: metadata.ino(),
                length: metadata.len(),
                modified: metadata.modified().ok(),
            },
            Err(_) => Self {
                inode: 0,
                length: 0,
                modified: None,
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_end_is_spoken_of_once_at_each_distance() {
        let hours = |hours: u64| Duration::from_secs(hours * 60 * 60);
        let mut warned = WARN_BEFORE.len();
        let mut spoken = Vec::new();
        for left in (0..1000).rev() {
            if let Some(near) = next_warning(hours(left), warned) {
                spoken.push(left);
                warned = near;
            }
        }
        assert_eq!(spoken, [720, 168, 24, 1]);
        assert_eq!(next_warning(hours(2), WARN_BEFORE.len()), Some(1));
    }
}
