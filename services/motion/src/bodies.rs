//! The bodies of one arm as capsules: base, links, drive unit and shaft.
//!
//! Links and wrists come from the nominal lengths of the arm and are rounded up; what a calibration
//! changes is less than that. The tool is where the kinematics in force put it.

use arthro_geometry::frame::{Base, Flange, Tool};
use arthro_geometry::{Point3, Rigid, Vector3};
use parry3d_f64::math::Pose3;
use parry3d_f64::query::details::distance_segment_segment;
use parry3d_f64::shape::Segment;
use serde::{Deserialize, Serialize};

use crate::kinematics::links::Links;
use crate::kinematics::model::Make;
use crate::kinematics::{Joints, ToolArm};
use crate::rcm::shaft;

/// How many bodies an arm has.
pub const BODIES: usize = 10;

/// One body of an arm.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Body {
    /// The column that carries joint 1.
    Base,
    /// The housings of joints 1 and 2, out to the upper arm.
    Shoulder,
    /// Between joints 2 and 3.
    UpperArm,
    /// The housing of joint 3, from the upper arm to the forearm.
    Elbow,
    /// Between joints 3 and 4.
    Forearm,
    /// The housings of joints 4, 5 and 6.
    Wrist1,
    /// See [`Body::Wrist1`].
    Wrist2,
    /// See [`Body::Wrist1`].
    Wrist3,
    /// What drives the instrument, on the flange.
    DriveUnit,
    /// From the drive unit to the tip.
    Shaft,
}

const BASE_RADIUS_MM: f64 = 75.0;
const SHOULDER_RADIUS_MM: f64 = 60.0;
const UPPER_ARM_RADIUS_MM: f64 = 60.0;
const ELBOW_RADIUS_MM: f64 = 55.0;
const FOREARM_RADIUS_MM: f64 = 50.0;
const WRIST_RADIUS_MM: f64 = 42.0;

/// What the tool is made of, seen as a body.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ToolShape {
    /// Of the shaft, mm.
    pub shaft_radius_mm: f64,
    /// Of the drive unit, from the flange along the shaft, mm.
    pub drive_unit_mm: f64,
    /// Of the drive unit about the flange's middle, mm.
    pub drive_unit_radius_mm: f64,
}

/// All places within a radius of a straight axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Capsule {
    /// The ends of the axis, mm.
    pub ends: [Point3; 2],
    /// Around it, mm.
    pub radius_mm: f64,
}

/// What an arm looks like, apart from its joints.
#[derive(Clone, Copy, Debug)]
pub struct ArmShape {
    links: Links,
    /// The tubes of upper arm and forearm, beside the line of the joints, along the axis of joint 2, mm.
    upper_arm_aside_mm: f64,
    forearm_aside_mm: f64,
    tool: ToolShape,
    tool_from_flange: Rigid<Tool, Flange>,
}

/// The bodies of one arm at one moment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bodies([Capsule; BODIES]);

impl Body {
    /// All, in the order of [`Bodies::iter`].
    pub const ALL: [Self; BODIES] = [
        Self::Base,
        Self::Shoulder,
        Self::UpperArm,
        Self::Elbow,
        Self::Forearm,
        Self::Wrist1,
        Self::Wrist2,
        Self::Wrist3,
        Self::DriveUnit,
        Self::Shaft,
    ];

    /// For people.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Base => "base",
            Self::Shoulder => "shoulder",
            Self::UpperArm => "upper arm",
            Self::Elbow => "elbow",
            Self::Forearm => "forearm",
            Self::Wrist1 => "wrist 1",
            Self::Wrist2 => "wrist 2",
            Self::Wrist3 => "wrist 3",
            Self::DriveUnit => "drive unit",
            Self::Shaft => "shaft",
        }
    }
}

impl ToolShape {
    /// An arthroscope of 4.0 mm.
    pub const ARTHROSCOPE: Self = Self {
        shaft_radius_mm: 2.0,
        drive_unit_mm: 110.0,
        drive_unit_radius_mm: 35.0,
    };

