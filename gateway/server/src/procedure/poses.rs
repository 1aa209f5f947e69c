//! Where the arms go: the approved bites carried from ct into the arms' bases, and the poses around
//! them.
//!
//! `base_from_ct = base_from_camera * camera_from_ct`. Tool frame: origin at the tip, x along the
//! shaft and out of the tip; at `forceps_rotation` 0 deg the jaw opens along z. Depth counts from the
//! portal along the shaft, positive inside.

use arthro_geometry::frame::{ArthroscopeBase, Base, Ct, ForcepsBase, Tool};
use arthro_geometry::{Point3, Rigid, Rotation, Similarity, Vector3};
use nalgebra::{Matrix3, Rotation3};

use crate::cases::case::{Plan, Registration};
use crate::config::Cell;

/// Depth of the tip before it goes in and after it came out, mm.
pub const OUTSIDE_DEPTH_MM: f64 = -5.0;
/// The arthroscope goes in at least this far, mm.
pub const VIEW_DEPTH_MIN_MM: f64 = 5.0;
/// Views nearer than this to each other are one view, mm: they keep more room to the forceps than this.
const SAME_VIEW_MM: f64 = 0.5;
/// Below this length a direction is taken as undefined, mm.
const UNDEFINED_MM: f64 = 1e-6;

/// Where the arms go in one procedure.
#[derive(Clone, Debug, PartialEq)]
pub struct Poses {
    /// In the forceps arm's base.
    pub forceps: Entry,
    /// In the arthroscope arm's base.
    pub arthroscope: Entry,
    /// The bites in order, in the forceps arm's base.
    pub bites: Vec<BitePose>,
    /// How the arthroscope watches each bite: as planned, or, without views, all from one place.
    pub views: Vec<ViewPose>,
}

/// How the arthroscope watches a bite, in its arm's base.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ViewPose {
    /// What its shaft aims at: the planned tip, or, without views, the middle of the bites.
    pub aim: Point3,
    /// How far it goes in, mm.
    pub depth_mm: f64,
}

/// How an arm stands at its portal, in its own base.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Entry {
    /// The portal.
    pub portal: Point3,
    /// Shaft from the portal towards the middle of the bites, tool z as upright as it goes.
    pub neutral: Rotation,
    /// What a pivot to the neutral direction aims at.
    pub neutral_aim: Point3,
    /// The tip [`OUTSIDE_DEPTH_MM`] deep in the neutral direction.
    pub outside_tip: Point3,
}

/// One bite in the forceps arm's base.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BitePose {
    /// Middle of the jaw: what the pivot aims at.
    pub center: Point3,
    /// How far the tip goes in, mm.
    pub depth_mm: f64,
    /// The direction in which the jaw opens; unit.
    pub opening: Vector3,
}

/// Why the plan cannot be carried into the cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PoseError {
    /// There is nothing to do.
    #[error("the plan has no bites")]
    NoBites,
    /// The middle of the bites lies on a portal, which leaves the shaft without a direction.
    #[error("the middle of the bites lies on the {0} portal")]
    AtPortal(&'static str),
}

/// Where ct lies in the forceps arm's base.
pub fn base_from_ct(registration: &Registration, cell: &Cell) -> Similarity<ForcepsBase, Ct> {
    Similarity::from(cell.forceps_base_from_camera) * registration.camera_from_ct
}

impl Poses {
    /// Carries the plan into the cell.
    pub fn of(plan: &Plan, registration: &Registration, cell: &Cell) -> Result<Self, PoseError> {
        let base_from_ct = base_from_ct(registration, cell);
        let bites: Vec<BitePose> = plan
            .bites
            .iter()
            .map(|bite| {
                let center = base_from_ct * bite.center;
                BitePose {
                    center,
                    depth_mm: (center - cell.forceps_portal).norm(),
                    opening: base_from_ct.direction(&bite.opening),
                }
            })
            .collect();
        let middle = middle_of(&bites).ok_or(PoseError::NoBites)?;
        let arthroscope_from_forceps = arthroscope_from_forceps(cell);
        let portal = cell.arthroscope_portal;
        let mut views: Vec<ViewPose> = plan
            .views
            .iter()
            .map(|view| {
                let tip = arthroscope_from_forceps * (base_from_ct * view.tip);
                ViewPose {
                    aim: tip,
                    depth_mm: (tip - portal).norm(),
                }
            })
            .collect();
        if views.iter().any(|view| view.depth_mm < UNDEFINED_MM) {
            return Err(PoseError::AtPortal("arthroscope"));
        }
        if views.is_empty() {
            let aim = arthroscope_from_forceps * middle;
            let depth_mm = (aim - portal).norm() - cell.view_distance_mm;
            let depth_mm = depth_mm.max(VIEW_DEPTH_MIN_MM);
            views = vec![ViewPose { aim, depth_mm }; bites.len()];
        }
        let aims = views.iter().map(|view| view.aim.coords);
        let middle_of_views = Point3::from(aims.sum::<Vector3>() / views.len() as f64);
        Ok(Self {
            forceps: Entry::towards(middle, cell.forceps_portal)
                .ok_or(PoseError::AtPortal("forceps"))?,
            arthroscope: Entry::towards(middle_of_views, portal)
                .ok_or(PoseError::AtPortal("arthroscope"))?,
            bites,
            views,
        })
    }

