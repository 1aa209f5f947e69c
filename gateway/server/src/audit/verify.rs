//! The check of a chain: entry after entry, from the first to the last, then against every head that was kept elsewhere.
//! Pure, so that the gateway, the command line and the tests find the same.

use std::collections::HashMap;

use super::entry::{Link, SIGNATURE_BYTES, Tail};
use super::key::{KeyId, PublicKey};
use crate::approval::Digest;
use crate::words::words;

words! {
    /// What is wrong with a chain.
    Fault {
        /// An entry says something else than what was signed.
        Edited = "EDITED",
        /// Entries are missing.
        Removed = "REMOVED",
        /// Entries stand in another order.
        Reordered = "REORDERED",
        /// The end is missing.
        Truncated = "TRUNCATED",
        /// The signature is none of the key that it names.
        SignatureWrong = "SIGNATURE_WRONG",
        /// Signed with a key that is not trusted.
        KeyUnknown = "KEY_UNKNOWN",
        /// The entry is another one than when its head was kept.
        Replaced = "REPLACED",
        /// A kept head is damaged itself.
        HeadDamaged = "HEAD_DAMAGED",
    }
}

/// The first thing that is wrong.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{fault} at entry {sequence}: {detail}")]
pub struct Defect {
    /// What is wrong.
    pub fault: Fault,
    /// The first entry concerned.
    pub sequence: u64,
    /// For a person.
    pub detail: String,
}

/// A signed end of the chain, as it was kept beside it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Head {
    /// Which entry.
    pub sequence: u64,
    /// Its hash.
    pub hash: Digest,
    /// Which key signed.
    pub key: KeyId,
    /// Ed25519 over the 32 bytes of the hash.
    pub signature: [u8; SIGNATURE_BYTES],
}

/// Checks one chain.
#[derive(Debug)]
pub struct Verifier {
    keys: HashMap<KeyId, PublicKey>,
    heads: Vec<Head>,
    /// The heads that are still to be met, by the entry they name.
    awaited: HashMap<u64, Vec<usize>>,
    tail: Tail,
}

// === impl Defect ===

impl Defect {
    /// States what is wrong where.
    pub fn new(fault: Fault, sequence: u64, detail: impl Into<String>) -> Self {
        Self {
            fault,
            sequence,
            detail: detail.into(),
        }
    }
}

// === impl Head ===

impl From<&Link> for Head {
    fn from(link: &Link) -> Self {
        Self {
            sequence: link.sequence,
            hash: link.hash,
            key: link.key.clone(),
            signature: link.signature,
        }
    }
}

// === impl Verifier ===

impl Verifier {
    /// Trusts these keys, and expects what these heads say.
    pub fn new(keys: impl IntoIterator<Item = PublicKey>, heads: Vec<Head>) -> Self {
        let mut awaited: HashMap<u64, Vec<usize>> = HashMap::new();
        for (index, head) in heads.iter().enumerate() {
            awaited.entry(head.sequence).or_default().push(index);
        }
        Self {
            keys: keys
                .into_iter()
                .map(|key| (key.id().clone(), key))
                .collect(),
            heads,
            awaited,
            tail: Tail::EMPTY,
        }
    }

    /// The last entry that was found good.
    pub fn tail(&self) -> Tail {
        self.tail
    }

    /// Which number the next entry must have.
    pub fn expected(&self) -> u64 {
        self.tail.sequence + 1
    }

    /// Checks the next entry.
    pub fn next(&mut self, link: &Link) -> Result<(), Defect> {
        let expected = self.expected();
        let sequence = link.sequence;
        let defect =
            |fault, detail: String| Err(Defect::new(fault, sequence.min(expected), detail));
        if sequence != expected {
            return if sequence > expected {
                defect(
                    Fault::Removed,
                    format!("entry {sequence} follows where {expected} should stand"),
                )
            } else {
                defect(
                    Fault::Reordered,
                    format!("entry {sequence} stands where {expected} should"),
                )
            };
        }
        if link.entry.hash(sequence, &link.previous, &link.key) != link.hash {
            return defect(
                Fault::Edited,
                "what it says does not give the hash it has".to_owned(),
            );
        }
        self.check_signature(sequence, &link.hash, &link.key, &link.signature)?;
        if link.previous != self.tail.hash {
            return defect(
                Fault::Replaced,
                "it was signed after another entry than the one before it".to_owned(),
            );
        }
        for index in self.awaited.remove(&sequence).unwrap_or_default() {
            self.meet(link, &self.heads[index])?;
        }
        self.tail = Tail::from(link);
        Ok(())
    }

    /// An entry that cannot even be read.
    pub fn unreadable(&self, detail: impl Into<String>) -> Defect {
        Defect::new(Fault::Edited, self.expected(), detail)
    }

    /// Checks that the chain goes as far as the heads say; its last entry then.
    pub fn finish(&self) -> Result<Tail, Defect> {
        let last = self.tail.sequence;
        let mut beyond: Vec<&Head> = self
            .awaited
            .values()
            .flatten()
            .map(|&i| &self.heads[i])
            .collect();
        beyond.sort_by_key(|head| head.sequence);
        let Some(newest) = beyond.last() else {
            return Ok(self.tail);
        };
        for head in &beyond {
            // Numbers count from 1; a head of entry 0 never was.
            if head.sequence <= last {
                return Err(Defect::new(
                    Fault::HeadDamaged,
                    head.sequence,
                    "a kept head names an entry that cannot be",
                ));
            }
            self.check_head(head)?;
        }
        Err(Defect::new(
            Fault::Truncated,
            last + 1,
            format!(
                "the chain ends at entry {last}, but a head of entry {} was kept",
                newest.sequence
            ),
        ))
    }

    fn meet(&self, link: &Link, head: &Head) -> Result<(), Defect> {
        if *head == Head::from(link) {
            return Ok(());
        }
        self.check_head(head)?;
        if head.hash == link.hash {
            return Ok(());
        }
        Err(Defect::new(
            Fault::Replaced,
            link.sequence,
            "it is another one than when its head was kept",
        ))
    }

    fn check_head(&self, head: &Head) -> Result<(), Defect> {
        self.check_signature(head.sequence, &head.hash, &head.key, &head.signature)
            .map_err(|defect| {
                Defect::new(
                    Fault::HeadDamaged,
                    head.sequence,
                    format!("a kept head is damaged: {}", defect.detail),
                )
            })
    }

    fn check_signature(
        &self,
        sequence: u64,
        hash: &Digest,
        key: &KeyId,
        signature: &[u8; SIGNATURE_BYTES],
    ) -> Result<(), Defect> {
        let Some(public) = self.keys.get(key) else {
            return Err(Defect::new(
                Fault::KeyUnknown,
                sequence,
                format!("it names the key {key}, which is not trusted"),
            ));
        };
        if public.signed(hash.as_bytes(), signature) {
            return Ok(());
        }
        Err(Defect::new(
            Fault::SignatureWrong,
            sequence,
            format!("the key {key} did not sign it"),
        ))
    }
}

#[cfg(test)]
mod tests;
