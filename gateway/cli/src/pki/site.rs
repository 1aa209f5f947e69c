//! The folder of a site's authority.
//!
//! `ca.pem` holds every authority that is trusted, `ca.key` the key of the one that issues. An authority is replaced in three
//! steps, at each of which everything works: a new one is trusted beside the old (`rotate`), every certificate is renewed
//! under it, the old one is dropped (`retire`). Files are replaced as a whole, so that who reads meanwhile reads one or the other.

use std::fs::{File, OpenOptions};
use std::io::{ErrorKind, Write as _};
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::{Path, PathBuf};

use arthro_bootstrap::config::TlsConfig;
use rcgen::{
    BasicConstraints, CertificateParams, CertifiedIssuer, DistinguishedName, DnType, IsCa, Issuer,
    KeyPair, KeyUsagePurpose, PublicKeyData as _,
};
use time::{Duration, OffsetDateTime};
use x509_parser::pem::Pem;
use x509_parser::prelude::X509Certificate;

use super::leaf::Leaf;
use crate::commands::read;
use crate::exit::Failure;

/// An authority that issues, and its folder.
#[derive(Clone, Debug)]
pub struct Site {
    folder: PathBuf,
}

// === impl Site ===

impl Site {
    /// Makes an authority where there is none.
    pub fn init(folder: &Path, name: &str, days: u32) -> Result<Self, Failure> {
        let site = Self {
            folder: folder.to_owned(),
        };
        std::fs::create_dir_all(folder)?;
        let (certificate, key) = authority(name, Duration::days(days.into()))?;
        create(&site.key_file(), &key, Secrecy::Secret)?;
        create(&site.authority_file(), &certificate, Secrecy::Open)?;
        Ok(site)
    }

    /// The authority that is there.
    pub fn open(folder: &Path) -> Result<Self, Failure> {
        let site = Self {
            folder: folder.to_owned(),
        };
        if !site.exists() {
            return Err(Failure::refused(
                "AUTHORITY_MISSING",
                format!(
                    "{} holds no authority; make one with: arthro pki init {0}",
                    folder.display()
                ),
            ));
        }
        Ok(site)
    }

    /// The authority that is there, or a new one.
    pub fn open_or_init(folder: &Path) -> Result<Self, Failure> {
        let site = Self {
            folder: folder.to_owned(),
        };
        if site.exists() {
            return Ok(site);
        }
        Self::init(folder, "arthro cell", 365)
    }

    /// Where it lives.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    fn exists(&self) -> bool {
        self.key_file().exists()
    }

    /// Which authorities are trusted, PEM.
    pub fn authority_file(&self) -> PathBuf {
        self.folder.join("ca.pem")
    }

    fn key_file(&self) -> PathBuf {
        self.folder.join("ca.key")
    }

    /// The files of a holder.
    pub fn files(&self, file: &str) -> Result<TlsConfig, Failure> {
        let plain = !file.is_empty() && !file.contains('/') && !file.starts_with('.');
        if !plain || file == "ca" {
            return Err(Failure::refused(
                "FILE_NAME_INVALID",
                format!("{file:?} cannot be the name of a holder's files; give --file"),
            ));
        }
        let path = |end: &str| self.folder.join(format!("{file}.{end}"));
        Ok(TlsConfig {
            certificate: path("pem"),
            key: path("key"),
            client_ca: self.authority_file(),
        })
    }

    /// Issues a certificate into files that do not exist yet.
    pub fn issue(&self, leaf: &Leaf, file: &str) -> Result<(), Failure> {
        let files = self.files(file)?;
        for path in [&files.key, &files.certificate] {
            if path.exists() {
                return Err(exists(path));
            }
        }
        let (certificate, key) = self.sign(leaf)?;
        create(&files.key, &key, Secrecy::Secret)?;
        create(&files.certificate, &certificate, Secrecy::Open)
    }

    /// Issues a certificate with a new key in the place of what is there.
    pub fn reissue(&self, leaf: &Leaf, file: &str) -> Result<(), Failure> {
        let files = self.files(file)?;
        let (certificate, key) = self.sign(leaf)?;
        // A server that reads between the two finds that they do not go together, keeps the old ones, and reads again.
        replace(&files.key, &key, Secrecy::Secret)?;
        replace(&files.certificate, &certificate, Secrecy::Open)
    }

    fn sign(&self, leaf: &Leaf) -> Result<(String, String), Failure> {
        let issuer = self.issuer()?;
        let params = leaf.params(OffsetDateTime::now_utc())?;
        let ends = self.issuing()?.ends;
        if params.not_after > ends {
            return Err(Failure::refused(
                "AUTHORITY_ENDS",
                format!(
                    "the authority ends on {}, before a certificate of {} days; give less --days or rotate the authority",
                    ends.date(),
                    leaf.days
                ),
            ));
        }
        let key = KeyPair::generate().map_err(unsigned)?;
        let certificate = params.signed_by(&key, &issuer).map_err(unsigned)?;
        Ok((certificate.pem(), key.serialize_pem()))
    }

    /// Makes a new authority that issues from now on, for as long as the old one; the old one stays trusted.
    pub fn rotate(&self) -> Result<(), Failure> {
        let old = self.issuing()?;
        let (certificate, key) = authority(&old.name, old.ends - old.begins)?;
        let trusted = String::from_utf8_lossy(&read(&self.authority_file())?).into_owned();
        // Trusted before it issues; whoever reads between the two still finds the certificate of the key.
        replace(
            &self.authority_file(),
            &format!("{certificate}{trusted}"),
            Secrecy::Open,
        )?;
        replace(&self.key_file(), &key, Secrecy::Secret)
    }

    /// Trusts only the authority that issues.
    pub fn retire(&self) -> Result<(), Failure> {
        let issuing = self.issuing()?.certificate;
        let text = pem::encode(&pem::Pem::new("CERTIFICATE", issuing));
        replace(&self.authority_file(), &text, Secrecy::Open)
    }

    /// How many authorities are trusted.
    pub fn trusted(&self) -> Result<usize, Failure> {
        Ok(self.authorities()?.len())
    }

    fn key(&self) -> Result<KeyPair, Failure> {
        let text = read(&self.key_file())?;
        KeyPair::from_pem(&String::from_utf8_lossy(&text))
            .map_err(|error| invalid(&self.key_file(), error))
    }

    fn issuer(&self) -> Result<Issuer<'static, KeyPair>, Failure> {
        let certificate = self.issuing()?.certificate.into();
        Issuer::from_ca_cert_der(&certificate, self.key()?)
            .map_err(|error| invalid(&self.authority_file(), error))
    }

    fn authorities(&self) -> Result<Vec<Pem>, Failure> {
        let path = self.authority_file();
        let text = read(&path)?;
        Pem::iter_from_buffer(&text)
            .collect::<Result<_, _>>()
            .map_err(|error| invalid(&path, error))
    }

    /// Of the trusted authorities, the one whose key is here.
    fn issuing(&self) -> Result<Issuing, Failure> {
        let path = self.authority_file();
        let key = self.key()?.subject_public_key_info();
        for pem in self.authorities()? {
            let certificate = pem.parse_x509().map_err(|error| invalid(&path, error))?;
            if certificate.public_key().raw == key {
                return Issuing::read(&certificate).ok_or_else(|| invalid(&path, "has odd dates"));
            }
        }
        Err(invalid(&path, "holds no certificate of ca.key"))
    }
}

