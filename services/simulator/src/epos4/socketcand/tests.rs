//! What the cell puts on the wire, byte for byte.

use std::time::Duration;

use epos4_link::bus::socketcand::text::Request;
use epos4_link::canopen::nmt::{self, Command, Target};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::time::timeout;

use super::super::{Drives, Node, NodeConfig};
use super::*;

struct Context {
    bus: Arc<Bus>,
    server: Server,
}

impl Context {
    async fn start() -> Self {
        let nodes = (1..=4)
            .map(|id| Node::new(NodeConfig::new(id, u32::from(id))))
            .collect();
        let bus = Bus::new(Drives::new(nodes));
        bus.tick(0.002, 0.002, &[]);
        let server = serve(([127, 0, 0, 1], 0).into(), Arc::clone(&bus))
            .await
            .unwrap();
        Self { bus, server }
    }

    /// Connected and in raw mode.
    async fn client(&self) -> TcpStream {
        let mut stream = TcpStream::connect(self.server.address()).await.unwrap();
        expect(&mut stream, "< hi >").await;
        say(&mut stream, "< open can0 >").await;
        expect(&mut stream, "< ok >").await;
        say(&mut stream, "< rawmode >").await;
        expect(&mut stream, "< ok >").await;
        stream
    }
}

async fn say(stream: &mut TcpStream, text: &str) {
    stream.write_all(text.as_bytes()).await.unwrap();
}

/// One segment, exactly.
async fn expect(stream: &mut TcpStream, text: &str) {
    let mut buffer = [0; 256];
    let len = timeout(Duration::from_secs(5), stream.read(&mut buffer))
        .await
        .unwrap()
        .unwrap();
    assert_eq!(std::str::from_utf8(&buffer[..len]).unwrap(), text);
}

#[tokio::test]
async fn a_read_by_sdo_carries_the_time_of_the_cell() {
    let context = Context::start().await;
    let mut client = context.client().await;
    context.bus.tick(0.002, 12.345_678, &[]);
    say(&mut client, "< send 601 8 40 18 10 1 0 0 0 0 >").await;
    expect(&mut client, "< frame 581 12.345678 43181001FB000000 >").await;
}

#[tokio::test]
async fn every_drive_answers_and_its_boot_up_is_stamped() {
    let context = Context::start().await;
    let mut client = context.client().await;
    let reset = Request::Send(nmt::encode(Command::ResetNode, Target::All));
    say(&mut client, &reset.to_string()).await;
    say(&mut client, "< echo >").await;
    expect(&mut client, "< echo >").await;
    context.bus.tick(0.002, 0.004, &[]);
    expect(
        &mut client,
        "< frame 701 0.004000 00 >< frame 702 0.004000 00 >< frame 703 0.004000 00 >< frame 704 0.004000 00 >",
    )
    .await;
}

#[tokio::test]
async fn there_is_no_bus_but_can0() {
    let context = Context::start().await;
    let mut stream = TcpStream::connect(context.server.address()).await.unwrap();
    expect(&mut stream, "< hi >").await;
    say(&mut stream, "< open can1 >").await;
    expect(&mut stream, "< error could not open bus >").await;
}

#[tokio::test]
async fn clients_that_do_not_read_are_put_off_and_the_next_is_served() {
    let context = Context::start().await;
    let (_idle, mut slow) = (context.client().await, context.client().await);
    let member = context.bus.join();
    // More than socket buffers and the queue hold, all at once: neither client reads meanwhile.
    let sync = epos4_link::frame::Frame::standard(0x080, [0; 8]);
    let mut sent = 0_usize;
    while context.bus.members() > 1 && sent < 50_000_000 {
        member.sender().send(&sync);
        sent += 1;
        if sent.is_multiple_of(1000) {
            tokio::task::yield_now().await;
        }
    }
    assert_eq!(
        context.bus.members(),
        1,
        "both slow clients are off the bus"
    );
    let mut rest = Vec::new();
    let _closed_or_reset = timeout(Duration::from_secs(10), slow.read_to_end(&mut rest))
        .await
        .unwrap();
    let mut fresh = context.client().await;
    say(&mut fresh, "< send 601 8 40 18 10 1 0 0 0 0 >").await;
    expect(&mut fresh, "< frame 581 0.002000 43181001FB000000 >").await;
}
