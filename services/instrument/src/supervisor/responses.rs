//! What a person does about a fault that is not one of the drive's own errors; those are in
//! [`emcy`](epos4_link::canopen::emcy::FACTS).

/// What a person does, before the fault is recovered.
pub(super) fn response(reason: &str) -> &'static str {
    match reason {
        "BUS_LOST" => {
            "Check the CAN adapter, its cable and the server behind it; recover, then home."
        }
        "BUS_OFF" => {
            "Check CAN cable, plugs, both terminating resistors and the bit rate of all nodes; recovering restarts the controller."
        }
        "BUS_ERROR_PASSIVE" => {
            "Check CAN cable, plugs, both terminating resistors and the bit rate of all nodes, then recover."
        }
        "BUS_QUEUE_FULL" => {
            "Nobody acknowledges frames: check that the drives have power and are connected, then recover."
        }
        "HEARTBEAT_LOST" | "SDO_NO_ANSWER" => {
            "Check the drive's supply and its place on the CAN bus; recover, then home if its reference is gone."
        }
        "UNEXPECTED_BOOT_UP" => {
            "The drive lost power or was reset: check its supply, recover, then home; its reference is gone."
        }
        "NMT_STATE_LOST" | "NMT_NO_TRANSITION" => {
            "Look for another master on the bus or an error of the drive, then recover."
        }
        "DUPLICATE_NODE_ID" => {
            "Set the DIP switches so that every drive has a number of its own, switch the drives off and on, then recover and home."
        }
        "WRONG_DEVICE" | "WRONG_NODE" => {
            "Another drive answers than before: check which drive is connected; recovering accepts it, then home."
        }
        "CONFIGURATION_MISMATCH" => {
            "Correct the drive's stored configuration or that of the axis; the detail names object, found and expected."
        }
        "STALE_PROCESS_DATA" => {
            "The drive changed and its process data did not come: check the CAN bus for lost frames, then recover."
        }
        "REFERENCE_LOST" | "NOT_HOMED" => "Recover, then home the axis.",
        "UNKNOWN_STATUSWORD" | "DRIVE_NO_TRANSITION" | "DRIVE_LEFT_OPERATION" => {
            "Look at the drive and for another master on the bus; recover, then look again before moving."
        }
        "TARGET_NOT_REACHED" => {
            "Look for what holds the axis or slips (tissue, jam, belt), free it, then recover."
        }
        reason if reason.starts_with("HOMING_") => {
            "Look where the axis stands; check switch, wiring and travel, then recover and home again."
        }
        "JAW_CLOSURE_DOUBTFUL" => {
            "The jaw does not follow its motor: look at belt, coupling and screw; recover, then home before the next bite."
        }
        "JAW_NEVER_MOVED" => {
            "Look for what blocks the jaw and whether the encoder counts when the feed is turned by hand; recover, then open it."
        }
        "POSITION_LIMITS_NOT_KEPT" | "DRIVE_HAS_POWER" => {
            "Look for another master on the bus that writes to this drive; recover, then home."
        }
        reason if reason.starts_with("JAW_") => {
            "Look at the jaw before anything else: it may hold tissue; recover, then open it or home."
        }
        _ => "Look at the axis and at the detail of the fault before recovering it.",
    }
}
