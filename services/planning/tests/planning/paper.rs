//! The paper's planner on the phantom.

use std::ops::ControlFlow;
use std::sync::LazyLock;
use std::time::Instant;

use arthro_geometry::phantom::{self, Phantom};
use arthro_geometry::{Point3, Vector3};
use arthro_planning::Error;
use arthro_planning::band::Band;
use arthro_planning::contour::Spline;
use arthro_planning::crescent::Crescent;
use arthro_planning::evaluation::time::Timing;
use arthro_planning::evaluation::{Evaluation, Task};
use arthro_planning::jaw::{Bite, DEFAULT_THROAT_MM, Jaw};
use arthro_planning::lesion::Lesion;
use arthro_planning::paper::{self, Cost, Path, Search};
use arthro_planning::plan;
use arthro_planning::target::{Rules, Target};
use arthro_planning::tissue::THROAT_LIMIT;
use arthro_planning::voxels::Voxels;
use proptest::prelude::*;

use crate::world::papers_case;

/// The search of the paper's case.
const SEARCH: Search = Search {
    cost: Cost::Corrected,
    step_mm: 1.0,
    tolerance_mm: 1.0,
    cost_limit_per_mm: 0.4,
    max_iterations: 100_000,
    seed: 0,
};
const JAW: Jaw = Jaw {
    width_mm: 3.0,
    length_mm: 4.5,
    throat_mm: DEFAULT_THROAT_MM,
};

/// A contour in the tissue of the phantom, in the axes of its crescent.
struct World {
    crescent: Crescent,
    voxels: Voxels,
    contour: Spline,
}

impl World {
    /// The contour that is drawn around the torn tissue.
    fn torn() -> Self {
        Self::with_contour(|crescent, voxels| {
            let request = papers_case();
            let lesion = Lesion::of(
                &request.lesion,
                request.lesion_spacing_mm,
                crescent,
                voxels,
                1.0,
            )
            .unwrap();
            drawn(Some(&lesion), crescent, voxels)
        })
    }

    /// The contour that is drawn where nothing is torn.
    fn whole() -> Self {
        Self::with_contour(|crescent, voxels| drawn(None, crescent, voxels))
    }

    /// The contour as the paper has it: a spline through 14 points clicked from start to goal, here
    /// with a depth that grows evenly along the crescent.
    fn clicked() -> Self {
        Self::with_contour(|crescent, _| {
            const CLICKS: usize = 14;
            let shape = Phantom::default();
            let ends = [phantom::START, phantom::GOAL].map(|end| shape.coordinates(&end));
            let [from, to] = ends;
            let mut points: Vec<Point3> = (0..CLICKS)
                .map(|click| {
                    let share = click as f64 / (CLICKS - 1) as f64;
                    let mix = |from: f64, to: f64| from + (to - from) * share;
                    shape.point(phantom::Coordinates {
                        phi_rad: mix(from.phi_rad, to.phi_rad),
                        width_fraction: mix(from.width_fraction, to.width_fraction),
                        height_fraction: mix(from.height_fraction, to.height_fraction),
                    })
                })
                .collect();
            let meniscal_from_ct = crescent.ct_from_meniscal.inverse();
            for point in &mut points {
                *point = meniscal_from_ct * *point;
            }
            Spline::fit(&points, CLICKS).unwrap()
        })
    }

    fn with_contour(draw: impl FnOnce(&Crescent, &Voxels) -> Spline) -> Self {
        let (crescent, voxels) =
            plan::model(&phantom::mesh(), &phantom::PORTAL_ANTEROLATERAL, 0.5, 1.0).unwrap();
        let contour = draw(&crescent, &voxels);
        Self {
            crescent,
            voxels,
            contour,
        }
    }

    fn search(&self, options: &Search) -> Result<Path, Error> {
        let (low, high) = phantom::TARGET_BOX;
        let in_box = |point: &Point3| {
            let point = self.crescent.ct_from_meniscal * *point;
            point.inf(&low) == low && point.sup(&high) == high
        };
        let go_on = |_| ControlFlow::Continue(());
        paper::search(&self.contour, &self.voxels, options, in_box, go_on)
    }

    fn portal(&self) -> Point3 {
        self.crescent.ct_from_meniscal.inverse() * phantom::PORTAL_ANTEROLATERAL
    }

