//! How long the planners take on the phantom: `cargo bench -p arthro-planning --bench planning`.

use std::ops::ControlFlow;
use std::time::Duration;

use arthro_geometry::{Point3, phantom};
use arthro_planning::bites::Patience;
use arthro_planning::contour::Spline;
use arthro_planning::crescent::Crescent;
use arthro_planning::jaw::Jaw;
use arthro_planning::paper::{self, Cost, Search};
use arthro_planning::plan::{self, Limits, Planner, Request};
use arthro_planning::target::{Aim, Rules, Target};
use arthro_planning::voxels::Voxels;
use criterion::Criterion;

/// Distance between the points of a lesion, mm.
const LESION_SPACING_MM: f64 = 0.5;

fn main() {
    let mut criterion = Criterion::default()
        .measurement_time(Duration::from_secs(10))
        .configure_from_args();
    paper_rrt(&mut criterion);
    bites(&mut criterion);
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

/// The bite planner on the scenarios TEAR and BAND, model to plan.
fn bites(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("bites");
    group.sample_size(10);
    for (name, request) in [("tear", tear()), ("band", band())] {
        group.bench_function(name, |bencher| {
            bencher.iter(|| plan::plan(&request, &|| Patience::GoOn, &mut |_| {}));
        });
    }
    group.finish();
}

/// Everything inboard of the contour from the paper's start to its goal.
fn band() -> Request {
    Request {
        model: phantom::mesh(),
        lesion: Vec::new(),
        lesion_spacing_mm: LESION_SPACING_MM,
        aim: Aim::Ends {
            start: phantom::START,
            goal: phantom::GOAL,
        },
        contour_rules: Rules {
            rim_min_mm: 3.2,
            ..Rules::default()
        },
        target_box: Some(phantom::TARGET_BOX),
        portals: vec![phantom::PORTAL_ANTEROLATERAL],
        jaw: Jaw::new(3.0, 4.5),
        voxel_mm: 0.5,
        planner: Planner::Bites,
        limits: Limits::default(),
        effort: 1,
        knee: None,
        arthroscope: None,
        seed: 1,
    }
}

/// What lies around the radial tear in the body.
fn tear() -> Request {
    let shape = phantom::Phantom::default();
    let (low, high) = phantom::TARGET_BOX;
    let steps = |from: f64, to: f64| {
        let count = ((to - from) / LESION_SPACING_MM) as usize;
        (0..count).map(move |step| from + LESION_SPACING_MM * step as f64)
    };
    let points = steps(low.x, high.x).flat_map(|x| {
        steps(low.y, high.y)
            .flat_map(move |y| steps(low.z, high.z).map(move |z| Point3::new(x, y, z)))
    });
    Request {
        lesion: points
            .filter(|point| shape.is_torn(point, &phantom::RadialTear::BODY))
            .collect(),
        aim: Aim::Lesion,
        contour_rules: Rules::default(),
        ..band()
    }
}
