use std::io::Cursor;
use std::sync::Mutex;

use mcap::io::MessageReader;
use prost::Message as _;

use super::*;

/// A disk of a few bytes that outlives the file on it.
#[derive(Clone)]
struct Disk(Arc<Mutex<State>>);

struct State {
    file: Cursor<Vec<u8>>,
    room: usize,
}

impl Disk {
    fn new(room: usize) -> Self {
        Self(Arc::new(Mutex::new(State {
            file: Cursor::default(),
            room,
        })))
    }

    fn bytes(&self) -> Vec<u8> {
        self.0.lock().unwrap().file.get_ref().clone()
    }
}

impl Write for Disk {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let mut state = self.0.lock().unwrap();
        let room = state.room - (state.file.position() as usize).min(state.room);
        if room == 0 && !bytes.is_empty() {
            return Err(io::ErrorKind::StorageFull.into());
        }
        state.file.write(&bytes[..bytes.len().min(room)])
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Seek for Disk {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.0.lock().unwrap().file.seek(to)
    }
}

impl Sink for Disk {
    fn cut(&mut self, length: u64) -> io::Result<()> {
        let mut state = self.0.lock().unwrap();
        state.file.get_mut().truncate(length as usize);
        Ok(())
    }

    fn sync(&mut self) -> io::Result<()> {
        Ok(())
    }
}

fn line(topic: Topic, at_ns: u64) -> Line {
    let event = arthro_proto::gateway::v1::RecordedEvent {
        detail: format!("at {at_ns}"),
        ..Default::default()
    };
    Line {
        topic,
        at_ns,
        message: event.encode_to_vec(),
    }
}

/// The times of all lines that can be read, and whether the file has its end.
fn read(bytes: &[u8]) -> (Vec<u64>, bool) {
    let mut times = Vec::new();
    for message in MessageReader::new(bytes) {
        match message {
            Ok(message) => times.push(message.log_time),
            Err(_) => return (times, false),
        }
    }
    (times, true)
}

/// Ten chunks of ten lines: the disk, and its length after each flush.
fn written(finish: bool) -> (Disk, Vec<usize>) {
    let disk = Disk::new(usize::MAX);
    let mut segment = Segment::begin(disk.clone(), BTreeMap::new()).unwrap();
    let mut whole = vec![segment.whole_bytes() as usize];
    for chunk in 0..10 {
        for index in 0..10 {
            segment
                .write(&line(Topic::Event, chunk * 10 + index))
                .unwrap();
        }
        segment.flush().unwrap();
        whole.push(segment.whole_bytes() as usize);
    }
    if finish {
        segment.finish().unwrap();
        return (disk, whole);
    }
    // What a killed process leaves: everything that was flushed, and nothing after it.
    let killed = Disk::new(usize::MAX);
    killed.0.lock().unwrap().file = Cursor::new(disk.bytes());
    drop(segment);
    (killed, whole)
}

#[test]
fn a_finished_file_holds_every_line_in_order() {
    let (disk, _) = written(true);
    assert_eq!(read(&disk.bytes()), ((0..100).collect(), true));
    let summary = mcap::Summary::read(&disk.bytes()).unwrap().unwrap();
    assert_eq!(summary.stats.unwrap().message_count, 100);
}

#[test]
fn a_file_cut_at_any_byte_holds_every_line_that_was_flushed_before() {
    let (disk, whole) = written(false);
    let bytes = disk.bytes();
    assert_eq!(bytes.len(), whole[10], "a flush leaves nothing behind");
    for cut in whole[0]..=bytes.len() {
        let flushed = whole.iter().filter(|&&length| length <= cut).count() - 1;
        let (times, ended) = read(&bytes[..cut]);
        assert!(!ended);
        let expected: Vec<u64> = (0..times.len() as u64).collect();
        assert_eq!(times, expected, "cut at {cut}");
        assert!(times.len() >= flushed * 10, "cut at {cut}");
    }
}

#[test]
fn on_a_full_disk_the_file_ends_with_why() {
    let (_, whole) = written(false);
    let reserve = 200;
    // The disk is full at every byte of one chunk.
    for room in whole[4] + 1..whole[5] {
        let disk = Disk::new(room);
        let mut segment = Segment::begin(disk.clone(), BTreeMap::new()).unwrap();
        let mut flushed = 0;
        for at_ns in 0..100 {
            let mut written = segment.write(&line(Topic::Event, at_ns));
            if at_ns % 10 == 9 {
                written = written.and_then(|()| segment.flush());
            }
            if written.is_err() {
                break;
            }
            if at_ns % 10 == 9 {
                flushed = at_ns + 1;
            }
        }
        assert_eq!(flushed, 40);
        let last = line(Topic::Event, 1_000);
        segment
            .give_up(&last, || disk.0.lock().unwrap().room += reserve)
            .unwrap();
        let mut expected: Vec<u64> = (0..40).collect();
        expected.push(1_000);
        assert_eq!(read(&disk.bytes()), (expected, true), "room for {room}");
    }
}
