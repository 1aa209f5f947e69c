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
use super::super::process_data::{
    CONTROL_PDO, LOAD_PDO, MOTION_PDO, control_mapping, load_mapping, motion_mapping,
};
use crate::config::Cell;
use crate::error::{Failure, object_reason};

/// Between two tries, real time.
const RETRY_PAUSE: Duration = Duration::from_secs(1);
/// A change of the NMT state, and the process data after it, must come within this, real time.
const NMT_LIMIT: Duration = Duration::from_secs(3);
/// At most a hundred times a second.
const INHIBIT: Duration = Duration::from_millis(10);
/// Abort connection option code, object 0x6007: brake on the quick stop ramp, then switch the power off.
const QUICK_STOP_THEN_OFF: i16 = 3;
/// Communication error behaviour, object 0x1029:01: leave OPERATIONAL.
const TO_PRE_OPERATIONAL: u8 = 0;
/// PDOs that are not used.
const UNUSED: [Pdo; 5] = [
    Pdo::Transmit(3),
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
        .until(|image| image.is_renewed_since(&before));
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
    let (node, cell, spec) = (link.node(), link.cell(), link.spec());
    let identity = Identity {
        vendor_id: node.read(objects::VENDOR_ID).await?,
        product_code: node.read(objects::PRODUCT_CODE).await?,
        revision: node.read(objects::REVISION_NUMBER).await?,
        serial_number: node.read(objects::SERIAL_NUMBER).await?,
    };
    check_identity(identity, cell)?;
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
    check(
        "CONFIGURATION_MISMATCH",
        "encoder resolution (0x3000:05)",
        node.read(objects::MAIN_SENSOR_RESOLUTION).await?,
        spec.drivetrain.quadcounts_per_motor_turn,
    )?;
    link.board()
        .update_axis(link.axis(), |state| state.identity = Some(identity));
    Ok(())
}

fn check_identity(identity: Identity, cell: &Cell) -> Result<(), Obstacle> {
    let vendor = identity.vendor_id;
    check("WRONG_DEVICE", "vendor (0x1018:01)", vendor, cell.vendor_id)?;
    let product = identity.product_code;
    let what = "product code (0x1018:02)";
    check("WRONG_DEVICE", what, product, cell.product_code)
}

fn check(reason: &'static str, what: &str, found: u32, expected: u32) -> Result<(), Obstacle> {
    if found == expected {
        return Ok(());
    }
    let detail = format!("{what} is 0x{found:08X}, configured is 0x{expected:08X}");
    Err(Obstacle::new(reason, detail))
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
    let [motion, load, control] = [motion_mapping(), load_mapping(), control_mapping()]
        .map(|mapping| mapping.map_err(|error| Obstacle::new("NO_PROCESS_DATA", error)));
    for pdo in UNUSED {
        node.turn_off_pdo(pdo).await?;
    }
    let on_change = Transmission::OnChange;
    node.map_transmit_pdo(MOTION_PDO, &motion?, on_change, INHIBIT)
        .await?;
    node.map_transmit_pdo(LOAD_PDO, &load?, on_change, INHIBIT)
        .await?;
    node.map_receive_pdo(CONTROL_PDO, &control?, on_change)
        .await?;
    Ok(())
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
