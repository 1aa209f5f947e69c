//! What a certificate of a person or service says, on its way into a file and out of it.

use std::net::IpAddr;
use std::path::Path;

use arthro_bootstrap::Role;
use arthro_bootstrap::tls::{Certified, certificate};
use rcgen::string::Ia5String;
use rcgen::{
    CertificateParams, DistinguishedName, DnType, ExtendedKeyUsagePurpose, KeyUsagePurpose, SanType,
};
use time::{Duration, OffsetDateTime};
use x509_parser::pem::Pem;
use x509_parser::prelude::GeneralName;

use crate::exit::Failure;

/// Clocks of a site may differ by this much.
const CLOCKS_DIFFER: Duration = Duration::minutes(5);
const DAY_S: u64 = 24 * 60 * 60;

/// A certificate to issue.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Leaf {
    /// The person or service.
    pub name: String,
    /// What they may do.
    pub role: Role,
    /// Where a service is called.
    pub dns: Vec<String>,
    /// Where a service is called.
    pub ip: Vec<IpAddr>,
    /// For how long.
    pub days: u32,
}

// === impl Leaf ===

impl Leaf {
    /// A service of a cell on one machine.
    pub fn on_this_machine(name: &str) -> Self {
        Self {
            name: name.to_owned(),
            role: Role::Service,
            dns: vec!["localhost".to_owned()],
            ip: vec![[127, 0, 0, 1].into(), std::net::Ipv6Addr::LOCALHOST.into()],
            days: 90,
        }
    }

    /// What an issued certificate says.
    pub fn read(path: &Path) -> Result<Self, Failure> {
        let holder = certified(path)?;
        let unreadable = |problem: String| {
            Failure::refused("FILE_INVALID", format!("{}: {problem}", path.display()))
        };
        let pem = first_pem(path)?;
        let certificate = pem
            .parse_x509()
            .map_err(|error| unreadable(error.to_string()))?;
        let names = certificate
            .subject_alternative_name()
            .map_err(|error| unreadable(error.to_string()))?;
        let (mut dns, mut ip) = (Vec::new(), Vec::new());
        for name in names.iter().flat_map(|names| &names.value.general_names) {
            match name {
                GeneralName::DNSName(host) => dns.push((*host).to_owned()),
                GeneralName::IPAddress(bytes) => ip.push(
                    address(bytes)
                        .ok_or_else(|| unreadable(format!("{bytes:?} is no IP address")))?,
                ),
                _ => {}
            }
        }
        let valid = holder.not_after.duration_since(holder.not_before);
        let days = valid.unwrap_or_default().as_secs() / DAY_S;
        Ok(Self {
            name: holder.name,
            role: holder.role,
            dns,
            ip,
            days: u32::try_from(days).unwrap_or(u32::MAX).max(1),
        })
    }

    /// What its files are called: the name in small letters, and a dash for all that a shell might trip over.
    pub fn file(&self) -> String {
        let plain: String = self
            .name
            .to_lowercase()
            .chars()
            .map(|letter| {
                if letter.is_alphanumeric() {
                    letter
                } else {
                    ' '
                }
            })
            .collect();
        plain.split_whitespace().collect::<Vec<_>>().join("-")
    }

    /// As the authority signs it.
    pub fn params(&self, now: OffsetDateTime) -> Result<CertificateParams, Failure> {
        let uris = certificate::uris(&self.name, self.role).ok_or_else(|| {
            Failure::refused(
                "NAME_INVALID",
                format!(
                    "--name is {:?}; must be 1 .. {} printable characters without blanks at its ends",
                    self.name,
                    certificate::NAME_LENGTH_MAX
                ),
            )
        })?;
        if self.role == Role::Service && self.dns.is_empty() && self.ip.is_empty() {
            return Err(Failure::refused(
                "HOST_MISSING",
                "a service is certified for the hosts under which it is called; give --dns or --ip",
            ));
        }
        let mut names: Vec<SanType> = Vec::new();
        for uri in uris {
            names.push(SanType::URI(plain(&uri)?));
        }
        for host in &self.dns {
            names.push(SanType::DnsName(plain(host)?));
        }
        names.extend(self.ip.iter().copied().map(SanType::IpAddress));
        let mut subject = DistinguishedName::new();
        subject.push(DnType::CommonName, self.name.as_str());
        subject.push(DnType::OrganizationalUnitName, self.role.as_str());
        let mut params = CertificateParams::default();
        params.distinguished_name = subject;
        params.subject_alt_names = names;
        params.not_before = now - CLOCKS_DIFFER;
        params.not_after = now + Duration::days(self.days.into());
        params.key_usages = vec![KeyUsagePurpose::DigitalSignature];
        params.extended_key_usages = vec![ExtendedKeyUsagePurpose::ClientAuth];
        if self.role == Role::Service {
            // Only a service may answer calls: no person can pose as one.
            params
                .extended_key_usages
                .push(ExtendedKeyUsagePurpose::ServerAuth);
        }
        params.use_authority_key_identifier_extension = true;
        Ok(params)
    }
}

/// Whom the certificate in a file names.
pub fn certified(path: &Path) -> Result<Certified, Failure> {
    Certified::read(&first_pem(path)?.contents)
        .map_err(|error| Failure::refused("FILE_INVALID", format!("{} {error}", path.display())))
}

fn first_pem(path: &Path) -> Result<Pem, Failure> {
    let bytes = crate::commands::read(path)?;
    let (pem, _) = Pem::read(std::io::Cursor::new(bytes)).map_err(|error| {
        Failure::refused("FILE_INVALID", format!("{}: {error}", path.display()))
    })?;
    Ok(pem)
}

fn plain(text: &str) -> Result<Ia5String, Failure> {
    Ia5String::try_from(text).map_err(|_| {
        Failure::refused(
            "HOST_INVALID",
            format!("{text:?} is not ASCII; write an international name as xn--…"),
        )
    })
}

fn address(bytes: &[u8]) -> Option<IpAddr> {
    match bytes.len() {
        4 => <[u8; 4]>::try_from(bytes).ok().map(IpAddr::from),
        16 => <[u8; 16]>::try_from(bytes).ok().map(IpAddr::from),
        _ => None,
    }
}
