//! Both ends of SDO, NMT, heartbeat and EMCY against a CANopen stack that nobody here wrote: `canopen-rs`.
#![allow(
    clippy::unwrap_used,
    clippy::panic,
    reason = "a helper that fails fails its test"
)]

use std::collections::BTreeMap;

use canopen_rs::sdo::{SdoClient, SdoEvent};
use canopen_rs::{ByteString, DataType, Entry, ErrorRegister, NodeId, ObjectDictionary, Value};
use epos4_link::canopen::emcy::Emergency;
use epos4_link::canopen::object::Address;
use epos4_link::canopen::sdo::client::{Failure, Step, Transfer};
use epos4_link::canopen::sdo::server::{Dictionary, Length, Server};
use epos4_link::canopen::sdo::{AbortCode, request_cob_id, response_cob_id};
use epos4_link::canopen::{heartbeat, nmt};
use epos4_link::frame::{Frame, Id};

const NODE_ID: u8 = 9;
/// The longest text that canopen-rs holds.
const TEXT: &str = "a text of thirty-two characters!";

const DEVICE_TYPE: Address = Address::new(0x1000, 0);
const NAME: Address = Address::new(0x1008, 0);
const BYTE: Address = Address::new(0x2000, 0);
const WORD: Address = Address::new(0x2001, 0);
const SIGNED: Address = Address::new(0x2002, 3);
const LONG: Address = Address::new(0x2003, 0);
const REMARK: Address = Address::new(0x2004, 0);

fn theirs(address: Address) -> canopen_rs::Address {
    canopen_rs::Address::new(address.index, address.subindex)
}

fn text(text: &str) -> Value {
    Value::VisibleString(ByteString::from_bytes(text.as_bytes()).unwrap())
}

fn frame(sent: &canopen_rs::TxFrame) -> Frame {
    Frame::new(Id::standard(sent.cob_id), sent.data()).unwrap()
}

/// Their node, started.
fn node() -> canopen_rs::Node<16> {
    let mut objects = ObjectDictionary::new();
    for (address, entry) in [
        (DEVICE_TYPE, Entry::constant(Value::Unsigned32(0x0002_0192))),
        (NAME, Entry::constant(text(TEXT))),
        (BYTE, Entry::rw(Value::Unsigned8(7))),
        (WORD, Entry::rw(Value::Unsigned16(0x8611))),
        (SIGNED, Entry::rw(Value::Integer32(-645_120))),
        (LONG, Entry::rw(Value::Unsigned64(0x0102_0304_0506_0708))),
        (REMARK, Entry::rw(text("none"))),
    ] {
        objects.insert(theirs(address), entry).unwrap();
    }
    let mut node = canopen_rs::Node::new(NodeId::new(NODE_ID).unwrap(), objects);
    let boot_up = frame(&node.boot());
    assert_eq!(
        heartbeat::decode(&boot_up),
        Some((NODE_ID, nmt::State::BootUp))
    );
    node
}

/// Our transfer against their server.
fn transfer(
    node: &mut canopen_rs::Node<16>,
    (mut transfer, mut request): (Transfer, [u8; 8]),
) -> Result<Vec<u8>, Failure> {
    loop {
        let answer = node
            .on_frame(request_cob_id(NODE_ID), &request)
            .expect("a started node answers");
        assert_eq!(answer.cob_id, response_cob_id(NODE_ID));
        match transfer.on_response(answer.data().try_into().unwrap())? {
            Step::Send(next) => request = next,
            Step::Done(value) => return Ok(value),
            other => panic!("{other:?} after {:02X?}", answer.data()),
        }
    }
}

#[test]
fn our_client_reads_from_their_server() {
    let mut node = node();
    let mut read = |address| transfer(&mut node, Transfer::upload(address)).unwrap();
    assert_eq!(read(DEVICE_TYPE), 0x0002_0192_u32.to_le_bytes());
    assert_eq!(read(BYTE), [7]);
    assert_eq!(read(WORD), [0x11, 0x86]);
    assert_eq!(read(SIGNED), (-645_120_i32).to_le_bytes());
    assert_eq!(read(LONG), 0x0102_0304_0506_0708_u64.to_le_bytes());
    assert_eq!(read(NAME), TEXT.as_bytes());
}

#[test]
fn our_client_writes_to_their_server() {
    let mut node = node();
    for (address, data) in [
        (BYTE, vec![0xFE]),
        (WORD, vec![0x0F, 0]),
        (SIGNED, 43_008_i32.to_le_bytes().to_vec()),
        (LONG, 5_u64.to_le_bytes().to_vec()),
        (REMARK, TEXT.as_bytes().to_vec()),
        (REMARK, b"seven b".to_vec()),
        (REMARK, b"a".to_vec()),
    ] {
        transfer(&mut node, Transfer::download(address, &data)).unwrap();
        let back = transfer(&mut node, Transfer::upload(address)).unwrap();
        assert_eq!(back, data, "{address}");
    }
}

