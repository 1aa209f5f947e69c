//! Data packages of inputs that do not fit their recipe.

use tokio::net::TcpStream;

use super::wires::{Bound, Rtde};
use crate::ur5::Series;
use crate::ur5::servers::lock;

const RECIPE: &[u8] = b"input_int_register_0,input_double_register_0";

/// A client with one recipe of inputs, and what it is told by text.
struct Writer {
    arm: Bound,
    client: Rtde,
}

impl Writer {
    async fn speaking(version: u8) -> Self {
        let arm = Bound::of(Series::Cb3).await;
        let address = arm.servers.addresses().rtde;
        let mut client = Rtde(TcpStream::connect(address).await.unwrap());
        assert_eq!(client.ask(b'V', &[0, version]).await, [1]);
        assert_eq!(client.ask(b'I', RECIPE).await, b"\x01INT32,DOUBLE");
        Self { arm, client }
    }

    /// The texts that come between a data package and the answer to a question after it.
    async fn write(&mut self, payload: &[u8]) -> Vec<Vec<u8>> {
        self.client.send(b'U', payload).await;
        self.client.send(b'v', &[]).await;
        let mut texts = Vec::new();
        loop {
            match self.client.frame().await.unwrap() {
                (b'M', text) => texts.push(text),
                (b'v', _) => return texts,
                _ => {}
            }
        }
    }

    fn registers(&self) -> (i32, f64) {
        let controller = lock(&self.arm.controller);
        let inputs = &controller.robot.inputs;
        (inputs.ints[0], inputs.doubles[0])
    }
}

fn package(recipe: u8, int: i32, double: f64) -> Vec<u8> {
    let mut payload = vec![recipe];
    payload.extend(int.to_be_bytes());
    payload.extend(double.to_be_bytes());
    payload
}

/// Text of version 2: message, source, level.
fn text(message: &str) -> Vec<u8> {
    let mut payload = vec![message.len() as u8];
    payload.extend(message.as_bytes());
    payload.extend(b"\x04RTDE\x02");
    payload
}

#[tokio::test]
async fn a_package_longer_than_its_recipe_writes_the_fields_there_is_room_for() {
    let mut writer = Writer::speaking(2).await;
    let mut payload = package(1, 44, 0.25);
    payload.extend([0; 48]);
    assert!(writer.write(&payload).await.is_empty());
    assert_eq!(writer.registers(), (44, 0.25));
}

#[tokio::test]
async fn packages_that_cannot_be_read_are_ignored_and_told_and_leave_the_connection() {
    for (payload, told) in [
        (
            package(1, 9, 9.0)[..12].to_vec(),
            "input recipe 1 needs 12 bytes of fields, 11 came",
        ),
        (
            package(2, 9, 9.0),
            "input recipe 2 is not set up, the last is 1",
        ),
        (
            package(0, 9, 9.0),
            "input recipe 0 is not set up, the last is 1",
        ),
        (Vec::new(), "it has no recipe byte"),
    ] {
        let mut writer = Writer::speaking(2).await;
        let texts = writer.write(&payload).await;
        assert_eq!(texts, [text(&format!("data package ignored: {told}"))]);
        assert_eq!(writer.registers(), (0, 0.0), "{told}");
        assert!(writer.write(&package(1, 7, 0.5)).await.is_empty());
        assert_eq!(writer.registers(), (7, 0.5), "{told}");
    }
}

#[tokio::test]
async fn version_one_is_told_by_a_level_and_a_message() {
    let mut writer = Writer::speaking(1).await;
    let texts = writer.write(&[]).await;
    assert_eq!(texts, [b"\x02data package ignored: it has no recipe byte"]);
}

#[tokio::test]
async fn warnings_come_once_a_second_and_count_what_they_left_out() {
    let mut writer = Writer::speaking(2).await;
    assert_eq!(writer.write(&[]).await.len(), 1);
    for _ in 0..40 {
        assert!(writer.write(&[]).await.is_empty());
    }
    writer.arm.tick(124);
    assert!(writer.write(&[]).await.is_empty());
    writer.arm.tick(2);
    let told = "data package ignored: it has no recipe byte; and 41 before it";
    assert_eq!(writer.write(&[]).await, [text(told)]);
    writer.arm.tick(126);
    let told = "data package ignored: it has no recipe byte";
    assert_eq!(writer.write(&[]).await, [text(told)]);
}
