//! The arthroscope sees the bites of the phantom.

use std::ops::ControlFlow;

use arthro_geometry::phantom::{self, Coordinates, Phantom};
use arthro_geometry::{Point3, Vector3};
use arthro_planning::crescent::Crescent;
use arthro_planning::jaw::{Bite, Jaw};
use arthro_planning::view::{self, Blind, Optics, Reason, Scene, Segment, View};
use arthro_planning::voxels::Voxels;

use crate::world::{papers_case, plan};

/// An anteromedial portal: as high and as far in front as the anterolateral one, on the body's side
/// of the crescent's middle.
const PORTAL_ANTEROMEDIAL: Point3 = Point3::new(62.0, 48.0, 94.5);

/// The phantom in the axes of its crescent.
struct World {
    crescent: Crescent,
    tissue: Voxels,
    bites: Vec<Bite>,
    /// The femur's condyle: its middle and radius, mm.
    condyle: Option<(Point3, f64)>,
    portal: Point3,
    optics: Optics,
}

impl World {
    /// Bites in two rows round the body through the anterolateral portal, watched from `portal`, both
    /// in the phantom's coordinates.
    fn watched_from(portal: Point3) -> Self {
        let mesh = phantom::mesh();
        let crescent = Crescent::of(&mesh, &phantom::PORTAL_ANTEROLATERAL).unwrap();
        let tissue = Voxels::of(&mesh, &crescent, 0.5, 1.0).unwrap();
        let mut world = Self {
            portal: crescent.ct_from_meniscal.inverse() * portal,
            crescent,
            tissue,
            bites: Vec::new(),
            condyle: None,
            optics: Optics::default(),
        };
        let rows = [0.1, 0.4].map(|width_fraction| (0..10).map(move |step| (width_fraction, step)));
        for (width_fraction, step) in rows.into_iter().flatten() {
            let bite = world.bite(60.0 - 13.0 * f64::from(step), width_fraction);
            world.bites.push(bite);
        }
        world
    }

    fn bite(&self, phi_deg: f64, width_fraction: f64) -> Bite {
        let center = Phantom::default().point(Coordinates {
            phi_rad: phi_deg.to_radians(),
            width_fraction,
            height_fraction: 0.5,
        });
        let portal = phantom::PORTAL_ANTEROLATERAL;
        let bite = Bite::through(&portal, center, &phantom::SUPERIOR, center).unwrap();
        bite.carried(&self.crescent.ct_from_meniscal.inverse())
    }

    fn plan(&self) -> Result<Vec<View>, Blind> {
        self.plan_watched(|_| ControlFlow::Continue(()))
    }

    fn plan_watched(&self, watch: impl FnMut(f64) -> ControlFlow<()>) -> Result<Vec<View>, Blind> {
        let scene = Scene {
            portal: self.portal,
            bites: &self.bites,
            jaw: Jaw::new(3.0, 4.5),
            forceps_radius_mm: 1.75,
            tissue: &self.tissue,
            bone_mm: &|shaft| {
                self.condyle.map_or(f64::INFINITY, |(middle, radius_mm)| {
                    let middle = Segment {
                        from: middle,
                        to: middle,
                    };
                    shaft.distance_mm(&middle) - radius_mm
                })
            },
            optics: &self.optics,
        };
        view::plan(&scene, watch)
    }

    fn reason(&self) -> (usize, Reason) {
        match self.plan() {
            Err(Blind::Bite { bite, reason }) => (bite, reason),
            other => panic!("{other:?}"),
        }
    }
}

/// The simulator's: 30 deg from the middle of the body towards the anterior side, 14 mm high, as far
/// from the middle of the hole as the anterolateral portal.
fn portal_over_the_body() -> Point3 {
    let center = Phantom::default().center;
    let skin_mm = (phantom::PORTAL_ANTEROLATERAL - center).norm();
    let flat_mm = (skin_mm * skin_mm - 14.0 * 14.0).sqrt();
    let (sin, cos) = 30f64.to_radians().sin_cos();
    center + phantom::SUPERIOR * 14.0 + Vector3::new(0.0, cos, sin) * flat_mm
}

fn both_portals() -> [World; 2] {
    [portal_over_the_body(), PORTAL_ANTEROMEDIAL].map(World::watched_from)
}

#[test]
fn every_bite_is_seen_from_either_portal_within_all_limits() {
    for world in both_portals() {
        let views = world.plan().unwrap();
        assert_eq!(views.len(), world.bites.len());
        let optics = &world.optics;
        for (view, bite) in views.iter().zip(&world.bites) {
            assert!(optics.distance_mm.contains(&view.distance_mm), "{view:?}");
            assert!(optics.depth_mm.contains(&view.depth_mm), "{view:?}");
            assert!(optics.roll_rad.contains(&view.roll_rad), "{view:?}");
            assert!(view.bite_offset_rad < optics.reach_rad(), "{view:?}");
            assert!(view.forceps_clearance_mm >= 2.0, "{view:?}");
            assert!(view.occluded_percent <= 25.0, "{view:?}");
            let tip_mm = world.tissue.distance_mm(&view.tip, 2.0);
            assert!(
                tip_mm.is_none_or(|mm| mm >= optics.shaft_radius_mm),
                "{view:?}"
            );
            // What the figures say is where the shaft is.
            let tip = world.portal + view.approach * view.depth_mm;
            assert!((tip - view.tip).norm() < 1e-9);
            let towards = bite.center - view.tip;
            assert!((view.optical_axis.angle(&towards) - view.bite_offset_rad).abs() < 1e-9);
            assert!((view.optical_axis.angle(&view.approach) - optics.tilt_rad).abs() < 1e-9);
        }
    }
}

