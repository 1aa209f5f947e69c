//! The error codes of the EPOS4: code, text, bit of the error register and reaction agree in two independent drivers that
//! cite maxon's firmware specification. What a person does about each is this project's own advice.

use super::{Fact, Reaction};

const RESTART: &str = "Switch the drive off and on, then home the axis again; if the error returns, have the drive checked.";
const FIRMWARE: &str = "Load the firmware that belongs to this hardware with the maker's tool, then check the configuration.";
const OVERCURRENT: &str = "Look for a short circuit or a jam between drive, motor and instrument, and check the current controller's gains.";
const OVERVOLTAGE: &str =
    "Check the power supply and whether it can take what a braking motor gives back.";
const UNDERVOLTAGE: &str =
    "Check the power supply, its cable and its fuse, and that it carries the current of all axes.";
const COOL: &str = "Let motor and drive cool down, free the instrument if it binds, and lower force or duty before going on.";
const REPLACE: &str = "Do not use the axis; have the drive checked or replaced.";
const PARAMETERS: &str = "Compare the drive's configuration with that of the axis, restore and save it, then switch the drive off and on.";
const SENSOR: &str = "Check the encoder, its plug and its cable, then home the axis again: its position cannot be trusted.";
const SENSOR_SETTING: &str = "Check that the encoder is plugged in and set up as built, including its direction, then home the axis again.";
const BUS_BUSY: &str =
    "Look for other senders on the CAN bus and for a bit rate that does not suit, then recover.";
const BUS_CABLE: &str = "Check CAN cable, plugs and both terminating resistors, and that all nodes have the same bit rate.";
const HOST: &str = "Find out why this service fell silent (process, adapter, cable), then recover; nothing moves before that.";
const BUS_IDS: &str = "Check that every node id and every COB-ID is used once on the bus, then set the drive up anew.";
const FOLLOWING: &str = "Look for what holds the axis or slips (tissue, jam, belt), free it, check its position, then recover.";
const LIMIT: &str = "Look where the axis stands and which switch is pressed, check the switch's wiring, then recover and home.";
const SOFTWARE_LIMIT: &str =
    "The target or the axis was beyond its travel; check the reference, home again if in doubt.";
const STO: &str = "Release the safe-torque-off inputs (emergency stop, door, connector) when it is safe, then recover.";
const GAINS: &str = "Check the controller's gains and the motor data, or tune the drive anew with the maker's tool.";

