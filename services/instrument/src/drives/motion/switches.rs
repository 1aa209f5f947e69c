//! Commissioning the switches of an axis: the power stage is off, the operator presses, the inputs are watched.

use std::time::Duration;

use epos4_link::cia402::{Command as Order, State};
use epos4_link::objects;
use tokio::sync::watch;

use crate::drives::commands::Report;
use crate::drives::link::{Limit, Link};
use crate::error::Failure;
use crate::switches::Inputs;
use crate::switches::commissioning::Commissioning;

/// How long the drive may take to cut the power, on the clock of the bus.
const POWER_OFF_LIMIT: Duration = Duration::from_secs(1);

/// Tells every step in the reports; a sentence for a person when all switches have passed.
pub(super) async fn commission(
    link: &Link,
    timeout: Duration,
    reports: &watch::Sender<Report>,
) -> Result<String, Failure> {
    power_off(link).await?;
    let mut commissioning = Commissioning::new(&link.settings().switches, timeout);
    loop {
        let sample = link.ask().await?;
        if let Some(state) = sample.statusword.state().filter(|state| has_power(*state)) {
            return Err(Failure::PowerCameOn { state });
        }
        let inputs = Inputs {
            levels: link.node().read(objects::INPUT_LEVELS).await?,
            functions: sample.inputs,
        };
        let over = commissioning.observe(&inputs, sample.stamp);
        let switches = commissioning.switches();
        reports.send_if_modified(|report| {
            let is_new = report.switches != switches;
            if is_new {
                report.switches = switches.to_vec();
            }
            is_new
        });
        if over {
            break;
        }
    }
    match commissioning.first_failure() {
        Some((switch, error)) => Err(Failure::Switch { switch, error }),
        None => Ok(format!(
            "{} of {} switches passed",
            commissioning.switches().len(),
            commissioning.switches().len()
        )),
    }
}

async fn power_off(link: &Link) -> Result<(), Failure> {
    let mut limit = Limit::new(POWER_OFF_LIMIT);
    loop {
        let sample = link.ask().await?;
        match sample.statusword.state() {
            Some(state) if has_power(state) => {
                link.node()
                    .write(objects::CONTROLWORD, Order::DisableVoltage.controlword())
                    .await?;
                limit.check(sample.stamp, state, "a state without power")?;
            }
            Some(_) => return Ok(()),
            None => return Err(Failure::UnknownStatusword(sample.statusword)),
        }
    }
}

const fn has_power(state: State) -> bool {
    matches!(
        state,
        State::SwitchedOn
            | State::OperationEnabled
            | State::QuickStopActive
            | State::FaultReactionActive
    )
}
