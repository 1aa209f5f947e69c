//! Frames that no node sends must neither end the network nor make it grow.

use std::task::{Context, Poll};

use super::*;

/// A bus that is full of noise: frames of random identifier and content, more often than not of a CANopen service.
struct Noise {
    rest: u32,
    state: u64,
    micros: u64,
    sent: Arc<AtomicU64>,
}

impl Noise {
    /// xorshift64*, so that every run is the same.
    fn next(&mut self) -> u64 {
        self.state ^= self.state >> 12;
        self.state ^= self.state << 25;
        self.state ^= self.state >> 27;
        self.state.wrapping_mul(0x2545_F491_4F6C_DD1D)
    }

    fn frame(&mut self) -> Frame {
        let (kind, node, content) = (self.next(), self.next() % 4 + 1, self.next());
        let len = match kind >> 32 & 7 {
            0 => self.next() as usize % 9,
            _ => 8,
        };
        let cob_id = [0x580, 0x580, 0x580, 0x600, 0x700, 0x080, 0x180, 0x280][kind as usize % 8];
        let id = match kind >> 40 & 15 {
            0 => Id::standard(self.next() as u16),
            1 => Id::extended(self.next() as u32),
            2 => Id::Error(self.next() as u32 & Id::MAX_EXTENDED),
            _ => Id::standard((cob_id + node) as u16),
        };
        let mut data = content.to_le_bytes();
        // Often an answer to what the callers ask, so that transfers get beyond their beginning.
        if kind >> 44 & 1 == 1 {
            data[1..4].copy_from_slice(&[0x41, 0x60, 0]);
            data[0] = [0x41, 0x40, 0x60, 0xC0, 0xC6, 0xA0, 0xA2, 0x00][kind as usize >> 3 & 7];
        }
        Frame::new(id, &data[..len]).unwrap()
    }
}

impl CanBus for Noise {
    fn send(&mut self, _: Frame) -> Result<(), bus::Error> {
        self.sent.fetch_add(1, Ordering::Relaxed);
        Ok(())
    }

    fn poll_receive(&mut self, context: &mut Context<'_>) -> Poll<Result<Stamped, bus::Error>> {
        self.rest -= 1;
        if self.rest == 0 {
            return Poll::Ready(Err(bus::Error::Closed("enough".to_owned())));
        }
        if self.rest.is_multiple_of(16) {
            // The callers have their turn.
            context.waker().wake_by_ref();
            return Poll::Pending;
        }
        self.micros += 100;
        let stamp = Duration::from_micros(self.micros);
        let frame = self.frame();
        Poll::Ready(Ok(Stamped { frame, stamp }))
    }
}

async fn survive(frames: u32) {
    let sent = Arc::new(AtomicU64::new(0));
    let noise = Noise {
        rest: frames,
        state: 0x9E37_79B9_7F4A_7C15,
        micros: 0,
        sent: sent.clone(),
    };
    let options = Options {
        sdo_timeout: Duration::from_millis(1),
        heartbeat: Some((127, Duration::from_millis(100))),
        node_heartbeat: Some(Duration::from_millis(100)),
        ..Options::default()
    };
    let (mut network, nodes) = Network::new(Box::new(noise), options);
    let mut events = 0_u64;
    let running = async move {
        while network.next_event().await.is_ok() {
            events += 1;
            assert!(network.lanes.len() <= 127 && network.events.len() <= 4);
            assert!(network.duplicates_told.len() <= 127);
        }
        events
    };
    let callers = [1, 2, 3, 4].map(|node_id| {
        let node = nodes.node(node_id);
        async move {
            let address = objects::STATUSWORD.address;
            let mut asked = 0_u64;
            loop {
                let outcome = match asked % 4 {
                    0 => node.read_bytes(address).await.map(|read| read.value),
                    1 => node.read_block(address).await.map(|read| read.value),
                    2 => node.write_block(address, &[7; 300]).await.map(|_| vec![]),
                    _ => node.write_bytes(address, &[7; 30]).await.map(|_| vec![]),
                };
                match outcome {
                    Ok(value) => assert!(value.len() <= 4096),
                    Err(Error::Gone) => return asked,
                    Err(_) => {}
                }
                asked += 1;
            }
        }
    });
    drop(nodes);
    let [a, b, c, d] = callers;
    let (events, a, b, c, d) = tokio::join!(running, a, b, c, d);
    assert!(events > u64::from(frames) / 4, "{events}");
    assert!(
        a.min(b).min(c).min(d) > u64::from(frames) / 20_000,
        "{a} {b} {c} {d}"
    );
    assert!(sent.load(Ordering::Relaxed) > 0);
}

#[tokio::test]
async fn noise_neither_ends_the_network_nor_makes_it_grow() {
    survive(300_000).await;
}

#[tokio::test]
#[ignore = "ten million frames: cargo test --release -p epos4-link -- --ignored noise"]
async fn ten_million_frames_of_noise() {
    survive(10_000_000).await;
}
