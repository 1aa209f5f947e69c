//! Writes of a gateway that another one has taken command from.

use std::sync::Arc;

use arthro_gateway::journal::{Duty, Journal, JournalError, Place};
use arthro_gateway::procedure::steps::Kind;
use sqlx::{AnyConnection, Connection as _};

use crate::store::{Store, on_both};
use crate::values::{case, done, filled, page, procedure, step};

/// Six kinds of writes, this many times each: more than a hundred attempts.
const ROUNDS: usize = 17;

on_both! {
    no_write_of_an_earlier_epoch_is_accepted,
}

/// What another gateway does when it takes command, and gives it up again at once.
async fn another_takes_command(store: &Store) {
    sqlx::any::install_default_drivers();
    let address = match store.place() {
        Place::File(path) => format!("sqlite:{}", path.display()),
        Place::Postgres(address) => address,
    };
    let mut connection = AnyConnection::connect(&address).await.unwrap();
    let taken =
        sqlx::query("UPDATE command SET epoch = epoch + 1, holder = 'another', expires_ms = 0")
            .execute(&mut connection)
            .await
            .unwrap();
    assert_eq!(taken.rows_affected(), 1);
    connection.close().await.unwrap();
}

async fn attempt(kind: usize, journal: &Arc<dyn Journal>) -> Result<(), JournalError> {
    let other = procedure("p", "c");
    match kind {
        0 => journal.create_case(&case("d")).await,
        1 => journal.save_case(&filled("c"), &[]).await,
        2 => journal.save_procedure(&other).await,
        3 => journal.intend("p", &step(2, Kind::Bite, Some(0))).await,
        4 => {
            journal
                .end_step(&other, &done(&step(1, Kind::Bite, Some(0))), None)
                .await
        }
        _ => journal.claim_open().await.map(drop),
    }
}

async fn no_write_of_an_earlier_epoch_is_accepted(store: Store) {
    let mut journal = store.open().await;
    journal.create_case(&case("c")).await.unwrap();
    let mut interrupted = procedure("p", "c");
    interrupted.bites_done = 1;
    journal.create_procedure(&interrupted).await.unwrap();
    let bite = step(1, Kind::Bite, Some(0));
    journal.intend("p", &bite).await.unwrap();
    interrupted.step = Some(bite.clone());

    let mut refused = 0;
    for _ in 0..ROUNDS {
        for kind in 0..6 {
            let Duty::InCommand { epoch: earlier } = *journal.duty().borrow() else {
                panic!("whoever opens the journal is in command");
            };
            another_takes_command(&store).await;
            let written = attempt(kind, &journal).await;
            assert!(
                matches!(&written, Err(JournalError::Fenced { epoch, holder }) if *epoch == earlier && holder == "another"),
                "{kind}: {written:?}"
            );
            assert!(matches!(*journal.duty().borrow(), Duty::Standby { .. }));
            refused += 1;
            journal = store.reopen(journal).await;
        }
    }
    assert!(refused >= 100);
    assert_eq!(journal.cases(&page(None, 9)).await.unwrap(), [case("c")]);
    assert_eq!(
        journal.procedures(&page(None, 9)).await.unwrap(),
        [interrupted]
    );
    assert_eq!(journal.steps("p").await.unwrap(), [bite]);
}
