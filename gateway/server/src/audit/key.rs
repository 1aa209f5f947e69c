//! The gateway's signing key: Ed25519, made at the first start, in a file that only its owner reads. Beside it lies the
//! public key, which is all that a check of the chain needs.

use std::fmt;
use std::fs::OpenOptions;
use std::io::{self, Write as _};
use std::os::unix::fs::{OpenOptionsExt as _, PermissionsExt as _};
use std::path::{Path, PathBuf};

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use ring::rand::SystemRandom;
use ring::signature::{ED25519, Ed25519KeyPair, KeyPair as _, UnparsedPublicKey};
use sha2::{Digest as _, Sha256};

use super::entry::{Entry, Link, SIGNATURE_BYTES, Tail};

/// What stands before the 32 bytes of an Ed25519 key in the form of RFC 8410.
const PUBLIC_PREFIX: [u8; 12] = [
    0x30, 0x2a, 0x30, 0x05, 0x06, 0x03, 0x2b, 0x65, 0x70, 0x03, 0x21, 0x00,
];
const PUBLIC_LABEL: &str = "PUBLIC KEY";
const PRIVATE_LABEL: &str = "PRIVATE KEY";

/// Names a key: the first eight bytes of SHA-256 of the public key, hexadecimal.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct KeyId(String);

/// What signs.
pub struct SigningKey {
    pair: Ed25519KeyPair,
    public: PublicKey,
}

/// What checks a signature.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PublicKey {
    id: KeyId,
    bytes: [u8; 32],
}

/// Why a key cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum KeyError {
    /// The file cannot be read or written.
    #[error("audit key {path} cannot be read or written")]
    File {
        /// Which one.
        path: PathBuf,
        /// What the system says.
        #[source]
        source: io::Error,
    },
    /// Others may read the private key.
    #[error("audit key {path} has the mode {mode:o}; must be 600, so that nobody else reads it")]
    Open {
        /// Which one.
        path: PathBuf,
        /// Its permission bits.
        mode: u32,
    },
    /// The file holds no key.
    #[error("audit key {path} holds no Ed25519 key in PEM")]
    Damaged {
        /// Which one.
        path: PathBuf,
    },
    /// The system gives no random numbers.
    #[error("the system gives no random numbers for an audit key")]
    Random,
}

// === impl KeyId ===

impl KeyId {
    /// From its text, as it stands in an entry.
    pub fn from_text(text: impl Into<String>) -> Self {
        Self(text.into())
    }

    /// Its text.
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl fmt::Display for KeyId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

// === impl SigningKey ===

impl SigningKey {
    /// Reads the key, or makes one where there is none; the public key is written beside it either way.
    pub fn open_or_make(path: &Path) -> Result<Self, KeyError> {
        let failed = |source| KeyError::File {
            path: path.to_owned(),
            source,
        };
        match std::fs::metadata(path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => {
                let document = Ed25519KeyPair::generate_pkcs8(&SystemRandom::new())
                    .map_err(|_| KeyError::Random)?;
                make(path, pem(PRIVATE_LABEL, document.as_ref()).as_bytes()).map_err(failed)?;
            }
            Err(error) => return Err(failed(error)),
            Ok(metadata) => {
                let mode = metadata.permissions().mode() & 0o777;
                if mode & 0o077 != 0 {
                    return Err(KeyError::Open {
                        path: path.to_owned(),
                        mode,
                    });
                }
            }
        }
        let text = std::fs::read_to_string(path).map_err(failed)?;
        let damaged = || KeyError::Damaged {
            path: path.to_owned(),
        };
        let document = from_pem(PRIVATE_LABEL, &text).ok_or_else(damaged)?;
        let key = Self::from_pkcs8(&document).ok_or_else(damaged)?;
        let public_path = public_path(path);
        std::fs::write(&public_path, key.public.to_pem()).map_err(|source| KeyError::File {
            path: public_path,
            source,
        })?;
        Ok(key)
    }

    /// A key that lives as long as this value.
    pub fn fleeting() -> Result<Self, KeyError> {
        let document =
            Ed25519KeyPair::generate_pkcs8(&SystemRandom::new()).map_err(|_| KeyError::Random)?;
        Self::from_pkcs8(document.as_ref()).ok_or(KeyError::Random)
    }

    fn from_pkcs8(document: &[u8]) -> Option<Self> {
        let pair = Ed25519KeyPair::from_pkcs8(document).ok()?;
        let bytes = pair.public_key().as_ref().try_into().ok()?;
        Some(Self {
            pair,
            public: PublicKey::of(bytes),
        })
    }

    /// What checks this key's signatures.
    pub fn public(&self) -> &PublicKey {
        &self.public
    }

