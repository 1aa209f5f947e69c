//! How long the planners take on the phantom: `cargo bench -p arthro-planning --bench planning`.

use std::ops::ControlFlow;
use std::time::Duration;

use arthro_geometry::{Point3, phantom};
use arthro_planning::contour::Spline;
use arthro_planning::crescent::Crescent;
use arthro_planning::paper::{self, Cost, Search};
use arthro_planning::plan;
use arthro_planning::target::{Aim, Rules, Target};
use arthro_planning::voxels::Voxels;
use criterion::Criterion;

fn main() {
    let mut criterion = Criterion::default()
        .measurement_time(Duration::from_secs(10))
        .configure_from_args();
    // Each scenario is a function below, called here.
    paper_rrt(&mut criterion);
    criterion.final_summary();
}

/// The phantom, and the contour from the paper's start to its goal, in the axes of the crescent.
struct World {
    crescent: Crescent,
    voxels: Voxels,
    contour: Spline,
}

impl World {
    fn papers_case() -> Result<Self, arthro_planning::Error> {
        let mesh = phantom::mesh();
        let (crescent, voxels) = plan::model(&mesh, &phantom::PORTAL_ANTEROLATERAL, 0.5, 1.0)?;
        let aim = Aim::Ends {
            start: phantom::START,
            goal: phantom::GOAL,
        };
        let aim = aim.carried(&crescent.ct_from_meniscal.inverse());
        let contour = Target::draw(&aim, &Rules::default(), None, &crescent, &voxels)?.spline;
        Ok(Self {
            crescent,
            voxels,
            contour,
        })
    }

    fn is_in_box(&self, point: &Point3) -> bool {
        let (low, high) = phantom::TARGET_BOX;
        let point = self.crescent.ct_from_meniscal * *point;
        point.inf(&low) == low && point.sup(&high) == high
    }
}

/// The paper's planner with the corrected cost; each run has the next of a hundred seeds.
fn paper_rrt(criterion: &mut Criterion) {
    let world = World::papers_case().expect("the phantom has a contour from the paper's ends");
    let mut seed = 0;
    criterion.bench_function("paper_rrt", |bencher| {
        bencher.iter(|| {
            seed = seed % 100 + 1;
            let options = Search {
                cost: Cost::Corrected,
                step_mm: 1.0,
                tolerance_mm: 1.0,
                cost_limit_per_mm: 0.4,
                max_iterations: 100_000,
                seed,
            };
            let in_box = |point: &Point3| world.is_in_box(point);
            let go_on = |_| ControlFlow::Continue(());
            paper::search(&world.contour, &world.voxels, &options, in_box, go_on)
        });
    });
}