/// All errors, by rising code.
pub const FACTS: &[Fact] = &[
    fact(
        0x1000,
        0x1000,
        "generic error",
        0x01,
        Reaction::Disable,
        RESTART,
    ),
    fact(
        0x1080,
        0x1083,
        "generic initialization error",
        0x01,
        Reaction::Disable,
        RESTART,
    ),
    fact(
        0x1090,
        0x1090,
        "firmware incompatibility",
        0x01,
        Reaction::Disable,
        FIRMWARE,
    ),
    fact(
        0x2310,
        0x2310,
        "overcurrent",
        0x02,
        Reaction::Disable,
        OVERCURRENT,
    ),
    fact(
        0x2320,
        0x2320,
        "power stage protection",
        0x02,
        Reaction::Disable,
        OVERCURRENT,
    ),
    fact(
        0x3210,
        0x3210,
        "overvoltage",
        0x04,
        Reaction::Disable,
        OVERVOLTAGE,
    ),
    fact(
        0x3220,
        0x3220,
        "undervoltage",
        0x04,
        Reaction::Disable,
        UNDERVOLTAGE,
    ),
    fact(
        0x4210,
        0x4210,
        "thermal overload of the power stage",
        0x08,
        Reaction::Disable,
        COOL,
    ),
    fact(
        0x4380,
        0x4380,
        "thermal overload of the motor",
        0x08,
        Reaction::Disable,
        COOL,
    ),
    fact(
        0x5113,
        0x5113,
        "logic supply voltage too low",
        0x04,
        Reaction::Disable,
        UNDERVOLTAGE,
    ),
    fact(
        0x5280,
        0x5281,
        "hardware defect",
        0x01,
        Reaction::Disable,
        REPLACE,
    ),
    fact(
        0x5480,
        0x5483,
        "hardware error",
        0x01,
        Reaction::Disable,
        REPLACE,
    ),
    fact(
        0x6080,
        0x6080,
        "sign of life",
        0x01,
        Reaction::Disable,
        RESTART,
    ),
    fact(
        0x6081,
        0x6081,
        "extension 1 watchdog",
        0x01,
        Reaction::AbortConnection,
        RESTART,
    ),
    fact(
        0x6180,
        0x6190,
        "internal software error",
        0x01,
        Reaction::Disable,
        RESTART,
    ),
    fact(
        0x6320,
        0x6320,
        "software parameter error",
        0x01,
        Reaction::FaultOption,
        PARAMETERS,
    ),
    fact(
        0x6380,
        0x6380,
        "persistent parameter corrupt",
        0x01,
        Reaction::Disable,
        PARAMETERS,
    ),
    fact(
        0x7320,
        0x7320,
        "position sensor error",
        0x20,
        Reaction::Disable,
        SENSOR,
    ),
    fact(
        0x7380,
        0x7380,
        "position sensor breach",
        0x20,
        Reaction::Disable,
        SENSOR,
    )
    .clearing_reference(),
    fact(
        0x7381,
        0x7381,
        "position sensor resolution error",
        0x20,
        Reaction::Disable,
        SENSOR,
    )
    .clearing_reference(),
    fact(
        0x7382,
        0x7382,
        "position sensor index error",
        0x20,
        Reaction::Disable,
        SENSOR,
    )
    .clearing_reference(),
    fact(
        0x7388,
        0x738A,
        "hall sensor error",
        0x20,
        Reaction::Disable,
        SENSOR,
    )
    .clearing_reference(),
    fact(
        0x738C,
        0x738C,
        "ssi sensor error",
        0x20,
        Reaction::Disable,
        SENSOR,
    ),
    fact(
        0x7390,
        0x7390,
        "missing main sensor",
        0x20,
        Reaction::Disable,
        SENSOR_SETTING,
    ),
    fact(
        0x7391,
        0x7391,
        "missing commutation sensor",
        0x20,
        Reaction::Disable,
        SENSOR_SETTING,
    ),
    fact(
        0x7392,
        0x7392,
        "main sensor direction error",
        0x20,
        Reaction::Disable,
        SENSOR_SETTING,
    )
    .clearing_reference(),
    fact(
        0x8110,
        0x8111,
        "can overrun",
        0x10,
        Reaction::AbortConnection,
        BUS_BUSY,
    ),
    fact(
        0x8120,
        0x8120,
        "can passive mode",
        0x10,
        Reaction::AbortConnection,
        BUS_CABLE,
    ),
    fact(
        0x8130,
        0x8130,
        "can heartbeat error",
        0x10,
        Reaction::AbortConnection,
        HOST,
    ),
    fact(
        0x8150,
        0x8150,
        "can pdo cob-id collision",
        0x10,
        Reaction::AbortConnection,
        BUS_IDS,
    ),
    fact(
        0x81FD,
        0x81FD,
        "can bus turned off",
        0x10,
        Reaction::AbortConnection,
        BUS_CABLE,
    ),
    fact(
        0x81FE,
        0x81FE,
        "can receive queue overflow",
        0x10,
        Reaction::AbortConnection,
        BUS_BUSY,
    ),
    fact(
        0x81FF,
        0x81FF,
        "can transmit queue overflow",
        0x10,
        Reaction::AbortConnection,
        BUS_BUSY,
    ),
    fact(
        0x8210,
        0x8210,
        "can pdo length error",
        0x10,
        Reaction::AbortConnection,
        BUS_IDS,
    ),
    fact(
        0x8250,
        0x8250,
        "rpdo timeout",
        0x10,
        Reaction::AbortConnection,
        HOST,
    ),
    fact(
        0x8611,
        0x8611,
        "following error",
        0x80,
        Reaction::FaultOption,
        FOLLOWING,
    ),
    fact(
        0x8A80,
        0x8A80,
        "negative limit switch",
        0x80,
        Reaction::FaultOption,
        LIMIT,
    ),
    fact(
        0x8A81,
        0x8A81,
        "positive limit switch",
        0x80,
        Reaction::FaultOption,
        LIMIT,
    ),
    fact(
        0x8A82,
        0x8A82,
        "software position limit",
        0x80,
        Reaction::FaultOption,
        SOFTWARE_LIMIT,
    ),
    fact(
        0x8A88,
        0x8A88,
        "safe torque off",
        0x01,
        Reaction::Disable,
        STO,
    ),
    fact(
        0xFF01,
        0xFF01,
        "system overload",
        0x01,
        Reaction::Disable,
        COOL,
    ),
    fact(0xFF02, 0xFF02, "watchdog", 0x01, Reaction::Disable, RESTART).clearing_reference(),
    fact(
        0xFF0B,
        0xFF0B,
        "system peak overload",
        0x01,
        Reaction::Disable,
        COOL,
    ),
    fact(
        0xFF10,
        0xFF10,
        "controller gain error",
        0x20,
        Reaction::FaultOption,
        GAINS,
    ),
    fact(
        0xFF12,
        0xFF21,
        "auto tuning error",
        0x20,
        Reaction::Disable,
        GAINS,
    ),
];

const fn fact(
    first: u16,
    last: u16,
    text: &'static str,
    register: u8,
    reaction: Reaction,
    response: &'static str,
) -> Fact {
    Fact {
        first,
        last,
        text,
        register,
        reaction,
        clears_reference: false,
        response,
    }
}

impl Fact {
    const fn clearing_reference(self) -> Self {
        Self {
            clears_reference: true,
            ..self
        }
    }
}
