//! Where things stand in the cell: arms, portals, camera and tray.

use arthro_geometry::frame::{ArthroscopeBase, Board, Camera, Flange, ForcepsBase, Tool};
use arthro_geometry::{Point3, Rigid, Rotation, Vector3};
use nalgebra::{Matrix3, Rotation3};
use serde::{Deserialize, Serialize};

use super::KneeFrame;
use super::crescent::Crescent;
use crate::calibration_board;

/// The middle of the calibration board: beside the drive unit's axis and in front of the flange, mm.
const BOARD_ASIDE_MM: f64 = 45.0;
const BOARD_AHEAD_MM: f64 = 60.0;

/// Where things stand, in the forceps arm's base unless said otherwise.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Layout {
    /// Middle of the hole of the meniscus, mm. Superior is up, anterior faces -x.
    pub knee_mm: [f64; 3],
    /// Base of the arthroscope arm, mm.
    pub arthroscope_base_mm: [f64; 3],
    /// Its turn about z, degrees.
    pub arthroscope_base_yaw_deg: f64,
    /// From the flange to the tip along the flange's z, mm.
    pub shaft_length_mm: f64,
    /// The forceps' portal in the knee.
    pub forceps_portal: ForcepsPortal,
    /// The arthroscope's portal, on the same skin.
    pub arthroscope_portal: ArthroscopePortal,
    /// The camera looks at the knee from this far, mm.
    pub camera_distance_mm: f64,
    /// Tilt of the view from straight down, degrees.
    pub camera_tilt_deg: f64,
    /// Side it is tilted to, degrees from x about z.
    pub camera_side_deg: f64,
    /// Middle of the tray's floor, mm.
    pub tray_mm: [f64; 3],
    /// Half of the tray's edge, mm.
    pub tray_half_mm: f64,
    /// How high above the tray's floor the jaw lets go, mm.
    pub tray_release_mm: f64,
    /// Direction of the forceps' shaft over the tray.
    pub tray_shaft: [f64; 3],
    /// The divot at rest, mm.
    pub divot_mm: [f64; 3],
    /// Joints that both arms start at, rad: forceps, arthroscope.
    pub start_joints_rad: [[f64; 6]; 2],
}

/// Where the forceps enter the knee.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ForcepsPortal {
    /// In front of the anterior rim, mm.
    pub in_front_mm: f64,
    /// Above the surface that the meniscus lies on, mm.
    pub above_mm: f64,
    /// From the middle of the hole to the side the crescent opens to, mm.
    pub aside_mm: f64,
}

/// Where the arthroscope enters the knee, as far from the middle of the hole as the forceps.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ArthroscopePortal {
    /// From the middle of the body towards the anterior side, degrees about the hole.
    pub angle_deg: f64,
    /// Above the surface that the meniscus lies on, mm.
    pub above_mm: f64,
}

impl Default for Layout {
    fn default() -> Self {
        Self {
            knee_mm: [750.0, 0.0, 250.0],
            arthroscope_base_mm: [350.0, 750.0, 0.0],
            arthroscope_base_yaw_deg: -90.0,
            shaft_length_mm: 310.0,
            forceps_portal: ForcepsPortal {
                in_front_mm: 26.0,
                above_mm: 10.0,
                aside_mm: 34.0,
            },
            arthroscope_portal: ArthroscopePortal {
                angle_deg: 30.0,
                above_mm: 14.0,
            },
            camera_distance_mm: 350.0,
            camera_tilt_deg: 35.0,
            camera_side_deg: 210.0,
            tray_mm: [600.0, -250.0, 240.0],
            tray_half_mm: 60.0,
            tray_release_mm: 60.0,
            tray_shaft: [1.0, 0.0, -0.2],
            divot_mm: [380.0, -240.0, 60.0],
            start_joints_rad: [
                [0.479, -1.185, -2.041, 3.004, -1.102, -1.469],
                [0.796, -1.456, -1.861, -3.148, -1.303, -1.522],
            ],
        }
    }
}

impl Layout {
    /// Where the knee would lie without the seed's displacement.
    pub fn nominal_knee(&self) -> Rigid<ForcepsBase, KneeFrame> {
        Rigid::new(Rotation::identity(), self.knee_mm.into())
    }

