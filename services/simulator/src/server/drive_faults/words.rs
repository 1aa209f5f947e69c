//! The words of the API for faults of drives, checked and turned into the simulator's own, and back.

use arthro_bootstrap::status;
use arthro_proto::simulator::v1::drive_fault::Fault as Word;
use arthro_proto::simulator::v1::{
    BusOff, DriveFault, DroppedNode, DuplicateNode, ErrorPassive, FrozenEncoder, GearRatio, Jam,
    RandomFrames, SilentSdo, StoOpen,
};
use tonic::Status;

use crate::epos4::{Fault, INPUT_COUNT};
use crate::server::faults::in_range;

const DELAY: (std::ops::RangeInclusive<f64>, &str) = (0.001..=60.0, "0.001 .. 60 s");

/// The fault and its seed.
pub(super) fn fault(fault: Option<DriveFault>) -> Result<(Fault, u64), Status> {
    let word = fault
        .and_then(|fault| fault.fault)
        .ok_or_else(|| status::invalid("fault", "must be set"))?;
    let delay = |field, delay_s| {
        in_range(field, delay_s, DELAY.0, DELAY.1)?;
        Ok::<f64, Status>(delay_s)
    };
    let seed = match &word {
        Word::CorruptFrame(frames) | Word::LostPdo(frames) => frames.seed,
        _ => 0,
    };
    let fault = match word {
        Word::DropNode(DroppedNode {}) => Fault::DropNode,
        Word::LateHeartbeatS(extra_s) => {
            Fault::LateHeartbeat(delay("fault.late_heartbeat_s", extra_s)?)
        }
        Word::Emergency(code) => match u16::try_from(code) {
            Ok(code @ 1..) => Fault::Emergency(code),
            _ => {
                let text = format!("{code} must be within 1 .. 65535");
                return Err(status::invalid("fault.emergency", text));
            }
        },
        Word::FrozenEncoder(FrozenEncoder {}) => Fault::FrozenEncoder,
        Word::SlippingBeltShare(share) => {
            Fault::SlippingBelt(checked_share("fault.slipping_belt_share", share)?)
        }
        Word::CutWireInput(input) => Fault::CutWire(checked_input("fault.cut_wire_input", input)?),
        Word::PressedSwitchInput(input) => {
            Fault::PressedSwitch(checked_input("fault.pressed_switch_input", input)?)
        }
        Word::SlowSdoS(extra_s) => Fault::SlowSdo(delay("fault.slow_sdo_s", extra_s)?),
        Word::SilentSdo(SilentSdo {}) => Fault::SilentSdo,
        Word::CorruptFrame(frames) => {
            Fault::CorruptFrame(share_or_all("fault.corrupt_frame.share", frames)?)
        }
        Word::LostPdo(frames) => Fault::LostPdo(share_or_all("fault.lost_pdo.share", frames)?),
        Word::DuplicateNode(DuplicateNode {}) => Fault::DuplicateNode,
        Word::ProductCode(code) => Fault::WrongIdentity(code),
        Word::Gear(GearRatio {
            numerator,
            denominator,
        }) => Fault::SwappedGear(numerator, denominator),
        Word::StoOpen(StoOpen {}) => Fault::StoOpen,
        Word::SupplyV(volt) => {
            in_range("fault.supply_v", volt, 0.0..=100.0, "0 .. 100 V")?;
            Fault::Supply(volt)
        }
        Word::PowerStageC(celsius) => {
            in_range(
                "fault.power_stage_c",
                celsius,
                -40.0..=200.0,
                "-40 .. 200 C",
            )?;
            Fault::PowerStageTemperature(celsius)
        }
        Word::Jam(Jam {}) => Fault::Jam,
        Word::I2tMotorPercent(percent) => {
            in_range(
                "fault.i2t_motor_percent",
                percent,
                0.0..=200.0,
                "0 .. 200 %",
            )?;
            Fault::I2tLevel(percent)
        }
        Word::BusOff(BusOff {}) => Fault::BusOff,
        Word::ErrorPassive(ErrorPassive {}) => Fault::ErrorPassive,
    };
    Ok((fault, seed))
}

/// The same for the API.
pub(super) fn told(fault: Fault, seed: u64) -> DriveFault {
    let frames = |share| RandomFrames { share, seed };
    let word = match fault {
        Fault::DropNode => Word::DropNode(DroppedNode {}),
        Fault::LateHeartbeat(extra_s) => Word::LateHeartbeatS(extra_s),
        Fault::Emergency(code) => Word::Emergency(u32::from(code)),
        Fault::FrozenEncoder => Word::FrozenEncoder(FrozenEncoder {}),
        Fault::SlippingBelt(share) => Word::SlippingBeltShare(share),
        Fault::CutWire(input) => Word::CutWireInput(u32::from(input)),
        Fault::PressedSwitch(input) => Word::PressedSwitchInput(u32::from(input)),
        Fault::SlowSdo(extra_s) => Word::SlowSdoS(extra_s),
        Fault::SilentSdo => Word::SilentSdo(SilentSdo {}),
        Fault::CorruptFrame(share) => Word::CorruptFrame(frames(share)),
        Fault::LostPdo(share) => Word::LostPdo(frames(share)),
        Fault::DuplicateNode => Word::DuplicateNode(DuplicateNode {}),
        Fault::WrongIdentity(code) => Word::ProductCode(code),
        Fault::SwappedGear(numerator, denominator) => Word::Gear(GearRatio {
            numerator,
            denominator,
        }),
        Fault::StoOpen => Word::StoOpen(StoOpen {}),
        Fault::Supply(volt) => Word::SupplyV(volt),
        Fault::PowerStageTemperature(celsius) => Word::PowerStageC(celsius),
        Fault::Jam => Word::Jam(Jam {}),
        Fault::I2tLevel(percent) => Word::I2tMotorPercent(percent),
        Fault::BusOff => Word::BusOff(BusOff {}),
        Fault::ErrorPassive => Word::ErrorPassive(ErrorPassive {}),
    };
    DriveFault { fault: Some(word) }
}

fn checked_share(field: &str, share: f64) -> Result<f64, Status> {
    if share > 0.0 && share <= 1.0 {
        Ok(share)
    } else {
        let text = format!("{share} must be above 0 and at most 1");
        Err(status::invalid(field, text))
    }
}

fn share_or_all(field: &str, frames: RandomFrames) -> Result<f64, Status> {
    if frames.share == 0.0 {
        Ok(1.0)
    } else {
        checked_share(field, frames.share)
    }
}

fn checked_input(field: &str, input: u32) -> Result<u8, Status> {
    u8::try_from(input)
        .ok()
        .filter(|input| (1..=INPUT_COUNT).contains(&usize::from(*input)))
        .ok_or_else(|| {
            let text = format!("{input} must be within 1 .. {INPUT_COUNT}");
            status::invalid(field, text)
        })
}