    /// The sizes by name, for checks of a configuration.
    pub fn named(&self) -> [(&'static str, f64); 3] {
        [
            ("shaft_radius_mm", self.shaft_radius_mm),
            ("drive_unit_mm", self.drive_unit_mm),
            ("drive_unit_radius_mm", self.drive_unit_radius_mm),
        ]
    }
}

/// A forceps of 3.5 mm.
impl Default for ToolShape {
    fn default() -> Self {
        Self {
            shaft_radius_mm: 1.75,
            ..Self::ARTHROSCOPE
        }
    }
}

impl ArmShape {
    /// Of an arm with its tool.
    pub fn new(arm: &ToolArm, tool: ToolShape) -> Self {
        let (upper_arm_aside_mm, forearm_aside_mm) = match arm.model().make() {
            Make::Ur5 => (135.85, 16.15),
            Make::Ur5e => (138.0, 7.0),
        };
        Self {
            links: *arm.model().links(),
            upper_arm_aside_mm,
            forearm_aside_mm,
            tool,
            tool_from_flange: arm.flange_from_tool().inverse(),
        }
    }

    /// The bodies in the arm's base, at joints that put the tool at `base_from_tool`.
    pub fn bodies(&self, joints: &Joints, base_from_tool: &Rigid<Base, Tool>) -> Bodies {
        let links = &self.links;
        let (s1, c1) = joints[0].sin_cos();
        let (s2, c2) = joints[1].sin_cos();
        let (s23, c23) = (joints[1] + joints[2]).sin_cos();
        let (s234, c234) = (joints[1] + joints[2] + joints[3]).sin_cos();
        let radial = Vector3::new(c1, s1, 0.0);
        // The axis of joints 2, 3 and 4.
        let aside = Vector3::new(s1, -c1, 0.0);
        let foot = Point3::origin();
        let shoulder = foot + Vector3::z() * links.d1_mm;
        let elbow = shoulder + radial * (links.a2_mm * c2) + Vector3::z() * (links.a2_mm * s2);
        let wrist = elbow + radial * (links.a3_mm * c23) + Vector3::z() * (links.a3_mm * s23);
        let wrist_1 = wrist + aside * links.d4_mm;
        let wrist_2 = wrist_1 + (radial * s234 - Vector3::z() * c234) * links.d5_mm;
        let flange = (*base_from_tool * self.tool_from_flange).origin();
        let (upper_arm, forearm) = (
            aside * self.upper_arm_aside_mm,
            aside * self.forearm_aside_mm,
        );

        let along = shaft(base_from_tool);
        let tip = base_from_tool.origin();
        let radius_mm = self.tool.shaft_radius_mm;
        let length_mm = (tip - flange).dot(&along) - self.tool.drive_unit_mm;
        // The cap of the capsule ends at the tip.
        let first = tip - along * radius_mm;
        let last = tip - along * length_mm.max(radius_mm);
        let capsule = |from, to, radius_mm| Capsule {
            ends: [from, to],
            radius_mm,
        };
        Bodies([
            capsule(foot, shoulder, BASE_RADIUS_MM),
            capsule(shoulder, shoulder + upper_arm, SHOULDER_RADIUS_MM),
            capsule(shoulder + upper_arm, elbow + upper_arm, UPPER_ARM_RADIUS_MM),
            capsule(elbow + upper_arm, elbow + forearm, ELBOW_RADIUS_MM),
            capsule(elbow + forearm, wrist + forearm, FOREARM_RADIUS_MM),
            capsule(wrist, wrist_1, WRIST_RADIUS_MM),
            capsule(wrist_1, wrist_2, WRIST_RADIUS_MM),
            capsule(wrist_2, flange, WRIST_RADIUS_MM),
            capsule(
                flange,
                flange + along * self.tool.drive_unit_mm,
                self.tool.drive_unit_radius_mm,
            ),
            capsule(first, last, radius_mm),
        ])
    }
}

impl Bodies {
    /// With their names.
    pub fn iter(&self) -> impl Iterator<Item = (Body, &Capsule)> {
        Body::ALL.into_iter().zip(&self.0)
    }

    /// One of them.
    pub fn get(&self, body: Body) -> &Capsule {
        &self.0[body as usize]
    }

