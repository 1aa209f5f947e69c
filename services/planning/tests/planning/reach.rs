//! Which bites a straight forceps can reach.

use std::path::PathBuf;

use arthro_geometry::mesh::NearestOnMesh;
use arthro_geometry::ply::{self, Space, Stated, Unit};
use arthro_geometry::{Mesh, Point3, Vector3, phantom};
use arthro_planning::Error;
use arthro_planning::crescent::Crescent;
use arthro_planning::jaw::{Bite, Jaw};
use arthro_planning::reach::{
    Bone, BoneName, Capsule, Cause, ERROR_MM, Generic, Joint, KeepOut, Limits, MARGIN_MM, Obstacle,
    Reach, Shaft, shafts_mm,
};
use proptest::prelude::*;
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

#[path = "../../benches/reach/knee.rs"]
mod knee;

const JAW: Jaw = Jaw {
    width_mm: 3.0,
    length_mm: 4.5,
    throat_mm: 1.0,
};
/// How much a facetted ball of radius 24 mm lies inside the true one, mm, at most.
const FACET_MM: f64 = 0.05;

fn no_tissue(_: &Point3) -> bool {
    false
}

fn bite_through(portal: &Point3, center: Point3) -> Bite {
    Bite::through(portal, center, &Vector3::z(), center).unwrap()
}

/// A joint of the phantom without scanned bones, the portal and the crescent.
fn phantom_joint(gap_mm: f64) -> (Joint, Point3, Crescent) {
    let mesh = phantom::mesh();
    let crescent = Crescent::of(&mesh, &phantom::PORTAL_ANTEROLATERAL).unwrap();
    let local = crescent.localize(&mesh);
    let joint = Generic::default().joint(&local, gap_mm).unwrap();
    let portal = crescent.ct_from_meniscal.inverse() * phantom::PORTAL_ANTEROLATERAL;
    (joint, portal, crescent)
}

/// Bites all along the crescent at a share of its width.
fn bites_along(crescent: &Crescent, portal: &Point3, share: f64) -> Vec<Bite> {
    crescent
        .rays()
        .step_by(8)
        .map(|angle_rad| {
            let (edge, rim) = (crescent.edge_mm(angle_rad), crescent.rim_mm(angle_rad));
            let radius_mm = (1.0 - share) * edge.unwrap() + share * rim.unwrap();
            let (sin, cos) = angle_rad.sin_cos();
            bite_through(portal, Point3::new(radius_mm * cos, radius_mm * sin, -1.0))
        })
        .collect()
}

fn knee_reach(opening_mm: f64, limits: Limits) -> Reach {
    let joint = Joint {
        femur: Some(Obstacle::Mesh(knee::femur())),
        tibia: Some(Obstacle::Mesh(knee::tibia())),
        opening_mm,
    };
    Reach::of(&joint, Shaft::forceps(&JAW), limits).unwrap()
}

fn capsule(from: Point3, to: Point3, radius_mm: f64) -> Capsule {
    Capsule {
        start: from,
        along: (to - from).normalize(),
        length_mm: (to - from).norm(),
        radius_mm,
    }
}

#[test]
fn more_of_the_crescent_is_reached_the_more_the_joint_is_opened() {
    let mut shares = Vec::new();
    // A gap over the meniscus' top of -3 mm is one of 3 mm over the plateau below it.
    for gap_mm in [-3.0, -2.0, -1.0, 1.0] {
        let (joint, portal, crescent) = phantom_joint(gap_mm);
        let reach = Reach::of(&joint, Shaft::forceps(&JAW), Limits::default()).unwrap();
        let bites = bites_along(&crescent, &portal, 0.4);
        let clear = bites.iter().filter(|bite| reach.is_clear(&portal, bite));
        shares.push(clear.count() as f64 / bites.len() as f64);
    }
    assert!(
        shares.windows(2).all(|pair| pair[0] <= pair[1]),
        "{shares:?}"
    );
    assert!(shares[0] < 0.7 && shares[3] == 1.0, "{shares:?}");
}

#[test]
fn a_closed_joint_says_how_far_it_must_be_opened_and_that_opening_is_enough() {
    let (joint, portal, crescent) = phantom_joint(-3.0);
    let reach_at = |opening_mm: f64| {
        let joint = Joint {
            opening_mm,
            ..joint.clone()
        };
        Reach::of(&joint, Shaft::forceps(&JAW), Limits::default()).unwrap()
    };
    let closed = reach_at(-3.0);
    let mut told = 0;
    for bite in bites_along(&crescent, &portal, 0.4) {
        let Err(obstruction) = closed.check(&portal, &bite, &no_tissue) else {
            continue;
        };
        let Cause::JointGap { needed_mm, .. } = obstruction.cause else {
            panic!("{obstruction}");
        };
        told += 1;
        assert!(reach_at(needed_mm).is_clear(&portal, &bite));
        assert!(!reach_at(needed_mm - 0.1).is_clear(&portal, &bite));
        assert_eq!(obstruction.cause.reason(), "JOINT_GAP_TOO_SMALL");
    }
    assert!(told > 5, "{told}");
}

