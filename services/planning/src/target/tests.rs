use super::*;
use crate::plan;
use arthro_geometry::Vector3;
use arthro_geometry::phantom::{self, RadialTear};

struct World {
    crescent: Crescent,
    voxels: Voxels,
    lesion: Lesion,
}

impl World {
    fn torn_phantom() -> Self {
        Self::phantom_torn(&RadialTear::BODY, 0.5)
    }

    fn phantom_torn(tear: &RadialTear, voxel_mm: f64) -> Self {
        let mesh = phantom::mesh();
        let (crescent, voxels) =
            plan::model(&mesh, &phantom::PORTAL_ANTEROLATERAL, voxel_mm, 1.0).unwrap();
        let shape = phantom::Phantom::default();
        let is_torn = |center: &Point3| shape.is_torn(&(crescent.ct_from_meniscal * *center), tear);
        let marks = voxels.centers().iter().map(is_torn).collect();
        let lesion = Lesion::of_voxels(marks, &voxels);
        Self {
            crescent,
            voxels,
            lesion,
        }
    }

    fn ends(&self, start: Point3, goal: Point3) -> Aim {
        let meniscal_from_ct = self.crescent.ct_from_meniscal.inverse();
        Aim::Ends {
            start: meniscal_from_ct * start,
            goal: meniscal_from_ct * goal,
        }
    }

    fn papers_ends(&self) -> Aim {
        self.ends(phantom::START, phantom::GOAL)
    }

    fn draw(&self, aim: &Aim, lesion: Option<&Lesion>) -> Result<Target, Error> {
        Target::draw(aim, &Rules::default(), lesion, &self.crescent, &self.voxels)
    }

    fn region_mm3(&self, target: &Target) -> f64 {
        let inboard = |center: &&Point3| target.band.contains(center, &self.crescent);
        self.voxels.centers().iter().filter(inboard).count() as f64 * self.voxels.voxel_mm3()
    }
}

fn curvatures(target: &Target) -> Vec<f64> {
    let parameters = target.spline.parameters_every(0.25).into_iter();
    parameters
        .map(|at| {
            target
                .spline
                .signed_curvature_per_mm(at, &Vector3::z())
                .abs()
        })
        .collect()
}

#[test]
fn the_band_from_the_papers_start_to_its_goal_has_the_published_size() {
    let world = World::torn_phantom();
    let target = world.draw(&world.papers_ends(), None).unwrap();
    let region_mm3 = world.region_mm3(&target);
    assert!((region_mm3 / 314.6 - 1.0).abs() < 0.03, "{region_mm3} mm3");
    let curvatures = curvatures(&target);
    let mean_per_mm = curvatures.iter().sum::<f64>() / curvatures.len() as f64;
    assert!((mean_per_mm - 0.075).abs() < 0.003, "{mean_per_mm} /mm");
    assert!(curvatures.iter().all(|at| (0.04..0.12).contains(at)));
    assert!((target.spline.length_mm() - 38.7).abs() < 0.2);
}

#[test]
fn the_contour_leads_from_start_to_goal() {
    let world = World::torn_phantom();
    let aim = world.papers_ends();
    let Aim::Ends { start, goal } = &aim else {
        unreachable!("papers_ends makes ends");
    };
    let target = world.draw(&aim, Some(&world.lesion)).unwrap();
    assert!((target.spline.point(0.0) - start).norm() < 1e-9);
    assert!((target.spline.point(1.0) - goal).norm() < 1e-9);
}

#[test]
fn the_target_around_a_tear_has_the_published_size() {
    // The planning voxels of 0.5 mm add a tenth: they are as coarse as the free edge is thick.
    let world = World::phantom_torn(&RadialTear::BODY, 0.25);
    let target = world.draw(&Aim::Lesion, Some(&world.lesion)).unwrap();
    let region_mm3 = world.region_mm3(&target);
    assert!((region_mm3 / 53.5 - 1.0).abs() < 0.03, "{region_mm3} mm3");
    let curvatures = curvatures(&target);
    let sharpest_per_mm = curvatures.iter().copied().fold(0.0, f64::max);
    assert!(sharpest_per_mm < 1.0 / 1.5, "{sharpest_per_mm} /mm");
}

