use arthro_geometry::{Point3, Vector3};

use super::*;
use crate::scenario::Spec;

/// Drives that go where they are told at 10 mm/s, without electronics.
struct Told {
    shafts_qc: [f64; 4],
    peak_load_ma: f64,
    switch_seen: bool,
}

impl Told {
    fn new() -> Self {
        Self {
            shafts_qc: axes::start_qc(),
            peak_load_ma: 0.0,
            switch_seen: false,
        }
    }

    /// Ticks the cell until the jaw's feed has arrived.
    fn feed(&mut self, cell: &mut Cell, joints_rad: &[[f64; 6]; 2], to_mm: f64) {
        let qc_per_mm = 21_504.0;
        while (self.shafts_qc[FORCEPS_FEED] - to_mm * qc_per_mm).abs() > 1e-6 {
            cell.tick(joints_rad, |dt_s, _, mechanics| {
                self.peak_load_ma = self.peak_load_ma.max(mechanics[FORCEPS_FEED].load_ma);
                self.switch_seen |= mechanics[FORCEPS_FEED].inputs[0].actuated;
                let step = 10.0 * qc_per_mm * dt_s;
                let left = to_mm * qc_per_mm - self.shafts_qc[FORCEPS_FEED];
                self.shafts_qc[FORCEPS_FEED] += left.clamp(-step, step);
                self.shafts_qc
            });
        }
    }
}

fn scenario() -> Scenario {
    Scenario::phantom(Spec::default()).unwrap()
}

/// Joints that bring the forceps' tip to a point with the shaft along a direction: Newton on the true
/// kinematics, from the joints the arm starts at.
pub(crate) fn reach(
    shape: &ArmShape,
    mut joints_rad: [f64; 6],
    tip: Point3,
    along: Vector3,
) -> Option<[f64; 6]> {
    let residual = |joints: &[f64; 6]| {
        let body = shape.at(joints);
        let place = (body.tip - tip) / 100.0;
        let direction = body.along - along;
        [
            place.x,
            place.y,
            place.z,
            direction.x,
            direction.y,
            direction.z,
        ]
    };
    type M6 = nalgebra::Matrix6<f64>;
    type V6 = nalgebra::Vector6<f64>;
    for _ in 0..200 {
        let now = V6::from(residual(&joints_rad));
        if now.norm() < 1e-10 {
            return Some(joints_rad);
        }
        let jacobian = M6::from_fn(|row, column| {
            let mut nudged = joints_rad;
            nudged[column] += 1e-6;
            (residual(&nudged)[row] - now[row]) / 1e-6
        });
        // The turn about the shaft is free and the wrist turns it without moving anything else.
        let damped = jacobian.transpose() * jacobian + M6::identity() * 1e-8;
        let step = damped.try_inverse()? * jacobian.transpose() * now;
        let scale = (0.2 / step.amax()).min(1.0);
        for (joint, change) in joints_rad.iter_mut().zip(step.iter()) {
            *joint -= scale * change;
        }
    }
    None
}

#[test]
fn a_bite_over_the_lesion_is_carried_to_the_tray() {
    let scenario = scenario();
    let mut cell = Cell::new(&scenario);
    let start = scenario.spec.layout.start_joints_rad;
    let lesion = &scenario.preoperative.lesion;
    let middle = lesion.iter().map(|p| p.coords).sum::<Vector3>() / lesion.len() as f64;
    let middle = *cell.knee.forceps_base_from_ct() * Point3::from(middle);
    let portal = cell.knee.portals()[0];
    let bite = reach(
        &cell.arms[0],
        start[0],
        middle,
        (middle - portal).normalize(),
    )
    .unwrap();
    let view = scenario.system_view();
    let tray = view.forceps_base_from_tool_at_tray;
    let tray = reach(
        &cell.arms[0],
        start[0],
        tray.origin(),
        tray.direction(&Vector3::x()),
    )
    .unwrap();

    let mut drives = Told::new();
    drives.feed(&mut cell, &[bite, start[1]], 0.0);
    drives.feed(&mut cell, &[bite, start[1]], 10.0);
    let account = cell.account();
    assert!(account.held.damaged_mm3 > 0.5, "{:?}", account.held);
    assert!(drives.peak_load_ma > 100.0, "{} mA", drives.peak_load_ma);
    drives.feed(&mut cell, &[tray, start[1]], 0.0);

    let account = cell.account();
    let tissue = account.referee.tissue();
    assert_eq!((tissue.bites, tissue.empty_bites), (1, 0));
    assert!((tissue.delivered_mm3 - tissue.removed.total_mm3()).abs() < 1e-9);
    assert!(account.referee.shafts()[0].rcm_max_mm < 1e-6);
    assert_eq!(account.referee.collisions(), []);
}

#[test]
fn the_same_inputs_give_the_same_account() {
    let run = || {
        let scenario = scenario();
        let mut cell = Cell::new(&scenario);
        let mut drives = Told::new();
        let mut joints = scenario.spec.layout.start_joints_rad;
        for _ in 0..50 {
            joints[0][0] -= 0.001;
            drives.feed(&mut cell, &joints, 1.0);
            drives.feed(&mut cell, &joints, 0.0);
        }
        format!("{:?}", cell.account().referee)
    };
    assert_eq!(run(), run());
}