#[test]
fn a_condyle_that_no_opening_frees_is_named_with_the_triangle_in_the_way() {
    let limits = Limits {
        max_opening_mm: 1.0,
        ..Limits::default()
    };
    let reach = knee_reach(0.0, limits);
    let portal = Point3::new(0.0, -48.0, 16.0);
    let bite = bite_through(&portal, Point3::new(0.0, 18.0, 4.0));
    let refused = reach.check(&portal, &bite, &no_tissue).unwrap_err();
    let Cause::HitsCondyle {
        distance_mm,
        triangle,
        ..
    } = refused.cause
    else {
        panic!("{refused}");
    };
    assert!(distance_mm < 0.0);
    let corner = knee::femur().corners(triangle.unwrap() as usize)[0];
    assert!((corner - refused.at).norm() < 3.0);
}

#[test]
fn a_low_portal_hits_the_tibia_and_raising_it_as_told_frees_the_shaft() {
    let reach = knee_reach(10.0, Limits::default());
    let center = Point3::new(0.0, 10.0, 4.0);
    let low = Point3::new(0.0, -48.0, 0.5);
    let refused = reach
        .check(&low, &bite_through(&low, center), &no_tissue)
        .unwrap_err();
    let Cause::HitsTibia {
        raise_mm: Some(raise_mm),
        ..
    } = refused.cause
    else {
        panic!("{refused}");
    };
    let raised = low + Vector3::z() * raise_mm;
    let clearance = reach.check(&raised, &bite_through(&raised, center), &no_tissue);
    assert!(clearance.unwrap().tibia_mm.unwrap() >= 0.5);
}

#[test]
fn a_portal_inside_bone_is_refused() {
    let reach = knee_reach(2.0, Limits::default());
    for (portal, expected) in [
        (Point3::new(0.0, -20.0, 24.0), BoneName::Femur),
        (Point3::new(0.0, -30.0, -6.0), BoneName::Tibia),
    ] {
        let bite = bite_through(&portal, Point3::new(0.0, 15.0, 15.0));
        let limits = Limits {
            elevation_rad: -1.5..=1.5,
            ..Limits::default()
        };
        let steep = knee_reach(2.0, limits);
        let refused = steep.check(&portal, &bite, &no_tissue).unwrap_err();
        let Cause::PortalInBone { bone, depth_mm } = refused.cause else {
            panic!("{refused}");
        };
        assert!(bone == expected && depth_mm > 1.0, "{refused}");
        assert!(!reach.is_clear(&portal, &bite));
    }
}

#[test]
fn elevation_insertion_and_a_missed_portal_are_told_with_number_and_limit() {
    let reach = knee_reach(10.0, Limits::default());
    let center = Point3::new(0.0, 0.0, 4.0);
    let reason = |portal: Point3, bite: &Bite| {
        let refused = reach.check(&portal, bite, &no_tissue).unwrap_err();
        assert!(!reach.is_clear(&portal, bite));
        refused.cause
    };
    let steep = Point3::new(0.0, -48.0, 30.0);
    let Cause::Elevation {
        limit_rad,
        lower_mm,
        ..
    } = reason(steep, &bite_through(&steep, center))
    else {
        panic!("no elevation");
    };
    let lowered = steep - Vector3::z() * lower_mm - center;
    assert!((lowered.z.atan2(48.0) - limit_rad).abs() < 1e-9);
    let far = Point3::new(0.0, -148.0, 20.0);
    let cause = reason(far, &bite_through(&far, center));
    assert_eq!(cause.reason(), "INSERTION_BEYOND_LIMIT");
    let portal = Point3::new(0.0, -48.0, 10.0);
    let aside = bite_through(&(portal + Vector3::x() * 4.0), center);
    assert_eq!(reason(portal, &aside).reason(), "SHAFT_MISSES_PORTAL");
    let mut backwards = bite_through(&portal, center);
    backwards.approach = -backwards.approach;
    assert_eq!(reason(portal, &backwards).reason(), "SHAFT_MISSES_PORTAL");
}

