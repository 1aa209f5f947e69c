//! Where the journal lies: a file of this machine, or a PostgreSQL server.

use std::fmt;
use std::path::PathBuf;

use serde::{Deserialize, Serialize};

/// Text that begins so is a server's address, any other a file's path.
const SERVERS: [&str; 2] = ["postgres://", "postgresql://"];

/// Key `gateway.journal`.
#[derive(Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(from = "String", into = "String")]
pub enum Place {
    /// An SQLite file.
    File(PathBuf),
    /// A database of a server, as an address `postgres://user:password@host:port/database?option=value`.
    Postgres(String),
}

// === impl Place ===

impl From<String> for Place {
    fn from(text: String) -> Self {
        match SERVERS.iter().any(|scheme| text.starts_with(scheme)) {
            true => Self::Postgres(text),
            false => Self::File(text.into()),
        }
    }
}

impl From<PathBuf> for Place {
    fn from(path: PathBuf) -> Self {
        Self::File(path)
    }
}

impl From<Place> for String {
    fn from(place: Place) -> Self {
        match place {
            Place::File(path) => path.to_string_lossy().into_owned(),
            Place::Postgres(address) => address,
        }
    }
}

/// Without the password.
impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::File(path) => path.display().fmt(f),
            Self::Postgres(address) => f.write_str(&without_password(address)),
        }
    }
}

impl fmt::Debug for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

/// The user's part ends at the last `@` before the path; options may name a password too.
fn without_password(address: &str) -> String {
    let (before_options, has_options) = match address.split_once('?') {
        Some((before, _)) => (before, true),
        None => (address, false),
    };
    let hidden = match before_options.split_once("://") {
        Some((scheme, rest)) => {
            let authority = rest.find('/').unwrap_or(rest.len());
            match rest[..authority].rsplit_once('@') {
                Some((user, host)) => {
                    let user = user.split(':').next().unwrap_or_default();
                    format!("{scheme}://{user}@{host}{}", &rest[authority..])
                }
                None => before_options.to_owned(),
            }
        }
        None => before_options.to_owned(),
    };
    if has_options { hidden + "?..." } else { hidden }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_is_a_server_and_anything_else_a_file() {
        let place = |text: &str| Place::from(text.to_owned());
        assert_eq!(
            place("/var/lib/arthro/journal.sqlite"),
            Place::File("/var/lib/arthro/journal.sqlite".into())
        );
        for server in ["postgres://db/arthro", "postgresql://db/arthro"] {
            assert_eq!(place(server), Place::Postgres(server.to_owned()));
        }
    }

    #[test]
    fn a_password_is_never_shown() {
        let shown = |text: &str| format!("{:?}", Place::Postgres(text.to_owned()));
        assert_eq!(
            shown("postgres://arthro:se@cret@db:5432/arthro?password=secret"),
            "postgres://arthro@db:5432/arthro?..."
        );
        assert_eq!(shown("postgres://db/arthro"), "postgres://db/arthro");
        assert_eq!(shown("postgres://arthro@db"), "postgres://arthro@db");
    }
}