    /// Whether each bite is watched from another place than the one that the arthroscope then stands at.
    pub fn view_moves(&self) -> Vec<bool> {
        let mut stands: Option<Point3> = None;
        let portal = &self.arthroscope.portal;
        self.views
            .iter()
            .map(|view| {
                let tip = view.tip(portal);
                let moves = stands.is_none_or(|stands| (tip - stands).norm() > SAME_VIEW_MM);
                if moves {
                    stands = Some(tip);
                }
                moves
            })
            .collect()
    }
}

impl ViewPose {
    /// Where the arthroscope's tip stands while it looks, in its arm's base.
    pub fn tip(&self, portal: &Point3) -> Point3 {
        let direction = self.aim - portal;
        portal + direction * (self.depth_mm / direction.norm())
    }
}

impl Entry {
    /// The neutral stance of a shaft through `portal` towards `aim`; `None` when the two coincide.
    fn towards(aim: Point3, portal: Point3) -> Option<Self> {
        let direction = (aim - portal).try_normalize(UNDEFINED_MM)?;
        Some(Self {
            portal,
            neutral: upright(direction),
            neutral_aim: aim,
            outside_tip: portal + direction * OUTSIDE_DEPTH_MM,
        })
    }
}

/// The tool's rotation with x along the unit vector `shaft` and z as close to the base's z as it goes. A vertical shaft
/// leaves z open; the base's x then takes its place.
pub fn upright(shaft: Vector3) -> Rotation {
    let across = |up: Vector3| (up - shaft * up.dot(&shaft)).try_normalize(UNDEFINED_MM);
    let z = across(Vector3::z())
        .or_else(|| across(Vector3::x()))
        .unwrap_or_else(Vector3::y);
    let y = z.cross(&shaft);
    Rotation::from_rotation_matrix(&Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[
        shaft, y, z,
    ])))
}

/// The `forceps_rotation` in degrees at which the jaw opens along `opening`, given the measured tool pose.
///
/// A positive angle turns the jaw right-handed about the shaft (tool x). The jaw is symmetric by 180 deg, so that two
/// angles a turn serve; the one nearest to `current_deg` within the travel is taken. `None` when `opening` lies along
/// the shaft or no such angle lies within the travel.
pub fn jaw_angle_deg(
    base_from_tool: &Rigid<Base, Tool>,
    opening: &Vector3,
    current_deg: f64,
    (lowest_deg, highest_deg): (f64, f64),
) -> Option<f64> {
    let in_tool = base_from_tool.rotation().inverse() * opening;
    if in_tool.yz().norm() < UNDEFINED_MM {
        return None;
    }
    // Turning z by the angle a about x gives (0, -sin a, cos a).
    let angle_deg = (-in_tool.y).atan2(in_tool.z).to_degrees();
    let nearest = angle_deg + 180.0 * ((current_deg - angle_deg) / 180.0).round();
    [0.0, -180.0, 180.0, -360.0, 360.0]
        .into_iter()
        .map(|turn| nearest + turn)
        .find(|angle| (lowest_deg..=highest_deg).contains(angle))
}

fn arthroscope_from_forceps(cell: &Cell) -> Rigid<ArthroscopeBase, ForcepsBase> {
    cell.forceps_base_from_arthroscope_base.inverse()
}

