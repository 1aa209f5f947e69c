use super::*;
use crate::primary::wire::Stamp;

fn said(notice: Notice) -> Message {
    let stamp = Stamp {
        timestamp_us: 0,
        source: 0,
    };
    Message::Notice(stamp, notice)
}

fn key(title: &str, text: &str) -> Message {
    said(Notice::Key {
        code: 0,
        argument: 0,
        title: title.into(),
        text: text.into(),
    })
}

fn exception(text: &str) -> Message {
    said(Notice::RuntimeException {
        line: 2,
        column: 3,
        text: text.into(),
    })
}

fn progress() -> Progress {
    Script::new("def main():\nend").unwrap().progress()
}

#[test]
fn a_program_is_one_function_with_a_name() {
    let script =
        Script::new("# ours\n def main( ): # here\n  if True:\n    sync()\n  end\nend # all\n\n")
            .unwrap();
    assert_eq!(script.name(), "main");
    assert!(script.text().ends_with("end # all\n"));
    for (text, why) in [
        ("", "does not begin with def NAME():"),
        ("movej([0])\n", "does not begin with def NAME():"),
        ("sec main():\nend\n", "does not begin with def NAME():"),
        ("def 1st():\nend\n", "does not begin with def NAME():"),
        ("def main(a):\nend\n", "does not begin with def NAME():"),
        ("def main():\n  sync()\n", "does not end with end"),
        ("def main():\n\0\nend\n", "holds a zero byte"),
    ] {
        assert!(
            matches!(Script::new(text), Err(Error::Script(told)) if told == why),
            "{text}"
        );
    }
    let long = format!("def main():\n{}end\n", " ".repeat(MAX_BYTES));
    assert!(matches!(Script::new(long), Err(Error::Script(_))));
}

#[test]
fn a_program_begins_and_ends_by_its_own_name() {
    let mut progress = progress();
    progress.observe(&key(STOPPED, "main"));
    progress.observe(&key(STARTED, "other"));
    assert!(!progress.began());
    assert_eq!(progress.outcome(), None);
    progress.observe(&key(STARTED, "main"));
    assert!(progress.began());
    progress.observe(&key(STOPPED, "other"));
    assert_eq!(progress.outcome(), None);
    progress.observe(&key(STOPPED, "main"));
    assert_eq!(progress.outcome(), Some(&Outcome::Ended));
}

#[test]
fn what_does_not_compile_is_told_from_what_fails_later() {
    let place = |text: &str| Exception {
        line: 2,
        column: 3,
        text: text.into(),
    };
    let mut never = progress();
    never.observe(&exception("compile_error_name_not_found:foo:"));
    let compiling = place("compile_error_name_not_found:foo:");
    assert_eq!(never.outcome(), Some(&Outcome::NotCompiled(compiling)));
    let mut later = progress();
    later.observe(&key(STARTED, "main"));
    later.observe(&exception("division by zero"));
    later.observe(&key(STOPPED, "main"));
    let failed = Outcome::Failed(place("division by zero"));
    assert_eq!(later.outcome(), Some(&failed));
    assert_eq!(place("x").to_string(), "line 2, column 3: x");
}

#[test]
fn a_violation_is_kept_as_the_likely_cause() {
    let mut progress = progress();
    for (code, level) in [
        (1, Level::Info),
        (153, Level::Violation),
        (2, Level::Warning),
    ] {
        progress.observe(&said(Notice::ErrorCode(ErrorCode {
            code,
            argument: 0,
            level,
            data_type: 0,
            data: 0,
            text: String::new(),
        })));
    }
    assert_eq!(progress.remark().map(|remark| remark.code), Some(153));
}

#[test]
fn runtime_states_show_begin_and_end() {
    let mut progress = progress();
    progress.observe_runtime(RuntimeState::Stopped);
    assert_eq!((progress.began(), progress.outcome()), (false, None));
    progress.observe_runtime(RuntimeState::Playing);
    progress.observe_runtime(RuntimeState::Stopping);
    assert_eq!((progress.began(), progress.outcome()), (true, None));
    progress.observe_runtime(RuntimeState::Stopped);
    assert_eq!(progress.outcome(), Some(&Outcome::Ended));
}
