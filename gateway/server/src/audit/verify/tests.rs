//! An honest chain is whole; whatever is done to it without the key is found.

use std::io::Cursor;

use proptest::prelude::*;
use proptest::test_runner::{Config, TestRunner};

use super::*;
use crate::audit::entry::{Entry, Kind, Who};
use crate::audit::key::SigningKey;
use crate::audit::lines;
use crate::audit::read::check_export;

const ENTRIES: usize = 40;
/// Columns of an entry that an attacker can write to.
const COLUMNS: usize = 20;

struct Chain {
    key: SigningKey,
    links: Vec<Link>,
}

impl Chain {
    fn new() -> Self {
        let key = SigningKey::fleeting().unwrap();
        let mut tail = Tail::EMPTY;
        let links = (0..ENTRIES)
            .map(|index| {
                let link = key.link(tail, entry(index));
                tail = Tail::from(&link);
                link
            })
            .collect();
        Self { key, links }
    }

    fn heads(&self) -> Vec<Head> {
        self.links.iter().map(Head::from).collect()
    }

    fn check(&self, links: &[Link], heads: Vec<Head>) -> Result<Tail, Defect> {
        let mut verifier = Verifier::new([self.key.public().clone()], heads);
        for link in links {
            verifier.next(link)?;
        }
        verifier.finish()
    }
}

/// Neighbours differ and many look alike, as in a real one.
fn entry(index: usize) -> Entry {
    let who = Who {
        name: "Dr. Adams".to_owned(),
        role: "surgeon".to_owned(),
        peer: "127.0.0.1:40000".to_owned(),
    };
    Entry {
        stated: "Dr. Adams".to_owned(),
        method: "/arthro.gateway.v1.CaseService/ApprovePlan".to_owned(),
        case_id: format!("case {}", index / 10),
        procedure_id: format!("procedure {}", index / 20),
        request: (!index.is_multiple_of(3)).then(|| Digest::from_bytes([index as u8; 32])),
        plan: (!index.is_multiple_of(4)).then(|| Digest::from_bytes([7; 32])),
        answers: index as u64 / 2,
        code: "OK".to_owned(),
        reason: "NONE".to_owned(),
        detail: "as asked".to_owned(),
        ..Entry::new(
            1_700_000_000_000 + index as i64 / 3,
            Kind::ALL[index % Kind::ALL.len()],
            who,
        )
    }
}

/// Changes one column of an entry: one bit of a number or of bytes, one letter of a text.
fn edit(link: &mut Link, column: usize, at: usize) {
    let bit = 1_u8 << (at % 8);
    let flip = |digest: &Digest| {
        let mut bytes = *digest.as_bytes();
        bytes[at / 8 % 32] ^= bit;
        Digest::from_bytes(bytes)
    };
    let flip_optional = |digest: &Option<Digest>| match digest {
        Some(digest) if !at.is_multiple_of(5) => Some(flip(digest)),
        Some(_) => None,
        None => Some(Digest::from_bytes([at as u8; 32])),
    };
    let alter = |text: &mut String| match at % 3 {
        0 => text.push(' '),
        1 => text.insert(0, 'x'),
        _ if text.is_empty() => text.push('x'),
        _ => text.truncate(text.len() - 1),
    };
    let entry = &mut link.entry;
    match column {
        0 => link.sequence ^= 1 << (at % 63),
        1 => link.previous = flip(&link.previous),
        2 => entry.at_ms ^= 1 << (at % 63),
        3 => {
            let place = Kind::ALL.iter().position(|kind| *kind == entry.kind);
            let other = place.unwrap() + 1 + at % (Kind::ALL.len() - 1);
            entry.kind = Kind::ALL[other % Kind::ALL.len()];
        }
        4 => alter(&mut entry.who.name),
        5 => alter(&mut entry.who.role),
        6 => alter(&mut entry.who.peer),
        7 => alter(&mut entry.stated),
        8 => alter(&mut entry.method),
        9 => alter(&mut entry.case_id),
        10 => alter(&mut entry.procedure_id),
        11 => entry.request = flip_optional(&entry.request),
        12 => entry.plan = flip_optional(&entry.plan),
        13 => entry.answers ^= 1 << (at % 63),
        14 => alter(&mut entry.code),
        15 => alter(&mut entry.reason),
        16 => alter(&mut entry.detail),
        17 => link.hash = flip(&link.hash),
        18 => {
            let mut id = link.key.as_str().to_owned();
            alter(&mut id);
            link.key = KeyId::from_text(id);
        }
        _ => link.signature[at / 8 % SIGNATURE_BYTES] ^= bit,
    }
}

