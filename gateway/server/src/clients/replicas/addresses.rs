//! Where the replicas of a service are, as the configuration says it.

use serde::{Deserialize, Serialize};

/// More replicas than any site has.
const REPLICAS_MAX: usize = 64;
/// What a name of the DNS begins with.
const DNS: &str = "dns:///";

/// One address, a list of them, or a name of the DNS whose every address is a replica (`dns:///name:port`).
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(
    untagged,
    expecting = "an address host:port, a list of addresses, or dns:///name:port"
)]
pub enum Addresses {
    /// `host:port` or `dns:///name:port`.
    One(String),
    /// Each `host:port`.
    List(Vec<String>),
}

/// The same, checked.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Where {
    /// These and no others.
    Listed(Vec<String>),
    /// Whatever the name stands for.
    Named {
        /// The name.
        name: String,
        /// The port of every replica.
        port: u16,
    },
}

impl From<String> for Addresses {
    fn from(address: String) -> Self {
        Self::One(address)
    }
}

impl Addresses {
    /// Checks them; the error names value and limit.
    pub fn checked(&self) -> Result<Where, String> {
        let listed = match self {
            Self::One(address) => match address.strip_prefix(DNS) {
                Some(named) => {
                    let (name, port) = host_and_port(named).ok_or_else(|| {
                        format!("is {address:?}; a name is written dns:///name:port")
                    })?;
                    return Ok(Where::Named {
                        name: name.to_owned(),
                        port,
                    });
                }
                None => std::slice::from_ref(address),
            },
            Self::List(addresses) => addresses,
        };
        if !(1..=REPLICAS_MAX).contains(&listed.len()) {
            return Err(format!(
                "lists {} addresses; must list 1 .. {REPLICAS_MAX}",
                listed.len()
            ));
        }
        for (index, address) in listed.iter().enumerate() {
            if address.starts_with(DNS) {
                return Err(format!("lists {address:?}; a name of the DNS stands alone"));
            }
            let authority = address
                .split_once("://")
                .map_or(address.as_str(), |(_, rest)| rest.trim_end_matches('/'));
            if host_and_port(authority).is_none() {
                return Err(format!("holds {address:?}; an address is host:port"));
            }
            if listed[..index].contains(address) {
                return Err(format!("lists {address:?} twice"));
            }
        }
        Ok(Where::Listed(listed.to_vec()))
    }
}

fn host_and_port(text: &str) -> Option<(&str, u16)> {
    let (host, port) = text.rsplit_once(':')?;
    let bare = !host.is_empty() && !host.contains(|c: char| c.is_whitespace() || c == '/');
    Some((host, port.parse().ok().filter(|_| bare)?))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn one(text: &str) -> Result<Where, String> {
        Addresses::One(text.to_owned()).checked()
    }

    fn list(texts: &[&str]) -> Result<Where, String> {
        Addresses::List(texts.iter().map(|&text| text.to_owned()).collect()).checked()
    }

    #[test]
    fn an_address_a_list_and_a_name_are_taken() {
        assert_eq!(
            one("127.0.0.1:50051"),
            Ok(Where::Listed(vec!["127.0.0.1:50051".to_owned()]))
        );
        assert!(list(&["a:1", "https://b:1", "[::1]:1"]).is_ok());
        assert_eq!(
            one("dns:///registration.local:50051"),
            Ok(Where::Named {
                name: "registration.local".to_owned(),
                port: 50051
            })
        );
    }

    #[test]
    fn what_is_no_address_is_refused_by_its_value() {
        for (found, problem) in [
            (one("registration"), "holds \"registration\""),
            (one(""), "holds \"\""),
            (one("a:65536"), "holds \"a:65536\""),
            (one("dns:///name"), "dns:///name:port"),
            (one("dns://8.8.8.8/name:1"), "an address is host:port"),
            (list(&[]), "lists 0 addresses"),
            (list(&["a:1", "b:1", "a:1"]), "lists \"a:1\" twice"),
            (list(&["a:1", "dns:///b:1"]), "stands alone"),
        ] {
            let refusal = found.unwrap_err();
            assert!(refusal.contains(problem), "{refusal}");
        }
    }
}
