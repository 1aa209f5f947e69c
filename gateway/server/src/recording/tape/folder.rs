//! The folder of recordings: names of files, its size, and what is held in reserve there.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// `PROCEDURE-001.mcap`, or the number after the last that is there.
pub(super) fn next_path(folder: &Path, procedure_id: &str) -> io::Result<(PathBuf, u32)> {
    let mut last = 0;
    for entry in fs::read_dir(folder)? {
        let name = entry?.file_name();
        let number = name
            .to_str()
            .and_then(|name| name.strip_prefix(procedure_id)?.strip_prefix('-'))
            .and_then(|rest| rest.strip_suffix(".mcap")?.parse().ok());
        last = last.max(number.unwrap_or(0));
    }
    let number = last + 1;
    Ok((
        folder.join(format!("{procedure_id}-{number:03}.mcap")),
        number,
    ))
}

pub(super) fn folder_bytes(folder: &Path) -> io::Result<u64> {
    let mut bytes = 0;
    for entry in fs::read_dir(folder)? {
        // A file that goes while it is looked at holds nothing.
        bytes += entry?.metadata().map_or(0, |metadata| metadata.len());
    }
    Ok(bytes)
}

pub(super) fn reserve(path: &Path) -> PathBuf {
    path.with_extension("mcap.reserve")
}

/// Reserves that a killed gateway left.
pub(super) fn remove_reserves(folder: &Path) {
    let Ok(entries) = fs::read_dir(folder) else {
        return;
    };
    for entry in entries.flatten() {
        let path = entry.path();
        if path
            .extension()
            .is_some_and(|extension| extension == "reserve")
        {
            fs::remove_file(path).ok();
        }
    }
}