#[test]
fn both_arms_start_apart_from_each_other_and_from_the_knee() {
    for seed in 0..20 {
        let scenario = Scenario::phantom(Spec {
            seed,
            ..Spec::default()
        })
        .unwrap();
        let mut cell = Cell::new(&scenario);
        let joints = scenario.spec.layout.start_joints_rad;
        cell.tick(&joints, |_, _, _| axes::start_qc());
        let account = cell.account();
        assert_eq!(account.referee.collisions(), [], "seed {seed}");
        assert_eq!(
            account.referee.shafts().map(|shaft| shaft.insertions),
            [0, 0]
        );
    }
}

#[test]
fn the_switch_of_a_feed_is_active_at_its_retracted_end() {
    let scenario = scenario();
    let mut cell = Cell::new(&scenario);
    let joints = scenario.spec.layout.start_joints_rad;
    let mut drives = Told::new();
    drives.feed(&mut cell, &joints, -0.9);
    assert!(!drives.switch_seen);
    drives.feed(&mut cell, &joints, -1.1);
    drives.feed(&mut cell, &joints, -1.05);
    assert!(drives.switch_seen);
}

/// Joints along a straight way of the tip while the shaft turns evenly; none where the arm cannot follow.
fn follow(shape: &ArmShape, joints_rad: [f64; 6], to: (Point3, Vector3)) -> Option<Vec<[f64; 6]>> {
    const STEPS: u32 = 40;
    let start = shape.at(&joints_rad);
    let mut way = vec![joints_rad];
    for step in 1..=STEPS {
        let share = f64::from(step) / f64::from(STEPS);
        let along = start.along.lerp(&to.1, share).normalize();
        let next = reach(
            shape,
            way[way.len() - 1],
            start.tip + (to.0 - start.tip) * share,
            along,
        )?;
        let jump = next
            .iter()
            .zip(&way[way.len() - 1])
            .map(|(a, b)| (a - b).abs())
            .fold(0.0, f64::max);
        if jump > 0.5 {
            return None;
        }
        way.push(next);
    }
    Some(way)
}

#[test]
fn every_bite_site_of_every_case_is_reached_without_contact() {
    let shared = crate::scenario::tests::shared_menisci();
    for seed in 0..4 {
        let spec = Spec {
            seed,
            ..Spec::default()
        };
        let phantom = (
            "phantom".to_owned(),
            Scenario::phantom(spec.clone()).unwrap(),
        );
        let cases = shared.iter().map(|(name, mesh)| {
            (
                name.clone(),
                Scenario::of_mesh(spec.clone(), mesh.clone()).unwrap(),
            )
        });
        for (name, scenario) in std::iter::once(phantom).chain(cases) {
            let mut cell = Cell::new(&scenario);
            let [mut forceps, mut arthroscope] = scenario.spec.layout.start_joints_rad;
            let knee = cell.knee.clone();
            let base_from_ct = *knee.forceps_base_from_ct();
            let lesion = &scenario.preoperative.lesion;
            let middle = lesion.iter().map(|p| p.coords).sum::<Vector3>() / lesion.len() as f64;
            let middle = base_from_ct * Point3::from(middle);
            let shapes = cell.arms.clone();
            let mut tick = |forceps: &[f64; 6], arthroscope: &[f64; 6]| {
                cell.tick(&[*forceps, *arthroscope], |_, _, _| axes::start_qc());
            };

            // The arthroscope goes in to 15 mm from the lesion.
            let [portal, view] = *knee.portals();
            let along = (middle - view).normalize();
            for tip in [
                view - along * 60.0,
                view - along * 5.0,
                middle - along * 15.0,
            ] {
                let way = follow(&shapes[1], arthroscope, (tip, along))
                    .unwrap_or_else(|| panic!("{name} seed {seed}: the arthroscope cannot follow"));
                way.iter().for_each(|joints| tick(&forceps, joints));
                arthroscope = way[way.len() - 1];
            }

            // The forceps goes to sites all along the contour and back.
            let crescent = &scenario.truth.crescent;
            let knee_from_ct = crescent.ct_from_knee.inverse();
            let phi = |point: &Point3| crate::scenario::crescent::polar(&(knee_from_ct * *point)).0;
            let (from, to) = (
                phi(&scenario.preoperative.start),
                phi(&scenario.preoperative.goal),
            );
            for step in 0..=6 {
                let phi_rad = from + (to - from) * f64::from(step) / 6.0;
                let sector = crescent.sector(phi_rad).unwrap();
                let site =
                    crescent.point(phi_rad, sector.free_edge_mm + 1.5, 0.2 * crescent.height_mm);
                let site = base_from_ct * site;
                let along = (site - portal).normalize();
                for tip in [
                    portal - along * 60.0,
                    portal - along * 5.0,
                    site,
                    portal - along * 5.0,
                ] {
                    let way = follow(&shapes[0], forceps, (tip, along)).unwrap_or_else(|| {
                        panic!(
                            "{name} seed {seed}: the forceps cannot follow at {:.0} deg",
                            phi_rad.to_degrees()
                        )
                    });
                    way.iter().for_each(|joints| tick(joints, &arthroscope));
                    forceps = way[way.len() - 1];
                }
            }
            let account = cell.account();
            assert_eq!(account.referee.collisions(), [], "{name} seed {seed}");
        }
    }
}
