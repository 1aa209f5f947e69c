//! Whether arms may be moved by what is known of them: drawn back without a person, told a portal with
//! the tool inside, or let go on from where they stand.

use arthro_geometry::frame::{Base, Tool};
use arthro_geometry::{Point3, Rigid, Vector3};

use crate::clients::instrument::Axes;
use crate::clients::motion::{Arm, Arms, Standing};
use crate::config::Rules;
use crate::error::{Error, Result};

/// A shaft farther from a portal than this is beside the knee, whatever its depth, mm. The motion service has the same.
const PORTAL_REACH_MM: f64 = 100.0;

/// Where a tool stands to a portal, both in one arm's base.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// Of the tip beyond the portal along the shaft, mm; negative outside.
    pub depth_mm: f64,
    /// Between the portal and the shaft's line, mm.
    pub off_portal_mm: f64,
}

impl Placement {
    /// Of a measured pose to a portal.
    pub fn of(base_from_tool: &Rigid<Base, Tool>, portal: &Point3) -> Self {
        let shaft = base_from_tool.direction(&Vector3::x());
        let portal_to_tip = base_from_tool.origin() - portal;
        let depth_mm = portal_to_tip.dot(&shaft);
        Self {
            depth_mm,
            off_portal_mm: (portal_to_tip - shaft * depth_mm).norm(),
        }
    }

    /// Whether the portal may be stated for an arm that stands so: it is outside, or its shaft passes the portal.
    pub fn may_have_portal(&self, tolerance_mm: f64) -> bool {
        let beside = self.off_portal_mm > PORTAL_REACH_MM;
        self.depth_mm <= 0.0 || beside || self.off_portal_mm <= tolerance_mm
    }
}

/// Each latched fault with its device.
pub fn faults(arms: &Arms, axes: &Axes) -> Vec<String> {
    let of_arms = Arm::ALL.iter().filter_map(|arm| {
        let fault = arms.get(*arm).fault.as_ref()?;
        Some(format!("{arm} {}: {}", fault.reason, fault.detail))
    });
    let of_drives = axes
        .faults
        .iter()
        .map(|(axis, fault)| format!("{axis} {}: {}", fault.reason, fault.detail));
    of_arms.chain(of_drives).collect()
}

/// Why both arms must not be drawn back without a person's decision; `None` when they may.
pub fn why_not_draw_back(arms: &Arms, axes: &Axes) -> Option<String> {
    let faults = faults(arms, axes);
    if !faults.is_empty() {
        return Some(format!("faults are latched: {}", faults.join("; ")));
    }
    if let Some(arm) = Arm::ALL.iter().find(|arm| !arms.get(**arm).connected) {
        return Some(format!("the {arm} is not connected"));
    }
    if arms.forceps.inside && !axes.jaw.is_known() {
        return Some(format!(
            "the forceps is inside and its jaw is {}; it must be OPEN or CLOSED",
            axes.jaw
        ));
    }
    None
}

/// How far an arm's tip and tool are from where they stood, mm and deg.
pub fn moved(stood: &Rigid<Base, Tool>, stands: &Rigid<Base, Tool>) -> (f64, f64) {
    let moved_mm = (stands.origin() - stood.origin()).norm();
    let moved_rad = stood.rotation().angle_to(&stands.rotation());
    (moved_mm, moved_rad.to_degrees())
}

