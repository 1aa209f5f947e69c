//! The bodies of one arm as capsules: the links of a UR5, the drive unit of the instrument, the shaft.

use arthro_geometry::frame::{Base, Flange, ForcepsBase, Tool};
use arthro_geometry::{Point3, Rigid, Vector3};
use nalgebra::{Isometry3, Translation3, UnitQuaternion};

use super::contact::Capsule;

/// Where the bodies of one arm are, mm in the forceps arm's base.
#[derive(Clone, Debug)]
pub struct ArmBody {
    /// The flange.
    pub forceps_base_from_flange: Rigid<ForcepsBase, Flange>,
    /// The tip of the shaft.
    pub tip: Point3,
    /// Unit vector along the shaft, out of the tip.
    pub along: Vector3,
    /// The shaft.
    pub shaft: Capsule,
    /// Everything behind it.
    pub links: [Capsule; 6],
}

/// What is true of one arm and its instrument.
#[derive(Clone, Debug)]
pub struct ArmShape {
    /// Where the arm stands.
    pub forceps_base_from_base: Rigid<ForcepsBase, Base>,
    /// The tool as it is really mounted.
    pub flange_from_tool: Rigid<Flange, Tool>,
    /// Radius of the shaft, mm.
    pub shaft_radius_mm: f64,
    /// How much of the shaft's end is a jaw, slimmer than the shaft and meant to reach below tissue, mm.
    pub jaw_mm: f64,
}

/// Nominal Denavit-Hartenberg row of a UR5, mm and rad.
struct Joint {
    a: f64,
    d: f64,
    alpha: f64,
}

const QUARTER: f64 = std::f64::consts::FRAC_PI_2;
const JOINTS: [Joint; 6] = [
    Joint {
        a: 0.0,
        d: 89.159,
        alpha: QUARTER,
    },
    Joint {
        a: -425.0,
        d: 0.0,
        alpha: 0.0,
    },
    Joint {
        a: -392.25,
        d: 0.0,
        alpha: 0.0,
    },
    Joint {
        a: 0.0,
        d: 109.15,
        alpha: QUARTER,
    },
    Joint {
        a: 0.0,
        d: 94.65,
        alpha: -QUARTER,
    },
    Joint {
        a: 0.0,
        d: 82.3,
        alpha: 0.0,
    },
];

/// The tubes of the upper arm and of the forearm run beside the line of the joint frames, mm.
const UPPER_ARM_ASIDE_MM: f64 = 135.85;
const FOREARM_ASIDE_MM: f64 = 16.15;
const UPPER_ARM_RADIUS_MM: f64 = 60.0;
const FOREARM_RADIUS_MM: f64 = 50.0;
const WRIST_RADIUS_MM: f64 = 42.0;
/// The drive unit sits on the flange.
const DRIVE_UNIT_MM: f64 = 110.0;
const DRIVE_UNIT_RADIUS_MM: f64 = 35.0;

impl ArmShape {
    /// The bodies for true joint angles.
    pub fn at(&self, joints_rad: &[f64; 6]) -> ArmBody {
        let mut frames = [Isometry3::identity(); 7];
        frames[0] = *self.forceps_base_from_base.isometry();
        for (index, joint) in JOINTS.iter().enumerate() {
            frames[index + 1] = frames[index] * joint.step(joints_rad[index]);
        }
        let at = |frame: usize, local: Vector3| frames[frame] * Point3::from(local);
        let origin = |frame: usize| at(frame, Vector3::zeros());
        let z = |mm: f64| Vector3::z() * mm;
        let capsule = |from: Point3, to: Point3, radius_mm: f64| Capsule {
            ends: [from, to],
            radius_mm,
        };
        let upper_arm = frames[1].rotation * z(UPPER_ARM_ASIDE_MM);
        let forearm = frames[1].rotation * z(FOREARM_ASIDE_MM);
        let along = frames[6].rotation * self.flange_from_tool.direction(&Vector3::x());
        let tip = at(6, self.flange_from_tool.translation_mm());
        ArmBody {
            forceps_base_from_flange: Rigid::from_isometry(frames[6]),
            tip,
            along,
            shaft: capsule(
                tip - along * (self.jaw_mm + self.shaft_radius_mm),
                at(6, z(DRIVE_UNIT_MM)),
                self.shaft_radius_mm,
            ),
            links: [
                capsule(
                    origin(1) + upper_arm,
                    origin(2) + upper_arm,
                    UPPER_ARM_RADIUS_MM,
                ),
                capsule(origin(2) + forearm, origin(3) + forearm, FOREARM_RADIUS_MM),
                capsule(origin(3), origin(4), WRIST_RADIUS_MM),
                capsule(origin(4), origin(5), WRIST_RADIUS_MM),
                capsule(origin(5), origin(6), WRIST_RADIUS_MM),
                capsule(origin(6), at(6, z(DRIVE_UNIT_MM)), DRIVE_UNIT_RADIUS_MM),
            ],
        }
    }
}

impl Joint {
    /// Rz(theta) Tz(d) Tx(a) Rx(alpha).
    fn step(&self, theta_rad: f64) -> Isometry3<f64> {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), theta_rad);
        let twist = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), self.alpha);
        let offset = turn * Vector3::new(self.a, 0.0, self.d);
        Isometry3::from_parts(Translation3::from(offset), turn * twist)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::Layout;

    #[test]
    fn the_flange_is_where_the_nominal_kinematics_put_it() {
        let shape = ArmShape {
            forceps_base_from_base: Rigid::identity(),
            flange_from_tool: Layout::default().flange_from_tool(),
            shaft_radius_mm: 1.75,
            jaw_mm: 2.25,
        };
        // All joints at zero: the arm lies along -x, the flange looks along -y (tool0 of ur_description).
        let body = shape.at(&[0.0; 6]);
        let flange = body.tip - body.along * 310.0;
        assert!(
            (flange - Point3::new(-817.25, -191.45, -5.491)).norm() < 1e-6,
            "{flange}"
        );
        assert!((body.along - Vector3::new(0.0, -1.0, 0.0)).norm() < 1e-9);
    }

    #[test]
    fn an_arm_that_points_up_has_its_tubes_above_its_base() {
        let shape = ArmShape {
            forceps_base_from_base: Rigid::identity(),
            flange_from_tool: Layout::default().flange_from_tool(),
            shaft_radius_mm: 1.75,
            jaw_mm: 2.25,
        };
        let body = shape.at(&[0.0, -QUARTER, 0.0, -QUARTER, 0.0, 0.0]);
        let [upper_arm, forearm, ..] = &body.links;
        assert!((upper_arm.ends[1].z - 514.159).abs() < 1e-6);
        assert!((forearm.ends[1].z - 906.409).abs() < 1e-6);
        // The forearm hangs on the inner side of the upper arm.
        assert!((upper_arm.ends[0].y - forearm.ends[0].y).abs() > 100.0);
    }
}