#[test]
fn the_contour_keeps_its_margin_from_the_lesion() {
    for depth_fraction in [0.2, 0.42, 0.6] {
        let tear = RadialTear {
            depth_fraction,
            phi_rad: 0.4,
            ..RadialTear::BODY
        };
        let world = World::phantom_torn(&tear, 0.5);
        for aim in [Aim::Lesion, world.papers_ends()] {
            let target = world.draw(&aim, Some(&world.lesion)).unwrap();
            let points = target.spline.points_every(0.1);
            let least_mm = Rules::default().lesion_margin_mm - 2.0 * FIT_SLACK_MM;
            for damaged in &world.lesion.points {
                assert!(target.band.contains(damaged, &world.crescent));
                let flat = |point: &Point3| (point.xy() - damaged.xy()).norm();
                let nearest_mm = points.iter().map(flat).fold(f64::INFINITY, f64::min);
                assert!(nearest_mm > least_mm, "{nearest_mm} mm");
            }
        }
    }
}

#[test]
fn the_target_around_a_tear_leaves_the_free_edge_without_a_jump_in_curvature() {
    let world = World::torn_phantom();
    let target = world.draw(&Aim::Lesion, Some(&world.lesion)).unwrap();
    for end in [target.spline.point(0.0), target.spline.point(1.0)] {
        let edge_mm = world.crescent.edge_mm(world.crescent.angle_rad(&end));
        let depth_mm = end.xy().coords.norm() - edge_mm.unwrap();
        assert!(depth_mm.abs() < 0.05, "{depth_mm} mm");
    }
    // A raised cosine would bend away from the edge with 0.6 /mm at once.
    let edge_curvature_per_mm = 0.0..0.2;
    for at in [0.0, 1.0] {
        let curvature_per_mm = target.spline.curvature_per_mm(at);
        assert!(
            edge_curvature_per_mm.contains(&curvature_per_mm),
            "{curvature_per_mm} /mm"
        );
    }
}

#[test]
fn a_wider_lesion_is_reached_around_further() {
    let narrow = World::torn_phantom();
    let wide = World::phantom_torn(
        &RadialTear {
            width_mm: 12.0,
            ..RadialTear::BODY
        },
        0.5,
    );
    let length_mm = |world: &World| {
        let target = world.draw(&Aim::Lesion, Some(&world.lesion)).unwrap();
        target.spline.length_mm()
    };
    assert!(length_mm(&wide) > length_mm(&narrow) + 4.0);
}

#[test]
fn a_target_around_no_lesion_is_refused() {
    let world = World::torn_phantom();
    let nothing = Lesion::of_voxels(vec![false; world.voxels.centers().len()], &world.voxels);
    for lesion in [None, Some(&nothing)] {
        let refusal = world.draw(&Aim::Lesion, lesion);
        assert!(matches!(
            refusal,
            Err(Error::Invalid {
                field: "lesion",
                ..
            })
        ));
    }
}

#[test]
fn a_lesion_beyond_start_and_goal_is_refused() {
    let world = World::torn_phantom();
    let aim = world.ends(phantom::START, Point3::new(54.0, 57.0, 57.0));
    let refusal = world.draw(&aim, Some(&world.lesion));
    assert!(matches!(refusal, Err(Error::LesionBeyondPath { .. })));
}