fn middle_of(bites: &[BitePose]) -> Option<Point3> {
    let sum: Vector3 = bites.iter().map(|bite| bite.center.coords).sum();
    (!bites.is_empty()).then(|| Point3::from(sum / bites.len() as f64))
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;

    use super::*;
    use crate::cases::case::{Bite, Verdict, View};
    use crate::config::Jaw;
    use arthro_geometry::frame::Camera;
    use bytes::Bytes;
    use proptest::prelude::*;

    fn cell() -> Cell {
        Cell {
            // The camera looks down on the knee from 300 mm above it.
            forceps_base_from_camera: Rigid::new(
                Rotation::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI),
                Vector3::new(750.0, 0.0, 550.0),
            ),
            forceps_base_from_arthroscope_base: Rigid::new(
                Rotation::from_axis_angle(&Vector3::z_axis(), -FRAC_PI_2),
                Vector3::new(350.0, 750.0, 0.0),
            ),
            forceps_portal: Point3::new(700.0, 0.0, 260.0),
            arthroscope_portal: Point3::new(700.0, 380.0, 260.0),
            forceps_base_from_tool_at_tray: Rigid::new(
                Rotation::identity(),
                Vector3::new(500.0, -200.0, 300.0),
            ),
            arthroscope_rest: Point3::new(600.0, 300.0, 300.0),
            view_distance_mm: 20.0,
            joint_opening_mm: None,
            calibrations: Cell::for_tests().calibrations,
        }
    }

    fn registration() -> Registration {
        let camera_from_ct: Similarity<Camera, Ct> = Similarity::new(
            1.01,
            Rotation::identity(),
            Vector3::new(-50.0, -40.0, 240.0),
        );
        Registration {
            camera_from_ct,
            verdict: Verdict::Accept,
            reasons: Vec::new(),
            encoded: Bytes::new(),
        }
    }

    fn plan(centers: &[[f64; 3]]) -> Plan {
        let bites = centers
            .iter()
            .map(|&[x, y, z]| Bite {
                center: Point3::new(x, y, z),
                approach: Vector3::x(),
                opening: Vector3::z(),
                contour_point: Point3::new(x, y, z),
            })
            .collect();
        Plan {
            bites,
            contour: Vec::new(),
            views: Vec::new(),
            jaw: Jaw::default(),
            encoded: Bytes::new(),
        }
    }

    fn poses() -> Poses {
        let plan = plan(&[[53.0, 48.0, 61.0], [54.0, 53.0, 36.0]]);
        Poses::of(&plan, &registration(), &cell()).unwrap()
    }

    #[test]
    fn a_bite_is_carried_through_registration_and_hand_eye() {
        // camera: 1.01 * (53, 48, 61) + (-50, -40, 240) = (3.53, 8.48, 301.61); base: x + 750, -y, 550 - z.
        let bite = poses().bites[0];
        assert!((bite.center - Point3::new(753.53, -8.48, 248.39)).norm() < 1e-9);
        let depth = (bite.center - cell().forceps_portal).norm();
        assert!((bite.depth_mm - depth).abs() < 1e-12);
        assert!((bite.opening + Vector3::z()).norm() < 1e-9);
    }

    #[test]
    fn the_neutral_shaft_points_from_the_portal_to_the_middle_of_the_bites() {
        let poses = poses();
        let middle = nalgebra::center(&poses.bites[0].center, &poses.bites[1].center);
        let shaft = poses.forceps.neutral * Vector3::x();
        let expected = (middle - poses.forceps.portal).normalize();
        assert!((shaft - expected).norm() < 1e-12);
        let depth = (poses.forceps.outside_tip - poses.forceps.portal).dot(&shaft);
        assert!((depth - OUTSIDE_DEPTH_MM).abs() < 1e-9);
    }

    #[test]
    fn the_arthroscope_stays_its_view_distance_short_of_the_bites() {
        let poses = poses();
        let view = poses.views[0];
        assert_eq!(poses.views, [view; 2]);
        assert_eq!(poses.view_moves(), [true, false]);
        let gap = (view.aim - view.tip(&poses.arthroscope.portal)).norm();
        assert!((gap - 20.0).abs() < 1e-9, "{gap}");
        // Both bases describe the same place.
        let middle = nalgebra::center(&poses.bites[0].center, &poses.bites[1].center);
        let back = cell().forceps_base_from_arthroscope_base * view.aim;
        assert!((back - middle).norm() < 1e-9);
    }

    #[test]
    fn the_arthroscope_stands_where_the_view_of_each_bite_has_it() {
        let mut plan = plan(&[[53.0, 48.0, 61.0], [54.0, 53.0, 36.0], [54.0, 53.0, 35.0]]);
        let view = |x| View {
            tip: Point3::new(x, 52.0, 60.0),
            approach: Vector3::x(),
            roll_rad: 0.0,
        };
        plan.views = vec![view(60.0), view(60.4), view(61.0)];
        let poses = Poses::of(&plan, &registration(), &cell()).unwrap();
        // camera: 1.01 * (60, 52, 60) + (-50, -40, 240) = (10.6, 12.52, 300.6); base: x + 750, -y, 550 - z.
        let expected = Point3::new(760.6, -12.52, 249.4);
        let tip = poses.views[0].tip(&cell().arthroscope_portal);
        let tip = cell().forceps_base_from_arthroscope_base * tip;
        assert!((tip - expected).norm() < 1e-9, "{tip}");
        // Each is held against where the arthroscope stands, so that small differences do not add up.
        assert_eq!(poses.view_moves(), [true, false, true]);
    }

    #[test]
    fn a_view_on_the_portal_leaves_the_arthroscope_without_a_direction() {
        let mut on_portal = plan(&[[53.0, 48.0, 61.0]]);
        let base_from_ct = base_from_ct(&registration(), &cell());
        let in_forceps = cell().forceps_base_from_arthroscope_base * cell().arthroscope_portal;
        on_portal.views = vec![View {
            tip: base_from_ct.inverse() * in_forceps,
            approach: Vector3::x(),
            roll_rad: 0.0,
        }];
        assert_eq!(
            Poses::of(&on_portal, &registration(), &cell()),
            Err(PoseError::AtPortal("arthroscope"))
        );
    }

    #[test]
    fn the_arthroscope_goes_in_at_least_its_least_depth() {
        let mut near = cell();
        near.view_distance_mm = 200.0;
        let plan = plan(&[[53.0, 48.0, 61.0]]);
        let poses = Poses::of(&plan, &registration(), &near).unwrap();
        assert_eq!(poses.views[0].depth_mm, VIEW_DEPTH_MIN_MM);
    }

    #[test]
    fn a_plan_without_bites_has_no_poses() {
        assert_eq!(
            Poses::of(&plan(&[]), &registration(), &cell()),
            Err(PoseError::NoBites)
        );
    }

    #[test]
    fn a_vertical_shaft_still_has_a_tool_frame() {
        for shaft in [Vector3::z(), -Vector3::z()] {
            let rotation = upright(shaft);
            assert!((rotation * Vector3::x() - shaft).norm() < 1e-12);
            assert!((rotation.norm() - 1.0).abs() < 1e-12);
        }
    }

    fn unit() -> impl Strategy<Value = Vector3> {
        (-1.0..1.0f64, -1.0..1.0f64, -1.0..1.0f64)
            .prop_map(|(x, y, z)| Vector3::new(x, y, z))
            .prop_filter("has a direction", |vector| vector.norm() > 0.05)
            .prop_map(|vector| vector.normalize())
    }

    proptest! {
        #[test]
        fn no_roll_brings_the_tool_z_closer_to_the_vertical(shaft in unit(), roll in -3.0..3.0f64) {
            let rotation = upright(shaft);
            prop_assert!((rotation * Vector3::x() - shaft).norm() < 1e-9);
            let rolled = Rotation::from_axis_angle(&Vector3::x_axis(), roll);
            let z = |rotation: Rotation| (rotation * Vector3::z()).z;
            prop_assert!(z(rotation * rolled) <= z(rotation) + 1e-9);
        }

        #[test]
        fn the_turned_jaw_opens_along_the_bite(
            shaft in unit(), roll in -3.0..3.0f64, turn in -3.0..3.0f64, current in -180.0..180.0f64
        ) {
            let turned = |angle: f64| Rotation::from_axis_angle(&Vector3::x_axis(), angle);
            let rotation = upright(shaft) * turned(roll);
            let opening = rotation * turned(turn) * Vector3::z();
            let base_from_tool = Rigid::new(rotation, Vector3::zeros());
            let travel = (-180.0, 180.0);
            let angle = jaw_angle_deg(&base_from_tool, &opening, current, travel).unwrap();
            prop_assert!((travel.0..=travel.1).contains(&angle));
            let jaw = rotation * turned(angle.to_radians()) * Vector3::z();
            prop_assert!((jaw.dot(&opening).abs() - 1.0).abs() < 1e-9);
        }

        #[test]
        fn the_jaw_turns_no_further_than_a_quarter_within_a_wide_travel(
            angle in -3.0..3.0f64, current in -180.0..180.0f64
        ) {
            let opening = Rotation::from_axis_angle(&Vector3::x_axis(), angle) * Vector3::z();
            let found =
                jaw_angle_deg(&Rigid::identity(), &opening, current, (-400.0, 400.0)).unwrap();
            prop_assert!((found - current).abs() <= 90.0 + 1e-9);
        }
    }

    #[test]
    fn an_opening_along_the_shaft_has_no_angle() {
        let travel = (-180.0, 180.0);
        assert_eq!(
            jaw_angle_deg(&Rigid::identity(), &Vector3::x(), 0.0, travel),
            None
        );
    }
}
