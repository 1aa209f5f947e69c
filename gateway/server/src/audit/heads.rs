//! The file of heads: one signed line for every write of the audit, kept beside the journal or, better, where whoever
//! writes the journal cannot write. It is what tells that the journal's end was cut off.

use std::io;
use std::path::{Path, PathBuf};

use tokio::fs::{File, OpenOptions};
use tokio::io::AsyncWriteExt as _;

use super::lines::{self, LineError};
use super::verify::{Defect, Fault, Head};

/// The open file.
#[derive(Debug)]
pub struct HeadsFile {
    path: PathBuf,
    file: File,
    unsynced: bool,
}

/// Why the file of heads cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum HeadsError {
    /// It cannot be read or written.
    #[error("heads file {path} cannot be read or written")]
    File {
        /// Which one.
        path: PathBuf,
        /// What the system says.
        #[source]
        source: io::Error,
    },
    /// A head cannot be written as a line.
    #[error("a head cannot be written")]
    Line(#[from] LineError),
}

// === impl HeadsFile ===

impl HeadsFile {
    /// Opens the file, creates it if it is absent. A last line that a loss of power tore is taken off: its entry stands
    /// in the journal.
    pub async fn open(path: &Path) -> Result<Self, HeadsError> {
        let failed = |source| HeadsError::File {
            path: path.to_owned(),
            source,
        };
        let file = OpenOptions::new()
            .create(true)
            .append(true)
            .open(path)
            .await
            .map_err(failed)?;
        let bytes = tokio::fs::read(path).await.map_err(failed)?;
        let whole = bytes
            .iter()
            .rposition(|&byte| byte == b'\n')
            .map_or(0, |end| end + 1);
        if whole < bytes.len() {
            file.set_len(whole as u64).await.map_err(failed)?;
        }
        Ok(Self {
            path: path.to_owned(),
            file,
            unsynced: false,
        })
    }

    /// Adds a head. It is with the system when this returns, and on the disk after the next [`sync`](Self::sync).
    pub async fn append(&mut self, head: &Head) -> Result<(), HeadsError> {
        let mut line = lines::head(head)?;
        line.push('\n');
        self.unsynced = true;
        let written = self.file.write_all(line.as_bytes()).await;
        match written {
            Ok(()) => self.file.flush().await,
            Err(error) => Err(error),
        }
        .map_err(|source| self.failed(source))
    }

    /// Puts what was added on the disk.
    pub async fn sync(&mut self) -> Result<(), HeadsError> {
        if !self.unsynced {
            return Ok(());
        }
        let synced = self.file.sync_data().await;
        synced.map_err(|source| self.failed(source))?;
        self.unsynced = false;
        Ok(())
    }

    fn failed(&self, source: io::Error) -> HeadsError {
        HeadsError::File {
            path: self.path.clone(),
            source,
        }
    }
}

/// Reads a file of heads; the first line that is none is a defect.
pub fn parse(text: &str) -> Result<Vec<Head>, Defect> {
    let whole = text.rfind('\n').map_or("", |end| &text[..end]);
    let mut heads = Vec::new();
    for (index, line) in whole.lines().enumerate() {
        match lines::read_head(line) {
            Ok(head) => heads.push(head),
            Err(error) => {
                return Err(Defect::new(
                    Fault::HeadDamaged,
                    heads.last().map_or(0, |head: &Head| head.sequence),
                    format!("line {} of the heads: {error}", index + 1),
                ));
            }
        }
    }
    Ok(heads)
}
