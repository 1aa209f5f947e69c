//! One entry of the audit, and how it is chained: its hash covers the hash before it, its number and all that it says.

use super::key::KeyId;
use crate::approval::{Canonical, Digest};
use crate::words::words;

/// Characters of a text that an entry keeps; what is longer is cut, so that nobody fills the disk with one call.
pub const TEXT_LONGEST: usize = 500;
/// What the first entry has as the hash before it.
pub const GENESIS: Digest = Digest::from_bytes([0; 32]);
/// Bytes of an Ed25519 signature.
pub const SIGNATURE_BYTES: usize = 64;

words! {
    /// What an entry tells.
    Kind {
        /// The gateway started.
        Start = "START",
        /// The gateway ended in order.
        End = "END",
        /// A call that changes something, before it is worked on.
        Command = "COMMAND",
        /// A call by which a person decides, before it is worked on.
        Decision = "DECISION",
        /// A stop, as it came.
        Stop = "STOP",
        /// How a call ended.
        Outcome = "OUTCOME",
        /// A call that was refused.
        Refusal = "REFUSAL",
        /// A person put their name to a plan.
        Approval = "APPROVAL",
        /// A procedure began, held, went on or ended.
        Procedure = "PROCEDURE",
        /// Something went wrong that no call asked for.
        Alarm = "ALARM",
    }
}

/// Who called.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Who {
    /// The certificate's name, `local` without TLS, `gateway` for the gateway itself.
    pub name: String,
    /// The certificate's role, or `local`, or `gateway`.
    pub role: String,
    /// The address that the call came from.
    pub peer: String,
}

/// What happened.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Entry {
    /// Milliseconds since 1970-01-01 UTC.
    pub at_ms: i64,
    /// What it tells.
    pub kind: Kind,
    /// Who called.
    pub who: Who,
    /// Who the request says is acting.
    pub stated: String,
    /// The full name of the call, such as `/arthro.gateway.v1.CaseService/ApprovePlan`.
    pub method: String,
    /// The case concerned.
    pub case_id: String,
    /// The procedure concerned.
    pub procedure_id: String,
    /// SHA-256 of the request's body as it came.
    pub request: Option<Digest>,
    /// The digest of the plan concerned.
    pub plan: Option<Digest>,
    /// The entry that this one ends; 0 for none.
    pub answers: u64,
    /// The status code of the answer.
    pub code: String,
    /// The stable word.
    pub reason: String,
    /// For a person.
    pub detail: String,
}

/// An entry in its place in the chain.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Link {
    /// Counts from 1 without a gap.
    pub sequence: u64,
    /// The hash of the entry before.
    pub previous: Digest,
    /// What happened.
    pub entry: Entry,
    /// SHA-256 of all of the above and of the key's id.
    pub hash: Digest,
    /// Which key signed.
    pub key: KeyId,
    /// Ed25519 over the 32 bytes of the hash.
    pub signature: [u8; SIGNATURE_BYTES],
}

/// Where a chain ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Tail {
    /// Number of the last entry; 0 when there is none.
    pub sequence: u64,
    /// Its hash.
    pub hash: Digest,
}

// === impl Entry ===

impl Entry {
    /// An entry that says no more than what and who.
    pub fn new(at_ms: i64, kind: Kind, who: Who) -> Self {
        Self {
            at_ms,
            kind,
            who,
            stated: String::new(),
            method: String::new(),
            case_id: String::new(),
            procedure_id: String::new(),
            request: None,
            plan: None,
            answers: 0,
            code: String::new(),
            reason: String::new(),
            detail: String::new(),
        }
    }

    /// Cuts every text to what an entry keeps. NUL, which PostgreSQL's texts cannot hold, becomes a blank.
    pub fn cut(mut self) -> Self {
        for text in [
            &mut self.who.name,
            &mut self.who.role,
            &mut self.who.peer,
            &mut self.stated,
            &mut self.method,
            &mut self.case_id,
            &mut self.procedure_id,
            &mut self.code,
            &mut self.reason,
            &mut self.detail,
        ] {
            if let Some((end, _)) = text.char_indices().nth(TEXT_LONGEST) {
                text.truncate(end);
            }
            if text.contains('\0') {
                *text = text.replace('\0', " ");
            }
        }
        self
    }

    /// The hash of this entry as number `sequence` after `previous`, signed with `key`.
    pub fn hash(&self, sequence: u64, previous: &Digest, key: &KeyId) -> Digest {
        let mut canonical = Canonical::new("arthro.audit.entry.v1");
        canonical.bytes(previous.as_bytes());
        canonical.counter(sequence);
        canonical.bytes(&self.at_ms.to_le_bytes());
        for text in [
            self.kind.as_str(),
            &self.who.name,
            &self.who.role,
            &self.who.peer,
            &self.stated,
            &self.method,
            &self.case_id,
            &self.procedure_id,
        ] {
            canonical.bytes(text.as_bytes());
        }
        for digest in [&self.request, &self.plan] {
            let bytes = digest.as_ref().map_or(&[][..], |digest| digest.as_bytes());
            canonical.bytes(bytes);
        }
        canonical.counter(self.answers);
        for text in [&self.code, &self.reason, &self.detail] {
            canonical.bytes(text.as_bytes());
        }
        canonical.bytes(key.as_str().as_bytes());
        canonical.digest()
    }
}

// === impl Tail ===

impl Tail {
    /// Of a chain without entries.
    pub const EMPTY: Self = Self {
        sequence: 0,
        hash: GENESIS,
    };
}

impl From<&Link> for Tail {
    fn from(link: &Link) -> Self {
        Self {
            sequence: link.sequence,
            hash: link.hash,
        }
    }
}
