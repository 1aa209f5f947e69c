//! Poses of which the generating joints are known, one in three of them at or near a singularity, and the account of an
//! inverse over them.

use std::f64::consts::{PI, TAU};

use arthro_motion::kinematics::Joints;
use arthro_motion::kinematics::flange_pose::FlangePose;
use arthro_motion::kinematics::links::Links;
use arthro_motion::kinematics::model::Model;
use arthro_motion::kinematics::singularity::Singularities;

/// A small seeded generator, so that the sweep is the same everywhere.
pub struct Sweep(pub u64);

impl Sweep {
    fn unit(&mut self) -> f64 {
        // splitmix64
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Each joint anywhere within half a turn.
    pub fn joints(&mut self) -> Joints {
        std::array::from_fn(|_| (self.unit() - 0.5) * TAU)
    }
}

/// What a sweep found.
#[derive(Clone, Copy, Debug, Default)]
pub struct Account {
    /// Poses without a solution.
    pub missing: usize,
    /// Poses whose generating joints are not among the solutions.
    pub lost: usize,
    /// How far the flange of the worst solution is from the pose, mm.
    pub worst_mm: f64,
    /// The same of its orientation, rad.
    pub worst_rad: f64,
    /// Solutions altogether.
    pub solutions: usize,
}

/// Joints at random, one set in three of them at or near one of the singularities.
pub fn generated(sweep: &mut Sweep, model: &Model, case: usize) -> Joints {
    let mut joints = sweep.joints();
    let links = model.links();
    let sign = [1.0, -1.0][case / 33 % 2];
    let off = match case % 33 {
        // At the singularity, then from far below what doubles resolve to what is harmless.
        0 | 3 | 6 | 9 | 12 => 0.0,
        _ => sign * 10_f64.powf(-16.0 * sweep.unit()),
    };
    match case % 33 {
        0..=1 => joints[4] = off,
        2..=3 => joints[4] = PI - off.abs(),
        4 => joints[4] = [1e-7, 1e-6, 1e-5, 1e-4, 1e-3][case % 5],
        5..=6 => joints[2] = off,
        7 => joints[2] = PI - off.abs(),
        8..=9 => {
            // The last bend over the shoulder: its reach a2 c2 + a3 c23 + d5 s234 is this small.
            let q23 = joints[1] + joints[2];
            let reach = links.a2_mm * joints[1].cos() + links.a3_mm * q23.cos();
            let sine = (100.0 * off - reach) / links.d5_mm;
            if sine.abs() <= 1.0 {
                joints[3] = sine.asin() - q23;
            }
        }
        10 => (joints[2], joints[4]) = (off, off),
        11 => joints = joints.map(|angle| (2.0 * angle / PI).round() * PI / 2.0),
        12 => joints = [0.0; 6],
        _ => {}
    }
    joints
}

/// How near the generating joints must be found again. A pose of this size is known to about 1e-15; 1e-12 leaves room
/// for the rounding of the way there and back. Where two solutions meet, at the shoulder and at the elbow, what follows
/// is known to that divided by the distance from there, or to its root if that is less; and a pose tells joints 4 and 6
/// to what is known divided by sin q5. From 1 rad on the pose tells nothing of them: any solution that reaches it counts.
fn tolerance_rad(links: &Links, near: &Singularities) -> f64 {
    let fold = |known: f64, distance: f64| (known / distance.max(1e-16)).min(known.sqrt());
    let known = fold(1e-12, (near.shoulder_mm / links.d4_mm).min(1.0));
    let wrist = near.wrist_rad.sin();
    // Below this joint 6 is that of the reference, unless joint 1 is not known well enough to see it.
    let is_singular = wrist < 0.9e-13 && known <= 1e-11;
    let wrist = if is_singular { 1.0 } else { wrist };
    fold(known / wrist, near.elbow_rad.sin()).min(1.0)
}

/// Solves `cases` poses.
pub fn account(model: &Model, seed: u64, cases: usize) -> Account {
    let mut sweep = Sweep(seed);
    let mut account = Account::default();
    for case in 0..cases {
        let joints = generated(&mut sweep, model, case);
        let wanted = model.forward(&joints);
        let solutions = model.inverse(&wanted, &joints);
        for solution in solutions.as_slice() {
            let (mm, rad) = residual(model, solution, &wanted);
            account.solutions += 1;
            account.worst_mm = account.worst_mm.max(mm);
            account.worst_rad = account.worst_rad.max(rad);
        }
        let tolerance = tolerance_rad(model.links(), &model.singularities(&joints));
        let is_generating = |solution: &Joints| {
            tolerance >= 1.0 || (0..6).all(|i| wrap(solution[i] - joints[i]).abs() <= tolerance)
        };
        let kept = solutions.as_slice().iter().any(is_generating);
        if !kept && account.lost < 5 {
            eprintln!("case {case}: {joints:?} lost in {:?}", solutions.as_slice());
        }
        account.missing += usize::from(solutions.as_slice().is_empty());
        account.lost += usize::from(!kept);
    }
    account
}

/// How far joints are from a pose, mm and rad.
fn residual(model: &Model, joints: &Joints, wanted: &FlangePose) -> (f64, f64) {
    let reached = model.forward(joints);
    assert!(reached.faces(wanted), "{joints:?}");
    let (shift_mm, turn_rad) = reached.error_to(wanted);
    (shift_mm.norm(), turn_rad.norm())
}

/// The same angle within half a turn.
fn wrap(angle: f64) -> f64 {
    angle - TAU * (angle / TAU).round()
}
