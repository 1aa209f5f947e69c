//! The frames of the cell as types.
//!
//! A frame carries no value; it exists so that composing the wrong transforms does not compile.

/// A coordinate frame known by name.
pub trait Frame: Copy + Clone + std::fmt::Debug + Send + Sync + 'static {
    /// The name used in messages and files.
    const NAME: &'static str;
}

macro_rules! frames {
    ($($(#[$doc:meta])* $name:ident = $text:literal;)*) => {$(
        $(#[$doc])*
        #[derive(Copy, Clone, Debug, PartialEq, Eq)]
        pub struct $name;
        impl Frame for $name {
            const NAME: &'static str = $text;
        }
    )*};
}

frames! {
    /// DICOM patient axes, LPS: +x left, +y posterior, +z superior.
    Ct = "ct";
    /// Optical axes: x right, y down, z forward.
    Camera = "camera";
    /// Base of the arm in question, UR convention.
    Base = "base";
    /// Base of the forceps arm, the common frame of a cell.
    ForcepsBase = "forceps_base";
    /// Base of the arthroscope arm.
    ArthroscopeBase = "arthroscope_base";
    /// Output flange of an arm, z out of the flange.
    Flange = "flange";
    /// Tool: origin at the tip, x along the shaft and out of the tip (Eq. 11 of the paper).
    Tool = "tool";
    /// Calibration board: x along its rows, y along its columns, z away from what looks at it.
    Board = "board";
    /// Portal: the point in the skin that the shaft pivots about.
    Portal = "portal";
}