    /// The same bodies after `change` of each point.
    pub fn map(&self, change: impl Fn(&Point3) -> Point3) -> Self {
        Self(self.0.map(|capsule| Capsule {
            ends: [change(&capsule.ends[0]), change(&capsule.ends[1])],
            radius_mm: capsule.radius_mm,
        }))
    }

    /// The farthest that an end of an axis is from where it is in `other`, mm: no place of any body moved farther.
    pub fn moved_mm(&self, other: &Self) -> f64 {
        let ends = |(a, b): (&Capsule, &Capsule)| {
            let first = (a.ends[0] - b.ends[0]).norm();
            first.max((a.ends[1] - b.ends[1]).norm())
        };
        self.0.iter().zip(&other.0).map(ends).fold(0.0, f64::max)
    }
}

impl Capsule {
    /// Free room to another, mm; negative by as much as they overlap, and for places that are no number.
    pub fn distance_mm(&self, other: &Self) -> f64 {
        let axes_mm = distance_segment_segment(&Pose3::IDENTITY, &self.segment(), &other.segment());
        unknown_is_none(axes_mm - self.radius_mm - other.radius_mm)
    }

    /// Free room that it has at least: between the spheres around both, mm.
    pub fn distance_at_least_mm(&self, other: &Self) -> f64 {
        let ((one, one_mm), (two, two_mm)) = (self.sphere(), other.sphere());
        (one - two).norm() - one_mm - two_mm
    }

    fn sphere(&self) -> (Point3, f64) {
        let half = (self.ends[1] - self.ends[0]) * 0.5;
        (self.ends[0] + half, half.norm() + self.radius_mm)
    }

    fn segment(&self) -> Segment {
        let [from, to] = self.ends;
        Segment::new(from.into(), to.into())
    }
}

/// A room that is no number must not pass for any.
pub fn unknown_is_none(room_mm: f64) -> f64 {
    if room_mm.is_nan() {
        f64::NEG_INFINITY
    } else {
        room_mm
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;

    use arthro_geometry::Rotation;

    use super::*;
    use crate::kinematics::model::Model;

    fn arm() -> ToolArm {
        ToolArm::new(
            Model::ur5(),
            Rigid::new(
                Rotation::from_axis_angle(&Vector3::y_axis(), -FRAC_PI_2),
                Vector3::new(0.0, 0.0, 310.0),
            ),
        )
    }

    fn bodies(joints: &Joints) -> Bodies {
        let arm = arm();
        let shape = ArmShape::new(&arm, ToolShape::default());
        shape.bodies(joints, &arm.base_from_tool(joints))
    }

    #[test]
    fn an_arm_that_points_up_has_its_tubes_above_its_base() {
        let bodies = bodies(&[0.0, -FRAC_PI_2, 0.0, -FRAC_PI_2, 0.0, 0.0]);
        assert!((bodies.get(Body::UpperArm).ends[1].z - 514.159).abs() < 1e-6);
        assert!((bodies.get(Body::Forearm).ends[1].z - 906.409).abs() < 1e-6);
        // The forearm hangs on the inner side of the upper arm.
        let aside = |body| bodies.get(body).ends[0].y;
        assert!((aside(Body::UpperArm) - aside(Body::Forearm)).abs() > 100.0);
    }

    #[test]
    fn neighbours_touch_each_other_all_along_the_arm() {
        let bodies = bodies(&[0.479, -1.185, -2.041, 3.004, -1.102, -1.469]);
        let all: Vec<_> = bodies.iter().collect();
        for pair in all.windows(2) {
            let gap_mm = pair[0].1.distance_mm(pair[1].1);
            assert!(gap_mm < 0.0, "{:?} {:?} {gap_mm}", pair[0].0, pair[1].0);
        }
    }

    #[test]
    fn the_shaft_ends_at_the_tip_and_begins_at_the_drive_unit() {
        let joints = [0.479, -1.185, -2.041, 3.004, -1.102, -1.469];
        let bodies = bodies(&joints);
        let pose = arm().base_from_tool(&joints);
        let axis = bodies.get(Body::Shaft);
        assert!((axis.ends[0] - (pose.origin() - shaft(&pose) * 1.75)).norm() < 1e-9);
        assert!((axis.ends[1] - (pose.origin() - shaft(&pose) * 200.0)).norm() < 1e-9);
    }
}
