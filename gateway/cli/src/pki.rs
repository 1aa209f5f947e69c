//! `arthro pki`: makes a site's authority, issues certificates, renews both.

mod leaf;
mod site;

use arthro_bootstrap::tls::Certified;
use serde_json::json;

use crate::arguments::{Pki, PkiIssue, PkiRotate};
use crate::exit::Failure;
use crate::output::Output;

pub use leaf::Leaf;
pub use site::Site;

/// Runs one of the commands.
pub fn run(pki: &Pki, output: &Output) -> Result<(), Failure> {
    match pki {
        Pki::Init(init) => {
            let site = Site::init(&init.folder, &init.name, init.days)?;
            let authority = site.authority_file();
            output.line(format!("authority  {}", authority.display()));
            output.result(&json!({"authority": authority}));
            Ok(())
        }
        Pki::Issue(issue) => self::issue(issue, output),
        Pki::Rotate(rotate) => self::rotate(rotate, output),
    }
}

fn issue(issue: &PkiIssue, output: &Output) -> Result<(), Failure> {
    let site = Site::open(&issue.folder)?;
    let leaf = Leaf {
        name: issue.name.clone(),
        role: issue.role.into(),
        dns: issue.dns.clone(),
        ip: issue.ip.clone(),
        days: issue.days,
    };
    let file = issue.file.clone().unwrap_or_else(|| leaf.file());
    site.issue(&leaf, &file)?;
    tell(&site, &file, output)
}

fn rotate(rotate: &PkiRotate, output: &Output) -> Result<(), Failure> {
    let site = Site::open(&rotate.folder)?;
    match &rotate.file {
        Some(file) => {
            let leaf = Leaf::read(&site.files(file)?.certificate)?;
            site.reissue(&leaf, file)?;
            return tell(&site, file, output);
        }
        None if rotate.retire => site.retire()?,
        None => site.rotate()?,
    }
    let authority = site.authority_file();
    let trusted = site.trusted()?;
    output.line(format!(
        "authority  {}  {trusted} trusted",
        authority.display()
    ));
    output.result(&json!({"authority": authority, "trusted": trusted}));
    Ok(())
}

fn tell(site: &Site, file: &str, output: &Output) -> Result<(), Failure> {
    let files = site.files(file)?;
    let Certified {
        name,
        role,
        not_after,
        ..
    } = leaf::certified(&files.certificate)?;
    let ends = time::OffsetDateTime::from(not_after).date().to_string();
    output.line(format!("{name} is {role} until {ends}"));
    output.line(format!(
        "certificate  {}\nkey          {}\nauthority    {}",
        files.certificate.display(),
        files.key.display(),
        files.client_ca.display()
    ));
    output.result(&json!({
        "name": name,
        "role": role.as_str(),
        "not_after": ends,
        "certificate": files.certificate,
        "key": files.key,
        "authority": files.client_ca,
    }));
    Ok(())
}

#[cfg(test)]
mod tests;
