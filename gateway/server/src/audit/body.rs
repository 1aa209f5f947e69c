//! Bodies on their way through the audit: a request's beginning is looked at and the rest hashed as it streams by, an
//! answer is followed to its status. Neither is ever held as a whole.

use std::collections::VecDeque;
use std::future::poll_fn;
use std::pin::Pin;
use std::sync::{Arc, Mutex, PoisonError};
use std::task::{Context, Poll, ready};

use bytes::Bytes;
use http_body::{Body as _, Frame};
use sha2::{Digest as _, Sha256};
use tonic::Status;
use tonic::body::Body;

use super::layer::Open;
use crate::approval::Digest;

/// How much of a request is looked at before it is worked on. A larger one has its digest in its outcome only.
const PREFIX_MOST: usize = 64 * 1024;

/// What has been heard of a request so far.
#[derive(Clone, Debug, Default)]
pub struct Heard(Arc<Mutex<Hash>>);

#[derive(Debug, Default)]
struct Hash {
    hasher: Sha256,
    ended: bool,
}

/// The beginning of a request.
pub(super) struct Prefix {
    bytes: Vec<u8>,
    frames: VecDeque<Result<Frame<Bytes>, Status>>,
    ended: bool,
    rest: Body,
    heard: Heard,
}

/// A request that is hashed as it streams by.
struct Hashed {
    frames: VecDeque<Result<Frame<Bytes>, Status>>,
    rest: Option<Body>,
    heard: Heard,
}

/// An answer that is followed to its status.
pub(super) struct Answer {
    inner: Body,
    open: Open,
}

// === impl Heard ===

impl Heard {
    /// SHA-256 of the whole request, once it is over.
    pub fn digest(&self) -> Option<Digest> {
        let hash = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        hash.ended
            .then(|| Digest::from_bytes(hash.hasher.clone().finalize().into()))
    }

    fn add(&self, frame: &Option<Result<Frame<Bytes>, Status>>) {
        let mut hash = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        match frame {
            None => hash.ended = true,
            Some(Ok(frame)) => {
                if let Some(data) = frame.data_ref() {
                    hash.hasher.update(data);
                }
            }
            Some(Err(_)) => {}
        }
    }
}

// === impl Prefix ===

impl Prefix {
    /// Takes the whole body where that is short, its first piece where the client streams.
    pub(super) async fn of(rest: Body, streams: bool) -> Self {
        let mut prefix = Self {
            bytes: Vec::new(),
            frames: VecDeque::new(),
            ended: false,
            rest,
            heard: Heard::default(),
        };
        while prefix.bytes.len() < PREFIX_MOST {
            let frame = poll_fn(|context| Pin::new(&mut prefix.rest).poll_frame(context)).await;
            prefix.heard.add(&frame);
            let Some(frame) = frame else {
                prefix.ended = true;
                break;
            };
            let data = frame.as_ref().ok().and_then(Frame::data_ref);
            let (has_data, failed) = (data.is_some(), frame.is_err());
            if let Some(data) = data {
                let room = PREFIX_MOST - prefix.bytes.len();
                prefix.bytes.extend(data.iter().take(room));
            }
            prefix.frames.push_back(frame);
            if failed || (streams && has_data) {
                break;
            }
        }
        prefix
    }

    /// What was looked at.
    pub(super) fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// The body as it came, and what is heard of it as it goes on.
    pub(super) fn into_body(self) -> (Body, Heard) {
        let body = Hashed {
            frames: self.frames,
            rest: (!self.ended).then_some(self.rest),
            heard: self.heard.clone(),
        };
        (Body::new(body), self.heard)
    }
}

impl http_body::Body for Hashed {
    type Data = Bytes;
    type Error = Status;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, Status>>> {
        if let Some(frame) = self.frames.pop_front() {
            return Poll::Ready(Some(frame));
        }
        let Some(rest) = self.rest.as_mut() else {
            return Poll::Ready(None);
        };
        let frame = ready!(Pin::new(rest).poll_frame(context));
        self.heard.add(&frame);
        Poll::Ready(frame)
    }

    fn is_end_stream(&self) -> bool {
        self.frames.is_empty()
            && self
                .rest
                .as_ref()
                .is_none_or(http_body::Body::is_end_stream)
    }
}

// === impl Answer ===

impl Answer {
    pub(super) fn new(inner: Body, open: Open) -> Self {
        Self { inner, open }
    }
}

impl http_body::Body for Answer {
    type Data = Bytes;
    type Error = Status;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, Status>>> {
        let frame = ready!(Pin::new(&mut self.inner).poll_frame(context));
        match &frame {
            Some(Ok(frame)) => {
                if let Some(trailers) = frame.trailers_ref() {
                    let status = Status::from_header_map(trailers);
                    let status = status.unwrap_or_else(|| Status::unknown("no status came"));
                    self.open.end(&status);
                }
            }
            Some(Err(status)) => self.open.end(status),
            None => self.open.end(&Status::ok("")),
        }
        Poll::Ready(frame)
    }

    fn is_end_stream(&self) -> bool {
        self.inner.is_end_stream()
    }
}
