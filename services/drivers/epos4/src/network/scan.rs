//! Which nodes there are on a bus.

use std::future::poll_fn;
use std::ops::RangeInclusive;
use std::pin::Pin;
use std::task::Poll;
use std::time::Duration;

use super::{Error, Node, Nodes};
use crate::canopen::object::Address;
use crate::objects;

/// How many node ids are asked at the same time, so that the queue to the bus takes all the requests.
const WINDOW: usize = 32;

/// A node that answered.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Found {
    /// Its number.
    pub node_id: u8,
    /// Object 0x1000.
    pub device_type: u32,
    /// Object 0x1008, when the node has one.
    pub device_name: Option<String>,
    /// Object 0x1018.
    pub identity: Identity,
}

/// Object 0x1018. What a node does not have is 0.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub struct Identity {
    /// Subindex 1.
    pub vendor_id: u32,
    /// Subindex 2.
    pub product_code: u32,
    /// Subindex 3.
    pub revision: u32,
    /// Subindex 4.
    pub serial_number: u32,
}

type Asking = Pin<Box<dyn Future<Output = Result<Option<Found>, Error>> + Send>>;

impl Nodes {
    /// Asks these node ids for their device type and tells those that answer within the timeout, by rising number. Each
    /// SDO server of the bus is asked, so no other master should be at work.
    pub async fn scan(
        &self,
        node_ids: RangeInclusive<u8>,
        timeout: Duration,
    ) -> Result<Vec<Found>, Error> {
        let node_ids: Vec<u8> = node_ids.filter(|id| (1..=127).contains(id)).collect();
        let mut found = Vec::new();
        for window in node_ids.chunks(WINDOW) {
            let asked = window.iter().map(|node_id| {
                let node = self.node(*node_id).with_sdo_timeout(timeout);
                Box::pin(ask(node)) as Asking
            });
            for answer in all(asked.collect()).await {
                found.extend(answer?);
            }
        }
        Ok(found)
    }
}

/// `None` for a node id at which nobody answers.
async fn ask(node: Node) -> Result<Option<Found>, Error> {
    let device_type = match node.read(objects::DEVICE_TYPE).await {
        Err(Error::NoAnswer { .. }) => return Ok(None),
        answer => or_zero(answer)?,
    };
    let name = node.read_bytes(Address::new(0x1008, 0)).await.ok();
    Ok(Some(Found {
        node_id: node.node_id(),
        device_type,
        device_name: name.map(|name| String::from_utf8_lossy(&name.value).into_owned()),
        identity: Identity {
            vendor_id: or_zero(node.read(objects::VENDOR_ID).await)?,
            product_code: or_zero(node.read(objects::PRODUCT_CODE).await)?,
            revision: or_zero(node.read(objects::REVISION_NUMBER).await)?,
            serial_number: or_zero(node.read(objects::SERIAL_NUMBER).await)?,
        },
    }))
}

/// An object that a node lacks is 0; a node that fell silent is an error.
fn or_zero(read: Result<u32, Error>) -> Result<u32, Error> {
    match read {
        Err(error) if error.abort_code().is_some() => Ok(0),
        read => read,
    }
}

/// Drives all futures at the same time; their outputs in the order of the futures.
async fn all<T>(mut futures: Vec<Pin<Box<dyn Future<Output = T> + Send>>>) -> Vec<T> {
    let mut outputs: Vec<Option<T>> = futures.iter().map(|_| None).collect();
    poll_fn(|context| {
        for (future, output) in futures.iter_mut().zip(&mut outputs) {
            if output.is_none()
                && let Poll::Ready(ready) = future.as_mut().poll(context)
            {
                *output = Some(ready);
            }
        }
        if outputs.iter().all(Option::is_some) {
            return Poll::Ready(());
        }
        Poll::Pending
    })
    .await;
    outputs.into_iter().flatten().collect()
}
