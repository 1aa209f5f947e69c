//! What callers hold: handles to the nodes of a network.

use std::time::Duration;

use tokio::sync::{mpsc, oneshot};

use super::lane::Sdo;
use super::orders::Order;
use super::{Error, Priority, Reading, Request};
use crate::canopen::object::{Address, Object, Value};
use crate::canopen::pdo::{self, Mapping, Pdo, Transmission};
use crate::canopen::sdo::client::Transfer;
use crate::canopen::{nmt, sync};
use crate::frame::{Frame, Id};

/// One node of the network. Cheap to clone.
#[derive(Clone, Debug)]
pub struct Node {
    node_id: u8,
    sdo_timeout: Option<Duration>,
    requests: mpsc::Sender<Request>,
}

impl Node {
    /// Its number.
    pub fn node_id(&self) -> u8 {
        self.node_id
    }

    /// The same node, whose SDO answers are waited for this long instead of as long as the network says.
    pub fn with_sdo_timeout(self, timeout: Duration) -> Self {
        Self {
            sdo_timeout: Some(timeout),
            ..self
        }
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

    /// Reads a large object by block transfer, or in segments when the node does not know that.
    pub async fn read_block(&self, address: Address) -> Result<Reading<Vec<u8>>, Error> {
        self.transfer(address, Transfer::block_upload(address), Priority::Normal)
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

    /// Writes a large object by block transfer, or in segments when the node does not know that.
    pub async fn write_block(&self, address: Address, data: &[u8]) -> Result<Duration, Error> {
        let transfer = Transfer::block_download(address, data);
        self.transfer(address, transfer, Priority::Normal)
            .await
            .map(|reading| reading.stamp)
    }

    /// Orders the node's NMT state. There is no answer; the heartbeat tells.
    pub async fn command(&self, command: nmt::Command) -> Result<(), Error> {
        let request = Request::Nmt(command, nmt::Target::Node(self.node_id));
        self.send(request).await
    }

    /// Orders the node's NMT state and waits until its heartbeat, or its boot-up after a reset, tells it; with the time
    /// of that. The timeout is real time. A node whose heartbeat is off (object 0x1017) tells boot-ups alone.
    pub async fn change_state(
        &self,
        command: nmt::Command,
        timeout: Duration,
    ) -> Result<Duration, Error> {
        let (reply, answer) = oneshot::channel();
        let order = Order {
            node_id: self.node_id,
            wanted: command.outcome(),
            timeout,
            reply,
        };
        self.send(Request::Order(command, order)).await?;
        answer.await.map_err(|_| Error::Gone)?
    }

    /// Has the node send these objects as its TPDO 1 to 4, and reads back that it will. The inhibit time counts in steps
    /// of 100 us.
    pub async fn map_transmit_pdo(
        &self,
        number: u8,
        mapping: &Mapping,
        transmission: Transmission,
        inhibit: Duration,
    ) -> Result<(), Error> {
        let pdo = Pdo::Transmit(number);
        self.set_up_pdo(pdo, mapping, transmission, inhibit).await
    }

    /// Has the node take these objects from its RPDO 1 to 4, and reads back that it will.
    pub async fn map_receive_pdo(
        &self,
        number: u8,
        mapping: &Mapping,
        transmission: Transmission,
    ) -> Result<(), Error> {
        let pdo = Pdo::Receive(number);
        self.set_up_pdo(pdo, mapping, transmission, Duration::ZERO)
            .await
    }

    async fn set_up_pdo(
        &self,
        pdo: Pdo,
        mapping: &Mapping,
        transmission: Transmission,
        inhibit: Duration,
    ) -> Result<(), Error> {
        let writes = pdo::setting_up(pdo, self.node_id, mapping, transmission, inhibit);
        for write in &writes {
            self.write_bytes(write.address, &write.data).await?;
        }
        for write in writes.into_iter().filter(|write| write.lasts) {
            let found = self.read_bytes(write.address).await?.value;
            if found != write.data {
                return Err(Error::ReadBack {
                    node_id: self.node_id,
                    address: write.address,
                    wrote: write.data,
                    found,
                });
            }
        }
        Ok(())
    }

    /// Has a PDO neither sent nor received.
    pub async fn turn_off_pdo(&self, pdo: Pdo) -> Result<(), Error> {
        for write in pdo::turning_off(pdo, self.node_id) {
            self.write_bytes(write.address, &write.data).await?;
        }
        Ok(())
    }

    /// Sends the node its RPDO 1 to 4. Nobody confirms it; a node that is not OPERATIONAL does not take it.
    pub async fn send_receive_pdo(&self, number: u8, data: &pdo::Data) -> Result<(), Error> {
        let id = Id::standard(Pdo::Receive(number).cob_id(self.node_id));
        match Frame::new(id, data.as_slice()) {
            Some(frame) => self.send(Request::Frame(frame)).await,
            // A PDO's data are those of one frame.
            None => Ok(()),
        }
    }

    async fn send(&self, request: Request) -> Result<(), Error> {
        self.requests.send(request).await.map_err(|_| Error::Gone)
    }

    async fn transfer(
        &self,
        address: Address,
        (transfer, first): (Transfer, [u8; 8]),
        priority: Priority,
    ) -> Result<Reading<Vec<u8>>, Error> {
        let (reply, answer) = oneshot::channel();
        let sdo = Sdo {
            address,
            transfer,
            first,
            timeout: self.sdo_timeout,
            reply,
        };
        self.send(Request::Sdo(self.node_id, priority, Box::new(sdo)))
            .await?;
        answer.await.map_err(|_| Error::Gone)?
    }
}

/// The way to the nodes of a [`Network`](super::Network). Cheap to clone.
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
            sdo_timeout: None,
            requests: self.requests.clone(),
        }
    }

    /// Orders the NMT state of all nodes. There is no answer; their heartbeats tell.
    pub async fn command_all(&self, command: nmt::Command) -> Result<(), Error> {
        self.send(Request::Nmt(command, nmt::Target::All)).await
    }

    /// Sends one SYNC.
    pub async fn send_sync(&self) -> Result<(), Error> {
        self.send(Request::Frame(sync::encode())).await
    }

    async fn send(&self, request: Request) -> Result<(), Error> {
        self.requests.send(request).await.map_err(|_| Error::Gone)
    }
}