#[test]
fn a_jaw_near_the_popliteal_bundle_is_refused() {
    let (joint, portal, crescent) = phantom_joint(10.0);
    let limits = Limits {
        keep_outs: vec![KeepOut::popliteal(&crescent, &portal)],
        ..Limits::default()
    };
    let reach = Reach::of(&joint, Shaft::forceps(&JAW), limits).unwrap();
    for bite in bites_along(&crescent, &portal, 0.6) {
        assert!(reach.is_clear(&portal, &bite), "{bite:?}");
    }
    let KeepOut::Vessel(vessel) = KeepOut::popliteal(&crescent, &portal) else {
        panic!("no vessel");
    };
    let center = vessel.at(vessel.way_mm(&Point3::origin()));
    let center = center + (portal - center).normalize() * 4.0;
    let bite = bite_through(&portal, center);
    let refused = reach.check(&portal, &bite, &no_tissue).unwrap_err();
    assert_eq!(refused.cause.reason(), "KEEP_OUT");
}

#[test]
fn a_plane_kept_out_of_counts_the_jaw_too() {
    let keep_outs = vec![KeepOut::HalfSpace {
        through: Point3::new(0.0, 10.0, 0.0),
        inward: Vector3::y(),
    }];
    let reach = knee_reach(
        10.0,
        Limits {
            keep_outs,
            ..Limits::default()
        },
    );
    let portal = Point3::new(0.0, -48.0, 12.0);
    let check = |y: f64| {
        let bite = bite_through(&portal, Point3::new(0.0, y, 4.0));
        reach.check(&portal, &bite, &no_tissue)
    };
    assert!(check(5.0).is_ok());
    assert_eq!(check(9.0).unwrap_err().cause.reason(), "KEEP_OUT");
}

#[test]
fn meniscus_on_the_way_is_measured_and_refused_only_if_asked() {
    let portal = Point3::new(0.0, -48.0, 12.0);
    let bite = bite_through(&portal, Point3::new(0.0, 10.0, 4.0));
    let slab = |point: &Point3| (-20.0..-12.0).contains(&point.y);
    let free = knee_reach(10.0, Limits::default());
    let clearance = free.check(&portal, &bite, &slab).unwrap();
    // 8 mm along y, a little more along the shaft and for its lower and upper side.
    assert!((8.0..9.5).contains(&clearance.meniscus_mm), "{clearance:?}");
    let limits = Limits {
        tissue_mm: Some(3.0),
        ..Limits::default()
    };
    let refused = knee_reach(10.0, limits)
        .check(&portal, &bite, &slab)
        .unwrap_err();
    assert_eq!(refused.cause.reason(), "SHAFT_IN_MENISCUS");
    assert!((refused.at.y + 12.0).abs() < 1.0);
}

#[test]
fn is_clear_says_what_check_says() {
    let reach = knee_reach(0.0, Limits::default());
    let mut clear = 0;
    for (portal, center) in knee::poses(2000) {
        let bite = bite_through(&portal, center);
        let checked = reach.check(&portal, &bite, &no_tissue);
        assert_eq!(
            checked.is_ok(),
            reach.is_clear(&portal, &bite),
            "{checked:?}"
        );
        if let Ok(clearance) = checked {
            clear += 1;
            assert!(clearance.femur_mm.unwrap() >= 0.5 - 1e-6);
            assert!(clearance.tibia_mm.unwrap() >= 0.5 - 1e-6);
        }
    }
    assert!((200..1800).contains(&clear), "{clear}");
}

#[test]
fn what_is_no_number_is_never_clear() {
    let reach = knee_reach(10.0, Limits::default());
    let portal = Point3::new(0.0, -48.0, 12.0);
    let bite = bite_through(&portal, Point3::new(0.0, 5.0, 4.0));
    assert!(reach.is_clear(&portal, &bite));
    let mut broken = vec![(Point3::new(f64::NAN, -48.0, 12.0), bite)];
    let mut nowhere = bite;
    nowhere.center.z = f64::NAN;
    let mut aimless = bite;
    aimless.approach.x = f64::INFINITY;
    broken.extend([(portal, nowhere), (portal, aimless), (bite.center, bite)]);
    for (portal, bite) in broken {
        assert!(!reach.is_clear(&portal, &bite));
        let refused = reach.check(&portal, &bite, &no_tissue).unwrap_err();
        assert_eq!(refused.cause.reason(), "NO_SHAFT");
    }
}

