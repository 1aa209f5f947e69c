//! Objects of CiA 301, 0x1000 to 0x1FFF, but for the process data records.

use super::objects;
use crate::entry::Rules;

objects! {
    /// CiA profile number 402 and the kind of drive.
    DEVICE_TYPE: u32 = 0x1000, 0, "device type", "", Rules::ro(0x0002_0192);
    /// Bits of the errors that are present.
    ERROR_REGISTER: u8 = 0x1001, 0, "error register", "", Rules::ro(0);
    /// How many errors are remembered; writing 0 clears them.
    ERROR_HISTORY_COUNT: u8 = 0x1003, 0, "number of errors", "", Rules::rw(0).one_of(&[0]);
    /// COB-ID of SYNC; this drive consumes it alone.
    SYNC_COB_ID: u32 = 0x1005, 0, "cob-id sync", "", Rules::ro(0x80);
    /// Takes [`SAVE_SIGNATURE`](super::SAVE_SIGNATURE).
    STORE_ALL: u32 = 0x1010, 1, "save all parameters", "", Rules::rw(1);
    /// Takes [`LOAD_SIGNATURE`](super::LOAD_SIGNATURE); acts with the next reset.
    RESTORE_ALL: u32 = 0x1011, 1, "restore all default parameters", "", Rules::rw(1);
    /// COB-ID of emergencies.
    EMCY_COB_ID: u32 = 0x1014, 0, "cob-id emcy", "", Rules::ro(0x80).plus_node_id();
    /// `node << 16 | timeout in ms` of a heartbeat that the drive expects; 0 is off.
    CONSUMER_HEARTBEAT_1: u32 = 0x1016, 1, "consumer 1 heartbeat time", "", Rules::rw(0).between(0, 0x007F_FFFF);
    /// Likewise, of another node.
    CONSUMER_HEARTBEAT_2: u32 = 0x1016, 2, "consumer 2 heartbeat time", "", Rules::rw(0).between(0, 0x007F_FFFF);
    /// Period of the drive's own heartbeat; 0 is off.
    PRODUCER_HEARTBEAT: u16 = 0x1017, 0, "producer heartbeat time", "ms", Rules::rw(0);
    /// 0x000000FB for maxon.
    VENDOR_ID: u32 = 0x1018, 1, "vendor id", "", Rules::ro(0x0000_00FB);
    /// Hardware in the upper word, 0 in the lower: 0x60500000 is the Compact 24/1.5 CAN.
    PRODUCT_CODE: u32 = 0x1018, 2, "product code", "", Rules::ro(0x6050_0000);
    /// Firmware in the upper word: 0x01700000 is 0x0170.
    REVISION_NUMBER: u32 = 0x1018, 3, "revision number", "", Rules::ro(0x0170_0000);
    /// Of this very drive.
    SERIAL_NUMBER: u32 = 0x1018, 4, "serial number", "", Rules::ro(0);
    /// What a communication error does to the NMT state: 0 pre-operational, 1 nothing, 2 stopped.
    COMMUNICATION_ERROR_BEHAVIOUR: u8 = 0x1029, 1, "communication error behaviour", "", Rules::rw(0).between(0, 2);
    /// COB-ID of SDO requests.
    SDO_REQUEST_COB_ID: u32 = 0x1200, 1, "cob-id sdo client to server", "", Rules::ro(0x600).plus_node_id();
    /// COB-ID of SDO responses.
    SDO_RESPONSE_COB_ID: u32 = 0x1200, 2, "cob-id sdo server to client", "", Rules::ro(0x580).plus_node_id();
}