    /// Scores bites on everything inboard of the contour.
    fn score_band(&self, bites: &[Bite]) -> Evaluation {
        let band = Band::inboard_of(&self.contour.points_every(0.2), &self.crescent);
        let lesion = Lesion::inboard_of(&band, &self.crescent, &self.voxels);
        let task = Task {
            crescent: &self.crescent,
            voxels: &self.voxels,
            lesion: &lesion,
            band: Some(&band),
            jaw: JAW,
            portals: &[],
            timing: Timing::default(),
            throat_limit: THROAT_LIMIT,
        };
        task.evaluate(bites)
    }

    /// Mean and greatest distance of a path's points to the contour, mm.
    fn off_mm(&self, points: &[Point3]) -> (f64, f64) {
        let samples = self.contour.points_every(0.02);
        let off_mm = |point: &Point3| {
            let distances = samples.iter().map(|sample| (point - sample).norm());
            distances.fold(f64::INFINITY, f64::min)
        };
        let off: Vec<f64> = points.iter().map(off_mm).collect();
        let mean = off.iter().sum::<f64>() / off.len() as f64;
        (mean, off.iter().copied().fold(0.0, f64::max))
    }
}

fn drawn(lesion: Option<&Lesion>, crescent: &Crescent, voxels: &Voxels) -> Spline {
    let aim = papers_case()
        .aim
        .carried(&crescent.ct_from_meniscal.inverse());
    Target::draw(&aim, &Rules::default(), lesion, crescent, voxels)
        .unwrap()
        .spline
}

fn turns_deg(points: &[Point3]) -> Vec<f64> {
    let corners = points.windows(3);
    corners
        .map(|at| (at[1] - at[0]).angle(&(at[2] - at[1])).to_degrees())
        .collect()
}

#[test]
fn every_one_of_a_hundred_seeds_reaches_the_goal_near_the_curve() {
    for world in [World::torn(), World::whole(), World::clicked()] {
        let mut sum_mm = 0.0;
        for seed in 1..=100 {
            let path = world.search(&corrected(seed)).unwrap();
            let (mean_mm, _) = world.off_mm(&path.points);
            assert!(mean_mm <= 0.5, "{mean_mm} mm with seed {seed}");
            sum_mm += mean_mm;
        }
        assert!(sum_mm / 100.0 <= 0.3, "{} mm on average", sum_mm / 100.0);
    }
}

#[test]
fn as_printed_the_path_strays_from_the_curve_and_turns_back() {
    let world = World::clicked();
    let (mut sum_mm, mut sharpest_deg): (f64, f64) = (0.0, 0.0);
    for seed in 1..=20 {
        let path = world.search(&printed(0.5, seed)).unwrap();
        sum_mm += world.off_mm(&path.points).0;
        sharpest_deg = turns_deg(&path.points)
            .into_iter()
            .fold(sharpest_deg, f64::max);
    }
    assert!(sum_mm / 20.0 > 1.5, "{} mm on average", sum_mm / 20.0);
    assert!(sharpest_deg > 90.0, "{sharpest_deg} deg");
}

#[test]
fn as_printed_a_threshold_that_would_shape_the_path_makes_the_search_fail() {
    let world = World::clicked();
    let reached = (1..=20).filter(|&seed| world.search(&printed(0.1, seed)).is_ok());
    assert_eq!(reached.count(), 0);
}

#[test]
fn a_path_keeps_the_limit_of_its_cost() {
    let world = World::torn();
    for options in [corrected(3), printed(0.4, 3)] {
        let path = world.search(&options).unwrap();
        let highest_per_mm = options.cost.highest_per_mm(&path.points, &world.contour);
        assert!(highest_per_mm <= options.cost_limit_per_mm + 1e-9);
    }
}

#[test]
fn the_same_seed_gives_the_same_path_to_the_last_bit_and_another_seed_another() {
    let world = World::torn();
    for options in [corrected(7), printed(0.4, 7)] {
        let bits = |options: &Search| -> Vec<u64> {
            let path = world.search(options).unwrap();
            let numbers = path
                .points
                .iter()
                .flat_map(|point| [point.x, point.y, point.z]);
            numbers.map(f64::to_bits).collect()
        };
        let other = Search { seed: 8, ..options };
        assert_eq!(bits(&options), bits(&options));
        assert_ne!(bits(&options), bits(&other));
    }
}

#[test]
fn a_contour_that_differs_in_its_last_bits_has_the_same_path() {
    let mut world = World::clicked();
    let points = world.contour.points_every(0.5);
    let shift = Vector3::new(3e-14, -5e-14, 2e-14);
    let shifted: Vec<Point3> = points.iter().map(|point| point + shift).collect();
    let contours = [points, shifted].map(|points| Spline::fit(&points, 30).unwrap());
    for seed in 1..=50 {
        let [path, other] = [0, 1].map(|which: usize| {
            world.contour = contours[which].clone();
            world.search(&corrected(seed)).unwrap().points
        });
        assert_eq!(path.len(), other.len(), "seed {seed}");
        let apart = path.iter().zip(&other).map(|(a, b)| (a - b).norm());
        assert!(apart.fold(0.0, f64::max) < 1e-9, "seed {seed}");
    }
}

