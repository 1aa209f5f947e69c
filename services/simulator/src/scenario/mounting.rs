//! How camera, tools, board and divot are really mounted. Nobody mounts anything exactly where the drawing has it; a
//! cell whose calibration is to be shown is one that is off.

use arthro_geometry::frame::{Board, Camera, Flange, ForcepsBase, Frame, Tool};
use arthro_geometry::{Point3, Rigid, Rotation, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use super::Spec;
use super::spec::in_range;
use crate::Error;

/// The mountings have random numbers of their own: the knee lies the same with or without them.
const STREAM: u64 = 1;

/// Bounds of what the seed draws; all zero is a cell that is as drawn.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Mounting {
    /// Camera, along each axis, mm.
    pub camera_mm: f64,
    /// Camera, about a random axis, degrees.
    pub camera_deg: f64,
    /// Tip of each tool, along each axis, mm.
    pub tool_mm: f64,
    /// Shaft of each tool, about a random axis, degrees.
    pub tool_deg: f64,
    /// Calibration board and divot, along each axis, mm.
    pub fixture_mm: f64,
    /// Calibration board, about a random axis, degrees.
    pub fixture_deg: f64,
}

/// Where things really are.
#[derive(Clone, Debug)]
pub(crate) struct Mounted {
    /// The camera.
    pub forceps_base_from_camera: Rigid<ForcepsBase, Camera>,
    /// Both tools: forceps, arthroscope.
    pub flange_from_tools: [Rigid<Flange, Tool>; 2],
    /// The calibration board on the forceps arm.
    pub flange_from_board: Rigid<Flange, Board>,
    /// The divot at rest.
    pub divot: Point3,
}

impl Mounting {
    /// A cell that nobody has calibrated: everything off by what a careful mechanic leaves.
    pub fn uncalibrated() -> Self {
        Self {
            camera_mm: 20.0,
            camera_deg: 4.0,
            tool_mm: 2.0,
            tool_deg: 0.5,
            fixture_mm: 4.0,
            fixture_deg: 2.0,
        }
    }

    /// Refuses bounds out of range.
    pub(super) fn checked(&self) -> Result<(), Error> {
        for (field, value) in [
            ("scenario.mounting.camera_mm", self.camera_mm),
            ("scenario.mounting.tool_mm", self.tool_mm),
            ("scenario.mounting.fixture_mm", self.fixture_mm),
        ] {
            in_range(field, value, 0.0..=50.0, "0 .. 50 mm")?;
        }
        for (field, value) in [
            ("scenario.mounting.camera_deg", self.camera_deg),
            ("scenario.mounting.tool_deg", self.tool_deg),
            ("scenario.mounting.fixture_deg", self.fixture_deg),
        ] {
            in_range(field, value, 0.0..=20.0, "0 .. 20 degrees")?;
        }
        Ok(())
    }
}

impl Mounted {
    /// The layout, off by what the seed draws.
    pub fn of(spec: &Spec) -> Self {
        let (layout, off) = (&spec.layout, &spec.mounting);
        let mut rng = ChaCha8Rng::seed_from_u64(spec.seed);
        rng.set_stream(STREAM);
        let drawn = layout.flange_from_tool();
        Self {
            forceps_base_from_camera: layout.forceps_base_from_camera()
                * displaced(&mut rng, off.camera_mm, off.camera_deg),
            flange_from_tools: [
                drawn * displaced(&mut rng, off.tool_mm, off.tool_deg),
                drawn * displaced(&mut rng, off.tool_mm, off.tool_deg),
            ],
            flange_from_board: layout.flange_from_board()
                * displaced(&mut rng, off.fixture_mm, off.fixture_deg),
            divot: Point3::from(layout.divot_mm) + shift(&mut rng, off.fixture_mm),
        }
    }
}

fn displaced<F: Frame>(rng: &mut ChaCha8Rng, mm: f64, deg: f64) -> Rigid<F, F> {
    let shift = shift(rng, mm);
    let axis = shift_of_one(rng)
        .try_normalize(1e-6)
        .unwrap_or_else(Vector3::z);
    let angle_rad = rng.random_range(-1.0..=1.0) * deg.to_radians();
    Rigid::new(Rotation::from_scaled_axis(axis * angle_rad), shift)
}

fn shift(rng: &mut ChaCha8Rng, mm: f64) -> Vector3 {
    shift_of_one(rng) * mm
}

fn shift_of_one(rng: &mut ChaCha8Rng) -> Vector3 {
    Vector3::from_fn(|_, _| rng.random_range(-1.0..=1.0))
}
