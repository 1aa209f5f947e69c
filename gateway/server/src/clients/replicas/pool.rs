//! Which replica takes the next call: of those that are well, the one with the fewest calls under way.
//!
//! A computation goes on long after its first answer, so a call counts until it is over, and a slow replica gets fewer.
//! Pure: channels are whatever `C` is, time comes in as an argument.

use std::time::Instant;

use super::breaker::{Breaker, Circuit};

/// What the last look at a replica found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Health {
    /// Not looked at yet, or it does not tell.
    Unknown,
    /// It serves.
    Serving,
    /// It says that it does not serve, as one does that is going down.
    NotServing,
    /// It did not answer.
    Unreachable,
}

/// The replicas of one service.
#[derive(Clone, Debug)]
pub struct Pool<C> {
    replicas: Vec<Replica<C>>,
    /// Counts the choices, so that replicas with equal load take turns.
    turn: usize,
}

#[derive(Clone, Debug)]
struct Replica<C> {
    address: String,
    channel: C,
    health: Health,
    breaker: Breaker,
    under_way: usize,
}

impl<C> Default for Pool<C> {
    fn default() -> Self {
        Self {
            replicas: Vec::new(),
            turn: 0,
        }
    }
}

impl<C: Clone> Pool<C> {
    /// Takes up new addresses and lets go those that are not listed any more; calls under way there go on.
    pub fn renew<E>(
        &mut self,
        addresses: &[String],
        mut connect: impl FnMut(&str) -> Result<C, E>,
    ) -> Result<(), E> {
        for address in addresses {
            if self.get(address).is_none() {
                self.replicas.push(Replica {
                    address: address.clone(),
                    channel: connect(address)?,
                    health: Health::Unknown,
                    breaker: Breaker::default(),
                    under_way: 0,
                });
            }
        }
        self.replicas
            .retain(|replica| addresses.contains(&replica.address));
        Ok(())
    }

    /// Whether there is none at all.
    pub fn is_empty(&self) -> bool {
        self.replicas.is_empty()
    }

    /// Every address with its channel.
    pub fn channels(&self) -> Vec<(String, C)> {
        self.replicas
            .iter()
            .map(|replica| (replica.address.clone(), replica.channel.clone()))
            .collect()
    }

    /// Chooses a replica and counts the call; those in `tried` only if there is no other. A replica that did not answer
    /// is the last resort, one that says that it does not serve is none.
    pub fn choose(&mut self, tried: &[String], now: Instant) -> Option<(String, C)> {
        self.turn = self.turn.wrapping_add(1);
        let count = self.replicas.len();
        let turn = self.turn;
        let (_, chosen) = self
            .replicas
            .iter_mut()
            .enumerate()
            .filter(|(_, replica)| {
                replica.health != Health::NotServing && replica.breaker.admits(now)
            })
            .min_by_key(|(index, replica)| {
                (
                    tried.contains(&replica.address),
                    replica.health == Health::Unreachable,
                    replica.under_way,
                    (index + turn) % count,
                )
            })?;
        chosen.breaker.enter();
        chosen.under_way += 1;
        Some((chosen.address.clone(), chosen.channel.clone()))
    }

    /// A call was answered.
    pub fn answered(&mut self, address: &str) {
        if let Some(replica) = self.get(address) {
            replica.breaker.succeeded();
            replica.health = Health::Serving;
        }
    }

    /// A call was not answered, or its answer broke off.
    pub fn failed(&mut self, address: &str, now: Instant) {
        if let Some(replica) = self.get(address) {
            replica.breaker.failed(now);
            replica.health = Health::Unreachable;
        }
    }

    /// A call is over; `settled` if it was answered or has failed before.
    pub fn over(&mut self, address: &str, settled: bool, now: Instant) {
        if let Some(replica) = self.get(address) {
            // A replica that left and came back between begins its count anew.
            replica.under_way = replica.under_way.saturating_sub(1);
            if !settled {
                replica.breaker.abandoned(now);
            }
        }
    }

    /// What a look at a replica found; answers whether that is news. One that is back is tried at once.
    pub fn looked(&mut self, address: &str, health: Health) -> bool {
        let Some(replica) = self.get(address) else {
            return false;
        };
        let news = replica.health != health;
        if replica.health == Health::Unreachable
            && matches!(health, Health::Serving | Health::Unknown)
        {
            replica.breaker.succeeded();
        }
        replica.health = health;
        news
    }

    /// What keeps each replica from being chosen, in one line.
    pub fn trouble(&self, now: Instant) -> String {
        let trouble = self.replicas.iter().map(|replica| {
            let what = match (replica.health, replica.breaker.circuit()) {
                (Health::NotServing, _) => "does not serve".to_owned(),
                (_, Circuit::Open { until }) => format!(
                    "failed several times and is tried again in {:.1} s",
                    until.saturating_duration_since(now).as_secs_f64()
                ),
                (_, Circuit::HalfOpen) => "is being tried after failures".to_owned(),
                (Health::Unreachable, _) => "does not answer".to_owned(),
                (Health::Serving | Health::Unknown, _) => "is there".to_owned(),
            };
            format!("{} {what}", replica.address)
        });
        trouble.collect::<Vec<_>>().join(", ")
    }

