//! Byte for byte, as a client sees it.

use epos4_link::canopen::nmt::{self, Command, Target};
use tokio::time::Instant;

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

    async fn connect(&self) -> TcpStream {
        let mut stream = TcpStream::connect(self.server.address()).await.unwrap();
        expect(&mut stream, "< hi >").await;
        stream
    }

    /// Connected and in raw mode.
    async fn client(&self) -> TcpStream {
        let mut stream = self.connect().await;
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
async fn frames_wait_until_the_handshake_is_read() {
    let context = Context::start().await;
    let mut client = context.connect().await;
    say(&mut client, "< open can0 >").await;
    expect(&mut client, "< ok >").await;
    say(&mut client, "< rawmode >< send 601 8 40 0 10 0 0 0 0 0 >").await;
    expect(&mut client, "< ok >").await;
    let handshake = Instant::now();
    expect(&mut client, "< frame 581 0.002000 4300100092010200 >").await;
    assert!(handshake.elapsed() > HOLD_BACK / 2);
}

#[tokio::test]
async fn everybody_else_hears_a_frame_and_its_sender_does_not() {
    let context = Context::start().await;
    let (mut first, mut second) = (context.client().await, context.client().await);
    say(&mut first, "< send 080 0  >").await;
    expect(&mut second, "< frame 080 0.002000  >").await;
    say(&mut second, "< send 00000123 2 1 ab >").await;
    expect(&mut first, "< frame 00000123 0.002000 01AB >").await;
    say(&mut second, "< echo >").await;
    expect(&mut second, "< echo >").await;
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
async fn what_is_not_understood_is_refused_and_the_bus_goes_on() {
    let context = Context::start().await;
    let mut client = context.client().await;
    say(&mut client, "< reboot now >").await;
    expect(&mut client, "< error unknown command >").await;
    say(&mut client, "< send 601 9 1 2 3 >").await;
    let mut buffer = [0; 256];
    let len = client.read(&mut buffer).await.unwrap();
    assert!(buffer[..len].starts_with(b"< error "));
    say(&mut client, "< echo >").await;
    expect(&mut client, "< echo >").await;
    let mut early = context.connect().await;
    say(&mut early, "< send 601 8 40 0 10 0 0 0 0 0 >").await;
    let len = early.read(&mut buffer).await.unwrap();
    assert!(buffer[..len].starts_with(b"< error "));
}

#[tokio::test]
async fn an_endless_message_drops_its_client() {
    let context = Context::start().await;
    let mut client = context.client().await;
    say(&mut client, &format!("< send {}", "0".repeat(5000))).await;
    let mut rest = Vec::new();
    let _closed_or_reset = timeout(Duration::from_secs(5), client.read_to_end(&mut rest))
        .await
        .unwrap();
    assert!(rest.is_empty());
}

#[tokio::test]
async fn a_client_that_does_not_read_is_dropped_and_the_others_are_served() {
    let context = Context::start().await;
    let (idle, mut alive) = (context.client().await, context.client().await);
    let mut member = context.bus.join();
    // More than socket buffers and the queue hold, all at once: neither client reads meanwhile.
    let sync = epos4_link::frame::Frame::standard(0x080, [0; 8]);
    let sender = member.sender();
    let mut sent = 0_usize;
    while context.bus.members() > 1 && sent < 50_000_000 {
        sender.send(&sync);
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
    let _closed_or_reset = timeout(Duration::from_secs(10), alive.read_to_end(&mut rest))
        .await
        .unwrap();
    let mut fresh = context.client().await;
    say(&mut fresh, "< send 601 8 40 18 10 1 0 0 0 0 >").await;
    expect(&mut fresh, "< frame 581 0.002000 43181001FB000000 >").await;
    assert!(
        member.try_heard().is_some(),
        "the third member heard what the fresh client asked"
    );
    drop(idle);
}