#[test]
fn unusable_bones_and_limits_are_refused_by_name() {
    let shaft = Shaft::forceps(&JAW);
    let of = |tibia: Mesh| {
        let joint = Joint {
            tibia: Some(Obstacle::Mesh(tibia)),
            ..Joint::default()
        };
        Reach::of(&joint, shaft, Limits::default()).map(|_| ())
    };
    let mut metres = knee::tibia();
    metres
        .vertices
        .iter_mut()
        .for_each(|vertex| *vertex /= 1000.0);
    assert!(of(metres).unwrap_err().to_string().contains("metres"));
    let mut huge = knee::tibia();
    huge.vertices.iter_mut().for_each(|vertex| *vertex *= 10.0);
    assert!(
        of(huge)
            .unwrap_err()
            .to_string()
            .contains("the limit is 4000000")
    );
    let mut holed = knee::tibia();
    holed.vertices[7].y = f64::NAN;
    assert!(of(holed).is_err() && of(Mesh::default()).is_err());
    let limits = Limits {
        clearance_mm: f64::NAN,
        ..Limits::default()
    };
    let refused = Reach::of(&Joint::default(), shaft, limits).unwrap_err();
    assert!(matches!(
        refused,
        Error::Invalid {
            field: "options.joint.limits.clearance_mm",
            ..
        }
    ));
}

#[test]
fn an_open_surface_is_a_wall_on_both_sides() {
    let mut tibia = knee::tibia();
    tibia.triangles.truncate(tibia.triangles.len() / 2);
    let bone = Bone::of("tibia", &Obstacle::Mesh(tibia)).unwrap();
    assert!(bone.point_mm(&Point3::new(0.0, 5.0, -5.0)) > 0.0);
    let through = capsule(
        Point3::new(5.0, 5.0, 20.0),
        Point3::new(5.0, 5.0, -5.0),
        1.75,
    );
    assert!(bone.touches(&through, 0.0));
}

/// How far the field of a mesh and its exact distance differ at 2000 places around it, mm.
fn field_errors_mm(mesh: &Mesh) -> Vec<f64> {
    let bone = Bone::of("tibia", &Obstacle::Mesh(mesh.clone())).unwrap();
    let surface = NearestOnMesh::new(mesh);
    let (low, high) = mesh.bounds().unwrap();
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let mut within = |axis: usize| random.random_range(low[axis] - 7.0..high[axis] + 7.0);
    let mut errors_mm: Vec<f64> = (0..2000)
        .map(|_| {
            let place = Point3::new(within(0), within(1), within(2));
            (bone.point_mm(&place).abs() - surface.distance_mm(&place).min(MARGIN_MM)).abs()
        })
        .collect();
    errors_mm.sort_by(f64::total_cmp);
    errors_mm
}

#[test]
fn the_field_of_a_real_tibia_is_its_distance() {
    for file in ["smith2019_R_tibia.ply", "pymskt_tibia.ply"] {
        let root = std::env::var_os("ARTHRO_DATA").map_or_else(
            || PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data")),
            PathBuf::from,
        );
        let path = root.join("bones").join(file);
        let Ok(bytes) = std::fs::read(&path) else {
            eprintln!("SKIPPED: {} is absent; set ARTHRO_DATA", path.display());
            return;
        };
        let stated = Stated {
            space: Space::Lps,
            unit: Unit::Millimetre,
        };
        let mesh = ply::read_mesh(&bytes, Some(stated)).unwrap();
        let errors_mm = field_errors_mm(&mesh);
        assert!(
            errors_mm[1000] < 0.02 && errors_mm[1980] < 0.2,
            "{file} {} {}",
            errors_mm[1000],
            errors_mm[1980]
        );
        assert!(errors_mm[1999] <= ERROR_MM);
    }
}

#[test]
fn shafts_are_as_far_apart_as_their_surfaces() {
    let along_x = capsule(
        Point3::new(-50.0, 0.0, 0.0),
        Point3::new(50.0, 0.0, 0.0),
        1.75,
    );
    let along_y = capsule(
        Point3::new(0.0, -50.0, 10.0),
        Point3::new(0.0, 50.0, 10.0),
        2.0,
    );
    assert!((shafts_mm(&along_x, &along_y) - 6.25).abs() < 1e-12);
    let crossing = along_y.displaced(&Vector3::new(0.0, 0.0, -9.0));
    assert!((shafts_mm(&along_x, &crossing) + 2.75).abs() < 1e-12);
}

fn ball_bone() -> &'static Bone {
    static BONE: std::sync::OnceLock<Bone> = std::sync::OnceLock::new();
    BONE.get_or_init(|| Bone::of("femur", &Obstacle::Mesh(knee::femur())).unwrap())
}

