//! What the operator wants of a procedure that is under way, and when that halts the step under way.

use crate::procedure::machine::Event;
use tokio::sync::watch;

/// What the operator wants of a running procedure.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Wish {
    /// Go on.
    Run,
    /// Halt the step under way and hold.
    Pause,
    /// Halt the step under way, retreat, and end.
    Abort,
    /// Halt everything. Stable word, and text for a person.
    Stop(&'static str, String),
}

impl Wish {
    /// Whether this wish takes the place of the one before: nothing undoes a stop, only a stop undoes an abort.
    pub fn overrides(&self, before: &Self) -> bool {
        match before {
            Self::Stop(..) => false,
            Self::Abort => matches!(self, Self::Abort | Self::Stop(..)),
            Self::Run | Self::Pause => true,
        }
    }

    /// The event that the wish is in the machine's table.
    pub const fn event(&self) -> Event {
        match self {
            Self::Run => Event::Resume,
            Self::Pause => Event::Pause,
            Self::Abort => Event::Abort,
            Self::Stop(..) => Event::Stop,
        }
    }

    /// Why a step that it halted has failed: the stable word, and for a person.
    pub fn why(&self) -> (&'static str, &str) {
        match self {
            Self::Run => ("HALTED", "halted"),
            Self::Pause => ("PAUSED", "halted by a pause"),
            Self::Abort => ("ABORTED", "halted by an abort"),
            Self::Stop(reason, detail) => (reason, detail),
        }
    }

    /// Whether it halts the step under way: everything does but to go on, and what is being obeyed already.
    fn halts(&self, obeyed: &Self) -> bool {
        *self != Self::Run && self != obeyed
    }
}

/// Resolves when the operator wants something that halts; never when everybody who could is gone.
pub async fn halted(wish: &mut watch::Receiver<Wish>, obeyed: &Wish) -> Wish {
    let halting = wish
        .wait_for(|wish| wish.halts(obeyed))
        .await
        .map(|wish| wish.clone());
    match halting {
        Ok(wish) => wish,
        Err(_) => std::future::pending().await,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all() -> [Wish; 4] {
        [
            Wish::Run,
            Wish::Pause,
            Wish::Abort,
            Wish::Stop("STOPPED", String::new()),
        ]
    }

    #[test]
    fn nothing_undoes_a_stop_and_only_a_stop_an_abort() {
        let [run, pause, abort, stop] = all();
        for wish in all() {
            assert!(!wish.overrides(&stop), "{wish:?}");
            assert!(wish.overrides(&run) && wish.overrides(&pause));
        }
        assert!(stop.overrides(&abort) && abort.overrides(&abort));
        assert!(!run.overrides(&abort) && !pause.overrides(&abort));
    }

    #[test]
    fn what_is_being_obeyed_does_not_halt_its_own_steps() {
        let [run, pause, abort, stop] = all();
        for obeyed in all() {
            assert!(!run.halts(&obeyed));
            assert!(!obeyed.halts(&obeyed));
        }
        assert!(abort.halts(&pause) && stop.halts(&abort) && pause.halts(&run));
    }
}
