//! The modes a controller reports, with the numbers of the RTDE guide and the words of the dashboard.

use std::fmt;

macro_rules! codes {
    ($(#[$doc:meta])* $name:ident { $($(#[$variant_doc:meta])* $variant:ident = $code:literal $word:literal,)* }) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        pub enum $name {
            $($(#[$variant_doc])* $variant,)*
            /// A number this crate does not know.
            Unknown(i32),
        }

        impl $name {
            /// The number on the wire.
            pub fn code(self) -> i32 {
                match self { $(Self::$variant => $code,)* Self::Unknown(code) => code }
            }

            /// From the number on the wire.
            pub fn from_code(code: i32) -> Self {
                match code { $($code => Self::$variant,)* other => Self::Unknown(other) }
            }
        }

        impl std::str::FromStr for $name {
            type Err = ();

            /// From the dashboard's word.
            fn from_str(word: &str) -> Result<Self, ()> {
                match word { $($word => Ok(Self::$variant),)* _ => Err(()) }
            }
        }

        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                match self { $(Self::$variant => f.write_str($word),)* Self::Unknown(code) => write!(f, "UNKNOWN({code})") }
            }
        }
    };
}

codes! {
    /// Power and brakes of the arm.
    RobotMode {
        /// The controller is not there.
        NoController = -1 "NO_CONTROLLER",
        /// The arm is not there.
        Disconnected = 0 "DISCONNECTED",
        /// Waits for a person to confirm the safety settings.
        ConfirmSafety = 1 "CONFIRM_SAFETY",
        /// Starting.
        Booting = 2 "BOOTING",
        /// No power at the arm.
        PowerOff = 3 "POWER_OFF",
        /// Power is coming up.
        PowerOn = 4 "POWER_ON",
        /// Powered, brakes on.
        Idle = 5 "IDLE",
        /// Brakes can be pushed.
        Backdrive = 6 "BACKDRIVE",
        /// Powered, brakes off.
        Running = 7 "RUNNING",
        /// Firmware update.
        UpdatingFirmware = 8 "UPDATING_FIRMWARE",
    }
}

codes! {
    /// What the safety system allows.
    SafetyMode {
        /// Everything.
        Normal = 1 "NORMAL",
        /// Reduced limits.
        Reduced = 2 "REDUCED",
        /// Stopped by a collision or a broken limit.
        ProtectiveStop = 3 "PROTECTIVE_STOP",
        /// Outside its limits, may be moved back.
        Recovery = 4 "RECOVERY",
        /// Safeguard input.
        SafeguardStop = 5 "SAFEGUARD_STOP",
        /// External emergency stop.
        SystemEmergencyStop = 6 "SYSTEM_EMERGENCY_STOP",
        /// Emergency stop button.
        RobotEmergencyStop = 7 "ROBOT_EMERGENCY_STOP",
        /// Safety limit broken.
        Violation = 8 "VIOLATION",
        /// Hardware fault.
        Fault = 9 "FAULT",
        /// Joint identity not confirmed.
        ValidateJointId = 10 "VALIDATE_JOINT_ID",
        /// Not defined.
        Undefined = 11 "UNDEFINED_SAFETY_MODE",
        /// Safeguard input of the automatic mode, e-Series.
        AutomaticModeSafeguardStop = 12 "AUTOMATIC_MODE_SAFEGUARD_STOP",
        /// Enabling device released, e-Series.
        ThreePositionEnablingStop = 13 "SYSTEM_THREE_POSITION_ENABLING_STOP",
    }
}

impl SafetyMode {
    /// The arm may move.
    pub fn allows_motion(self) -> bool {
        matches!(self, Self::Normal | Self::Reduced)
    }
}

codes! {
    /// Whether a program runs.
    RuntimeState {
        /// Ending.
        Stopping = 0 "STOPPING",
        /// None runs.
        Stopped = 1 "STOPPED",
        /// Runs.
        Playing = 2 "PLAYING",
        /// Pausing.
        Pausing = 3 "PAUSING",
        /// Paused.
        Paused = 4 "PAUSED",
        /// Resuming.
        Resuming = 5 "RESUMING",
    }
}