#[test]
fn our_client_names_their_aborts() {
    let mut node = node();
    let mut code = |begun| match transfer(&mut node, begun) {
        Err(Failure::Aborted(code)) => code,
        other => panic!("not refused: {other:?}"),
    };
    assert_eq!(
        code(Transfer::upload(Address::new(0x6041, 0))),
        AbortCode::NO_OBJECT
    );
    assert_eq!(
        code(Transfer::download(DEVICE_TYPE, &[0; 4])),
        AbortCode::READ_ONLY
    );
    assert_eq!(code(Transfer::download(WORD, &[0; 4])), AbortCode::TOO_LONG);
    assert_eq!(code(Transfer::download(LONG, &[0; 9])), AbortCode::TOO_LONG);
}

#[test]
fn their_node_obeys_our_nmt_and_we_read_its_heartbeat() {
    let mut node = node();
    for (command, state) in [
        (nmt::Command::Start, nmt::State::Operational),
        (nmt::Command::Stop, nmt::State::Stopped),
        (
            nmt::Command::EnterPreOperational,
            nmt::State::PreOperational,
        ),
    ] {
        let order = nmt::encode(command, nmt::Target::Node(NODE_ID));
        node.on_frame(nmt::COB_ID, order.data());
        let told = heartbeat::decode(&frame(&node.heartbeat()));
        assert_eq!(told, Some((NODE_ID, state)));
    }
    node.on_frame(
        nmt::COB_ID,
        nmt::encode(nmt::Command::Start, nmt::Target::All).data(),
    );
    let told = heartbeat::decode(&frame(&node.heartbeat()));
    assert_eq!(told, Some((NODE_ID, nmt::State::Operational)));
}

#[test]
fn we_read_their_emergencies() {
    let mut node = node();
    let raised = node.raise_emergency(0x8611, ErrorRegister(0x80), [1, 2, 3, 4, 5]);
    let told = Emergency::decode(&frame(&raised)).unwrap();
    assert_eq!(told.0, NODE_ID);
    assert_eq!(
        (told.1.code, told.1.error_register, told.1.manufacturer),
        (0x8611, 0x81, [1, 2, 3, 4, 5])
    );
    let cleared = Emergency::decode(&frame(&node.clear_errors())).unwrap();
    assert_eq!(cleared.1, Emergency::new(Emergency::RESET, 0));
}

/// What our server serves here.
struct Bytes(BTreeMap<Address, Vec<u8>>);

impl Dictionary for Bytes {
    fn read(&mut self, address: Address) -> Result<Vec<u8>, AbortCode> {
        self.0.get(&address).cloned().ok_or(AbortCode::NO_OBJECT)
    }

    fn write(&mut self, address: Address, data: &[u8], _: Length) -> Result<(), AbortCode> {
        if address == DEVICE_TYPE {
            return Err(AbortCode::READ_ONLY);
        }
        self.0.insert(address, data.to_vec());
        Ok(())
    }
}

/// Their client against our server.
fn served(
    server: &mut Server,
    objects: &mut Bytes,
    client: &mut SdoClient,
    mut request: [u8; 8],
) -> Result<Option<Value>, AbortCode> {
    loop {
        let answer = server.answer(request, objects).expect("an answer");
        match client.on_response(&answer) {
            SdoEvent::Send(next) => request = next,
            SdoEvent::Complete(value) => return Ok(value),
            SdoEvent::Aborted(code) => return Err(AbortCode(code)),
        }
    }
}

#[test]
fn their_client_reads_and_writes_our_server() {
    let mut objects = Bytes(BTreeMap::from([
        (DEVICE_TYPE, 0x0002_0192_u32.to_le_bytes().to_vec()),
        (NAME, TEXT.as_bytes().to_vec()),
    ]));
    let mut server = Server::default();
    let mut client = SdoClient::new(NodeId::new(NODE_ID).unwrap());
    for (address, kind, value) in [
        (
            DEVICE_TYPE,
            DataType::Unsigned32,
            Value::Unsigned32(0x0002_0192),
        ),
        (NAME, DataType::VisibleString, text(TEXT)),
    ] {
        let request = client.read(theirs(address), kind);
        let read = served(&mut server, &mut objects, &mut client, request);
        assert_eq!(read, Ok(Some(value)), "{address}");
    }
    for (address, value, bytes) in [
        (WORD, Value::Unsigned16(0x8611), vec![0x11, 0x86]),
        (LONG, Value::Unsigned64(5), 5_u64.to_le_bytes().to_vec()),
        (REMARK, text(TEXT), TEXT.as_bytes().to_vec()),
    ] {
        let request = client.write(theirs(address), value);
        let written = served(&mut server, &mut objects, &mut client, request);
        assert_eq!(written, Ok(None), "{address}");
        assert_eq!(objects.0.get(&address), Some(&bytes), "{address}");
    }
    let request = client.read(theirs(Address::new(0x6041, 0)), DataType::Unsigned16);
    let refused = served(&mut server, &mut objects, &mut client, request);
    assert_eq!(refused, Err(AbortCode::NO_OBJECT));
    let request = client.write(theirs(DEVICE_TYPE), Value::Unsigned32(1));
    let refused = served(&mut server, &mut objects, &mut client, request);
    assert_eq!(refused, Err(AbortCode::READ_ONLY));
}
