//! What callers hold: handles to the nodes of a network.

use std::time::Duration;

use tokio::sync::{mpsc, oneshot};

use super::{Error, Priority, Reading, Request, Sdo};
use crate::canopen::nmt;
use crate::canopen::object::{Address, Object, Value};
use crate::canopen::sdo::client::Transfer;

/// One node of the network. Cheap to clone.
#[derive(Clone, Debug)]
pub struct Node {
    node_id: u8,
    requests: mpsc::Sender<Request>,
}

impl Node {
    /// Its number.
    pub fn node_id(&self) -> u8 {
        self.node_id
    }

    /// Reads an object.
    pub async fn read<T: Value>(&self, object: Object<T>) -> Result<T, Error> {
        self.read_stamped(object).await.map(|reading| reading.value)
    }

    /// Reads an object and the time of the answer.
    pub async fn read_stamped<T: Value>(&self, object: Object<T>) -> Result<Reading<T>, Error> {
        let Reading {
            value: bytes,
            stamp,
        } = self.read_bytes(object.address).await?;
        let value = T::from_le_slice(&bytes).ok_or(Error::Size {
            node_id: self.node_id,
            address: object.address,
            len: bytes.len(),
            expected: T::SIZE,
        })?;
        Ok(Reading { value, stamp })
    }

    /// Reads an object of any type, little-endian.
    pub async fn read_bytes(&self, address: Address) -> Result<Reading<Vec<u8>>, Error> {
        self.transfer(address, Transfer::upload(address), Priority::Normal)
            .await
    }

    /// Writes an object. Returns when the node has confirmed, with the time of that.
    pub async fn write<T: Value>(&self, object: Object<T>, value: T) -> Result<Duration, Error> {
        self.write_bytes(object.address, &value.to_le_vec()).await
    }

    /// Writes an object before everything else that waits for this node.
    pub async fn write_urgently<T: Value>(
        &self,
        object: Object<T>,
        value: T,
    ) -> Result<Duration, Error> {
        let transfer = Transfer::download(object.address, &value.to_le_vec());
        self.transfer(object.address, transfer, Priority::Urgent)
            .await
            .map(|reading| reading.stamp)
    }

    /// Writes an object of any type, little-endian.
    pub async fn write_bytes(&self, address: Address, data: &[u8]) -> Result<Duration, Error> {
        let transfer = Transfer::download(address, data);
        self.transfer(address, transfer, Priority::Normal)
            .await
            .map(|reading| reading.stamp)
    }

    /// Orders the node's NMT state. There is no answer; the heartbeat tells.
    pub async fn command(&self, command: nmt::Command) -> Result<(), Error> {
        let request = Request::Nmt(command, nmt::Target::Node(self.node_id));
        self.requests.send(request).await.map_err(|_| Error::Gone)
    }

    async fn transfer(
        &self,
        address: Address,
        (transfer, first): (Transfer, [u8; 8]),
        priority: Priority,
    ) -> Result<Reading<Vec<u8>>, Error> {
        let (reply, answer) = oneshot::channel();
        let request = Request::Sdo(
            self.node_id,
            priority,
            Sdo {
                address,
                transfer,
                first,
                reply,
            },
        );
        self.requests.send(request).await.map_err(|_| Error::Gone)?;
        answer.await.map_err(|_| Error::Gone)?
    }
}

/// The way to the nodes of a [`Network`]. Cheap to clone.
#[derive(Clone, Debug)]
pub struct Nodes {
    requests: mpsc::Sender<Request>,
}

impl Nodes {
    pub(super) fn new(requests: mpsc::Sender<Request>) -> Self {
        Self { requests }
    }

    /// A node by its number, 1 to 127.
    pub fn node(&self, node_id: u8) -> Node {
        Node {
            node_id,
            requests: self.requests.clone(),
        }
    }
}