    fn get(&mut self, address: &str) -> Option<&mut Replica<C>> {
        self.replicas
            .iter_mut()
            .find(|replica| replica.address == address)
    }
}

#[cfg(test)]
mod tests {
    use std::convert::Infallible;
    use std::time::Duration;

    use super::super::breaker::{COOL_DOWN, FAILURES_TO_OPEN};
    use super::*;

    fn addresses(names: &[&str]) -> Vec<String> {
        names.iter().map(|&name| name.to_owned()).collect()
    }

    fn pool(names: &[&str]) -> Pool<()> {
        let mut pool = Pool::default();
        pool.renew(&addresses(names), |_| Ok::<_, Infallible>(()))
            .unwrap();
        pool
    }

    fn choose(pool: &mut Pool<()>, now: Instant) -> Option<String> {
        pool.choose(&[], now).map(|(address, ())| address)
    }

    #[test]
    fn calls_that_stay_open_are_spread_evenly() {
        let now = Instant::now();
        let mut pool = pool(&["a", "b", "c"]);
        let mut counts = std::collections::BTreeMap::new();
        for _ in 0..300 {
            *counts.entry(choose(&mut pool, now).unwrap()).or_insert(0) += 1;
        }
        assert_eq!(counts.into_values().collect::<Vec<_>>(), [100, 100, 100]);
    }

    #[test]
    fn short_calls_take_turns() {
        let now = Instant::now();
        let mut pool = pool(&["a", "b"]);
        let mut counts = [0, 0];
        for _ in 0..100 {
            let chosen = choose(&mut pool, now).unwrap();
            pool.answered(&chosen);
            pool.over(&chosen, true, now);
            counts[usize::from(chosen == "b")] += 1;
        }
        assert_eq!(counts, [50, 50]);
    }

    #[test]
    fn a_slow_replica_gets_fewer_calls() {
        let now = Instant::now();
        let mut pool = pool(&["slow", "quick"]);
        let mut slow = 0;
        for _ in 0..100 {
            match choose(&mut pool, now).unwrap().as_str() {
                // Never over.
                "slow" => slow += 1,
                quick => pool.over(quick, true, now),
            }
        }
        assert!(slow <= 2, "{slow} of 100 calls");
    }

    #[test]
    fn a_replica_that_does_not_serve_is_left_alone_until_it_does() {
        let now = Instant::now();
        let mut pool = pool(&["a", "b"]);
        assert!(pool.looked("a", Health::NotServing));
        for _ in 0..10 {
            assert_eq!(choose(&mut pool, now).as_deref(), Some("b"));
        }
        assert!(pool.looked("b", Health::NotServing));
        assert_eq!(choose(&mut pool, now), None);
        assert_eq!(pool.trouble(now), "a does not serve, b does not serve");
        assert!(pool.looked("a", Health::Serving));
        assert_eq!(choose(&mut pool, now).as_deref(), Some("a"));
    }

    #[test]
    fn a_replica_that_failed_is_the_last_resort_and_then_none() {
        let now = Instant::now();
        let mut pool = pool(&["a", "b"]);
        pool.failed("a", now);
        for _ in 0..10 {
            assert_eq!(choose(&mut pool, now).as_deref(), Some("b"));
        }
        let alone = pool.choose(&addresses(&["b"]), now);
        assert_eq!(
            alone.map(|(address, ())| address).as_deref(),
            Some("a"),
            "one that this call has not tried yet comes first"
        );
        for _ in 0..FAILURES_TO_OPEN {
            pool.failed("a", now);
            pool.failed("b", now);
        }
        assert_eq!(choose(&mut pool, now), None);
        assert!(choose(&mut pool, now + COOL_DOWN).is_some());
    }

    #[test]
    fn a_replica_that_answers_again_is_back_before_its_cool_down() {
        let now = Instant::now();
        let mut pool = pool(&["a"]);
        for _ in 0..FAILURES_TO_OPEN {
            pool.failed("a", now);
        }
        assert_eq!(choose(&mut pool, now + COOL_DOWN / 2), None);
        assert!(pool.looked("a", Health::Serving));
        assert!(choose(&mut pool, now + COOL_DOWN / 2).is_some());
    }

    #[test]
    fn addresses_that_are_gone_leave_and_new_ones_join() {
        let now = Instant::now();
        let mut pool = pool(&["a", "b"]);
        let held = choose(&mut pool, now).unwrap();
        pool.renew(&addresses(&["c"]), |_| Ok::<_, Infallible>(()))
            .unwrap();
        assert_eq!(choose(&mut pool, now).as_deref(), Some("c"));
        // The call of a replica that left ends without harm.
        pool.over(&held, true, now + Duration::from_secs(1));
        assert_eq!(pool.channels().len(), 1);
    }
}
