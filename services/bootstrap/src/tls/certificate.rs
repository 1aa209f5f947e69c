//! What a certificate of the site says of its holder: name and role, as two URIs among its subject alternative names.
//!
//! `urn:arthro:name:Dr.%20Adams` and `urn:arthro:role:surgeon`. Each stands there exactly once, and nothing else begins with
//! `urn:arthro:`. Of a name, all but letters, digits and `-._~` is percent-encoded UTF-8.

use std::time::{Duration, SystemTime, UNIX_EPOCH};

use x509_parser::prelude::{FromDer as _, GeneralName, X509Certificate};

use crate::identity::Role;

const URN: &str = "urn:arthro:";
const NAME: &str = "urn:arthro:name:";
const ROLE: &str = "urn:arthro:role:";
/// A name may have this many characters.
pub const NAME_LENGTH_MAX: usize = 64;

/// Who holds a certificate, and for how long.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Certified {
    /// The person or service.
    pub name: String,
    /// What they may do.
    pub role: Role,
    /// Not valid before this.
    pub not_before: SystemTime,
    /// Not valid after this.
    pub not_after: SystemTime,
}

/// Why a certificate names nobody.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CertificateError {
    /// No X.509 certificate.
    #[error("cannot be read as an X.509 certificate")]
    Unreadable,
    /// Nothing or several where one thing must stand.
    #[error("has {count} subject alternative names of the form {form}…; must have exactly one")]
    NotOne {
        /// How the name begins.
        form: &'static str,
        /// How many there are.
        count: usize,
    },
    /// A word that is no role.
    #[error("carries the role {0:?}; must be viewer, operator, surgeon or service")]
    UnknownRole(String),
    /// A name that is none.
    #[error("carries the name {0:?}; must be 1 .. {NAME_LENGTH_MAX} printable characters")]
    BadName(String),
    /// Something that nobody knows how to read.
    #[error("carries {0:?}; of {URN} only name and role are known")]
    UnknownUrn(String),
}

// === impl Certified ===

impl Certified {
    /// Reads a certificate, which somebody else has verified.
    ///
    /// # Errors
    /// It does not name exactly one holder and one role.
    pub fn read(der: &[u8]) -> Result<Self, CertificateError> {
        let (rest, certificate) =
            X509Certificate::from_der(der).map_err(|_| CertificateError::Unreadable)?;
        if !rest.is_empty() {
            return Err(CertificateError::Unreadable);
        }
        // A second extension of the same kind is an error of the parser, so that none can hide behind the first.
        let names = certificate
            .subject_alternative_name()
            .map_err(|_| CertificateError::Unreadable)?;
        let uris: Vec<&str> = names
            .iter()
            .flat_map(|names| &names.value.general_names)
            .filter_map(|name| match name {
                GeneralName::URI(uri) if uri.starts_with(URN) => Some(*uri),
                _ => None,
            })
            .collect();
        if let Some(unknown) = uris
            .iter()
            .find(|uri| !uri.starts_with(NAME) && !uri.starts_with(ROLE))
        {
            return Err(CertificateError::UnknownUrn((*unknown).to_owned()));
        }
        let role = only(&uris, ROLE)?;
        let name = only(&uris, NAME)?;
        let validity = certificate.validity();
        Ok(Self {
            name: name_of(name).ok_or_else(|| CertificateError::BadName(name.to_owned()))?,
            role: Role::parse(role)
                .ok_or_else(|| CertificateError::UnknownRole(role.to_owned()))?,
            not_before: at(validity.not_before.timestamp()),
            not_after: at(validity.not_after.timestamp()),
        })
    }

    /// Whether the certificate holds at this time.
    pub fn is_valid_at(&self, now: SystemTime) -> bool {
        (self.not_before..=self.not_after).contains(&now)
    }
}

/// The two subject alternative names that say so, or nothing where `name` cannot be one.
pub fn uris(name: &str, role: Role) -> Option<[String; 2]> {
    let encoded = encode(name);
    (name_of(&encoded).as_deref() == Some(name))
        .then(|| [format!("{NAME}{encoded}"), format!("{ROLE}{role}")])
}

fn only<'a>(uris: &[&'a str], form: &'static str) -> Result<&'a str, CertificateError> {
    let mut found = uris.iter().filter_map(|uri| uri.strip_prefix(form));
    match (found.next(), found.count()) {
        (Some(value), 0) => Ok(value),
        (None, _) => Err(CertificateError::NotOne { form, count: 0 }),
        (Some(_), more) => Err(CertificateError::NotOne {
            form,
            count: more + 1,
        }),
    }
}

fn at(seconds: i64) -> SystemTime {
    let length = Duration::from_secs(seconds.unsigned_abs());
    let time = if seconds < 0 {
        UNIX_EPOCH.checked_sub(length)
    } else {
        UNIX_EPOCH.checked_add(length)
    };
    time.unwrap_or(UNIX_EPOCH)
}

fn encode(name: &str) -> String {
    let mut encoded = String::new();
    for byte in name.bytes() {
        if byte.is_ascii_alphanumeric() || b"-._~".contains(&byte) {
            encoded.push(char::from(byte));
        } else {
            encoded.push_str(&format!("%{byte:02X}"));
        }
    }
    encoded
}

/// A name that can stand in a log line and be told from another by eye: no controls, no blanks at its ends.
fn name_of(encoded: &str) -> Option<String> {
    let mut bytes = Vec::new();
    let mut rest = encoded.bytes();
    while let Some(byte) = rest.next() {
        bytes.push(match byte {
            b'%' => {
                let mut digit = || char::from(rest.next()?).to_digit(16);
                u8::try_from(digit()? * 16 + digit()?).ok()?
            }
            _ => byte,
        });
    }
    let name = String::from_utf8(bytes).ok()?;
    let fits = (1..=NAME_LENGTH_MAX).contains(&name.chars().count());
    let plain = !name.chars().any(char::is_control) && name.trim() == name;
    (fits && plain).then_some(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_comes_back_from_its_uri() {
        for name in ["Dr. Adams", "gateway", "张晓", "50%/β"] {
            let [uri, role] = uris(name, Role::Surgeon).unwrap();
            assert_eq!(name_of(uri.strip_prefix(NAME).unwrap()).unwrap(), name);
            assert_eq!(role, "urn:arthro:role:surgeon");
        }
    }

    #[test]
    fn a_name_that_cannot_be_told_by_eye_is_none() {
        let long = "a".repeat(NAME_LENGTH_MAX + 1);
        for name in ["", " Dr. Adams", "Dr.\nAdams", long.as_str()] {
            assert_eq!(uris(name, Role::Viewer), None, "{name:?}");
        }
        for encoded in ["%4", "%zz", "%ff", "%0a"] {
            assert_eq!(name_of(encoded), None, "{encoded:?}");
        }
    }
}
