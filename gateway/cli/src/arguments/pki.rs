//! `arthro pki`: the certificates of a site.

use std::net::IpAddr;
use std::path::PathBuf;

use arthro_bootstrap::Role;
use clap::{Args, Subcommand, ValueEnum};

#[derive(Debug, Subcommand)]
pub enum Pki {
    /// Makes the site's authority: ca.pem, which everybody trusts, and ca.key, which only issues.
    Init(PkiInit),
    /// Issues a certificate that names a person or service and one role.
    Issue(PkiIssue),
    /// Renews a certificate with a new key, or the authority itself with a time of overlap.
    Rotate(PkiRotate),
}

#[derive(Debug, Args)]
pub struct PkiInit {
    /// Where the authority lives; keep it where only who issues can read.
    pub folder: PathBuf,
    /// The site, for people to read.
    #[arg(long, default_value = "arthro site")]
    pub name: String,
    /// How long the authority is valid, days.
    #[arg(long, default_value_t = 3650, value_parser = clap::value_parser!(u32).range(1..=7300))]
    pub days: u32,
}

#[derive(Debug, Args)]
pub struct PkiIssue {
    /// The authority's folder.
    pub folder: PathBuf,
    /// The person or service; records keep this name.
    #[arg(long)]
    pub name: String,
    /// What they may do.
    #[arg(long, value_enum)]
    pub role: RoleName,
    /// DNS name under which a service is called; may be given several times.
    #[arg(long, value_name = "HOST")]
    pub dns: Vec<String>,
    /// IP address under which a service is called; may be given several times.
    #[arg(long, value_name = "ADDRESS")]
    pub ip: Vec<IpAddr>,
    /// How long the certificate is valid, days.
    #[arg(long, default_value_t = 90, value_parser = clap::value_parser!(u32).range(1..=825))]
    pub days: u32,
    /// What the files are called, before .pem and .key; from the name if not given.
    #[arg(long, value_name = "FILE")]
    pub file: Option<String>,
}

#[derive(Debug, Args)]
#[group(skip)]
pub struct PkiRotate {
    /// The authority's folder.
    pub folder: PathBuf,
    /// The certificate to renew, as its files are called, without .pem.
    #[arg(value_name = "FILE", required_unless_present_any = ["authority", "retire"], conflicts_with_all = ["authority", "retire"])]
    pub file: Option<String>,
    /// Makes a new authority that issues from now on; the old one stays trusted beside it.
    #[arg(long, conflicts_with = "retire")]
    pub authority: bool,
    /// Ends the overlap: only the authority that issues stays trusted.
    #[arg(long)]
    pub retire: bool,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum RoleName {
    /// Looks on.
    Viewer,
    /// Prepares, runs and recovers.
    Operator,
    /// Approves plans, and all of an operator's.
    Surgeon,
    /// Another service of the cell.
    Service,
}

impl From<RoleName> for Role {
    fn from(name: RoleName) -> Self {
        match name {
            RoleName::Viewer => Self::Viewer,
            RoleName::Operator => Self::Operator,
            RoleName::Surgeon => Self::Surgeon,
            RoleName::Service => Self::Service,
        }
    }
}
