//! Commands that must not act, hundreds of each kind: of lost leases, replayed, and delivered in another
//! order than they were given. Each test prints how many were tried and how many were taken.
#![allow(
    clippy::unwrap_used,
    clippy::panic,
    clippy::print_stdout,
    reason = "a test says what it counted, and why it failed"
)]

use std::time::Duration;

use arthro_authority::{
    Begin, Leases, OperationState, Operations, Outcome, REMEMBERED_OPERATIONS, Refusal,
};

const TTL: Duration = Duration::from_secs(2);
const ATTEMPTS: u64 = 1000;

/// A device with its authority, as motion and instrument have it: the token first, then the id.
struct Device {
    leases: Leases,
    operations: Operations,
    now: Duration,
    acted: Vec<String>,
}

impl Device {
    fn new() -> Self {
        Self {
            leases: Leases::new(1_000),
            operations: Operations::new(REMEMBERED_OPERATIONS),
            now: Duration::ZERO,
            acted: Vec::new(),
        }
    }

    /// A lease after the one before has run out.
    fn lease(&mut self) -> u64 {
        self.now += TTL;
        let lease = self.leases.acquire("gateway", TTL, self.now).unwrap();
        lease.fencing_token
    }

    fn command(&mut self, token: u64, id: &str, what: &str) -> Result<Begin, Refusal> {
        self.leases.check(token, self.now)?;
        let begin = self.operations.begin(id, what.as_bytes())?;
        if begin == Begin::New {
            self.acted.push(format!("{id} {what}"));
            let detail = what.to_owned();
            self.operations.finish(id, Outcome::Done { detail });
        }
        Ok(begin)
    }
}

/// The same shuffle every time (xorshift and Fisher-Yates).
fn shuffled<T>(mut items: Vec<T>) -> Vec<T> {
    let mut state = 0x9E37_79B9_7F4A_7C15_u64;
    for last in (1..items.len()).rev() {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        items.swap(last, (state % (last as u64 + 1)) as usize);
    }
    items
}

#[test]
fn no_token_but_the_one_in_force_is_taken() {
    let mut device = Device::new();
    let old: Vec<u64> = (0..ATTEMPTS).map(|_| device.lease()).collect();
    let newest = device.lease();
    let never_granted = (1..=ATTEMPTS).map(|ahead| newest + ahead);
    for token in old.into_iter().chain(never_granted).chain([0, u64::MAX]) {
        let refusal = device
            .command(token, &token.to_string(), "move")
            .unwrap_err();
        let expected = if (1..newest).contains(&token) {
            "STALE_FENCING_TOKEN"
        } else {
            "NO_LEASE"
        };
        assert_eq!(refusal.reason(), expected, "{token}");
    }
    println!(
        "stale or invented tokens: {} tried, {} taken",
        2 * ATTEMPTS + 2,
        device.acted.len()
    );
    assert!(device.acted.is_empty());
    device.command(newest, "now", "move").unwrap();
}

#[test]
fn a_replayed_id_answers_with_its_first_outcome_and_acts_no_more() {
    let mut device = Device::new();
    let token = device.lease();
    for number in 0..ATTEMPTS {
        device.command(token, &number.to_string(), "move").unwrap();
    }
    let before = device.acted.clone();
    for number in shuffled((0..ATTEMPTS).collect()) {
        let id = number.to_string();
        let Begin::Repeated(first) = device.command(token, &id, "move").unwrap() else {
            panic!("{id} acted twice")
        };
        assert_eq!((first.id, first.state), (id.clone(), OperationState::Done));
        let other = device.command(token, &id, "bite").unwrap_err();
        assert_eq!(other.reason(), "OPERATION_ID_REUSED");
    }
    println!(
        "replayed ids: {} tried, {} taken",
        2 * ATTEMPTS,
        device.acted.len() - before.len()
    );
    assert_eq!(device.acted, before);
}

#[test]
fn commands_that_arrive_after_command_has_passed_on_do_not_act_whatever_their_order() {
    let mut device = Device::new();
    let mut late = Vec::new();
    for lease in 0..ATTEMPTS / 10 {
        let token = device.lease();
        for number in 0..10 {
            late.push((token, format!("{lease}.{number}")));
        }
    }
    let newest = device.lease();
    let tried = late.len();
    for (token, id) in shuffled(late) {
        let refusal = device.command(token, &id, "move").unwrap_err();
        assert_eq!(refusal.reason(), "STALE_FENCING_TOKEN");
    }
    println!(
        "reordered past a lease: {tried} tried, {} taken",
        device.acted.len()
    );
    assert!(device.acted.is_empty());
    // A refused command has not used up its id.
    assert_eq!(device.command(newest, "0.0", "move").unwrap(), Begin::New);
}