/// What somebody without the key makes of the chain from `from` on: all numbers, links and hashes right, the signatures
/// as good as can be.
fn rehash(links: &mut [Link], from: usize, forger: Option<&SigningKey>) {
    let mut tail = match from {
        0 => Tail::EMPTY,
        _ => Tail::from(&links[from - 1]),
    };
    for link in &mut links[from..] {
        link.sequence = tail.sequence + 1;
        link.previous = tail.hash;
        link.hash = link.entry.hash(link.sequence, &link.previous, &link.key);
        if let Some(forger) = forger {
            link.signature = forger.link(tail, link.entry.clone()).signature;
        }
        tail = Tail::from(&*link);
    }
}

#[derive(Clone, Debug)]
enum Attack {
    Edit {
        at: usize,
        column: usize,
        bit: usize,
    },
    EditAndRehash {
        at: usize,
        column: usize,
        bit: usize,
        forged: bool,
    },
    Remove {
        at: usize,
        count: usize,
    },
    RemoveAndRehash {
        at: usize,
        count: usize,
        forged: bool,
    },
    Swap {
        at: usize,
        other: usize,
        renumber: bool,
    },
    SwapAndRehash {
        at: usize,
        other: usize,
    },
    Duplicate {
        at: usize,
        to: usize,
    },
    Truncate {
        keep: usize,
    },
    TruncateAndAppend {
        keep: usize,
        forged: bool,
    },
    Insert {
        at: usize,
    },
}

fn attacks() -> impl Strategy<Value = Attack> {
    let at = 0..ENTRIES;
    prop_oneof![
        4 => (at.clone(), 0..COLUMNS, 0..1000_usize)
            .prop_map(|(at, column, bit)| Attack::Edit { at, column, bit }),
        // Everything but what a rehash makes right again.
        4 => (at.clone(), 2..17_usize, 0..1000_usize, any::<bool>()).prop_map(
            |(at, column, bit, forged)| Attack::EditAndRehash { at, column, bit, forged }
        ),
        2 => (at.clone(), 1..ENTRIES).prop_map(|(at, count)| Attack::Remove { at, count }),
        2 => (at.clone(), 1..ENTRIES, any::<bool>())
            .prop_map(|(at, count, forged)| Attack::RemoveAndRehash { at, count, forged }),
        2 => (at.clone(), at.clone(), any::<bool>())
            .prop_map(|(at, other, renumber)| Attack::Swap { at, other, renumber }),
        1 => (at.clone(), at.clone()).prop_map(|(at, other)| Attack::SwapAndRehash { at, other }),
        1 => (at.clone(), at.clone()).prop_map(|(at, to)| Attack::Duplicate { at, to }),
        2 => at.clone().prop_map(|keep| Attack::Truncate { keep }),
        2 => (at.clone(), any::<bool>())
            .prop_map(|(keep, forged)| Attack::TruncateAndAppend { keep, forged }),
        1 => at.prop_map(|at| Attack::Insert { at }),
    ]
}

/// The chain after the attack, and which faults may be found; `None` where nothing was changed.
fn attacked(
    chain: &Chain,
    attack: &Attack,
    forger: &SigningKey,
) -> Option<(Vec<Link>, Vec<Fault>)> {
    use Fault::{Edited, KeyUnknown, Removed, Reordered, SignatureWrong, Truncated};
    let mut links = chain.links.clone();
    let forger_if = |forged: &bool| forged.then_some(forger);
    let faults = match attack {
        Attack::Edit { at, column, bit } => {
            edit(&mut links[*at], *column, *bit);
            vec![Edited, Removed, Reordered, SignatureWrong, KeyUnknown]
        }
        Attack::EditAndRehash {
            at,
            column,
            bit,
            forged,
        } => {
            edit(&mut links[*at], *column, *bit);
            rehash(&mut links, *at, forger_if(forged));
            vec![SignatureWrong]
        }
        Attack::Remove { at, count } => {
            let end = (*at + *count).min(ENTRIES);
            links.drain(*at..end);
            vec![Removed, Truncated]
        }
        Attack::RemoveAndRehash { at, count, forged } => {
            let end = (*at + *count).min(ENTRIES);
            links.drain(*at..end);
            rehash(&mut links, *at, forger_if(forged));
            vec![SignatureWrong, Truncated]
        }
        Attack::Swap {
            at,
            other,
            renumber,
        } => {
            if at == other {
                return None;
            }
            links.swap(*at, *other);
            if *renumber {
                (links[*at].sequence, links[*other].sequence) = (*at as u64 + 1, *other as u64 + 1);
                vec![Edited]
            } else {
                vec![Removed, Reordered]
            }
        }
        Attack::SwapAndRehash { at, other } => {
            if chain.links[*at].entry == chain.links[*other].entry {
                return None;
            }
            links.swap(*at, *other);
            rehash(&mut links, *at.min(other), None);
            vec![SignatureWrong]
        }
        Attack::Duplicate { at, to } => {
            let copy = links[*at].clone();
            links.insert(*to, copy);
            vec![Removed, Reordered]
        }
        Attack::Truncate { keep } => {
            links.truncate(*keep);
            vec![Truncated]
        }
        Attack::TruncateAndAppend { keep, forged } => {
            links.truncate(*keep);
            let mut tail = links.last().map_or(Tail::EMPTY, Tail::from);
            for index in *keep..ENTRIES {
                let mut link = forger.link(tail, entry(index + 100));
                if *forged {
                    link.key = chain.key.public().id().clone();
                    link.hash = link.entry.hash(link.sequence, &link.previous, &link.key);
                }
                tail = Tail::from(&link);
                links.push(link);
            }
            vec![KeyUnknown, SignatureWrong]
        }
        Attack::Insert { at } => {
            let mut forged = links[*at].clone();
            forged.entry.detail = "never happened".to_owned();
            links.insert(*at, forged);
            rehash(&mut links, *at, None);
            vec![SignatureWrong]
        }
    };
    Some((links, faults))
}

