use std::io;

use tempfile::TempDir;

use super::*;
use crate::recording::read::{End, Lines};

fn settings(folder: &TempDir) -> Settings {
    Settings {
        folder: folder.path().to_owned(),
        segment_max_bytes: u64::MAX,
        folder_max_bytes: u64::MAX,
    }
}

fn about(procedure_id: &str) -> About {
    About {
        procedure_id: procedure_id.to_owned(),
        case_id: "case".to_owned(),
        plan_digest: "digest".to_owned(),
    }
}

fn event(detail: &str) -> proto::RecordedEvent {
    proto::RecordedEvent {
        detail: detail.to_owned(),
        ..Default::default()
    }
}

/// Ends the tape and waits until everything is written.
fn ended(tape: Tape, thread: JoinHandle<()>) {
    drop(tape);
    thread.join().unwrap();
}

fn tape(settings: Settings) -> (Tape, JoinHandle<()>) {
    Tape::start(settings).unwrap()
}

/// The files of the folder, sorted, each with its lines and how it ends.
fn files(folder: &TempDir) -> Vec<(String, Vec<Line>, Option<End>)> {
    let mut names: Vec<_> = fs::read_dir(folder.path())
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    names
        .into_iter()
        .map(|name| {
            let mut lines = Lines::open(&folder.path().join(&name)).unwrap();
            let mut all = Vec::new();
            while let Some(line) = lines.next_line().unwrap() {
                all.push(line);
            }
            (name, all, lines.end())
        })
        .collect()
}

fn reasons(lines: &[Line]) -> Vec<String> {
    lines
        .iter()
        .filter(|line| line.topic == Topic::Event)
        .map(|line| {
            proto::RecordedEvent::decode(line.message.as_slice())
                .unwrap()
                .reason
        })
        .filter(|reason| !reason.is_empty())
        .collect()
}

#[test]
fn each_procedure_and_each_run_of_one_has_a_file_of_its_own() {
    let folder = tempfile::tempdir().unwrap();
    let (mut tape, thread) = tape(settings(&folder));
    for procedure_id in ["one", "two", "one"] {
        tape.begin(about(procedure_id));
        tape.write(Topic::Event, 5, &event(procedure_id));
        tape.end();
    }
    ended(tape, thread);
    let files = files(&folder);
    let names: Vec<_> = files.iter().map(|(name, _, _)| name.as_str()).collect();
    assert_eq!(names, ["one-001.mcap", "one-002.mcap", "two-001.mcap"]);
    for (name, lines, end) in &files {
        assert_eq!(*end, Some(End::Whole), "{name}");
        assert_eq!(lines[0].topic, Topic::Recording);
        assert_eq!((lines.len(), lines[1].topic), (2, Topic::Event));
    }
}

#[test]
fn a_file_that_grows_too_large_is_followed_by_one_with_the_same_context() {
    let folder = tempfile::tempdir().unwrap();
    let (mut tape, thread) = tape(Settings {
        segment_max_bytes: 1,
        ..settings(&folder)
    });
    tape.begin(about("one"));
    tape.write(Topic::Procedure, 5, &proto::Procedure::default());
    // Every file is too large at once, so that each flush begins another.
    let mut state = tape.state();
    while !state
        .borrow_and_update()
        .file
        .as_ref()
        .is_some_and(|path| path.ends_with("one-003.mcap"))
    {
        std::thread::yield_now();
    }
    ended(tape, thread);
    let files = files(&folder);
    assert!(files.len() >= 3);
    for (name, lines, end) in &files {
        assert_eq!(*end, Some(End::Whole), "{name}");
        let topics: Vec<_> = lines.iter().map(|line| line.topic).collect();
        assert_eq!(topics, [Topic::Recording, Topic::Procedure], "{name}");
    }
}

#[test]
fn a_full_folder_ends_the_recording_with_an_alarm_and_deletes_nothing() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("older.mcap"), vec![0; 1000]).unwrap();
    let (mut tape, thread) = tape(Settings {
        folder_max_bytes: 1000,
        ..settings(&folder)
    });
    tape.begin(about("one"));
    let mut state = tape.state();
    let alarm = loop {
        if let Some(alarm) = state.borrow_and_update().alarm.clone() {
            break alarm;
        }
        std::thread::yield_now();
    };
    assert_eq!(alarm.0, "RECORDINGS_FULL");
    assert!(alarm.1.contains("1000"), "{}", alarm.1);
    ended(tape, thread);
    let left: Vec<_> = fs::read_dir(folder.path()).unwrap().collect();
    assert_eq!(left.len(), 1);
}

#[test]
fn a_full_disk_is_told_in_the_file_and_the_next_procedure_is_recorded_again() {
    let folder = tempfile::tempdir().unwrap();
    let mut writer = Writer::new(settings(&folder), watch::Sender::default());
    writer.about = Some(about("one"));
    writer.attempt(|this| this.begin());
    writer.attempt(|_| Err(io::Error::from(io::ErrorKind::StorageFull).into()));
    let state = writer.state.borrow().clone();
    assert_eq!(state.alarm.unwrap().0, "RECORDING_DISK_FULL");
    // What comes after is not recorded, and is no trouble either.
    writer.write(event_line(event("lost"), 7));
    writer.about = Some(about("two"));
    writer.attempt(|this| this.begin());
    writer.end();
    assert_eq!(writer.state.borrow().alarm, None);
    let files = files(&folder);
    assert_eq!(files.len(), 2, "no reserve is left: {files:?}");
    assert_eq!(reasons(&files[0].1), ["RECORDING_DISK_FULL"]);
    assert_eq!(files[0].2, Some(End::Whole));
}

#[test]
fn a_slow_disk_loses_lines_and_says_how_many_but_never_a_beginning() {
    // Nobody takes anything from the queue at first.
    let (orders, received) = sync_channel(2);
    let mut tape = Tape {
        orders,
        state: watch::Sender::default(),
        missing: 0,
        kept: VecDeque::new(),
    };
    tape.begin(about("one"));
    for _ in 0..4 {
        tape.write(Topic::Event, 5, &event("first"));
    }
    tape.end();
    tape.begin(about("two"));
    assert_eq!(tape.state().borrow().dropped_lines, 3);
    let mut taken = Vec::new();
    for _ in 0..10 {
        taken.extend(received.try_iter());
        tape.write(Topic::Event, 5, &event("second"));
    }
    let kinds: String = taken
        .iter()
        .map(|order| match order {
            Order::Begin(_) => 'B',
            Order::Write(line) if reasons(std::slice::from_ref(line)) == ["RECORDING_GAP"] => 'G',
            Order::Write(_) => 'W',
            Order::End => 'E',
        })
        .collect();
    assert!(kinds.starts_with("BWEB"), "{kinds}");
    assert_eq!(kinds.matches('G').count(), 1, "{kinds}");
}

#[test]
fn reserves_of_a_killed_gateway_are_removed_and_its_files_stay() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("one-001.mcap"), b"cut").unwrap();
    fs::write(folder.path().join("one-001.mcap.reserve"), b"").unwrap();
    let (mut tape, thread) = tape(settings(&folder));
    tape.begin(about("one"));
    tape.end();
    ended(tape, thread);
    let mut left: Vec<_> = fs::read_dir(folder.path())
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    left.sort();
    assert_eq!(left, ["one-001.mcap", "one-002.mcap"]);
}
