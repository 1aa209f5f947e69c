//! The row that says who commands: its epoch is the fencing token of every write, its lease tells when the holder
//! is thought dead. Time is the database's own, which is one for all gateways.

use std::sync::Weak;
use std::time::Duration;

use sqlx::{Any, AnyPool, AssertSqlSafe, Row as _, Transaction};

use tokio::time::{Instant, MissedTickBehavior};

use super::{Dialect, SqlJournal};
use crate::journal::{Duty, JournalError};

/// A gateway that has not renewed for so long is thought dead. Longer than the leases on the devices, so that these
/// have run out, and the devices have stopped, before another gateway takes command.
pub const LEASE_TTL: Duration = Duration::from_secs(3);
/// How often the lease is renewed, and how often a standby looks whether it has run out.
pub const RENEWAL_PERIOD: Duration = Duration::from_millis(500);

/// When command may be taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Take {
    /// Once the lease of whoever holds it has run out.
    WhenFree,
    /// At once: a lock on the file says that nobody else has it.
    AtOnce,
}

/// Whether the row still bears `epoch`. If so, nobody takes command before the transaction ends.
pub async fn hold(
    transaction: &mut Transaction<'_, Any>,
    dialect: Dialect,
    epoch: i64,
) -> Result<bool, JournalError> {
    let row = sqlx::query(dialect.hold())
        .bind(epoch)
        .fetch_optional(&mut **transaction)
        .await?;
    Ok(row.is_some())
}

/// The epoch and name of whoever holds command, or held it last.
async fn holder(pool: &AnyPool) -> Result<(i64, String), JournalError> {
    let row = sqlx::query("SELECT epoch, holder FROM command")
        .fetch_one(pool)
        .await?;
    Ok((row.try_get("epoch")?, row.try_get("holder")?))
}

/// Keeps command while this gateway has it, and takes it when the other's lease has run out. Ends with the journal.
pub async fn keep(journal: Weak<SqlJournal>, name: String) {
    let mut ticks = tokio::time::interval(RENEWAL_PERIOD);
    ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let mut held_until = Instant::now() + LEASE_TTL;
    loop {
        ticks.tick().await;
        let Some(journal) = journal.upgrade() else {
            return;
        };
        let changing = journal.changing.lock().await;
        if changing.has_left {
            return;
        }
        let duty = journal.duty.borrow().clone();
        match duty {
            Duty::InCommand { epoch } => held_until = journal.renew(epoch, held_until).await,
            Duty::Standby { .. } => {
                let asked_at = Instant::now();
                match journal.take_command(&name, Take::WhenFree).await {
                    Ok(true) => held_until = asked_at + LEASE_TTL,
                    Ok(false) => {}
                    Err(error) => {
                        tracing::warn!(
                            error = crate::error::chain(&error),
                            "no answer about command"
                        );
                    }
                }
            }
        }
    }
}

impl SqlJournal {
    /// Takes command if it may be taken; says whether this gateway is in command now.
    pub(in crate::journal) async fn take_command(
        &self,
        name: &str,
        take: Take,
    ) -> Result<bool, JournalError> {
        let now = self.dialect.now_ms();
        let free = match take {
            Take::WhenFree => format!("expires_ms <= {now}"),
            Take::AtOnce => "TRUE".to_owned(),
        };
        let taken = sqlx::query(AssertSqlSafe(format!(
            "UPDATE command SET epoch = epoch + 1, holder = $1, expires_ms = {now} + $2 WHERE {free} RETURNING epoch"
        )))
        .bind(name)
        .bind(LEASE_TTL.as_millis() as i64)
        .fetch_optional(&self.keeper)
        .await?;
        let duty = match &taken {
            Some(row) => Duty::InCommand {
                epoch: row.try_get("epoch")?,
            },
            None => Duty::Standby {
                holder: holder(&self.keeper).await?.1,
            },
        };
        self.change_duty(duty);
        Ok(taken.is_some())
    }

