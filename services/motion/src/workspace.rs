//! Half-spaces that an arm keeps to: a table, a wall, the patient's other leg, the place of the surgeon.

use arthro_geometry::{Point3, Vector3};
use serde::{Deserialize, Serialize};

use crate::bodies::{Bodies, Body, Capsule, unknown_is_none};

/// How far the norm of a plane's normal may be from 1.
const UNIT_TOLERANCE: f64 = 1e-3;

/// All places at least `offset_mm` along `normal` from the origin of the arm's base.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Plane {
    /// For people.
    pub name: String,
    /// Unit vector in the arm's base, to the side that is open.
    pub normal: [f64; 3],
    /// Of the plane along it, mm.
    pub offset_mm: f64,
    /// What of the arm must stay on the open side.
    #[serde(default = "everything")]
    pub keeps: Vec<Part>,
}

/// A part of an arm that a plane holds for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Part {
    /// The tip alone.
    Tip,
    /// The whole shaft.
    Shaft,
    /// Flange and drive unit, wrists, forearm and elbow. Not shoulder and base, which stand where they are bolted.
    Arm,
}

/// The body of an arm that is nearest to a plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Beyond<'a> {
    /// The plane's name.
    pub plane: &'a str,
    /// What is there.
    pub body: &'static str,
    /// Its free room to the plane, mm: negative beyond it.
    pub room_mm: f64,
}

impl Plane {
    /// What is wrong with it, if anything.
    pub fn fault(&self) -> Option<String> {
        let norm = Vector3::from(self.normal).norm();
        // A NaN is in no range.
        if !(..=UNIT_TOLERANCE).contains(&(norm - 1.0).abs()) {
            return Some(format!(
                "has a normal of norm {norm}; must be 1 within {UNIT_TOLERANCE}"
            ));
        }
        if !(-10_000.0..=10_000.0).contains(&self.offset_mm) {
            let offset_mm = self.offset_mm;
            return Some(format!(
                "has offset_mm {offset_mm}; must be within -10000 .. 10000"
            ));
        }
        if self.keeps.is_empty() {
            return Some("keeps nothing; must keep tip, shaft or arm".to_owned());
        }
        None
    }

    /// Free room of what it holds for, mm, and of which body: the least.
    fn room(&self, tip: &Point3, bodies: &Bodies) -> (f64, &'static str) {
        let mut least = (f64::INFINITY, "nothing");
        let mut take = |room_mm: f64, what: &'static str| {
            if room_mm < least.0 {
                least = (room_mm, what);
            }
        };
        for part in &self.keeps {
            match part {
                Part::Tip => take(self.height_mm(tip), "tip"),
                Part::Shaft => take(self.room_of(bodies.get(Body::Shaft)), "shaft"),
                Part::Arm => {
                    for body in [
                        Body::Elbow,
                        Body::Forearm,
                        Body::Wrist1,
                        Body::Wrist2,
                        Body::Wrist3,
                        Body::DriveUnit,
                    ] {
                        take(self.room_of(bodies.get(body)), body.as_str());
                    }
                }
            }
        }
        least
    }

    fn room_of(&self, capsule: &Capsule) -> f64 {
        let [from, to] = capsule.ends.map(|end| self.height_mm(&end));
        from.min(to) - capsule.radius_mm
    }

    fn height_mm(&self, point: &Point3) -> f64 {
        unknown_is_none(Vector3::from(self.normal).dot(&point.coords) - self.offset_mm)
    }
}

/// The least free room to any of the planes, if there are any.
pub fn least_room<'a>(planes: &'a [Plane], tip: &Point3, bodies: &Bodies) -> Option<Beyond<'a>> {
    let rooms = planes.iter().map(|plane| {
        let (room_mm, body) = plane.room(tip, bodies);
        Beyond {
            plane: &plane.name,
            body,
            room_mm,
        }
    });
    rooms.min_by(|a, b| a.room_mm.total_cmp(&b.room_mm))
}