#[test]
fn the_bites_are_near_the_middle_of_the_image_and_the_arthroscope_moves_little() {
    for world in both_portals() {
        let views = world.plan().unwrap();
        let count = views.len() as f64;
        let mean_rad = views.iter().map(|view| view.bite_offset_rad).sum::<f64>() / count;
        assert!(mean_rad < 0.5 * world.optics.reach_rad(), "{mean_rad} rad");
        let moves = views
            .windows(2)
            .map(|pair| (pair[1].tip - pair[0].tip).norm());
        let mean_mm = moves.sum::<f64>() / (count - 1.0);
        // Bites of one row lie 3 mm apart, the rows 30 mm.
        assert!(mean_mm < 4.0, "{mean_mm} mm");
    }
}

#[test]
fn what_lies_behind_the_free_edge_is_hidden_from_over_the_body() {
    let mut world = World::watched_from(portal_over_the_body());
    world.portal.z = 6.0;
    world.optics.depth_mm = 5.0..=25.0;
    world.optics.occluded_max_percent = 0.0;
    world.bites = vec![world.bite(-20.0, 0.02)];
    let (_, reason) = world.reason();
    let Reason::Occluded { percent, .. } = reason else {
        panic!("{reason:?}");
    };
    assert!(percent > 10.0, "{percent} %");
    // One sight of nine is hidden: who puts up with that sees the bite.
    world.optics.occluded_max_percent = percent;
    assert_eq!(world.plan().unwrap().len(), 1);
}

#[test]
fn forceps_through_the_arthroscopes_portal_are_too_close() {
    let mut world = World::watched_from(portal_over_the_body());
    let center = world.bites[5].center;
    world.bites[5] = Bite::through(&world.portal, center, &Vector3::z(), center).unwrap();
    let (bite, reason) = world.reason();
    assert_eq!((bite, reason.code()), (5, "SHAFTS_TOO_CLOSE"));
}

#[test]
fn the_bites_of_a_plan_are_seen() {
    let plan = plan(&papers_case()).unwrap();
    for mut world in both_portals() {
        let meniscal_from_ct = world.crescent.ct_from_meniscal.inverse();
        let bites = plan.bites.iter();
        world.bites = bites
            .map(|planned| planned.bite.carried(&meniscal_from_ct))
            .collect();
        assert_eq!(world.plan().unwrap().len(), plan.bites.len());
    }
}

#[test]
fn a_straight_view_of_a_narrow_field_that_may_not_turn_is_out_of_view() {
    let mut world = World::watched_from(portal_over_the_body());
    world.optics.field_of_view_rad = 20f64.to_radians();
    world.optics.roll_rad = -0.7..=-0.6;
    let (_, reason) = world.reason();
    let Reason::OutOfView {
        angle_rad,
        limit_rad,
    } = reason
    else {
        panic!("{reason:?}");
    };
    assert!(angle_rad > limit_rad && limit_rad == world.optics.reach_rad());
}

#[test]
fn a_portal_out_of_reach_of_the_bites_is_a_matter_of_depth() {
    let mut world = World::watched_from(portal_over_the_body());
    world.portal *= 5.0;
    let (_, reason) = world.reason();
    assert!(
        matches!(reason, Reason::DepthRange { depth_mm, high_mm: 100.0, .. } if depth_mm > 100.0)
    );
}

/// A condyle of 24 mm over the middle of the hole, `gap_mm` above the tibia.
fn condyle(gap_mm: f64) -> Option<(Point3, f64)> {
    Some((Point3::new(0.0, 0.0, gap_mm - 2.0 + 24.0), 24.0))
}

#[test]
fn the_arthroscope_looks_past_the_femur_of_an_opened_joint() {
    let mut world = World::watched_from(portal_over_the_body());
    world.condyle = condyle(8.0);
    let (middle, radius_mm) = condyle(8.0).unwrap();
    for view in world.plan().unwrap() {
        let free_mm = (view.tip - middle).norm() - radius_mm - world.optics.shaft_radius_mm;
        assert!(free_mm >= world.optics.bone_clearance_min_mm, "{view:?}");
    }
}

#[test]
fn a_portal_inside_a_bone_is_named() {
    let mut world = World::watched_from(PORTAL_ANTEROMEDIAL);
    world.condyle = Some((world.portal, 10.0));
    let (_, reason) = world.reason();
    assert_eq!(
        reason,
        Reason::ShaftHitsBone {
            clearance_mm: -12.0,
            limit_mm: 0.5
        }
    );
}

#[test]
fn the_same_scene_has_the_same_views_and_a_watcher_can_end_the_search() {
    let world = World::watched_from(portal_over_the_body());
    assert_eq!(world.plan(), world.plan());
    let ended = world.plan_watched(|share| {
        if share < 0.5 {
            ControlFlow::Continue(())
        } else {
            ControlFlow::Break(())
        }
    });
    assert_eq!(ended, Err(Blind::Cancelled));
}

#[test]
fn what_cannot_be_right_is_refused_by_name() {
    let refused = |spoil: fn(&mut World)| {
        let mut world = World::watched_from(portal_over_the_body());
        spoil(&mut world);
        match world.plan() {
            Err(Blind::Invalid { field, .. }) => field,
            other => panic!("{other:?}"),
        }
    };
    assert_eq!(refused(|world| world.portal.x = f64::NAN), "portal");
    assert_eq!(
        refused(|world| world.bites[7].center.y = f64::INFINITY),
        "bites"
    );
    assert_eq!(
        refused(|world| world.optics.distance_mm = 10.0..=1e9),
        "distance_max_mm"
    );
}

#[test]
fn no_bites_need_no_views() {
    let mut world = World::watched_from(portal_over_the_body());
    world.bites.clear();
    assert_eq!(world.plan(), Ok(Vec::new()));
}
