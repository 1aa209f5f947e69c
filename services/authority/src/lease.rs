//! Leases: the right to command one device, held by one commander at a time and lost unless renewed.
//!
//! Each lease ever granted has a fencing token greater than every one before it, also those granted before a restart,
//! so that a command delayed on its way cannot act after command has passed to somebody else.

use std::time::Duration;

use crate::Refusal;

/// The shortest time to live: below it a scheduling hiccup of the holder would stop the device.
pub const TTL_MIN: Duration = Duration::from_millis(200);
/// The longest time to live: above it a dead holder would block the device for too long.
pub const TTL_MAX: Duration = Duration::from_secs(60);
/// The longest name of a holder.
pub const HOLDER_MAX_CHARS: usize = 100;

/// The leases of one device: at most one is in force.
#[derive(Debug)]
pub struct Leases {
    next_token: u64,
    latest: Option<Granted>,
    /// Ran out unseen and has been followed by another lease: still to be reported.
    lost: Option<Lease>,
}

/// A granted lease.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Lease {
    /// Goes with every command.
    pub fencing_token: u64,
    /// Who holds it, as named at acquisition.
    pub holder: String,
    /// It is lost unless renewed within this time.
    pub ttl: Duration,
    /// When it runs out, on the caller's clock.
    pub expires_at: Duration,
}

/// The newest lease and what became of it.
#[derive(Debug)]
struct Granted {
    lease: Lease,
    ending: Ending,
}

#[derive(Debug, PartialEq, Eq)]
enum Ending {
    /// In force, or ran out without anybody having looked yet.
    Open,
    Released,
    /// Ran out, and [`Leases::expired`] has said so.
    ExpiryReported,
}

impl Leases {
    /// No lease in force. `start` is the milliseconds since 1970 at which the service started: tokens count up from it,
    /// so that they keep growing over restarts as long as fewer than 1000 leases a second were granted since the last
    /// one. It counts as at least 1 and at most 2^63; a token is never 0.
    #[must_use]
    pub fn new(start: u64) -> Self {
        Self {
            next_token: start.clamp(1, 1 << 63),
            latest: None,
            lost: None,
        }
    }

    /// Grants a new lease unless one is in force, even to a holder of the same name: a name is no proof of identity.
    pub fn acquire(
        &mut self,
        holder: &str,
        ttl: Duration,
        now: Duration,
    ) -> Result<Lease, Refusal> {
        let chars = holder.chars().count();
        if !(1..=HOLDER_MAX_CHARS).contains(&chars) {
            return Err(Refusal::HolderName { chars });
        }
        if !(TTL_MIN..=TTL_MAX).contains(&ttl) {
            return Err(Refusal::Ttl { ttl });
        }
        if let Some(lease) = self.current(now) {
            return Err(Refusal::LeaseHeld {
                holder: lease.holder.clone(),
                remaining: lease.expires_at.saturating_sub(now),
            });
        }
        let lease = Lease {
            fencing_token: self.next_token,
            holder: holder.to_owned(),
            ttl,
            expires_at: now.saturating_add(ttl),
        };
        self.next_token += 1;
        self.lost = self.expired(now);
        self.latest = Some(Granted {
            lease: lease.clone(),
            ending: Ending::Open,
        });
        Ok(lease)
    }

    /// Prolongs the lease in force by its time to live from now. An expired one cannot be revived: the device has been
    /// stopped, or is about to be.
    pub fn renew(&mut self, token: u64, now: Duration) -> Result<Lease, Refusal> {
        let held = self.in_force_mut(token, now)?;
        held.lease.expires_at = now.saturating_add(held.lease.ttl);
        Ok(held.lease.clone())
    }

    /// Gives the lease back.
    pub fn release(&mut self, token: u64, now: Duration) -> Result<(), Refusal> {
        self.in_force_mut(token, now)?.ending = Ending::Released;
        Ok(())
    }