    /// The entry after `tail`, hashed and signed.
    pub fn link(&self, tail: Tail, entry: Entry) -> Link {
        let sequence = tail.sequence + 1;
        let key = self.public.id.clone();
        let hash = entry.hash(sequence, &tail.hash, &key);
        let mut signature = [0; SIGNATURE_BYTES];
        signature.copy_from_slice(self.pair.sign(hash.as_bytes()).as_ref());
        Link {
            sequence,
            previous: tail.hash,
            entry,
            hash,
            key,
            signature,
        }
    }
}

impl fmt::Debug for SigningKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "SigningKey({})", self.public.id)
    }
}

// === impl PublicKey ===

impl PublicKey {
    fn of(bytes: [u8; 32]) -> Self {
        let hash: [u8; 32] = Sha256::digest(bytes).into();
        let id = hash[..8].iter().map(|byte| format!("{byte:02x}")).collect();
        Self {
            id: KeyId(id),
            bytes,
        }
    }

    /// Reads a public key's PEM file.
    pub fn read(path: &Path) -> Result<Self, KeyError> {
        let text = std::fs::read_to_string(path).map_err(|source| KeyError::File {
            path: path.to_owned(),
            source,
        })?;
        Self::from_pem(&text).ok_or_else(|| KeyError::Damaged {
            path: path.to_owned(),
        })
    }

    /// From PEM as RFC 8410 has it.
    pub fn from_pem(text: &str) -> Option<Self> {
        let document = from_pem(PUBLIC_LABEL, text)?;
        let bytes = document.strip_prefix(&PUBLIC_PREFIX)?.try_into().ok()?;
        Some(Self::of(bytes))
    }

    /// As PEM, which `openssl pkey -pubin` reads too.
    pub fn to_pem(&self) -> String {
        let mut document = PUBLIC_PREFIX.to_vec();
        document.extend_from_slice(&self.bytes);
        pem(PUBLIC_LABEL, &document)
    }

    /// Its name in the entries.
    pub fn id(&self) -> &KeyId {
        &self.id
    }

    /// Whether this key signed these bytes.
    pub fn signed(&self, bytes: &[u8], signature: &[u8]) -> bool {
        UnparsedPublicKey::new(&ED25519, self.bytes)
            .verify(bytes, signature)
            .is_ok()
    }
}

/// Puts a file there whole, unless another gateway that starts at the same time was first.
fn make(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let mut fresh = path.as_os_str().to_owned();
    fresh.push(format!(".{}", std::process::id()));
    let fresh = PathBuf::from(fresh);
    let mut file = OpenOptions::new()
        .write(true)
        .create_new(true)
        .mode(0o600)
        .open(&fresh)?;
    file.write_all(bytes)?;
    file.sync_all()?;
    let linked = std::fs::hard_link(&fresh, path);
    std::fs::remove_file(&fresh)?;
    match linked {
        Err(error) if error.kind() != io::ErrorKind::AlreadyExists => Err(error),
        _ => Ok(()),
    }
}

/// Where the public key of the key at `path` lies.
pub fn public_path(path: &Path) -> PathBuf {
    let mut public = path.as_os_str().to_owned();
    public.push(".pub");
    public.into()
}

fn pem(label: &str, document: &[u8]) -> String {
    // An Ed25519 document is short; its base64 fits into lines of 64 as PEM wants them.
    let text = STANDARD.encode(document);
    let mut lines = String::new();
    for (index, character) in text.chars().enumerate() {
        if index > 0 && index % 64 == 0 {
            lines.push('\n');
        }
        lines.push(character);
    }
    format!("-----BEGIN {label}-----\n{lines}\n-----END {label}-----\n")
}

fn from_pem(label: &str, text: &str) -> Option<Vec<u8>> {
    let body = text
        .split_once(&format!("-----BEGIN {label}-----"))?
        .1
        .split_once(&format!("-----END {label}-----"))?
        .0;
    let body: String = body.split_whitespace().collect();
    STANDARD.decode(body).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_key_is_made_once_and_only_its_owner_reads_it() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("audit-key");
        let made = SigningKey::open_or_make(&path).unwrap();
        let mode = std::fs::metadata(&path).unwrap().permissions().mode();
        assert_eq!(mode & 0o777, 0o600);
        let opened = SigningKey::open_or_make(&path).unwrap();
        assert_eq!(opened.public(), made.public());
        let public = PublicKey::read(&public_path(&path)).unwrap();
        assert_eq!(&public, made.public());
    }

    #[test]
    fn a_key_that_others_may_read_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("audit-key");
        SigningKey::open_or_make(&path).unwrap();
        std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o640)).unwrap();
        assert!(matches!(
            SigningKey::open_or_make(&path),
            Err(KeyError::Open { mode: 0o640, .. })
        ));
    }

    #[test]
    fn a_file_without_a_key_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("audit-key.pub");
        std::fs::write(&path, "-----BEGIN PUBLIC KEY-----\nAAAA\n").unwrap();
        assert!(matches!(
            PublicKey::read(&path),
            Err(KeyError::Damaged { .. })
        ));
    }
}