#[test]
fn a_search_stops_when_told_to_and_within_its_iterations() {
    let world = World::torn();
    let hopeless = Search {
        cost_limit_per_mm: 0.0,
        max_iterations: 3_000,
        ..corrected(1)
    };
    let mut heard = Vec::new();
    let stopped = paper::search(
        &world.contour,
        &world.voxels,
        &hopeless,
        |_| true,
        |iterations| {
            heard.push(iterations);
            match heard.len() {
                3 => ControlFlow::Break(()),
                _ => ControlFlow::Continue(()),
            }
        },
    );
    assert_eq!(stopped, Err(Error::Cancelled));
    assert!(heard[2] < 1_000, "{heard:?}");
    match world.search(&hopeless) {
        Err(Error::NoPath {
            iterations,
            left_mm,
        }) => {
            assert_eq!(iterations, 3_000);
            assert!((20.0..26.0).contains(&left_mm), "{left_mm} mm");
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn the_papers_bites_have_the_middle_of_their_jaw_on_the_contour() {
    let world = World::clicked();
    let portal = world.portal();
    let contour = &world.contour;
    let count = paper::PAPERS_BITES;
    let bites = paper::equally_spaced(contour, count, &portal, &Vector3::z()).unwrap();
    assert_eq!(bites.len(), 39);
    let centers: Vec<Point3> = bites.iter().map(|bite| bite.center).collect();
    assert!(world.off_mm(&centers).1 < 0.02);
    assert!((centers[0] - contour.point(0.0)).norm() < 1e-9);
    assert!((centers[38] - contour.point(1.0)).norm() < 1e-9);
    let ways_mm = centers.windows(2).map(|pair| (pair[1] - pair[0]).norm());
    let spacing_mm = contour.length_mm() / 38.0;
    assert!(
        ways_mm
            .into_iter()
            .all(|way_mm| (way_mm - spacing_mm).abs() < 0.01)
    );
    for bite in &bites {
        let along = (bite.center - portal).normalize();
        assert!((bite.approach - along).norm() < 1e-9);
        assert_eq!(bite.contour_point, bite.center);
    }
}

#[test]
fn bites_that_cannot_be_are_refused_by_name() {
    let contour = World::clicked().contour;
    let above = contour.point(0.5) + Vector3::z() * 40.0;
    let refused = |count, portal: &Point3| match paper::equally_spaced(
        &contour,
        count,
        portal,
        &Vector3::z(),
    ) {
        Err(Error::Invalid { field, .. }) => field,
        other => panic!("{other:?}"),
    };
    assert_eq!(refused(1, &Point3::origin()), "count");
    assert_eq!(refused(1_001, &Point3::origin()), "count");
    assert_eq!(refused(3, &above), "options.portal");
}

#[test]
fn thirty_nine_bites_on_the_contour_cut_the_rim_that_they_should_leave() {
    let world = World::clicked();
    let portal = world.portal();
    let bites =
        paper::equally_spaced(&world.contour, paper::PAPERS_BITES, &portal, &Vector3::z()).unwrap();
    let scored = world.score_band(&bites);
    // The best the contour itself could leave is its own distance to the rim, 3.2 mm.
    assert!(scored.rim_min_mm < 1.5, "{scored:?}");
    assert!(scored.region_covered_percent < 75.0, "{scored:?}");
    assert!(scored.outside_removed_mm3 > 250.0, "{scored:?}");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn a_path_has_exact_ends_equal_steps_and_stays_on_the_tissue(
        seed in any::<u64>(),
        step_mm in 0.4..3.0f64,
        tolerance_mm in 0.5..2.0f64,
    ) {
        static WORLD: LazyLock<World> = LazyLock::new(World::torn);
        let world = &*WORLD;
        let corrected = Search { step_mm, tolerance_mm, ..corrected(seed) };
        let printed = Search { step_mm, tolerance_mm, ..printed(0.6, seed) };
        for options in [corrected, printed] {
            let points = match world.search(&options) {
                Ok(path) => path.points,
                // As printed it may fail; put right it must not.
                Err(_) if options.cost == Cost::AsPrinted => continue,
                Err(error) => panic!("{error} with {options:?}"),
            };
            let last = points.len() - 1;
            prop_assert_eq!(points[0], world.contour.point(0.0));
            prop_assert_eq!(points[last], world.contour.point(1.0));
            let way_mm = |index: usize| (points[index + 1] - points[index]).norm();
            prop_assert!((0..last - 1).all(|index| (way_mm(index) - step_mm).abs() < 1e-9));
            prop_assert!((0.5 * step_mm..=1.5 * step_mm + 1e-9).contains(&way_mm(last - 1)));
            for point in &points[1..last] {
                prop_assert!(world.voxels.distance_mm(point, tolerance_mm).is_some());
            }
        }
    }
}

/// Prints the tables of docs/planning-paper.md.
#[test]
#[ignore = "measures; run with --ignored --nocapture"]
fn table_of_both_costs() {
    for (name, world) in [
        ("clicked", World::clicked()),
        ("torn", World::torn()),
        ("whole", World::whole()),
    ] {
        println!("{name}: {:.1} mm", world.contour.length_mm());
        for step_mm in [1.0, 0.25, 0.5, 2.0] {
            let options = Search {
                step_mm,
                ..corrected(0)
            };
            print_row(&world, &options);
        }
        for cost_limit_per_mm in [0.5, 0.4, 0.3, 0.2, 0.1] {
            print_row(&world, &printed(cost_limit_per_mm, 0));
        }
        for step_mm in [0.5, 2.0] {
            let options = Search {
                step_mm,
                ..printed(0.4, 0)
            };
            print_row(&world, &options);
        }
    }
    let world = World::clicked();
    let portal = world.portal();
    let spaced =
        paper::equally_spaced(&world.contour, paper::PAPERS_BITES, &portal, &Vector3::z()).unwrap();
    println!("39 on the contour: {:?}", world.score_band(&spaced));
    for options in [corrected(0), printed(0.4, 0), printed(0.5, 0)] {
        let scores = (1..=100).filter_map(|seed| {
            let path = world.search(&Search { seed, ..options }).ok()?;
            let bites = paper::bites(&path.points, &portal, &Vector3::z()).unwrap();
            Some(world.score_band(&bites))
        });
        let scores: Vec<Evaluation> = scores.collect();
        let mean =
            |of: fn(&Evaluation) -> f64| scores.iter().map(of).sum::<f64>() / scores.len() as f64;
        println!(
            "{:?} {}: covered {:.1} %, outside {:.0} mm3, least rim {:.2} mm",
            options.cost,
            options.cost_limit_per_mm,
            mean(|score| score.region_covered_percent),
            mean(|score| score.outside_removed_mm3),
            mean(|score| score.rim_min_mm),
        );
    }
}

fn corrected(seed: u64) -> Search {
    Search { seed, ..SEARCH }
}

fn printed(cost_limit_per_mm: f64, seed: u64) -> Search {
    Search {
        cost: Cost::AsPrinted,
        cost_limit_per_mm,
        ..corrected(seed)
    }
}

fn print_row(world: &World, options: &Search) {
    let mut times_ms = Vec::new();
    let mut found = Vec::new();
    for seed in 1..=100 {
        let began = Instant::now();
        let path = world.search(&Search { seed, ..*options });
        times_ms.push(began.elapsed().as_secs_f64() * 1e3);
        found.extend(path.ok());
    }
    times_ms.sort_by(f64::total_cmp);
    let mean = |values: Vec<f64>| values.iter().sum::<f64>() / values.len().max(1) as f64;
    let offs: Vec<(f64, f64)> = found
        .iter()
        .map(|path| world.off_mm(&path.points))
        .collect();
    let turns: Vec<f64> = found
        .iter()
        .flat_map(|path| turns_deg(&path.points))
        .collect();
    println!(
        "{:?} {} step {}: {}/100, median {:.2} ms, p95 {:.2} ms, {:.0} \
         iterations, {:.1} points, off {:.2} / {:.2} mm, turn {:.1} / {:.0} deg",
        options.cost,
        options.cost_limit_per_mm,
        options.step_mm,
        found.len(),
        times_ms[50],
        times_ms[95],
        mean(
            found
                .iter()
                .map(|path| f64::from(path.iterations))
                .collect()
        ),
        mean(found.iter().map(|path| path.points.len() as f64).collect()),
        mean(offs.iter().map(|off| off.0).collect()),
        offs.iter().map(|off| off.1).fold(0.0, f64::max),
        mean(turns.clone()),
        turns.iter().copied().fold(0.0, f64::max),
    );
}