    /// Whether a command with this token may act now.
    pub fn check(&self, token: u64, now: Duration) -> Result<&Lease, Refusal> {
        let Some(Granted { lease, ending }) = &self.latest else {
            return Err(Refusal::NoLease { token });
        };
        if token == 0 || token > lease.fencing_token {
            return Err(Refusal::NoLease { token });
        }
        if token < lease.fencing_token {
            return Err(Refusal::StaleFencingToken {
                token,
                newest: lease.fencing_token,
            });
        }
        if *ending == Ending::Released {
            return Err(Refusal::NoLease { token });
        }
        if lease.ran_out(now) {
            return Err(Refusal::LeaseExpired {
                token,
                holder: lease.holder.clone(),
                ttl: lease.ttl,
                ago: now.saturating_sub(lease.expires_at),
            });
        }
        Ok(lease)
    }

    /// The lease in force, if any.
    #[must_use]
    pub fn current(&self, now: Duration) -> Option<&Lease> {
        let Granted { lease, ending } = self.latest.as_ref()?;
        (*ending != Ending::Released && !lease.ran_out(now)).then_some(lease)
    }

    /// A lease that has run out, once, even if another has been granted since: the owner of the device asks on every
    /// tick and stops the device when answered.
    pub fn expired(&mut self, now: Duration) -> Option<Lease> {
        if let Some(lost) = self.lost.take() {
            return Some(lost);
        }
        let Granted { lease, ending } = self.latest.as_mut()?;
        if *ending != Ending::Open || !lease.ran_out(now) {
            return None;
        }
        *ending = Ending::ExpiryReported;
        Some(lease.clone())
    }

    fn in_force_mut(&mut self, token: u64, now: Duration) -> Result<&mut Granted, Refusal> {
        self.check(token, now)?;
        self.latest.as_mut().ok_or(Refusal::NoLease { token })
    }
}

