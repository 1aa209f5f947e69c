//! The paper's planner on the phantom.

use std::ops::ControlFlow;
use std::time::Instant;

use arthro_geometry::phantom::{self, Phantom};
use arthro_geometry::{Point3, Vector3};
use arthro_planning::Error;
use arthro_planning::contour::Spline;
use arthro_planning::crescent::Crescent;
use arthro_planning::lesion::Lesion;
use arthro_planning::paper::{self, Cost, Path, Search};
use arthro_planning::plan;
use arthro_planning::reference::{Ends, Reference};
use arthro_planning::voxels::Voxels;
use proptest::prelude::*;

use crate::world::{papers_case, papers_search};

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
    let meniscal_from_ct = crescent.ct_from_meniscal.inverse();
    let ends = Ends {
        start: meniscal_from_ct * phantom::START,
        goal: meniscal_from_ct * phantom::GOAL,
        tolerance_mm: 1.0,
        rim_min_mm: 3.0,
    };
    Reference::draw(&ends, lesion, crescent, voxels)
        .unwrap()
        .spline
}

fn turns_deg(points: &[Point3]) -> Vec<f64> {
    let corners = points.windows(3);
    corners
        .map(|at| (at[1] - at[0]).angle(&(at[2] - at[1])).to_degrees())
        .collect()
}

/// Prints the table of docs/planning-paper.md.
#[test]
#[ignore = "measures; run with --ignored --nocapture"]
fn table_of_both_costs() {
    for (name, world) in [
        ("clicked", World::clicked()),
        ("torn", World::torn()),
        ("whole", World::whole()),
    ] {
        println!("{name}: {:.1} mm", world.contour.length_mm());
        let rows = [
            (Cost::Corrected, 0.4, 1.0),
            (Cost::Corrected, 0.4, 0.5),
            (Cost::Corrected, 0.4, 2.0),
            (Cost::AsPrinted, 0.5, 1.0),
            (Cost::AsPrinted, 0.4, 1.0),
            (Cost::AsPrinted, 0.3, 1.0),
            (Cost::AsPrinted, 0.2, 1.0),
        ];
        for (cost, cost_limit_per_mm, step_mm) in rows {
            print_row(&world, cost, cost_limit_per_mm, step_mm);
        }
    }
}

fn print_row(world: &World, cost: Cost, cost_limit_per_mm: f64, step_mm: f64) {
    let mut times_ms = Vec::new();
    let mut found = Vec::new();
    for seed in 1..=100 {
        let options = Search {
            cost,
            cost_limit_per_mm,
            step_mm,
            seed,
            ..papers_search()
        };
        let began = Instant::now();
        let path = world.search(&options);
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
        "{cost:?} {cost_limit_per_mm} step {step_mm}: {}/100, median {:.2} ms, p95 {:.2} ms, {:.0} \
         iterations, {:.1} points, off {:.2} / {:.2} mm, turn {:.1} / {:.0} deg",
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
