//! Connections to servers, and who is shown to them.
//!
//! A process is one person: the identity is settled once, from the flags or by the command that starts a cell.

use std::sync::OnceLock;

use arthro_bootstrap::Credentials;
use arthro_bootstrap::config::TlsConfig;
use arthro_bootstrap::tls::Dial;
use tonic::transport::Channel;

use crate::arguments::Tls;
use crate::exit::{Failure, Kind};

static IDENTITY: OnceLock<Credentials> = OnceLock::new();

/// Takes the identity that the flags name, if they name one.
pub fn identify(tls: &Tls) -> Result<(), Failure> {
    let (Some(client_ca), Some(certificate), Some(key)) =
        (&tls.tls_ca, &tls.tls_cert, &tls.tls_key)
    else {
        return Ok(());
    };
    identify_by(&TlsConfig {
        certificate: certificate.clone(),
        key: key.clone(),
        client_ca: client_ca.clone(),
    })
}

/// Takes the identity of these files; whatever was taken before stays.
pub fn identify_by(files: &TlsConfig) -> Result<(), Failure> {
    let credentials = Credentials::read(files)
        .map_err(|error| Failure::refused_because("IDENTITY_UNUSABLE", &error))?;
    IDENTITY.get_or_init(|| credentials);
    Ok(())
}

/// A connection to `url`, such as `https://gateway:50050` or `http://127.0.0.1:50050`.
pub async fn open(url: &str) -> Result<Channel, Failure> {
    let dial = Dial::to(url, IDENTITY.get())
        .map_err(|error| Failure::refused_because("ADDRESS_UNUSABLE", &error))?;
    dial.connect().await.map_err(|error| {
        let failure = Failure::from(error);
        Failure::new(
            Kind::Unreachable,
            failure.reason,
            format!("{url}: {}", failure.message),
        )
    })
}
