//! The signal that a server is going down.

use tokio::sync::watch;

/// Tells owner tasks and open streams that the server is going down. Clones share one signal.
#[derive(Clone, Debug)]
pub struct Drain {
    started: watch::Receiver<bool>,
    held: watch::Sender<usize>,
}

/// The end that starts a [`Drain`].
#[derive(Debug)]
pub(crate) struct DrainSource {
    started: watch::Sender<bool>,
    held: watch::Receiver<usize>,
}

/// Keeps a server that goes down from ending, for as long as its drain lasts: a device is being left in order.
#[derive(Debug)]
pub struct Hold(watch::Sender<usize>);

impl Drain {
    pub(crate) fn channel() -> (DrainSource, Self) {
        let (start, started) = watch::channel(false);
        let (hold, held) = watch::channel(0);
        let source = DrainSource {
            started: start,
            held,
        };
        (
            source,
            Self {
                started,
                held: hold,
            },
        )
    }

    /// A drain that never starts, for tests and for parts that run without a server.
    pub fn never() -> Self {
        let (source, drain) = Self::channel();
        // Keeping the sender alive is what makes the signal wait for ever.
        std::mem::forget(source);
        drain
    }

    /// Has the server wait with its end until this is dropped.
    pub fn hold(&self) -> Hold {
        self.held.send_modify(|holds| *holds += 1);
        Hold(self.held.clone())
    }

    /// Resolves when the shutdown begins.
    pub async fn started(&self) {
        let mut receiver = self.started.clone();
        // A dropped source means that the server is gone, which is a shutdown too.
        receiver.wait_for(|started| *started).await.ok();
    }
}

impl DrainSource {
    pub(crate) fn start(&self) {
        self.started.send_replace(true);
    }

    /// Resolves when nobody holds the server any more.
    pub(crate) async fn released(&self) {
        let mut held = self.held.clone();
        // Without anybody who could hold it, nobody does.
        held.wait_for(|holds| *holds == 0).await.ok();
    }
}

impl Drop for Hold {
    fn drop(&mut self) {
        self.0.send_modify(|holds| *holds -= 1);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn a_drain_ends_when_the_last_hold_is_dropped() {
        let (source, drain) = Drain::channel();
        source.released().await;
        let holds = (drain.hold(), drain.clone().hold());
        source.start();
        drain.started().await;
        drop(holds.0);
        tokio::select! {
            biased;
            () = source.released() => panic!("one still holds"),
            () = std::future::ready(()) => {}
        }
        drop(holds.1);
        source.released().await;
    }
}
