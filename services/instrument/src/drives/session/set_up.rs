//! Setting one drive up: what it is, what it stores, what it sends and what it does when this host falls silent.

use std::time::Duration;

use epos4_link::canopen::nmt;
use epos4_link::canopen::object::{Address, Object, Value};
use epos4_link::canopen::pdo::{Pdo, Transmission};
use epos4_link::network::{self, Identity, Node};
use epos4_link::objects;
use tokio::time::{sleep, timeout};

use super::super::board::Readiness;
use super::super::link::Link;
use super::super::process_data::{CONTROL_PDO, Part, control_mapping};
use crate::check::{self, Found};
use crate::error::{Failure, object_reason};

/// Between two tries, real time.
const RETRY_PAUSE: Duration = Duration::from_secs(1);
/// A change of the NMT state, and the process data after it, must come within this, real time.
const NMT_LIMIT: Duration = Duration::from_secs(3);
/// Abort connection option code, object 0x6007: brake on the quick stop ramp, then switch the power off.
const QUICK_STOP_THEN_OFF: i16 = 3;
/// Communication error behaviour, object 0x1029:01: leave OPERATIONAL.
const TO_PRE_OPERATIONAL: u8 = 0;
/// PDOs that are not used.
const UNUSED: [Pdo; 4] = [
    Pdo::Transmit(4),
    Pdo::Receive(2),
    Pdo::Receive(3),
    Pdo::Receive(4),
];

/// Why a drive cannot be commanded yet.
#[derive(Clone, PartialEq, Eq, Debug)]
struct Obstacle {
    reason: &'static str,
    detail: String,
}

impl Obstacle {
    fn new(reason: &'static str, detail: impl ToString) -> Self {
        Self {
            reason,
            detail: detail.to_string(),
        }
    }
}

impl From<network::Error> for Obstacle {
    fn from(error: network::Error) -> Self {
        Self::new(object_reason(&error), error)
    }
}

impl From<Failure> for Obstacle {
    fn from(failure: Failure) -> Self {
        Self::new(failure.reason(), failure)
    }
}

/// Tries until the drive is what it should be and has its settings. An error is a fault that a person has to see first.
pub(super) async fn set_up(link: Link) -> Result<(), Failure> {
    let mut last = None;
    loop {
        let obstacle = match try_set_up(&link).await {
            Ok(()) => {
                tracing::info!(axis = %link.axis(), "drive ready");
                link.board()
                    .update_axis(link.axis(), |state| state.readiness = Readiness::Ready);
                return Ok(());
            }
            Err(obstacle) => obstacle,
        };
        let Obstacle { reason, detail } = obstacle.clone();
        not_ready(&link, reason, &detail);
        if reason == "WRONG_NODE" && link.board().fault(link.axis()).is_none() {
            return Err(Failure::WrongNode(detail));
        }
        if last.as_ref() != Some(&obstacle) {
            tracing::warn!(axis = %link.axis(), reason, detail, "drive not ready");
        }
        last = Some(obstacle);
        sleep(RETRY_PAUSE).await;
    }
}

pub(super) fn not_ready(link: &Link, reason: &'static str, detail: &str) {
    link.board().update_axis(link.axis(), |state| {
        state.readiness = Readiness::NotReady {
            reason,
            detail: detail.to_owned(),
        };
    });
}

async fn try_set_up(link: &Link) -> Result<(), Obstacle> {
    let (node, cell) = (link.node(), link.cell());
    identify(link).await?;
    link.read_condition().await?;
    // Mappings are changed in PRE-OPERATIONAL, and the heartbeat tells when the drive is there.
    write_checked(node, objects::PRODUCER_HEARTBEAT, cell.heartbeat_ms).await?;
    node.change_state(nmt::Command::EnterPreOperational, NMT_LIMIT)
        .await?;
    guard(link).await?;
    map(node).await?;
    let before = link.process_data().image();
    node.change_state(nmt::Command::Start, NMT_LIMIT).await?;
    // Entering OPERATIONAL, the drive sends everything that it is to send.
    let came = link
        .process_data()
        .until(|image| Part::ALL.iter().all(|part| image.is_newer(*part, &before)));
    if timeout(NMT_LIMIT, came).await.is_err() {
        let detail = format!(
            "no process data within {} s of OPERATIONAL",
            NMT_LIMIT.as_secs()
        );
        return Err(Obstacle::new("NO_PROCESS_DATA", detail));
    }
    link.ask().await?;
    Ok(())
}

