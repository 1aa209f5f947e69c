//! The header of an NRRD file: `field: description` lines up to the first empty one.

use std::collections::BTreeMap;

use super::{Error, MAX_HEADER_BYTES};

/// The fields that the reader knows. The format has others, which do not change what a voxel holds or where it is.
const FIELDS: [&str; 16] = [
    "byte skip",
    "data file",
    "dimension",
    "encoding",
    "endian",
    "kinds",
    "line skip",
    "sizes",
    "space",
    "space dimension",
    "space directions",
    "space origin",
    "space units",
    "spacings",
    "type",
    "units",
];

/// Known fields and what they say.
#[derive(Debug)]
pub(super) struct Header(BTreeMap<&'static str, String>);

impl Header {
    /// What a field says, if it stands there.
    pub(super) fn get(&self, field: &'static str) -> Option<&str> {
        self.0.get(field).map(String::as_str)
    }

    /// What a field says that must stand there.
    pub(super) fn need(&self, field: &'static str) -> Result<&str, Error> {
        self.get(field).ok_or(Error::Missing(field))
    }

    /// The refusal of what a field says.
    pub(super) fn refuse(&self, field: &'static str, limit: &'static str) -> Error {
        Error::Field {
            field,
            value: self.get(field).unwrap_or_default().to_owned(),
            limit,
        }
    }
}

/// The header of a file, and what follows it.
pub(super) fn split(file: &[u8]) -> Result<(Header, &[u8]), Error> {
    let mut rest = file;
    let magic = take_line(&mut rest).ok_or(Error::Magic)?;
    if !matches!(
        magic.as_str(),
        "NRRD0001" | "NRRD0002" | "NRRD0003" | "NRRD0004" | "NRRD0005"
    ) {
        return Err(Error::Magic);
    }
    let mut fields = BTreeMap::new();
    for line in 2.. {
        if file.len() - rest.len() > MAX_HEADER_BYTES {
            return Err(Error::Endless);
        }
        // A detached header may end with the file instead of an empty line.
        let Some(text) = take_line(&mut rest) else {
            break;
        };
        if text.is_empty() {
            break;
        }
        let is_key_with_value = text.contains(":=");
        if text.starts_with('#') || is_key_with_value {
            continue;
        }
        let Some((name, description)) = text.split_once(": ") else {
            return Err(Error::Line { line, text });
        };
        // The format also writes `data file` as `datafile`, and so on.
        let squeezed = name.to_ascii_lowercase().replace(' ', "");
        let known = FIELDS
            .iter()
            .find(|field| field.replace(' ', "") == squeezed);
        if let Some(field) = known
            && fields
                .insert(*field, description.trim().to_owned())
                .is_some()
        {
            return Err(Error::Twice(field));
        }
    }
    Ok((Header(fields), rest))
}

/// Takes a line off, without its end; `None` at the end of the file. Never takes more than the longest header.
fn take_line(rest: &mut &[u8]) -> Option<String> {
    if rest.is_empty() {
        return None;
    }
    let window = &rest[..rest.len().min(MAX_HEADER_BYTES + 1)];
    let end = window.iter().position(|byte| *byte == b'\n');
    let (line, taken) = match end {
        Some(end) => (&window[..end], end + 1),
        None => (window, window.len()),
    };
    *rest = &rest[taken..];
    let text = String::from_utf8_lossy(line);
    Some(text.trim_end_matches('\r').to_owned())
}
