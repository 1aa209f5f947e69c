use super::*;
use crate::switches::commissioning::{Step, SwitchError};

/// The time of the fake drives flies.
const COMMISSION: Command = Command::CommissionSwitches {
    axis: Axis::ForcepsFeed,
    timeout: Duration::from_secs(600),
};

async fn wait_for(ticket: &mut Ticket, step: Step) {
    let reached = ticket
        .reports
        .wait_for(|report| report.switches.iter().any(|switch| switch.step == step));
    let in_time = tokio::time::timeout(Duration::from_secs(30), reached).await;
    assert!(in_time.is_ok_and(|report| report.is_ok()), "{step:?}");
}

/// Changes the level of an input.
fn toggle(world: &World, input: u8) {
    world.cell.change(FORCEPS_FEED, |drive| {
        let levels = drive.get(objects::INPUT_LEVELS) ^ 1 << (input - 1);
        drive.set(objects::INPUT_LEVELS, levels);
    });
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_switch_is_pressed_and_released_while_the_drive_has_no_power() {
    let mut world = World::homed().await;
    assert_eq!(
        world.cell.drive(FORCEPS_FEED).state,
        State::OperationEnabled
    );
    let mut ticket = world.begin(COMMISSION).await.unwrap();
    wait_for(&mut ticket, Step::Press).await;
    assert_eq!(
        world.cell.drive(FORCEPS_FEED).state,
        State::SwitchOnDisabled
    );
    assert_eq!(world.reason(Command::OpenJaw).await, "AXIS_MOVING");
    toggle(&world, 1);
    wait_for(&mut ticket, Step::Release).await;
    toggle(&world, 1);
    let ended = ticket.ended().await.unwrap();
    assert_eq!(ended.operation.state, OperationState::Done, "{ended:?}");
    assert_eq!(ended.switches[0].step, Step::Passed);
    let drive = world.cell.drive(FORCEPS_FEED);
    assert!(drive.targets_qc.is_empty(), "nothing moves");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_switch_on_another_input_or_with_a_cut_wire_is_named() {
    let mut world = World::ready().await;
    let mut ticket = world.begin(COMMISSION).await.unwrap();
    wait_for(&mut ticket, Step::Press).await;
    for _ in 0..2 {
        toggle(&world, 2);
        // Until the level has settled.
        let seen = world.handle.snapshot().axes[1].sample.unwrap().stamp;
        world
            .until(|state| {
                let sample = state.axes[1].sample.unwrap();
                sample.stamp > seen + Duration::from_millis(100)
            })
            .await;
    }
    let ended = ticket.ended().await.unwrap();
    assert_eq!(ended.operation.reason, "SWITCH_WRONG_INPUT");
    assert_eq!(
        ended.switches[0].step,
        Step::Failed(SwitchError::WrongInput(2))
    );
    assert_eq!(
        ended.operation.detail,
        "negative limit switch on input 1 is wired to input 2: that one changed instead"
    );

    toggle(&world, 1);
    let hasty = Command::CommissionSwitches {
        axis: Axis::ForcepsFeed,
        timeout: Duration::from_secs(1),
    };
    let ended = world.run(hasty).await;
    assert_eq!(ended.operation.reason, "SWITCH_ACTIVE_AT_REST");
    assert_eq!(world.fault(Axis::ForcepsFeed), "");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_axis_without_switches_has_nothing_to_commission() {
    let mut world = World::ready().await;
    let commission = Command::CommissionSwitches {
        axis: Axis::ForcepsRotation,
        timeout: Duration::from_secs(2),
    };
    assert_eq!(world.reason(commission).await, "SWITCHES_NOT_CONFIGURED");
}
