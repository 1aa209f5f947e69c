//! Work that keeps a processor for long: hashes and checks of whole models. It is done aside, on a thread of its own, so that
//! the threads that answer a stop never wait for it.

/// The outcome of `work`, done aside.
pub(crate) async fn aside<T: Send + 'static>(work: impl FnOnce() -> T + Send + 'static) -> T {
    match tokio::task::spawn_blocking(work).await {
        Ok(outcome) => outcome,
        Err(error) => match error.try_into_panic() {
            Ok(panic) => std::panic::resume_unwind(panic),
            // Only the end of the runtime cancels this, and the caller with it.
            Err(_) => std::future::pending().await,
        },
    }
}
