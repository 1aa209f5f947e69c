//! Commands that must not move an arm, more than a hundred of each kind.

use super::*;

const ATTEMPTS: usize = 120;

impl Cell {
    /// Another lease in place of the one in force.
    fn pass_on(&mut self) {
        self.commander.release(self.token).unwrap();
        self.token = self.acquire();
    }

    /// Orders to the controller other than to hold.
    fn orders(&self) -> usize {
        let commands = self.commands();
        let orders = commands.iter().filter(|order| **order != Command::Hold);
        orders.count()
    }
}

fn all_moves(cell: &Cell) -> [Move; 4] {
    [
        insert(-5.0),
        free(cell, -20.0, 0.5),
        pivot(cell, 0.1),
        joints(START),
    ]
}

#[tokio::test]
async fn no_stale_token_moves_an_arm() {
    let mut cell = Cell::new().await;
    let mut old = Vec::new();
    for _ in 0..ATTEMPTS {
        old.push(cell.token);
        cell.pass_on();
    }
    let newest = cell.token;
    let mut refused = 0;
    for (number, token) in old.into_iter().enumerate() {
        cell.token = token;
        let wanted = all_moves(&cell)[number % 4].clone();
        assert_eq!(cell.refusal(wanted).await, "STALE_FENCING_TOKEN");
        refused += 1;
    }
    let taken = cell.orders();
    println!("stale tokens: {refused} tried, {taken} orders went out");
    assert_eq!(taken, 0);
    cell.token = newest;
    cell.carry_out(insert(-5.0)).await.unwrap();
}

#[tokio::test]
async fn no_replayed_id_moves_an_arm_again() {
    let mut cell = Cell::new().await;
    let by = cell.by();
    let first = cell.handle.begin(by.clone(), b"in", insert(-5.0)).await;
    let Accepted::Running { mut progress, .. } = first.unwrap() else {
        panic!("not begun")
    };
    let first = ended(&mut progress).await.operation;
    cell.state().await;
    let followed = cell.robot.lock().followed.len();
    for _ in 0..ATTEMPTS {
        let again = cell.handle.begin(by.clone(), b"in", insert(-5.0)).await;
        let Accepted::Ended(again) = again.unwrap() else {
            panic!("acted again")
        };
        assert_eq!(again, first);
        let other = cell.handle.begin(by.clone(), b"deeper", insert(20.0)).await;
        assert_eq!(other.err().unwrap().reason(), "OPERATION_ID_REUSED");
    }
    cell.state().await;
    let moved = cell.robot.lock().followed.len() - followed;
    println!(
        "replayed ids: {} tried, {moved} samples followed",
        2 * ATTEMPTS
    );
    assert_eq!(moved, 0);
}

/// Each bite's commands were given under its own lease and arrive backwards, after the last lease was granted.
#[tokio::test]
async fn commands_that_come_late_and_in_another_order_move_nothing() {
    let mut cell = Cell::new().await;
    let mut late = Vec::new();
    for _ in 0..ATTEMPTS / 4 {
        for wanted in all_moves(&cell) {
            late.push((cell.by(), wanted));
        }
        cell.pass_on();
    }
    let tried = late.len();
    for (by, wanted) in late.into_iter().rev() {
        let refusal = cell.handle.begin(by, b"late", wanted).await.err().unwrap();
        assert_eq!(refusal.reason(), "STALE_FENCING_TOKEN");
    }
    let taken = cell.orders();
    println!("reordered past a lease: {tried} tried, {taken} orders went out");
    assert_eq!(taken, 0);
}

/// Under one lease a command that overtakes the one before it finds the arm elsewhere than it needs it.
#[tokio::test]
async fn commands_that_overtake_each_other_are_refused_by_where_the_arm_is() {
    let mut cell = Cell::new().await;
    cell.go_to_depth(10.0).await;
    let followed = cell.robot.lock().followed.len();
    for _ in 0..ATTEMPTS / 2 {
        assert_eq!(cell.refusal(free(&cell, -60.0, 0.0)).await, "TOOL_INSIDE");
        assert_eq!(cell.refusal(insert(5.0)).await, "WRONG_DIRECTION");
    }
    cell.state().await;
    let moved = cell.robot.lock().followed.len() - followed;
    println!("overtaking commands: {ATTEMPTS} tried, {moved} samples followed");
    assert_eq!(moved, 0);
}