/// The authority that issues.
struct Issuing {
    name: String,
    begins: OffsetDateTime,
    ends: OffsetDateTime,
    certificate: Vec<u8>,
}

impl Issuing {
    fn read(certificate: &X509Certificate<'_>) -> Option<Self> {
        let name = certificate.subject().iter_organization().next();
        let validity = certificate.validity();
        let at = |seconds| OffsetDateTime::from_unix_timestamp(seconds).ok();
        Some(Self {
            name: name?.as_str().ok()?.to_owned(),
            begins: at(validity.not_before.timestamp())?,
            ends: at(validity.not_after.timestamp())?,
            certificate: certificate.as_raw().to_vec(),
        })
    }
}

/// A new authority, certificate and key.
fn authority(name: &str, valid: Duration) -> Result<(String, String), Failure> {
    let now = OffsetDateTime::now_utc();
    let mut subject = DistinguishedName::new();
    // Two authorities of one site are told apart by when they were made.
    subject.push(
        DnType::CommonName,
        format!("{name} {}", now.unix_timestamp()),
    );
    subject.push(DnType::OrganizationName, name);
    let mut params = CertificateParams::default();
    params.distinguished_name = subject;
    params.is_ca = IsCa::Ca(BasicConstraints::Constrained(0));
    params.key_usages = vec![KeyUsagePurpose::KeyCertSign, KeyUsagePurpose::CrlSign];
    params.not_before = now - Duration::minutes(5);
    params.not_after = params.not_before + valid + Duration::minutes(5);
    let key = KeyPair::generate().map_err(unsigned)?;
    let issuer = CertifiedIssuer::self_signed(params, key).map_err(unsigned)?;
    Ok((issuer.pem(), issuer.key().serialize_pem()))
}

/// Who may read a file.
#[derive(Clone, Copy)]
enum Secrecy {
    Secret,
    Open,
}

impl Secrecy {
    fn mode(self) -> u32 {
        match self {
            Self::Secret => 0o600,
            Self::Open => 0o644,
        }
    }
}

/// Writes a file that must not exist.
fn create(path: &Path, text: &str, secrecy: Secrecy) -> Result<(), Failure> {
    let file = OpenOptions::new()
        .write(true)
        .create_new(true)
        .mode(secrecy.mode())
        .open(path);
    match file {
        Ok(file) => Ok(write(file, text)?),
        Err(error) if error.kind() == ErrorKind::AlreadyExists => Err(exists(path)),
        Err(error) => Err(invalid(path, error)),
    }
}

/// Puts a new file in the place of an old one, whole or not at all.
fn replace(path: &Path, text: &str, secrecy: Secrecy) -> Result<(), Failure> {
    let mut new = path.as_os_str().to_owned();
    new.push(format!(".{}.new", std::process::id()));
    let new = PathBuf::from(new);
    create(&new, text, secrecy)?;
    std::fs::rename(&new, path).map_err(|error| invalid(path, error))
}

fn write(mut file: File, text: &str) -> std::io::Result<()> {
    file.write_all(text.as_bytes())?;
    file.sync_all()
}

fn exists(path: &Path) -> Failure {
    Failure::refused(
        "FILE_EXISTS",
        format!(
            "{} is there already and is not overwritten; renew it with: arthro pki rotate",
            path.display()
        ),
    )
}

fn invalid(path: &Path, error: impl std::fmt::Display) -> Failure {
    Failure::refused("FILE_INVALID", format!("{}: {error}", path.display()))
}

fn unsigned(error: rcgen::Error) -> Failure {
    Failure::failed("CERTIFICATE_UNSIGNED", error)
}