fn slab_bone() -> &'static (Bone, NearestOnMesh) {
    static BONE: std::sync::OnceLock<(Bone, NearestOnMesh)> = std::sync::OnceLock::new();
    BONE.get_or_init(|| {
        let mesh = knee::tibia();
        let bone = Bone::of("tibia", &Obstacle::Mesh(mesh.clone())).unwrap();
        (bone, NearestOnMesh::new(&mesh))
    })
}

prop_compose! {
    fn a_point(reach_mm: f64)(x in -reach_mm..reach_mm, y in -reach_mm..reach_mm, z in -reach_mm..reach_mm)
        -> Vector3 {
        Vector3::new(x, y, z)
    }
}

proptest! {
    #[test]
    fn the_field_of_a_ball_is_its_distance(offset in a_point(31.0)) {
        let exact_mm = (offset.norm() - knee::FEMUR.1).clamp(-MARGIN_MM, MARGIN_MM);
        let field_mm = ball_bone().point_mm(&(Point3::new(0.0, 0.0, knee::FEMUR.0) + offset));
// Where the samples around a place are cut off at the margin the value between them is too.
        let tolerance_mm = if exact_mm.abs() < MARGIN_MM - 1.0 { 0.1 } else { ERROR_MM };
        prop_assert!((field_mm - exact_mm).abs() < FACET_MM + tolerance_mm, "{} {}", field_mm, exact_mm);
    }

    #[test]
    fn a_shaft_touches_a_ball_when_it_is_nearer_than_the_radii(
        from in a_point(60.0), to in a_point(60.0), clearance_mm in 0.0..12.0f64,
    ) {
        prop_assume!((to - from).norm() > 1.0);
        let center = Point3::new(0.0, 0.0, knee::FEMUR.0);
        let shaft = capsule(center + from, center + to, 1.75);
        let ball = Obstacle::Ball { center, radius_mm: knee::FEMUR.1 };
        let exact = Bone::of("femur", &ball).unwrap().nearest(&shaft);
        let near = ball_bone().nearest(&shaft);
        prop_assert!(near.distance_mm >= exact.distance_mm - 1e-6);
        prop_assert!(exact.distance_mm < -1.75 || exact.distance_mm > MARGIN_MM - 1.75 || near.distance_mm < exact.distance_mm + FACET_MM + 0.01,
            "{} {}", near.distance_mm, exact.distance_mm);
        let margin_mm = exact.distance_mm - clearance_mm;
        if margin_mm > 0.0 {
            prop_assert!(!ball_bone().touches(&shaft, clearance_mm));
        }
        if margin_mm < -FACET_MM {
            prop_assert!(ball_bone().touches(&shaft, clearance_mm));
        }
    }

    #[test]
    fn a_shaft_touches_when_one_of_its_pieces_does(from in a_point(60.0), to in a_point(60.0)) {
        prop_assume!((to - from).norm() > 10.0);
        static BONE: std::sync::OnceLock<Bone> = std::sync::OnceLock::new();
        let bone = BONE.get_or_init(|| Bone::of("knee", &Obstacle::Mesh(knee::knee())).unwrap());
        let whole = capsule(Point3::from(from), Point3::from(to), 1.75);
        let pieces = (0..30).map(|piece| Capsule {
            start: whole.at(whole.length_mm * f64::from(piece) / 30.0),
            length_mm: whole.length_mm / 30.0,
            ..whole
        });
        prop_assert_eq!(bone.touches(&whole, 0.0), pieces.into_iter().any(|piece| bone.touches(&piece, 0.0)));
    }

    #[test]
    fn a_shaft_touches_a_slab_exactly_when_a_place_of_its_axis_is_within_the_radius(
        from in a_point(50.0), to in a_point(50.0),
    ) {
        prop_assume!((to - from).norm() > 1.0);
        let (bone, surface) = slab_bone();
        let shaft = capsule(Point3::from(from), Point3::from(to), 1.75);
        // Sampled every 0.2 mm, the surface is at most 0.1 mm nearer than told.
        let steps = (shaft.length_mm / 0.2).ceil();
        let sampled_mm = (0..=steps as usize)
            .map(|step| surface.distance_mm(&shaft.at(shaft.length_mm * step as f64 / steps)))
            .fold(f64::INFINITY, f64::min);
        // Wholly inside the slab no surface need be near.
        prop_assume!(bone.point_mm(&shaft.start) > 0.0);
        if sampled_mm < shaft.radius_mm {
            prop_assert!(bone.touches(&shaft, 0.0));
        }
        if sampled_mm > shaft.radius_mm + 0.1 {
            prop_assert!(!bone.touches(&shaft, 0.0), "{}", sampled_mm);
        }
    }
}
