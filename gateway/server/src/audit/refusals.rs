//! Calls that the server answered before they reached a service: the wrong role, too many at the same time.

use arthro_bootstrap::{Caller, RefusedCall};
use tokio::sync::broadcast::Receiver;
use tokio::sync::broadcast::error::RecvError;

use super::entry::{Entry, Kind, Who};
use super::keeper::Audit;
use crate::wall_clock::now_ms;

/// Records them until the server is gone.
pub async fn record(audit: Audit, mut refusals: Receiver<RefusedCall>) {
    loop {
        match refusals.recv().await {
            Ok(call) => {
                audit.note(entry(call));
            }
            Err(RecvError::Lagged(missed)) => {
                let mut entry = Entry::new(now_ms(), Kind::Alarm, Who::gateway());
                entry.reason = "REFUSALS_MISSED".to_owned();
                entry.detail = format!("{missed} refusals came faster than they could be recorded");
                audit.note(entry);
            }
            Err(RecvError::Closed) => return,
        }
    }
}

fn entry(call: RefusedCall) -> Entry {
    let who = Who {
        peer: call.peer.map_or_else(String::new, |peer| peer.to_string()),
        ..call.caller.as_ref().map(Who::from).unwrap_or_default()
    };
    Entry {
        method: call.method,
        code: "REFUSED".to_owned(),
        reason: call.reason,
        detail: call.message,
        ..Entry::new(now_ms(), Kind::Refusal, who)
    }
}

// === impl Who ===

impl Who {
    /// The gateway itself.
    pub fn gateway() -> Self {
        Self {
            name: "gateway".to_owned(),
            role: "gateway".to_owned(),
            peer: String::new(),
        }
    }
}

impl From<&Caller> for Who {
    fn from(caller: &Caller) -> Self {
        let role = match caller {
            Caller::Local => "local",
            Caller::Certified { role, .. } => role.as_str(),
        };
        Self {
            name: caller.name().to_owned(),
            role: role.to_owned(),
            peer: String::new(),
        }
    }
}