impl Lease {
    fn ran_out(&self, now: Duration) -> bool {
        now >= self.expires_at
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const TTL: Duration = Duration::from_secs(2);

    fn at_s(seconds: f64) -> Duration {
        Duration::from_secs_f64(seconds)
    }

    fn held() -> (Leases, u64) {
        let mut leases = Leases::new(1_000);
        let token = leases
            .acquire("gateway", TTL, at_s(0.0))
            .unwrap()
            .fencing_token;
        (leases, token)
    }

    #[test]
    fn a_held_lease_refuses_others_and_says_who_and_for_how_long() {
        let (mut leases, _) = held();
        let refusal = leases.acquire("operator", TTL, at_s(0.5)).unwrap_err();
        assert_eq!(
            refusal,
            Refusal::LeaseHeld {
                holder: "gateway".into(),
                remaining: at_s(1.5)
            }
        );
        assert_eq!(refusal.reason(), "LEASE_HELD");
        assert_eq!(refusal.metadata()[1], ("remaining_s", "1.5".to_owned()));
    }

    #[test]
    fn a_renewed_lease_outlives_its_first_time_to_live() {
        let (mut leases, token) = held();
        assert_eq!(
            leases.renew(token, at_s(1.9)).unwrap().expires_at,
            at_s(3.9)
        );
        assert!(leases.check(token, at_s(3.8)).is_ok());
        assert_eq!(leases.expired(at_s(3.8)), None);
    }

    #[test]
    fn an_expired_lease_is_reported_once_and_cannot_be_revived() {
        let (mut leases, token) = held();
        assert_eq!(
            leases.check(token, at_s(2.0)).unwrap_err().reason(),
            "LEASE_EXPIRED"
        );
        assert_eq!(
            leases.renew(token, at_s(2.0)).unwrap_err().reason(),
            "LEASE_EXPIRED"
        );
        assert_eq!(
            leases.expired(at_s(2.0)).map(|lease| lease.fencing_token),
            Some(token)
        );
        assert_eq!(leases.expired(at_s(2.1)), None);
        assert_eq!(
            leases.check(token, at_s(2.1)).unwrap_err().reason(),
            "LEASE_EXPIRED"
        );
    }

    #[test]
    fn an_expiry_is_reported_even_if_command_has_passed_on() {
        let (mut leases, token) = held();
        leases.acquire("operator", TTL, at_s(2.0)).unwrap();
        assert_eq!(
            leases.expired(at_s(2.0)).map(|lease| lease.fencing_token),
            Some(token)
        );
        assert_eq!(leases.expired(at_s(2.0)), None);
    }

    #[test]
    fn a_stale_token_is_refused() {
        let (mut leases, old) = held();
        let new = leases
            .acquire("operator", TTL, at_s(2.0))
            .unwrap()
            .fencing_token;
        assert_eq!(
            leases.check(old, at_s(2.1)),
            Err(Refusal::StaleFencingToken {
                token: old,
                newest: new
            })
        );
        assert_eq!(
            leases.release(old, at_s(2.1)).unwrap_err().reason(),
            "STALE_FENCING_TOKEN"
        );
        assert!(leases.check(new, at_s(2.1)).is_ok());
    }

    #[test]
    fn a_released_lease_commands_no_more_and_frees_the_device_at_once() {
        let (mut leases, token) = held();
        leases.release(token, at_s(0.1)).unwrap();
        assert_eq!(
            leases.check(token, at_s(0.1)),
            Err(Refusal::NoLease { token })
        );
        assert_eq!(leases.expired(at_s(9.0)), None);
        assert!(leases.acquire("operator", TTL, at_s(0.1)).is_ok());
    }

    #[test]
    fn a_token_never_granted_is_no_lease() {
        assert_eq!(
            Leases::new(7).check(7, at_s(0.0)),
            Err(Refusal::NoLease { token: 7 })
        );
        let (leases, token) = held();
        assert_eq!(
            leases.check(token + 1, at_s(0.0)),
            Err(Refusal::NoLease { token: token + 1 })
        );
        assert_eq!(
            leases.check(0, at_s(0.0)),
            Err(Refusal::NoLease { token: 0 })
        );
    }

    #[test]
    fn bad_names_and_times_to_live_name_the_field() {
        let mut leases = Leases::new(0);
        for (holder, ttl, field) in [
            ("", TTL, "holder"),
            (&*"x".repeat(101), TTL, "holder"),
            ("gateway", Duration::from_millis(199), "ttl_s"),
            ("gateway", Duration::from_secs(61), "ttl_s"),
        ] {
            assert_eq!(
                leases.acquire(holder, ttl, at_s(0.0)).unwrap_err().field(),
                Some(field)
            );
        }
    }

    #[derive(Clone, Debug)]
    enum Act {
        Wait(u16),
        Acquire,
        Renew(usize),
        Release(usize),
        Restart,
    }

    fn act() -> impl Strategy<Value = Act> {
        prop_oneof![
            (1_u16..3_000).prop_map(Act::Wait),
            Just(Act::Acquire),
            (0_usize..8).prop_map(Act::Renew),
            (0_usize..8).prop_map(Act::Release),
            Just(Act::Restart),
        ]
    }

    proptest! {
        /// Over any history with restarts, each grant takes at least a millisecond.
        #[test]
        fn tokens_only_grow_and_at_most_one_is_in_force(acts in prop::collection::vec(act(), 1..200), start in 0_u64..1 << 42) {
            let mut now_ms = start;
            let mut leases = Leases::new(now_ms);
            let mut granted: Vec<u64> = Vec::new();
            for act in acts {
                now_ms += 1;
                let now = Duration::from_millis(now_ms);
                let pick = |back: usize| granted.iter().rev().nth(back).copied().unwrap_or(0);
                match act {
                    Act::Wait(ms) => now_ms += u64::from(ms),
                    Act::Acquire => {
                        let was_held = leases.current(now).is_some();
                        if let Ok(lease) = leases.acquire("anyone", TTL, now) {
                            prop_assert!(!was_held);
                            prop_assert!(granted.last().is_none_or(|last| lease.fencing_token > *last));
                            granted.push(lease.fencing_token);
                        } else {
                            prop_assert!(was_held);
                        }
                    }
                    Act::Renew(back) => {
                        let token = pick(back);
                        let allowed = leases.check(token, now).is_ok();
                        prop_assert_eq!(leases.renew(token, now).is_ok(), allowed);
                    }
                    Act::Release(back) => {
                        let token = pick(back);
                        if leases.release(token, now).is_ok() {
                            prop_assert!(leases.current(now).is_none());
                        }
                    }
                    Act::Restart => leases = Leases::new(now_ms),
                }
                let now = Duration::from_millis(now_ms);
                let in_force: Vec<_> = granted.iter().filter(|token| leases.check(**token, now).is_ok()).collect();
                prop_assert!(in_force.len() <= 1);
                prop_assert_eq!(in_force.first().copied().copied(), leases.current(now).map(|lease| lease.fencing_token));
            }
        }
    }
}