    /// Both portals in the knee's frame: forceps, arthroscope. They lie on one skin, a sphere about
    /// the middle of the hole.
    pub fn portals_in_knee(&self, crescent: &Crescent) -> [Point3; 2] {
        let taught = &self.forceps_portal;
        let forceps = Point3::new(
            crescent.anterior_rim_mm - taught.in_front_mm,
            -taught.aside_mm,
            taught.above_mm,
        );
        let skin_mm = forceps.coords.norm();
        let height_mm = self.arthroscope_portal.above_mm.min(0.9 * skin_mm);
        let radius_mm = (skin_mm * skin_mm - height_mm * height_mm).sqrt();
        let angle_rad = self.arthroscope_portal.angle_deg.to_radians();
        let arthroscope = Point3::new(
            -radius_mm * angle_rad.sin(),
            radius_mm * angle_rad.cos(),
            height_mm,
        );
        [forceps, arthroscope]
    }

    /// Where the arthroscope arm stands.
    pub fn forceps_base_from_arthroscope_base(&self) -> Rigid<ForcepsBase, ArthroscopeBase> {
        Rigid::new(
            Rotation::from_scaled_axis(Vector3::z() * self.arthroscope_base_yaw_deg.to_radians()),
            self.arthroscope_base_mm.into(),
        )
    }

    /// Tip and axes of both tools: x along the shaft, which is the flange's z.
    pub fn flange_from_tool(&self) -> Rigid<Flange, Tool> {
        Rigid::new(
            Rotation::from_scaled_axis(Vector3::y() * -90f64.to_radians()),
            Vector3::z() * self.shaft_length_mm,
        )
    }

    /// The calibration board on the drive unit of the forceps: its rows run along the shaft.
    pub fn flange_from_board(&self) -> Rigid<Flange, Board> {
        // The board's z looks away from the camera, to the drive unit that it is clamped to.
        let axes = [Vector3::z(), -Vector3::x(), -Vector3::y()];
        let rotation = Rotation::from_rotation_matrix(&Rotation3::from_matrix_unchecked(
            Matrix3::from_columns(&axes),
        ));
        let middle = Vector3::new(0.0, BOARD_ASIDE_MM, BOARD_AHEAD_MM);
        Rigid::new(rotation, middle - rotation * calibration_board::middle())
    }

    /// Where the camera is as drawn.
    pub fn forceps_base_from_camera(&self) -> Rigid<ForcepsBase, Camera> {
        let (tilt, side) = (
            self.camera_tilt_deg.to_radians(),
            self.camera_side_deg.to_radians(),
        );
        let towards_camera =
            Vector3::new(tilt.sin() * side.cos(), tilt.sin() * side.sin(), tilt.cos());
        let forward = -towards_camera;
        // Rows run along the horizontal; straight down this direction still exists.
        let right = Vector3::new(side.sin(), -side.cos(), 0.0);
        let axes = [right, forward.cross(&right), forward];
        let rotation = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&axes));
        Rigid::new(
            Rotation::from_rotation_matrix(&rotation),
            Vector3::from(self.knee_mm) + towards_camera * self.camera_distance_mm,
        )
    }

    /// Tool pose over the tray, its z as far up as the shaft lets it.
    pub fn forceps_base_from_tool_at_tray(&self) -> Rigid<ForcepsBase, Tool> {
        let along = Vector3::from(self.tray_shaft)
            .try_normalize(1e-6)
            .unwrap_or_else(Vector3::x);
        let across = Vector3::z()
            .cross(&along)
            .try_normalize(1e-6)
            .unwrap_or_else(Vector3::y);
        let axes = [along, across, along.cross(&across)];
        let rotation = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&axes));
        Rigid::new(
            Rotation::from_rotation_matrix(&rotation),
            Vector3::from(self.tray_mm) + Vector3::z() * self.tray_release_mm,
        )
    }

    /// Whether something let go at this point falls into the tray.
    pub fn over_tray(&self, at: &Point3) -> bool {
        // Higher than this, it would miss.
        const DROP_MM: f64 = 150.0;
        let from_floor = at - Point3::from(self.tray_mm);
        from_floor.x.abs() <= self.tray_half_mm
            && from_floor.y.abs() <= self.tray_half_mm
            && (0.0..=DROP_MM).contains(&from_floor.z)
    }
}
