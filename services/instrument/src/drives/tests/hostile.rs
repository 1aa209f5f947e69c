//! Commands that must not move a drive, more than a hundred of each kind.

use super::*;

const ATTEMPTS: usize = 120;

impl World {
    /// Another lease in place of the one in force.
    async fn pass_on(&mut self) {
        self.handle.release(self.token).await.unwrap();
        let lease = self
            .handle
            .acquire("next".into(), Duration::from_secs(60))
            .await;
        self.token = lease.unwrap().fencing_token;
    }

    fn targets(&self) -> usize {
        let nodes = FORCEPS_ROTATION..=4;
        nodes
            .map(|node| self.cell.drive(node).targets_qc.len())
            .sum()
    }

    async fn refusal(&self, by: Authorization, command: Command) -> String {
        let refusal = self.handle.command(by, command).await.unwrap_err();
        arthro_bootstrap::status::reason(&tonic::Status::from(refusal)).unwrap()
    }
}

fn all_commands() -> [Command; 4] {
    [
        MOVE_ROTATION,
        Command::OpenJaw,
        Command::Move {
            axis: Axis::ForcepsFeed,
            target: 3.0,
        },
        Command::Home(Axis::ALL.to_vec()),
    ]
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn no_stale_token_moves_a_drive() {
    let mut world = World::homed().await;
    let targets = world.targets();
    let mut old = Vec::new();
    for _ in 0..ATTEMPTS {
        old.push(world.authorization());
        world.pass_on().await;
    }
    for (number, by) in old.into_iter().enumerate() {
        let command = all_commands()[number % 4].clone();
        assert_eq!(world.refusal(by, command).await, "STALE_FENCING_TOKEN");
    }
    let taken = world.targets() - targets;
    println!("stale tokens: {ATTEMPTS} tried, {taken} taken");
    assert_eq!(taken, 0);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn no_replayed_id_moves_a_drive_again() {
    let mut world = World::homed().await;
    let by = world.authorization();
    let first = world.handle.command(by.clone(), MOVE_ROTATION).await;
    let first = first.unwrap().ended().await.unwrap().operation;
    assert_eq!(first.state, OperationState::Done);
    let targets = world.targets();
    for _ in 0..ATTEMPTS {
        let again = world.handle.command(by.clone(), MOVE_ROTATION).await;
        let mut again = again.unwrap();
        assert!(again.repeated);
        assert_eq!(again.ended().await.unwrap().operation, first);
        let other = Command::Move {
            axis: Axis::ForcepsRotation,
            target: 12.0,
        };
        assert_eq!(
            world.refusal(by.clone(), other).await,
            "OPERATION_ID_REUSED"
        );
    }
    let taken = world.targets() - targets;
    println!("replayed ids: {} tried, {taken} taken", 2 * ATTEMPTS);
    assert_eq!(taken, 0);
}

/// Given under many leases, and they arrive backwards after the last was granted.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn commands_that_come_late_and_in_another_order_move_nothing() {
    let mut world = World::homed().await;
    let targets = world.targets();
    let mut late = Vec::new();
    for _ in 0..ATTEMPTS / 4 {
        for command in all_commands() {
            late.push((world.authorization(), command));
        }
        world.pass_on().await;
    }
    let tried = late.len();
    for (by, command) in late.into_iter().rev() {
        assert_eq!(world.refusal(by, command).await, "STALE_FENCING_TOKEN");
    }
    let taken = world.targets() - targets;
    println!("reordered past a lease: {tried} tried, {taken} taken");
    assert_eq!(taken, 0);
}
