//! Who calls: the person or service that a client certificate names, and the role it carries.
//!
//! Without TLS a server binds loopback only, and whoever reaches it is at the machine itself: [`Caller::Local`], who may do
//! everything and is believed in who they say they are.

use std::fmt;

use tonic::Extensions;

/// What a caller may do. Each method of each service names the least role it asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Role {
    /// Looks on.
    Viewer,
    /// Prepares, runs, pauses, aborts and recovers.
    Operator,
    /// Approves plans, and all of an operator's.
    Surgeon,
    /// Another service of the cell; no person.
    Service,
}

/// Who calls; found in the request's extensions.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Caller {
    /// Over loopback without TLS.
    Local,
    /// With a certificate of the site's authority.
    Certified {
        /// The certificate's name of the person or service.
        name: String,
        /// The certificate's role.
        role: Role,
    },
}

/// A person who says to be another one than the certificate names.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("is {stated:?}, but the certificate names {certified:?}; leave it empty or give that name")]
pub struct OtherName {
    /// What the request says.
    pub stated: String,
    /// What the certificate says.
    pub certified: String,
}

impl Role {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Viewer, Self::Operator, Self::Surgeon, Self::Service];

    /// The word in certificates, refusals and docs.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Viewer => "viewer",
            Self::Operator => "operator",
            Self::Surgeon => "surgeon",
            Self::Service => "service",
        }
    }

    /// The role of a word.
    pub fn parse(word: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|role| role.as_str() == word)
    }
}

impl fmt::Display for Role {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}

impl Caller {
    /// Whoever a server has put into the extensions; it puts nobody only without TLS.
    pub fn of(extensions: &Extensions) -> Self {
        extensions.get().cloned().unwrap_or(Self::Local)
    }

    /// The name that a record keeps: the certificate's, or `local`.
    pub fn name(&self) -> &str {
        match self {
            Self::Local => "local",
            Self::Certified { name, .. } => name,
        }
    }

    /// Who acts, where a request has a field for it: the certificate's name, which `stated` may repeat; without a
    /// certificate whoever is stated.
    pub fn acting(&self, stated: String) -> Result<String, OtherName> {
        match self {
            Self::Local => Ok(stated),
            Self::Certified { name, .. } if stated.is_empty() || stated == *name => {
                Ok(name.clone())
            }
            Self::Certified { name, .. } => Err(OtherName {
                stated,
                certified: name.clone(),
            }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_certified_person_cannot_act_under_another_name() {
        let surgeon = Caller::Certified {
            name: "Dr. Adams".into(),
            role: Role::Surgeon,
        };
        for stated in ["", "Dr. Adams"] {
            assert_eq!(surgeon.acting(stated.into()).unwrap(), "Dr. Adams");
        }
        let refusal = surgeon.acting("Dr. Brown".into()).unwrap_err();
        assert_eq!(
            refusal.to_string(),
            "is \"Dr. Brown\", but the certificate names \"Dr. Adams\"; leave it empty or give that name"
        );
    }

    #[test]
    fn without_a_certificate_whoever_is_stated_acts() {
        let caller = Caller::of(&Extensions::default());
        assert_eq!(caller.acting("Dr. Brown".into()).unwrap(), "Dr. Brown");
        assert_eq!(caller.name(), "local");
    }

    #[test]
    fn every_role_has_its_word() {
        for role in Role::ALL {
            assert_eq!(Role::parse(role.as_str()), Some(role));
        }
        assert_eq!(Role::parse("admin"), None);
    }
}