/// Refuses with POSE_MOVED when an arm is not where it stood.
pub fn stand_where_they_stood(stood: &Standing, arms: &Arms, rules: &Rules) -> Result<()> {
    for arm in Arm::ALL {
        let (moved_mm, moved_deg) = moved(stood.get(*arm), &arms.get(*arm).base_from_tool);
        let near = moved_mm <= rules.pose_tolerance_mm && moved_deg <= rules.pose_tolerance_deg;
        if !near {
            return Err(Error::PoseMoved {
                arm: *arm,
                moved_mm,
                moved_deg,
                limit_mm: rules.pose_tolerance_mm,
                limit_deg: rules.pose_tolerance_deg,
            });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use arthro_geometry::Rotation;

    use super::*;
    use crate::clients::Fault;
    use crate::clients::instrument::Jaw;
    use crate::clients::motion::ArmState;
    use crate::config::PauseMode;

    const RULES: Rules = Rules {
        pause: PauseMode::Hold,
        pose_tolerance_mm: 1.0,
        pose_tolerance_deg: 1.0,
        portal_tolerance_mm: 5.0,
    };

    fn at(x: f64, turned_deg: f64) -> Rigid<Base, Tool> {
        let turn = Rotation::from_axis_angle(&Vector3::z_axis(), turned_deg.to_radians());
        Rigid::new(turn, Vector3::new(x, 0.0, 0.0))
    }

    fn arm(inside: bool) -> ArmState {
        ArmState {
            controller_time_s: 0.0,
            base_from_tool: at(0.0, 0.0),
            inside,
            moving: false,
            connected: true,
            fault: None,
        }
    }

    fn arms() -> Arms {
        Arms {
            forceps: arm(true),
            arthroscope: arm(true),
        }
    }

    fn fault(reason: &str) -> Fault {
        Fault {
            reason: reason.to_owned(),
            detail: "cut".to_owned(),
        }
    }

    #[test]
    fn a_jaw_in_tissue_that_nobody_knows_is_not_drawn_back() {
        for jaw in Jaw::ALL {
            let why = why_not_draw_back(&arms(), &Axes::standing(*jaw, Vec::new()));
            assert_eq!(why.is_none(), jaw.is_known(), "{jaw}");
        }
    }

    #[test]
    fn an_unknown_jaw_outside_keeps_nobody_inside() {
        let mut arms = arms();
        arms.forceps.inside = false;
        assert_eq!(
            why_not_draw_back(&arms, &Axes::standing(Jaw::Unknown, Vec::new())),
            None
        );
    }

    #[test]
    fn a_fault_of_any_device_is_named_and_keeps_the_arms_where_they_are() {
        let mut arms = arms();
        arms.arthroscope.fault = Some(fault("STATE_STALE"));
        let lost = vec![("FORCEPS_FEED", fault("HEARTBEAT_LOST"))];
        let why = why_not_draw_back(&arms, &Axes::standing(Jaw::Open, lost)).unwrap();
        assert!(why.contains("ARTHROSCOPE STATE_STALE: cut"), "{why}");
        assert!(why.contains("FORCEPS_FEED HEARTBEAT_LOST: cut"), "{why}");
    }

    #[test]
    fn an_arm_that_is_out_of_sight_or_moves_stands_nowhere() {
        let mut unseen = arms();
        unseen.forceps.connected = false;
        assert!(unseen.standing(0).is_none());
        assert!(why_not_draw_back(&unseen, &Axes::standing(Jaw::Open, Vec::new())).is_some());
        let mut moving = arms();
        moving.arthroscope.moving = true;
        assert!(moving.standing(0).is_none());
    }

    #[test]
    fn a_shift_or_a_turn_beyond_the_limit_is_refused_with_both_numbers() {
        let stood = arms().standing(0).unwrap();
        let mut moved = arms();
        moved.forceps.base_from_tool = at(0.99, 0.99);
        stand_where_they_stood(&stood, &moved, &RULES).unwrap();
        for pose in [at(1.01, 0.0), at(0.0, 1.01), at(f64::NAN, 0.0)] {
            moved.arthroscope.base_from_tool = pose;
            let refusal = stand_where_they_stood(&stood, &moved, &RULES).unwrap_err();
            assert_eq!(refusal.reason(), "POSE_MOVED");
            assert!(refusal.to_string().contains("ARTHROSCOPE"), "{refusal}");
        }
    }

    #[test]
    fn a_portal_is_stated_with_the_tool_inside_only_if_the_shaft_passes_it() {
        let placed =
            |depth: f64, off: f64| Placement::of(&at(0.0, 0.0), &Point3::new(-depth, off, 0.0));
        let inside = placed(30.0, 4.0);
        assert!((inside.depth_mm - 30.0).abs() < 1e-12);
        assert!((inside.off_portal_mm - 4.0).abs() < 1e-12);
        assert!(inside.may_have_portal(5.0));
        assert!(!placed(30.0, 6.0).may_have_portal(5.0));
        assert!(placed(-30.0, 6.0).may_have_portal(5.0), "outside");
        assert!(placed(30.0, 150.0).may_have_portal(5.0), "beside the knee");
    }
}