/// Who the drive is, and whether it is set up for this axis.
async fn identify(link: &Link) -> Result<(), Obstacle> {
    let node = link.node();
    let identity = Identity {
        vendor_id: node.read(objects::VENDOR_ID).await?,
        product_code: node.read(objects::PRODUCT_CODE).await?,
        revision: node.read(objects::REVISION_NUMBER).await?,
        serial_number: node.read(objects::SERIAL_NUMBER).await?,
    };
    let known = link.board().identity(link.axis());
    if let Some(known) = known.filter(|known| *known != identity) {
        let detail = format!(
            "serial number {} (0x1018:04), product 0x{:08X}, revision 0x{:08X}; before it was {}, 0x{:08X}, 0x{:08X}",
            identity.serial_number,
            identity.product_code,
            identity.revision,
            known.serial_number,
            known.product_code,
            known.revision
        );
        return Err(Obstacle::new("WRONG_NODE", detail));
    }
    let found = found(node, &identity).await?;
    let mismatches = check::mismatches(&found, link.cell(), link.settings());
    if let Some(reason) = check::reason(&mismatches) {
        let all: Vec<String> = mismatches.iter().map(ToString::to_string).collect();
        return Err(Obstacle::new(reason, all.join("; ")));
    }
    link.board()
        .update_axis(link.axis(), |state| state.identity = Some(identity));
    Ok(())
}

/// What the drive stores of what is checked.
async fn found(node: &Node, identity: &Identity) -> Result<Found, network::Error> {
    let mut input_functions = [0; objects::INPUT_COUNT as usize];
    for (input, function) in (1..).zip(&mut input_functions) {
        *function = node.read(objects::digital_input_function(input)).await?;
    }
    Ok(Found {
        vendor_id: identity.vendor_id,
        product_code: identity.product_code,
        main_sensor_resolution: node.read(objects::MAIN_SENSOR_RESOLUTION).await?,
        encoder_pulses: node.read(objects::ENCODER_PULSES).await?,
        gear_numerator: node.read(objects::GEAR_NUMERATOR).await?,
        gear_denominator: node.read(objects::GEAR_DENOMINATOR).await?,
        output_current_limit_ma: node.read(objects::OUTPUT_CURRENT_LIMIT).await?,
        min_position_limit: node.read(objects::MIN_POSITION_LIMIT).await?,
        max_position_limit: node.read(objects::MAX_POSITION_LIMIT).await?,
        input_functions,
        input_polarity: node.read(objects::INPUT_POLARITY).await?,
        supported_drive_modes: node.read(objects::SUPPORTED_DRIVE_MODES).await?,
    })
}

/// What the drive does by itself when something goes wrong: also when this host is not heard any more.
async fn guard(link: &Link) -> Result<(), Obstacle> {
    let (node, cell, spec) = (link.node(), link.cell(), link.spec());
    let deceleration = spec.drivetrain.to_rpm(spec.quick_stop_deceleration);
    write_checked(node, objects::QUICK_STOP_DECELERATION, deceleration).await?;
    write_checked(node, objects::ABORT_CONNECTION_OPTION, QUICK_STOP_THEN_OFF).await?;
    let behaviour = objects::COMMUNICATION_ERROR_BEHAVIOUR;
    write_checked(node, behaviour, TO_PRE_OPERATIONAL).await?;
    let timeout_ms = u16::try_from(cell.heartbeat_timeout.as_millis()).unwrap_or(u16::MAX);
    let consumer = u32::from(cell.host_node_id) << 16 | u32::from(timeout_ms);
    write_checked(node, objects::CONSUMER_HEARTBEAT_1, consumer).await
}

/// What the drive sends and takes as process data.
async fn map(node: &Node) -> Result<(), Obstacle> {
    let unmapped = |error| Obstacle::new("NO_PROCESS_DATA", error);
    for pdo in UNUSED {
        node.turn_off_pdo(pdo).await?;
    }
    for part in Part::ALL {
        let mapping = part.mapping().map_err(unmapped)?;
        node.map_transmit_pdo(part.pdo(), &mapping, Transmission::OnChange, inhibit(part))
            .await?;
    }
    let control = control_mapping().map_err(unmapped)?;
    node.map_receive_pdo(CONTROL_PDO, &control, Transmission::OnChange)
        .await?;
    Ok(())
}

/// The statusword comes at once, what changes all the time a hundred times a second at most.
fn inhibit(part: Part) -> Duration {
    match part {
        Part::Status => Duration::from_millis(1),
        Part::Motion | Part::Inputs => Duration::from_millis(10),
    }
}

/// Writes a setting on which safety rests, and reads it back.
async fn write_checked<T: Value + PartialEq>(
    node: &Node,
    object: Object<T>,
    value: T,
) -> Result<(), Obstacle> {
    node.write(object, value).await?;
    let found = node.read(object).await?;
    if found == value {
        return Ok(());
    }
    let Address { index, subindex } = object.address;
    let detail = format!(
        "{} (0x{index:04X}:{subindex:02X}) is {found:?} after {value:?} was written",
        object.name
    );
    Err(Obstacle::new("SDO_READ_BACK", detail))
}
