//! A cell with TLS: a certificate for each of its services, and one of each role for people to try.

use std::path::Path;

use arthro_bootstrap::Role;

use crate::arguments::ServiceName;
use crate::connection;
use crate::exit::Failure;
use crate::pki::{Leaf, Site};

const SERVICES: [ServiceName; 6] = [
    ServiceName::Registration,
    ServiceName::Planning,
    ServiceName::Motion,
    ServiceName::Instrument,
    ServiceName::Simulator,
    ServiceName::Gateway,
];
const PERSONS: [Role; 3] = [Role::Viewer, Role::Operator, Role::Surgeon];
/// Certificates of persons that are made here are for trying.
const DAYS: u32 = 90;

/// The site of `folder`, with every certificate that a cell needs. This process becomes its operator.
pub fn site(folder: &Path) -> Result<Site, Failure> {
    std::fs::create_dir_all(folder)?;
    // Services have a working folder of their own.
    let site = Site::open_or_init(&folder.canonicalize()?)?;
    for service in SERVICES {
        provide(&site, &Leaf::on_this_machine(service.as_str()))?;
    }
    for role in PERSONS {
        provide(
            &site,
            &Leaf {
                name: role.as_str().to_owned(),
                role,
                dns: Vec::new(),
                ip: Vec::new(),
                days: DAYS,
            },
        )?;
    }
    connection::identify_by(&site.files(Role::Operator.as_str())?)?;
    Ok(site)
}

fn provide(site: &Site, leaf: &Leaf) -> Result<(), Failure> {
    let file = leaf.file();
    if site.files(&file)?.certificate.exists() {
        return Ok(());
    }
    site.issue(leaf, &file)
}

/// What a shell must be told before it can call the cell.
pub fn exports(site: &Site) -> Result<String, Failure> {
    let files = site.files(Role::Surgeon.as_str())?;
    Ok(format!(
        "export ARTHRO_TLS_CA={} ARTHRO_TLS_CERT={} ARTHRO_TLS_KEY={}\n  ",
        files.client_ca.display(),
        files.certificate.display(),
        files.key.display()
    ))
}