fn everything() -> Vec<Part> {
    vec![Part::Tip, Part::Shaft, Part::Arm]
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;

    use arthro_geometry::{Rigid, Rotation};

    use super::*;
    use crate::bodies::{ArmShape, ToolShape};
    use crate::kinematics::ToolArm;
    use crate::kinematics::model::Model;

    const JOINTS: [f64; 6] = [0.479, -1.185, -2.041, 3.004, -1.102, -1.469];

    fn plane(normal: [f64; 3], offset_mm: f64, keeps: &[Part]) -> Plane {
        Plane {
            name: "table".to_owned(),
            normal,
            offset_mm,
            keeps: keeps.to_vec(),
        }
    }

    fn room(plane: Plane) -> (f64, &'static str) {
        let arm = ToolArm::new(
            Model::ur5(),
            Rigid::new(
                Rotation::from_axis_angle(&Vector3::y_axis(), -FRAC_PI_2),
                Vector3::new(0.0, 0.0, 310.0),
            ),
        );
        let pose = arm.base_from_tool(&JOINTS);
        let shape = ArmShape::new(&arm, ToolShape::default());
        let bodies = shape.bodies(&JOINTS, &pose);
        let planes = [plane];
        let beyond = least_room(&planes, &pose.origin(), &bodies).unwrap();
        (beyond.room_mm, beyond.body)
    }

    #[test]
    fn each_part_has_its_own_room_to_a_plane() {
        let up = [0.0, 0.0, 1.0];
        let (tip_mm, _) = room(plane(up, 0.0, &[Part::Tip]));
        let (shaft_mm, what) = room(plane(up, 0.0, &[Part::Shaft]));
        assert_eq!(what, "shaft");
        // The shaft's capsule lies within its radius about an axis that ends at the tip.
        assert!((shaft_mm - tip_mm).abs() < 4.0, "{shaft_mm} {tip_mm}");
        // Under a ceiling the elbow and the forearm come first.
        let ceiling = plane(
            [0.0, 0.0, -1.0],
            -1000.0,
            &[Part::Tip, Part::Shaft, Part::Arm],
        );
        let (arm_mm, what) = room(ceiling);
        assert!(["elbow", "forearm"].contains(&what), "{what}");
        assert!(arm_mm < 1000.0 - tip_mm);
    }

    #[test]
    fn the_plane_that_leaves_the_least_room_is_told() {
        assert_eq!(
            least_room(&[], &Point3::origin(), &bodies_at_origin()),
            None
        );
        let planes = [
            plane([0.0, 0.0, 1.0], -500.0, &[Part::Tip]),
            plane([0.0, 0.0, -1.0], 100.0, &[Part::Tip]),
        ];
        let tip = Point3::new(0.0, 0.0, 40.0);
        let beyond = least_room(&planes, &tip, &bodies_at_origin()).unwrap();
        assert_eq!(beyond.room_mm, -140.0);
    }

    #[test]
    fn a_place_that_is_no_number_is_beyond_every_plane() {
        let planes = [plane([0.0, 0.0, 1.0], 0.0, &[Part::Tip])];
        let tip = Point3::new(0.0, 0.0, f64::NAN);
        let beyond = least_room(&planes, &tip, &bodies_at_origin()).unwrap();
        assert_eq!(beyond.room_mm, f64::NEG_INFINITY);
    }

    #[test]
    fn a_plane_that_means_nothing_is_refused() {
        let fault = |plane: Plane| plane.fault().unwrap();
        assert!(fault(plane([0.0, 0.0, 2.0], 0.0, &[Part::Tip])).contains("norm 2"));
        assert!(fault(plane([f64::NAN, 0.0, 1.0], 0.0, &[Part::Tip])).contains("norm NaN"));
        assert!(fault(plane([0.0, 0.0, 1.0], f64::NAN, &[Part::Tip])).contains("offset_mm NaN"));
        assert!(fault(plane([0.0, 0.0, 1.0], 0.0, &[])).contains("keeps nothing"));
        assert_eq!(plane([0.0, 0.0, 1.0], 0.0, &[Part::Arm]).fault(), None);
    }

    fn bodies_at_origin() -> Bodies {
        let arm = ToolArm::new(Model::ur5(), Rigid::identity());
        let shape = ArmShape::new(&arm, ToolShape::default());
        shape.bodies(&JOINTS, &Rigid::identity())
    }
}
