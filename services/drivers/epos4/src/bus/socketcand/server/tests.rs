//! Byte for byte, as a client sees it.

use std::time::Duration;

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::sync::mpsc;
use tokio::time::{Instant, timeout};

use super::*;
use crate::frame::{Frame, Id};

/// `can0` of a server, whose clock stands at 1.5 s.
struct World {
    bus: in_process::Bus,
    server: Server,
    gone: mpsc::UnboundedReceiver<Gone>,
}

struct Watched {
    buses: BTreeMap<String, in_process::Bus>,
    gone: mpsc::UnboundedSender<Gone>,
}

impl Buses for Watched {
    fn knows(&self, bus: &str) -> bool {
        self.buses.knows(bus)
    }

    fn attach(&self, bus: &str) -> Option<Box<dyn CanBus>> {
        self.buses.attach(bus)
    }

    fn on_gone(&self, _client: SocketAddr, why: &Gone) {
        self.gone.send(why.clone()).ok();
    }
}

impl World {
    async fn start() -> Self {
        let bus = in_process::Bus::new(|| Duration::from_millis(1500));
        let (sender, gone) = mpsc::unbounded_channel();
        let buses = Watched {
            buses: BTreeMap::from([("can0".to_owned(), bus.clone())]),
            gone: sender,
        };
        let server = serve(([127, 0, 0, 1], 0).into(), buses).await.unwrap();
        Self { bus, server, gone }
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

    async fn next_gone(&mut self) -> Gone {
        timeout(Duration::from_secs(10), self.gone.recv())
            .await
            .unwrap()
            .unwrap()
    }
}

async fn say(stream: &mut TcpStream, text: &str) {
    stream.write_all(text.as_bytes()).await.unwrap();
}

/// One segment, exactly.
async fn expect(stream: &mut TcpStream, text: &str) {
    assert_eq!(segment(stream).await, text);
}

async fn segment(stream: &mut TcpStream) -> String {
    let mut buffer = [0; 256];
    let len = timeout(Duration::from_secs(5), stream.read(&mut buffer))
        .await
        .unwrap()
        .unwrap();
    String::from_utf8(buffer[..len].to_vec()).unwrap()
}

#[tokio::test]
async fn frames_wait_until_the_handshake_is_read() {
    let world = World::start().await;
    let mut client = world.connect().await;
    say(&mut client, "< open can0 >").await;
    expect(&mut client, "< ok >").await;
    say(&mut client, "< rawmode >< echo >").await;
    expect(&mut client, "< ok >").await;
    let handshake = Instant::now();
    world
        .bus
        .attach()
        .send(Frame::standard(0x701, [5]))
        .unwrap();
    let mut rest = String::new();
    while rest.len() < "< echo >< frame 701 1.500000 05 >".len() {
        rest += &segment(&mut client).await;
    }
    assert!(rest.contains("< frame 701 1.500000 05 >"), "{rest}");
    assert!(handshake.elapsed() > client::HOLD_BACK / 2);
}

#[tokio::test]
async fn the_handshake_may_be_cut_at_every_byte() {
    let world = World::start().await;
    let mut client = world.connect().await;
    for (text, answer) in [
        ("< open can0 >", "< ok >"),
        ("< echo >", "< echo >"),
        ("< rawmode >", "< ok >"),
        ("< echo >", "< echo >"),
    ] {
        for byte in text.as_bytes().chunks(1) {
            client.write_all(byte).await.unwrap();
            tokio::task::yield_now().await;
        }
        expect(&mut client, answer).await;
    }
}

#[tokio::test]
async fn everybody_else_hears_a_frame_and_its_sender_does_not() {
    let world = World::start().await;
    let (mut first, mut second) = (world.client().await, world.client().await);
    say(&mut first, "< send 080 0  >").await;
    expect(&mut second, "< frame 080 1.500000  >").await;
    say(&mut second, "< send 00000123 2 1 ab >").await;
    expect(&mut first, "< frame 00000123 1.500000 01AB >").await;
    say(&mut second, "< echo >").await;
    expect(&mut second, "< echo >").await;
}

#[tokio::test]
async fn reports_of_the_controller_are_told_by_their_class() {
    let world = World::start().await;
    let mut client = world.client().await;
    let bus_off = Frame::new(Id::Error(Id::ERROR_BUS_OFF), &[0; 8]).unwrap();
    world.bus.attach().send(bus_off).unwrap();
    expect(&mut client, "< error 040 1.500000 >").await;
}

#[tokio::test]
async fn what_is_not_understood_is_refused_and_the_bus_goes_on() {
    let world = World::start().await;
    let mut client = world.client().await;
    say(&mut client, "< reboot now >").await;
    expect(&mut client, "< error unknown command >").await;
    say(&mut client, "< send 601 9 1 2 3 >").await;
    expect(&mut client, "< error length 0 to 8 expected >").await;
    say(&mut client, "< echo >").await;
    expect(&mut client, "< echo >").await;
}

#[tokio::test]
async fn a_bus_that_is_not_there_is_refused_and_may_be_named_anew() {
    let world = World::start().await;
    let mut client = world.connect().await;
    for (text, answer) in [
        ("< rawmode >", "< error no bus in raw mode >"),
        ("< send 601 1 0 >", "< error no bus in raw mode >"),
        ("< open can1 >", "< error could not open bus >"),
        ("< open can0 >", "< ok >"),
        ("< rawmode >", "< ok >"),
    ] {
        say(&mut client, text).await;
        expect(&mut client, answer).await;
    }
}

#[tokio::test]
async fn an_endless_message_drops_its_client() {
    let mut world = World::start().await;
    let mut client = world.client().await;
    say(&mut client, &format!("< send {}", "0".repeat(5000))).await;
    assert!(matches!(world.next_gone().await, Gone::Dropped(why) if why.contains("longer than")));
    drop(client);
    let polite = world.client().await;
    drop(polite);
    assert_eq!(world.next_gone().await, Gone::Left);
}

#[tokio::test]
async fn a_client_that_does_not_read_is_dropped_and_the_others_are_served() {
    let mut world = World::start().await;
    let (_idle, mut alive) = (world.client().await, world.client().await);
    let mut sender = world.bus.attach();
    const BATCH: usize = 100;
    let mut batch = vec![0; BATCH * "< frame 080 1.500000 0000000000000000 >".len()];
    // More than socket buffers and queues hold. The one that reads is never more than a batch behind.
    let mut sent = 0;
    while world.gone.is_empty() {
        assert!(sent < 50_000_000, "the idle client is dropped in the end");
        for _ in 0..BATCH {
            sender.send(Frame::standard(0x080, [0; 8])).unwrap();
        }
        alive.read_exact(&mut batch).await.unwrap();
        sent += BATCH;
    }
    assert!(matches!(world.next_gone().await, Gone::Dropped(why) if why.contains("does not read")));
    say(&mut alive, "< echo >").await;
    expect(&mut alive, "< echo >").await;
}

#[tokio::test]
async fn noise_harms_nobody_but_its_sender() {
    let world = World::start().await;
    let mut polite = world.client().await;
    let mut state = 1_u64;
    for round in 0..64 {
        let mut noisy = if round % 2 == 0 {
            world.connect().await
        } else {
            world.client().await
        };
        let noise: Vec<u8> = (0..4096)
            .map(|_| {
                // xorshift64, Marsaglia 2003.
                state ^= state << 13;
                state ^= state >> 7;
                state ^= state << 17;
                b"<> send0123456789abcdef\0\xFF"[(state % 25) as usize]
            })
            .collect();
        // It may be put off meanwhile.
        noisy.write_all(&noise).await.ok();
    }
    say(&mut polite, "< echo >").await;
    let mut heard = String::new();
    while !heard.ends_with("< echo >") {
        heard += &segment(&mut polite).await;
    }
}

#[tokio::test]
async fn clients_beyond_the_limit_are_not_let_in() {
    let mut world = World::start().await;
    let mut clients = Vec::new();
    for _ in 0..CLIENTS_MAX {
        clients.push(world.connect().await);
    }
    let mut refused = TcpStream::connect(world.server.address()).await.unwrap();
    assert_eq!(refused.read(&mut [0; 16]).await.unwrap(), 0);
    assert_eq!(world.next_gone().await, Gone::TooMany);
    drop(clients.pop());
    assert_eq!(world.next_gone().await, Gone::Left);
    world.connect().await;
}

#[tokio::test]
async fn all_clients_hear_all_frames_in_one_order() {
    let world = World::start().await;
    let mut clients = Vec::new();
    for _ in 0..32 {
        clients.push(world.client().await);
    }
    for (number, client) in clients.iter_mut().enumerate() {
        say(client, &format!("< send 1{number:02X} 0  >")).await;
    }
    let mut heard = Vec::new();
    for client in &mut clients {
        let mut text = String::new();
        while text.len() < 31 * "< frame 100 1.500000  >".len() {
            text += &segment(client).await;
        }
        heard.push(text);
    }
    let own = |number: usize| format!("< frame 1{number:02X} 1.500000  >");
    // The order of all is that of the first client, with its own frame where the second has it.
    let place = heard[1].find(&own(0)).unwrap();
    let mut all = heard[0].clone();
    all.insert_str(place, &own(0));
    for (number, text) in heard.iter().enumerate().skip(2) {
        assert_eq!(*text, all.replace(&own(number), ""));
    }
}