    /// Renews the lease; answers until when this gateway may believe that it is in command. That ends before the lease
    /// does: it is counted from before the question.
    async fn renew(&self, epoch: i64, held_until: Instant) -> Instant {
        let now = self.dialect.now_ms();
        let query = AssertSqlSafe(format!(
            "UPDATE command SET expires_ms = {now} + $2 WHERE epoch = $1"
        ));
        let renewing = sqlx::query(query)
            .bind(epoch)
            .bind(LEASE_TTL.as_millis() as i64)
            .execute(&self.keeper);
        let asked_at = Instant::now();
        match tokio::time::timeout_at(held_until, renewing).await {
            Ok(Ok(renewed)) if renewed.rows_affected() == 1 => return asked_at + LEASE_TTL,
            Ok(Ok(_)) => {
                if let Err(error) = self.lose(epoch).await {
                    tracing::warn!(
                        error = crate::error::chain(&error),
                        "who is in command is not known"
                    );
                }
                return held_until;
            }
            Ok(Err(error)) => {
                tracing::warn!(error = crate::error::chain(&error), "command not renewed");
            }
            Err(_) => tracing::warn!("command not renewed: the database does not answer"),
        }
        if Instant::now() >= held_until {
            self.change_duty(nobody());
        }
        held_until
    }

    /// Gives command up for good.
    pub(super) async fn give_command_up(&self) -> Result<(), JournalError> {
        self.changing.lock().await.has_left = true;
        let Duty::InCommand { epoch } = self.duty.send_replace(nobody()) else {
            return Ok(());
        };
        sqlx::query("UPDATE command SET holder = '', expires_ms = 0 WHERE epoch = $1")
            .bind(epoch)
            .execute(&self.keeper)
            .await?;
        Ok(())
    }

    /// Command of `epoch` is lost; answers whose it is.
    pub(super) async fn lose(&self, epoch: i64) -> Result<String, JournalError> {
        // Nothing is written from here on, even if it cannot be learnt who is in command.
        self.duty.send_if_modified(|duty| {
            let lost = *duty == Duty::InCommand { epoch };
            if lost {
                *duty = nobody();
            }
            lost
        });
        let (_, holder) = holder(&self.keeper).await?;
        self.duty.send_if_modified(|duty| match duty {
            Duty::Standby { holder: known } if *known != holder => {
                known.clone_from(&holder);
                true
            }
            _ => false,
        });
        Ok(holder)
    }

    fn change_duty(&self, now: Duty) {
        let changed = self.duty.send_if_modified(|duty| {
            let changed = *duty != now;
            duty.clone_from(&now);
            changed
        });
        if changed {
            tracing::info!(duty = ?now, "command changed");
        }
    }
}

fn nobody() -> Duty {
    Duty::Standby {
        holder: String::new(),
    }
}

// === impl Dialect ===

impl Dialect {
    /// The command row at an epoch, locked against whoever would take command, not against other writers.
    const fn hold(self) -> &'static str {
        match self {
            // Whoever writes has the whole file.
            Self::Sqlite => "SELECT epoch FROM command WHERE epoch = $1",
            Self::Postgres => "SELECT epoch FROM command WHERE epoch = $1 FOR SHARE",
        }
    }

    /// What ends a selection of rows to work on, so that two gateways never get the same one.
    pub(super) const fn skip_locked(self) -> &'static str {
        match self {
            Self::Sqlite => "",
            Self::Postgres => " FOR UPDATE SKIP LOCKED",
        }
    }

    /// The database's clock, ms since 1970-01-01 UTC.
    const fn now_ms(self) -> &'static str {
        match self {
            Self::Sqlite => "CAST(unixepoch('subsec') * 1000 AS INTEGER)",
            Self::Postgres => "CAST(extract(epoch FROM clock_timestamp()) * 1000 AS BIGINT)",
        }
    }
}
