//! The paper's search with the corrected cost over many seeds, on the contour of a case.

use std::ops::ControlFlow;
use std::time::Instant;

use arthro_planning::Error;
use arthro_planning::paper::{self, Cost};
use serde_json::{Value, json};

use crate::exit::Failure;
use crate::plan::request::{Asked, papers_search};

const SEEDS: u64 = 100;

/// What the search found.
pub struct Found {
    /// With how many seeds it reached the goal.
    found: usize,
    /// Mean distance of the points of all paths to the contour, mm.
    mean_off_mm: f64,
    /// Median time of a search, ms.
    median_ms: f64,
    /// The cost that no path exceeds, 1/mm.
    limit_per_mm: f64,
}

/// Searches with every seed.
pub fn run(asked: &Asked) -> Result<Found, Failure> {
    let (site, target) = asked.target()?;
    let ct_from_meniscal = &site.crescent.ct_from_meniscal;
    let is_allowed = |point: &arthro_geometry::Point3| {
        let point = *ct_from_meniscal * *point;
        let target_box = asked.request.target_box;
        target_box.is_none_or(|(low, high)| point.inf(&low) == low && point.sup(&high) == high)
    };
    let contour = &target.spline;
    let (mut off_mm, mut times_ms, mut found) = (Vec::new(), Vec::new(), 0);
    for seed in 1..=SEEDS {
        let search = papers_search(Cost::Corrected, seed);
        let began = Instant::now();
        let watch = |_| ControlFlow::Continue(());
        let path = paper::search(contour, &site.voxels, &search, is_allowed, watch);
        times_ms.push(1000.0 * began.elapsed().as_secs_f64());
        let path = match path {
            Ok(path) => path,
            Err(Error::NoPath { .. }) => continue,
            Err(error) => return Err(error.into()),
        };
        found += 1;
        let points = path.points.iter();
        off_mm.extend(points.map(|point| (contour.point(contour.nearest(point)) - point).norm()));
    }
    times_ms.sort_by(f64::total_cmp);
    Ok(Found {
        found,
        mean_off_mm: off_mm.iter().sum::<f64>() / off_mm.len().max(1) as f64,
        median_ms: times_ms[times_ms.len() / 2],
        limit_per_mm: papers_search(Cost::Corrected, 1).cost_limit_per_mm,
    })
}

impl Found {
    /// For programs.
    pub fn json(&self) -> Value {
        json!({
            "cost": "corrected",
            "seeds": SEEDS,
            "found": self.found,
            "mean_off_mm": self.mean_off_mm,
            "median_ms": self.median_ms,
            "limit_per_mm": self.limit_per_mm,
        })
    }

    /// For people, beside what is asked.
    pub fn line(&self) -> String {
        format!(
            "phantom band, paper's search with corrected cost: {} of {SEEDS} seeds, {:.2} mm off the contour (asked <= 0.5), \
             median {:.2} ms (asked <= 5)",
            self.found, self.mean_off_mm, self.median_ms
        )
    }
}