#[test]
fn an_honest_chain_is_whole_and_so_is_each_beginning_of_it_without_heads() {
    let chain = Chain::new();
    let tail = chain.check(&chain.links, chain.heads()).unwrap();
    assert_eq!(tail, Tail::from(chain.links.last().unwrap()));
    for keep in 0..=ENTRIES {
        assert!(chain.check(&chain.links[..keep], Vec::new()).is_ok());
    }
}

#[test]
fn four_thousand_random_tamperings_are_all_found_and_called_by_their_name() {
    const TAMPERINGS: u32 = 4000;
    let chain = Chain::new();
    let forger = SigningKey::fleeting().unwrap();
    let mut runner = TestRunner::new(Config {
        cases: TAMPERINGS,
        ..Config::default()
    });
    let found = std::cell::Cell::new(0_u32);
    runner
        .run(&attacks(), |attack| {
            let Some((links, faults)) = attacked(&chain, &attack, &forger) else {
                return Err(TestCaseError::reject("nothing was changed"));
            };
            let defect = chain.check(&links, chain.heads());
            prop_assert!(defect.is_err(), "missed");
            let defect = defect.unwrap_err();
            prop_assert!(faults.contains(&defect.fault), "{defect}");
            found.set(found.get() + 1);
            Ok(())
        })
        .unwrap();
    println!("{} tamperings, {} found", TAMPERINGS, found.get());
    assert!(found.get() >= TAMPERINGS);
}

#[test]
fn every_column_of_every_entry_matters() {
    let chain = Chain::new();
    for at in 0..ENTRIES {
        for column in 0..COLUMNS {
            for bit in 0..24 {
                let mut links = chain.links.clone();
                edit(&mut links[at], column, bit * 7);
                let defect = chain.check(&links, Vec::new());
                assert!(defect.is_err(), "column {column} of entry {at}, {bit}");
            }
        }
    }
}

#[test]
fn whoever_cuts_the_chain_and_goes_on_with_the_key_is_found_by_the_heads() {
    let chain = Chain::new();
    for keep in 0..ENTRIES {
        let mut links = chain.links[..keep].to_vec();
        let mut tail = links.last().map_or(Tail::EMPTY, Tail::from);
        for index in keep..ENTRIES + 5 {
            let link = chain.key.link(tail, entry(index + 100));
            tail = Tail::from(&link);
            links.push(link);
        }
        let defect = chain.check(&links, chain.heads()).unwrap_err();
        assert_eq!(
            (defect.fault, defect.sequence),
            (Fault::Replaced, keep as u64 + 1)
        );
    }
}

#[test]
fn a_damaged_head_is_told_from_a_damaged_chain() {
    let chain = Chain::new();
    for at in 0..ENTRIES {
        let mut heads = chain.heads();
        heads[at].hash = Digest::from_bytes([1; 32]);
        let defect = chain.check(&chain.links, heads).unwrap_err();
        assert_eq!(
            (defect.fault, defect.sequence),
            (Fault::HeadDamaged, at as u64 + 1)
        );
    }
}

#[test]
fn every_flipped_bit_of_an_export_is_found() {
    let chain = Chain::new();
    let mut export = Vec::new();
    for link in &chain.links[..4] {
        export.extend(lines::entry(link).unwrap().into_bytes());
        export.push(b'\n');
    }
    let check = |export: &[u8]| {
        let keys = vec![chain.key.public().clone()];
        let heads = chain.heads()[..4].to_vec();
        check_export(Cursor::new(export), keys, heads).unwrap()
    };
    check(&export).unwrap();
    for at in 0..export.len() * 8 {
        let mut edited = export.clone();
        edited[at / 8] ^= 1 << (at % 8);
        assert!(check(&edited).is_err(), "bit {at}");
    }
    for end in 0..export.len() - 1 {
        assert!(check(&export[..end]).is_err(), "cut after {end} bytes");
    }
}