#[test]
fn an_end_too_near_the_rim_is_refused_with_the_rim_it_leaves() {
    let world = World::torn_phantom();
    let rules = Rules {
        rim_min_mm: 4.0,
        ..Rules::default()
    };
    let aim = world.papers_ends();
    match Target::draw(&aim, &rules, None, &world.crescent, &world.voxels) {
        Err(Error::RimBelowLimit { rim_mm, at, .. }) => {
            assert!((3.0..4.0).contains(&rim_mm), "{rim_mm} mm");
            assert!((at - phantom::GOAL).norm() < 2.0, "{at}");
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_tear_that_leaves_too_little_rim_is_refused_with_what_would_make_it_possible() {
    let deep = RadialTear {
        depth_fraction: 0.8,
        phi_rad: 0.5,
        ..RadialTear::BODY
    };
    let world = World::phantom_torn(&deep, 0.5);
    let refusal = world.draw(&Aim::Lesion, Some(&world.lesion)).unwrap_err();
    let Error::RimBelowLimit {
        rim_mm, angle_rad, ..
    } = refusal
    else {
        panic!("{refusal:?}");
    };
    assert!((1.0..2.0).contains(&rim_mm), "{rim_mm} mm");
    let said = refusal.to_string();
    let degrees = format!("{rim_mm:.2} mm < 3 mm at {:.0} deg", angle_rad.to_degrees());
    assert!(said.contains(&degrees), "{said}");
    assert!(
        said.contains(&format!("{:.2} mm nearer", 3.0 - rim_mm)),
        "{said}"
    );
    let rules = Rules {
        rim_min_mm: rim_mm,
        ..Rules::default()
    };
    let lesion = Some(&world.lesion);
    assert!(Target::draw(&Aim::Lesion, &rules, lesion, &world.crescent, &world.voxels).is_ok());
}

#[test]
fn start_and_goal_at_the_same_place_are_refused() {
    let world = World::torn_phantom();
    let refusal = world.draw(&world.ends(phantom::START, phantom::START), None);
    assert!(matches!(refusal, Err(Error::Invalid { .. })));
}

#[test]
fn inner_edge_and_midline_run_from_horn_to_horn_through_the_tissue() {
    let world = World::torn_phantom();
    let shape = phantom::Phantom::default();
    for (line, width_fraction) in [(Line::InnerEdge, 0.0), (Line::Midline, 0.5)] {
        let spline = line.of(&world.crescent, &world.voxels).unwrap();
        let mut furthest_rad = 0f64;
        for point in spline.points_every(0.5) {
            let at = shape.coordinates(&(world.crescent.ct_from_meniscal * point));
            furthest_rad = furthest_rad.max(at.phi_rad.abs());
            if at.phi_rad.abs() < 1.55 {
                let off = (at.width_fraction - width_fraction).abs();
                assert!(off < 0.05, "{line:?} {at:?}");
                assert!((at.height_fraction - 0.5).abs() < 0.25, "{line:?} {at:?}");
            }
        }
        assert!(furthest_rad > 0.9 * shape.horn_rad, "{furthest_rad}");
    }
}

/// A curve half a width deep that somebody clicked, from one angle to another in degrees.
fn clicked(world: &World, from_deg: i32, to_deg: i32) -> Vec<Point3> {
    let steps = (from_deg - to_deg).abs() / 10;
    (0..=steps)
        .map(|step| {
            let angle_rad = f64::from(from_deg + (to_deg - from_deg) * step / steps).to_radians();
            let edge_mm = world.crescent.edge_mm(angle_rad).unwrap();
            let radius_mm = 0.5 * (edge_mm + world.crescent.rim_mm(angle_rad).unwrap());
            let (sin, cos) = angle_rad.sin_cos();
            Point3::new(radius_mm * cos, radius_mm * sin, 4.0)
        })
        .collect()
}

fn outwards(point: &Point3, by_mm: f64) -> Point3 {
    point + by_mm * point.xy().coords.normalize().push(0.0)
}

fn curve(points: &[Point3]) -> Aim {
    Aim::Curve {
        points: points.to_vec(),
    }
}

fn curve_refusal(world: &World, points: &[Point3]) -> String {
    world.draw(&curve(points), None).unwrap_err().to_string()
}

#[test]
fn a_drawn_curve_is_followed_in_the_middle_of_the_tissue_from_either_end() {
    let world = World::torn_phantom();
    let points = clicked(&world, -40, 50);
    let backwards: Vec<Point3> = points.iter().rev().copied().collect();
    let target = world.draw(&curve(&points), None).unwrap();
    let other = world.draw(&curve(&backwards), None).unwrap();
    for point in &points {
        let foot = target.spline.point(target.spline.nearest(point));
        assert!((foot.xy() - point.xy()).norm() < 0.1, "{point}");
        assert!(world.voxels.distance_mm(&foot, 1.0) == Some(0.0), "{foot}");
    }
    let (region_mm3, other_mm3) = (world.region_mm3(&target), world.region_mm3(&other));
    assert!(
        (region_mm3 - other_mm3).abs() < 1.0,
        "{region_mm3} {other_mm3} mm3"
    );
}

#[test]
fn a_curve_that_leaves_the_tissue_is_refused_with_the_point() {
    let world = World::torn_phantom();
    let mut points = clicked(&world, -40, 50);
    points[4] = Point3::new(1.0, 0.0, 0.0);
    let refusal = curve_refusal(&world, &points);
    assert!(
        refusal.contains("[4]") && refusal.contains("1 mm"),
        "{refusal}"
    );
    points[4].x = f64::NAN;
    let refusal = curve_refusal(&world, &points);
    assert!(
        refusal.contains("[4]") && refusal.contains("finite"),
        "{refusal}"
    );
    // All four lie on tissue, but the curve through them cuts across the hollow.
    let ends = clicked(&world, -80, 80);
    let across = [
        outwards(&ends[0], 3.0),
        ends[1],
        ends[15],
        outwards(&ends[16], 3.0),
    ];
    let refusal = curve_refusal(&world, &across);
    assert!(refusal.contains("leaves the tissue near"), "{refusal}");
}

#[test]
fn a_curve_that_crosses_itself_or_turns_back_is_refused_with_the_points() {
    let world = World::torn_phantom();
    let mut points = clicked(&world, -40, 50);
    points[4] = outwards(&points[2], 2.0);
    let refusal = curve_refusal(&world, &points);
    assert!(
        refusal.contains("[4] goes back along the crescent by"),
        "{refusal}"
    );
    let mut knot = clicked(&world, -40, 50);
    let (out, back) = (outwards(&knot[6], 2.0), outwards(&knot[5], 2.0));
    knot.splice(7..7, [out, back, outwards(&knot[5], -1.0)]);
    let refusal = curve_refusal(&world, &knot);
    assert!(refusal.contains("crosses itself"), "{refusal}");
}

#[test]
fn a_curve_of_fewer_than_four_places_is_refused_with_their_number() {
    let world = World::torn_phantom();
    let points = clicked(&world, -10, 10);
    let doubled: Vec<Point3> = points.iter().flat_map(|point| [*point; 2]).collect();
    let refusal = curve_refusal(&world, &doubled);
    assert!(
        refusal.contains("has 3 distinct points; must be at least 4"),
        "{refusal}"
    );
}

#[test]
fn a_curve_inboard_of_the_lesion_is_refused() {
    let world = World::torn_phantom();
    let mut points = clicked(&world, -40, 50);
    for point in &mut points {
        let edge_mm = world
            .crescent
            .edge_mm(world.crescent.angle_rad(point))
            .unwrap();
        *point *= (edge_mm + 1.5) / point.xy().coords.norm();
    }
    let refusal = world
        .draw(&curve(&points), Some(&world.lesion))
        .unwrap_err();
    assert!(
        matches!(refusal, Error::LesionBeyondPath { .. }),
        "{refusal}"
    );
}

#[test]
fn a_contour_beyond_the_rim_is_refused_without_offering_a_limit() {
    let horn = RadialTear {
        phi_rad: -1.75,
        ..RadialTear::BODY
    };
    let world = World::phantom_torn(&horn, 0.5);
    let refusal = world.draw(&Aim::Lesion, Some(&world.lesion)).unwrap_err();
    assert!(matches!(refusal, Error::RimBelowLimit { rim_mm, .. } if rim_mm < 0.0));
    let said = refusal.to_string();
    assert!(!said.contains("rim limit of at most"), "{said}");
    assert!(said.contains("nearer to the free edge"), "{said}");
}

#[test]
fn a_deep_tear_in_a_frayed_edge_does_not_deepen_the_whole_of_it() {
    let mut world = World::torn_phantom();
    let frayed = RadialTear {
        phi_rad: 0.2,
        depth_fraction: 0.1,
        width_mm: 14.0,
    };
    let frayed = World::phantom_torn(&frayed, 0.5).lesion.marks;
    let marks = world.lesion.marks.iter().zip(&frayed);
    let marks = marks.map(|(torn, frayed)| *torn || *frayed).collect();
    world.lesion = Lesion::of_voxels(marks, &world.voxels);
    let target = world.draw(&Aim::Lesion, Some(&world.lesion)).unwrap();
    // As deep as the tear everywhere, it would be 3.3 times the lesion.
    let times_lesion = world.region_mm3(&target) / world.lesion.volume_mm3();
    assert!(times_lesion < 2.7, "{times_lesion}");
    let sharpest_per_mm = curvatures(&target).into_iter().fold(0.0, f64::max);
    assert!(sharpest_per_mm < 0.5, "{sharpest_per_mm} /mm");
}

#[test]
fn a_start_in_the_lesion_is_refused_with_sound_numbers() {
    let world = World::torn_phantom();
    let shape = phantom::Phantom::default();
    for phi_rad in [0.0, 0.04, 0.06, 0.08, 0.1, 0.12] {
        let start = shape.point(phantom::Coordinates {
            phi_rad,
            width_fraction: 0.05,
            height_fraction: 0.5,
        });
        match world.draw(&world.ends(start, phantom::GOAL), Some(&world.lesion)) {
            Ok(_) | Err(Error::LesionBeyondPath { .. }) => {}
            Err(Error::RimBelowLimit { rim_mm, .. }) => assert!(rim_mm > -2.0, "{rim_mm} mm"),
            Err(other) => panic!("{other}"),
        }
    }
}
