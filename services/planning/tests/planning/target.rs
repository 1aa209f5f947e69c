//! Targets that are found without start and goal: around a tear, on the phantom and on real menisci.

use arthro_geometry::markups::{self, Kind, Markup};
use arthro_geometry::{Point3, Vector3};
use arthro_planning::Error;
use arthro_planning::crescent::Crescent;
use arthro_planning::lesion::Lesion;
use arthro_planning::plan::{self, Request};
use arthro_planning::target::{Aim, Line, Rules, Target};
use arthro_planning::voxels::Voxels;
use nalgebra::Isometry3;
use proptest::prelude::*;

use crate::menisci::MENISCI;
use crate::world::papers_case;

struct Drawn {
    crescent: Crescent,
    voxels: Voxels,
    lesion: Lesion,
    target: Result<Target, Error>,
}

impl Drawn {
    fn around_the_tear_of(request: &Request) -> Self {
        let (crescent, voxels) =
            plan::model(&request.model, &request.portals[0], request.voxel_mm, 1.0).unwrap();
        let spacing_mm = request.lesion_spacing_mm;
        let lesion = Lesion::of(&request.lesion, spacing_mm, &crescent, &voxels, 1.0).unwrap();
        let rules = Rules::default();
        let target = Target::draw(&Aim::Lesion, &rules, Some(&lesion), &crescent, &voxels);
        Self {
            crescent,
            voxels,
            lesion,
            target,
        }
    }

    fn contour_in_ct(&self) -> Vec<Point3> {
        let points = self.target.as_ref().unwrap().spline.points_every(0.5);
        let points = points.iter();
        points
            .map(|point| self.crescent.ct_from_meniscal * *point)
            .collect()
    }
}

fn moved(request: &Request, motion: &Isometry3<f64>) -> Request {
    let mut moved = request.clone();
    for vertex in &mut moved.model.vertices {
        *vertex = motion * *vertex;
    }
    for point in &mut moved.lesion {
        *point = motion * *point;
    }
    moved.portals = vec![motion * request.portals[0]];
    moved
}

#[test]
fn every_meniscus_has_a_target_around_the_tear_in_its_body() {
    for meniscus in &MENISCI {
        let Some(request) = meniscus.torn() else {
            continue;
        };
        let drawn = Drawn::around_the_tear_of(&request);
        let target = match &drawn.target {
            Ok(target) => target,
            Err(Error::RimBelowLimit { rim_mm, .. }) => {
                // The tear leaves so little by itself; less would be the contour's fault.
                assert!(*rim_mm > 2.8, "{}: {rim_mm} mm", meniscus.file);
                continue;
            }
            Err(refusal) => panic!("{}: {refusal}", meniscus.file),
        };
        let is_inboard = |point: &Point3| target.band.contains(point, &drawn.crescent);
        let left = drawn
            .lesion
            .points
            .iter()
            .filter(|point| !is_inboard(point));
        assert_eq!(left.count(), 0, "{}", meniscus.file);
        let centers = drawn.voxels.centers().iter();
        let region = centers.filter(|center| is_inboard(center)).count();
        let times_lesion = region as f64 * drawn.voxels.voxel_mm3() / drawn.lesion.volume_mm3();
        assert!(
            (1.0..4.5).contains(&times_lesion),
            "{}: {times_lesion}",
            meniscus.file
        );
        for at in target.spline.parameters_every(0.25) {
            let curvature_per_mm = target.spline.signed_curvature_per_mm(at, &Vector3::z());
            assert!(
                curvature_per_mm.abs() < 1.0 / 1.5,
                "{}: {curvature_per_mm} /mm",
                meniscus.file
            );
        }
    }
}

#[test]
fn a_curve_drawn_in_slicer_is_the_target_in_whichever_axes_it_was_saved() {
    let request = papers_case();
    let (crescent, voxels) =
        plan::model(&request.model, &request.portals[0], request.voxel_mm, 1.0).unwrap();
    let midline = Line::Midline
        .of(&crescent, &voxels)
        .unwrap()
        .points_every(2.0);
    let points: Vec<Point3> = midline[6..midline.len() - 6]
        .iter()
        .map(|point| crescent.ct_from_meniscal * *point)
        .collect();
    let turned = points
        .iter()
        .map(|point| Point3::new(-point.x, -point.y, point.z));
    let file = |points: Vec<Point3>| {
        let markup = Markup {
            name: "new edge".into(),
            kind: Kind::Curve,
            points,
            skipped: 0,
        };
        String::from_utf8(markups::write(&[markup])).unwrap()
    };
    let ras = file(turned.collect()).replace(r#""LPS""#, r#""RAS""#);
    let drawn = [file(points), ras].map(|file| {
        let curve = markups::read_one(file.as_bytes(), Some("new edge")).unwrap();
        let meniscal_from_ct = crescent.ct_from_meniscal.inverse();
        let aim = Aim::Curve {
            points: curve
                .points
                .iter()
                .map(|point| meniscal_from_ct * *point)
                .collect(),
        };
        Target::draw(&aim, &Rules::default(), None, &crescent, &voxels).unwrap()
    });
    let [lps, ras] = drawn.map(|target| target.spline.points_every(1.0));
    assert_eq!(lps, ras);
    for point in &midline[8..midline.len() - 8] {
        let away = lps.iter().map(|at| (at.xy() - point.xy()).norm());
        assert!(away.fold(f64::INFINITY, f64::min) < 0.7, "{point}");
    }
}

fn largest_distance_mm(a: &[Point3], b: &[Point3]) -> f64 {
    let pairs = a.iter().zip(b);
    pairs.map(|(a, b)| (a - b).norm()).fold(0.0, f64::max)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(8))]

    #[test]
    fn the_target_moves_with_the_patient(
        axis in (-1.0..1.0f64, -1.0..1.0f64, 0.1..1.0f64),
        angle_rad in -3.1..3.1f64,
        shift_mm in (-80.0..80.0f64, -80.0..80.0f64, -80.0..80.0f64),
    ) {
        let axis = Vector3::new(axis.0, axis.1, axis.2).normalize();
        let motion = Isometry3::new(
            Vector3::new(shift_mm.0, shift_mm.1, shift_mm.2),
            axis * angle_rad,
        );
        let real = MENISCI[0].torn();
        for request in std::iter::once(papers_case()).chain(real) {
            let here = Drawn::around_the_tear_of(&request).contour_in_ct();
            let there = Drawn::around_the_tear_of(&moved(&request, &motion)).contour_in_ct();
            let carried: Vec<Point3> = here.iter().map(|point| motion * *point).collect();
            prop_assert_eq!(here.len(), there.len());
            let distance_mm = largest_distance_mm(&carried, &there);
            prop_assert!(distance_mm < 0.05, "{} mm", distance_mm);
        }
    }
}
