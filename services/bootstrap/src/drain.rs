//! The signal that a server is going down.

use tokio::sync::watch;

/// Tells owner tasks and open streams that the server is going down. Clones share one signal.
#[derive(Clone, Debug)]
pub struct Drain(watch::Receiver<bool>);

/// The end that starts a [`Drain`].
#[derive(Debug)]
pub(crate) struct DrainSource(watch::Sender<bool>);

impl Drain {
    pub(crate) fn channel() -> (DrainSource, Self) {
        let (sender, receiver) = watch::channel(false);
        (DrainSource(sender), Self(receiver))
    }

    /// A drain that never starts, for tests and for parts that run without a server.
    pub fn never() -> Self {
        let (source, drain) = Self::channel();
        // Keeping the sender alive is what makes the signal wait for ever.
        std::mem::forget(source);
        drain
    }

    /// Resolves when the shutdown begins.
    pub async fn started(&self) {
        let mut receiver = self.0.clone();
        // A dropped source means that the server is gone, which is a shutdown too.
        receiver.wait_for(|started| *started).await.ok();
    }
}

impl DrainSource {
    pub(crate) fn start(&self) {
        self.0.send_replace(true);
    }
}
