use arthro_geometry::frame::Base;
use arthro_geometry::{Rigid, Similarity};

use super::*;
use crate::referee::body::ArmShape;
use crate::scenario::{Layout, Scenario, Spec};

fn scenario() -> Scenario {
    Scenario::phantom(Spec::default()).unwrap()
}

/// An arm whose shaft runs through a point towards another, everything else far away.
fn shaft(tip: Point3, from: Point3) -> ArmBody {
    let shape = ArmShape {
        forceps_base_from_base: Rigid::<_, Base>::new(
            arthro_geometry::Rotation::identity(),
            Vector3::new(from.x * 10.0, from.y * 10.0, 5000.0),
        ),
        flange_from_tool: Layout::default().flange_from_tool(),
        shaft_radius_mm: 1.75,
        jaw_mm: 2.25,
    };
    let along = (tip - from).normalize();
    let mut body = shape.at(&[0.0; 6]);
    body.tip = tip;
    body.along = along;
    body.shaft.ends = [tip - along * 4.0, tip - along * 200.0];
    body
}

fn outside(knee: &Knee, arm: usize) -> ArmBody {
    let portal = knee.portals()[arm];
    let out = (portal - knee.forceps_base_from_knee().origin()).normalize();
    shaft(portal + out * 20.0, portal + out * 300.0)
}

/// A tip 20 mm inside whose shaft misses the portal by `aside_mm`.
fn inside(knee: &Knee, arm: usize, aside_mm: f64) -> ArmBody {
    let portal = knee.portals()[arm];
    let inwards = (knee.forceps_base_from_knee().origin() - portal).normalize();
    let aside = inwards.cross(&Vector3::z()).normalize() * aside_mm;
    let on_shaft = portal + aside;
    shaft(on_shaft + inwards * 20.0, on_shaft - inwards * 200.0)
}

#[test]
fn the_distance_to_the_portal_counts_only_while_inside() {
    let knee = Knee::new(&scenario());
    let mut referee = Referee::default();
    referee.tick(0.0, &[outside(&knee, 0), outside(&knee, 1)], &knee);
    assert_eq!(referee.shafts()[0], ShaftAccount::default());
    for aside_mm in [0.3, 0.1, 0.0] {
        referee.tick(0.0, &[inside(&knee, 0, aside_mm), outside(&knee, 1)], &knee);
    }
    let [forceps, arthroscope] = referee.shafts();
    assert!((forceps.rcm_max_mm - 0.3).abs() < 1e-9);
    assert!((forceps.rcm_rms_mm() - (0.1_f64 / 3.0).sqrt()).abs() < 1e-9);
    assert!((forceps.depth_max_mm - 20.0).abs() < 1e-9);
    assert_eq!((forceps.ticks_inside, forceps.insertions), (3, 1));
    assert_eq!(arthroscope.ticks_inside, 0);
}

#[test]
fn one_contact_is_one_collision_with_its_deepest_point() {
    let knee = Knee::new(&scenario());
    let mut referee = Referee::default();
    let bones = knee.bones();
    let under_condyle = bones.condyle_center - Vector3::z() * bones.condyle_radius_mm;
    let away = outside(&knee, 1);
    for below_mm in [3.0, 1.0, 0.5, 3.0, 1.0] {
        // Lies flat below the sphere, so only the distance below it matters.
        let at = |x: f64| {
            let point = under_condyle + Vector3::new(x, 0.0, -below_mm);
            *knee.forceps_base_from_knee() * point
        };
        let mut body = shaft(at(50.0), at(-100.0));
        body.shaft.ends = [at(50.0), at(-100.0)];
        referee.tick(0.0, &[body, away.clone()], &knee);
    }
    let depths: Vec<f64> = referee
        .collisions()
        .iter()
        .map(|c| c.penetration_mm)
        .collect();
    assert_eq!(
        referee.collisions()[0].between,
        ("forceps shaft", "femoral condyle")
    );
    assert!(
        depths.len() == 2 && (depths[0] - 1.25).abs() < 1e-9,
        "{depths:?}"
    );
}

#[test]
fn crossed_shafts_collide() {
    let knee = Knee::new(&scenario());
    let mut referee = Referee::default();
    let portal = knee.portals()[0];
    let away = |along: Vector3| shaft(portal + along * 100.0, portal - along * 100.0);
    referee.tick(0.0, &[away(Vector3::x()), away(Vector3::y())], &knee);
    assert_eq!(
        referee.collisions()[0].between,
        ("forceps shaft", "arthroscope shaft")
    );
}

#[test]
fn tissue_let_go_is_told_by_where() {
    let mut referee = Referee::default();
    let bite = Volume {
        healthy_mm3: 2.0,
        damaged_mm3: 3.0,
    };
    for place in [Place::Tray, Place::Inside, Place::Tray] {
        referee.jaw(jaw::Event::Bit(bite), Place::Inside);
        referee.jaw(jaw::Event::Released(bite), place);
    }
    referee.jaw(jaw::Event::Bit(Volume::default()), Place::Inside);
    let tissue = referee.tissue();
    assert_eq!((tissue.bites, tissue.empty_bites), (3, 1));
    assert_eq!(
        (tissue.delivered_mm3, tissue.dropped_inside_mm3),
        (10.0, 5.0)
    );
    assert_eq!(tissue.removed.damaged_mm3, 9.0);
}

#[test]
fn the_true_registration_scores_zero_and_a_wrong_one_its_error() {
    let scenario = scenario();
    let truth = Similarity::from(scenario.camera_from_ct());
    assert!(scenario.score(&truth).tre_max_mm < 1e-9);
    let mut claimed = truth;
    claimed.translation_mm.x += 0.7;
    let score = scenario.score(&claimed);
    for error in [
        score.tre_rms_mm,
        score.tre_max_mm,
        score.lesion_tre_rms_mm,
        score.translation_error_mm,
    ] {
        assert!((error - 0.7).abs() < 1e-9, "{score:?}");
    }
    claimed.scale = 1.02;
    assert!((scenario.score(&claimed).scale_error - 0.02).abs() < 1e-12);
}
