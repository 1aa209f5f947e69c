//! How much memory a process holds.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use tokio::task::JoinHandle;

/// Between two samples.
const PERIOD: Duration = Duration::from_millis(100);

/// Looks again and again at the memory of a process.
#[derive(Debug)]
pub struct Resident {
    most: Arc<AtomicU64>,
    sampling: JoinHandle<()>,
}

/// Resident memory of a process, bytes; 0 when it is gone.
pub fn resident_bytes(process: u32) -> u64 {
    let status = std::fs::read_to_string(format!("/proc/{process}/status")).unwrap_or_default();
    status
        .lines()
        .find_map(|line| line.strip_prefix("VmRSS:"))
        .and_then(|text| {
            text.trim()
                .trim_end_matches("kB")
                .trim()
                .parse::<u64>()
                .ok()
        })
        .map_or(0, |kib| kib * 1024)
}

impl Resident {
    /// From now on.
    pub fn of(process: u32) -> Self {
        let most = Arc::new(AtomicU64::new(0));
        let seen = most.clone();
        let sampling = tokio::spawn(async move {
            let mut ticks = tokio::time::interval(PERIOD);
            loop {
                ticks.tick().await;
                seen.fetch_max(resident_bytes(process), Ordering::Relaxed);
            }
        });
        Self { most, sampling }
    }

    /// The most that was seen, bytes.
    pub fn most_bytes(&self) -> u64 {
        self.most.load(Ordering::Relaxed)
    }
}

impl Drop for Resident {
    fn drop(&mut self) {
        self.sampling.abort();
    }
}
