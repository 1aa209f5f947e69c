//! Verification of a registration: known landmarks touched with the calibrated tip, and what their distances say.
//!
//! A residual of the registration is not its error, and no covariance knows what it was not told. A landmark that the
//! registration did not use, touched with the very tip that will bite, measures the whole chain: registration, hand-eye,
//! arm and tip together.

use arthro_geometry::{Point3, Vector3};
use nalgebra::Matrix3;

use crate::approval::Digest;
use crate::words::words;

/// Most landmarks of a case.
pub const TOUCHES_MAX: usize = 32;
/// Landmarks nearer to each other than this are one, mm.
const APART_MM: f64 = 3.0;
/// Landmarks spread at least this far along their main direction, root mean square, mm.
const ALONG_MIN_MM: f64 = 5.0;
/// And at least this far across it, mm: on one line a turn about the line shows in none of them.
const ACROSS_MIN_MM: f64 = 2.0;

/// What was touched for one case.
#[derive(Clone, Debug, PartialEq)]
pub struct Verification {
    /// Of model, scene, registration and calibrations: what the touches are about.
    pub basis: Digest,
    /// In the order of touching, one a landmark.
    pub touches: Vec<Touch>,
}

/// One landmark touched with the tip of the forceps.
#[derive(Clone, Debug, PartialEq)]
pub struct Touch {
    /// The landmark's name.
    pub landmark: String,
    /// Where it is in ct.
    pub point: Point3,
    /// Where registration and hand-eye have it, in the forceps arm's base.
    pub expected: Point3,
    /// Where the tip was measured, in the forceps arm's base.
    pub tip: Point3,
    /// Who touched.
    pub operator: String,
    /// Milliseconds since 1970-01-01 UTC.
    pub touched_at_ms: i64,
}

/// What a verification is held to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Largest root mean square distance, mm.
    pub limit_mm: f64,
    /// Fewest landmarks.
    pub touches_min: usize,
    /// Whether approval asks for a passed verification.
    pub required: bool,
}

/// What the touches say.
#[derive(Clone, Debug, PartialEq)]
pub struct Finding {
    /// Root mean square distance, mm; 0 without any touch.
    pub rms_mm: f64,
    /// Largest distance, mm.
    pub max_mm: f64,
    /// The judgement.
    pub verdict: Verdict,
    /// What is still missing, with value and limit.
    pub missing: Vec<String>,
}

words! {
    /// Judgement of a verification.
    Verdict {
        /// Nothing was touched.
        Absent = "ABSENT",
        /// What was touched fits, but does not say enough.
        Pending = "PENDING",
        /// Enough landmarks were found where they should be.
        Passed = "PASSED",
        /// The landmarks are not where they should be.
        Failed = "FAILED",
    }
}

impl Touch {
    /// Between where the landmark was found and where it should be, mm.
    pub fn distance_mm(&self) -> f64 {
        (self.tip - self.expected).norm()
    }
}

impl Verification {
    /// Nothing touched yet.
    pub const fn new(basis: Digest) -> Self {
        Self {
            basis,
            touches: Vec::new(),
        }
    }

    /// Keeps a touch in the place of an earlier one of the same landmark; says whether there was room.
    pub fn touch(&mut self, touch: Touch) -> bool {
        self.touches
            .retain(|other| other.landmark != touch.landmark);
        let room = self.touches.len() < TOUCHES_MAX;
        if room {
            self.touches.push(touch);
        }
        room
    }

    /// Takes a touch back; says whether there was one.
    pub fn remove(&mut self, landmark: &str) -> bool {
        let before = self.touches.len();
        self.touches.retain(|touch| touch.landmark != landmark);
        self.touches.len() < before
    }
}

impl Finding {
    /// Judges what was touched. Landmarks that are too far off speak against the registration however few they are; to
    /// speak for it they have to be enough and spread.
    pub fn of(touches: &[Touch], limits: &Limits) -> Self {
        let squares: f64 = touches
            .iter()
            .map(|touch| touch.distance_mm().powi(2))
            .sum();
        let rms_mm = (squares / touches.len().max(1) as f64).sqrt();
        let max_mm = touches.iter().map(Touch::distance_mm).fold(0.0, f64::max);
        let missing = missing(touches, limits);
        let verdict = if touches.is_empty() {
            Verdict::Absent
        } else if rms_mm > limits.limit_mm {
            Verdict::Failed
        } else if missing.is_empty() {
            Verdict::Passed
        } else {
            Verdict::Pending
        };
        Self {
            rms_mm,
            max_mm,
            verdict,
            missing,
        }
    }
}

fn missing(touches: &[Touch], limits: &Limits) -> Vec<String> {
    let (count, least) = (touches.len(), limits.touches_min);
    if count < least {
        return vec![format!(
            "TOO_FEW_LANDMARKS: {count} touched; must be {least} or more"
        )];
    }
    let mut missing = Vec::new();
    for (index, touch) in touches.iter().enumerate() {
        let near = touches[..index]
            .iter()
            .map(|other| (other, (other.point - touch.point).norm()))
            .find(|(_, apart_mm)| *apart_mm < APART_MM);
        if let Some((other, apart_mm)) = near {
            missing.push(format!(
                "LANDMARKS_COINCIDE: {} and {} are {apart_mm:.1} mm apart; must be {APART_MM} mm or more",
                other.landmark, touch.landmark
            ));
        }
    }
    let [along_mm, across_mm] = spread_mm(touches);
    if along_mm < ALONG_MIN_MM || across_mm < ACROSS_MIN_MM {
        missing.push(format!(
            "LANDMARKS_NOT_SPREAD: {along_mm:.1} mm along and {across_mm:.1} mm across their main direction, root mean \
             square; must be {ALONG_MIN_MM} and {ACROSS_MIN_MM} mm or more"
        ));
    }
    missing
}

/// Root mean square spread of the landmarks along their main direction and along the second one.
fn spread_mm(touches: &[Touch]) -> [f64; 2] {
    let count = touches.len().max(1) as f64;
    let sum: Vector3 = touches.iter().map(|touch| touch.point.coords).sum();
    let middle = sum / count;
    let scatter: Matrix3<f64> = touches
        .iter()
        .map(|touch| {
            let arm = touch.point.coords - middle;
            arm * arm.transpose()
        })
        .sum();
    let mut variances: [f64; 3] = (scatter / count).symmetric_eigenvalues().into();
    variances.sort_by(f64::total_cmp);
    [variances[2], variances[1]].map(|variance| variance.max(0.0).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMITS: Limits = Limits {
        limit_mm: 1.5,
        touches_min: 3,
        required: false,
    };

    fn touch(landmark: &str, [x, y, z]: [f64; 3], off_mm: f64) -> Touch {
        let point = Point3::new(x, y, z);
        Touch {
            landmark: landmark.to_owned(),
            point,
            expected: point,
            tip: point + Vector3::new(0.0, off_mm, 0.0),
            operator: "operator".to_owned(),
            touched_at_ms: 0,
        }
    }

    fn triangle(off_mm: f64) -> Vec<Touch> {
        vec![
            touch("horn", [0.0, 0.0, 0.0], off_mm),
            touch("notch", [20.0, 0.0, 0.0], off_mm),
            touch("rim", [0.0, 15.0, 0.0], off_mm),
        ]
    }

    fn verdict(touches: &[Touch]) -> Verdict {
        Finding::of(touches, &LIMITS).verdict
    }

    #[test]
    fn three_landmarks_where_they_should_be_pass() {
        let finding = Finding::of(&triangle(1.0), &LIMITS);
        assert_eq!(finding.verdict, Verdict::Passed);
        assert!((finding.rms_mm - 1.0).abs() < 1e-12 && finding.missing.is_empty());
    }

    #[test]
    fn the_root_mean_square_decides_and_the_largest_is_told() {
        let mut touches = triangle(0.0);
        touches[0].tip.y += 3.0;
        let finding = Finding::of(&touches, &LIMITS);
        assert!((finding.rms_mm - 3.0f64.sqrt()).abs() < 1e-12);
        assert_eq!((finding.max_mm, finding.verdict), (3.0, Verdict::Failed));
    }

    #[test]
    fn one_landmark_far_off_is_enough_to_fail_and_never_to_pass() {
        assert_eq!(verdict(&[]), Verdict::Absent);
        assert_eq!(verdict(&triangle(0.0)[..1]), Verdict::Pending);
        assert_eq!(verdict(&triangle(1.6)[..1]), Verdict::Failed);
    }

    #[test]
    fn landmarks_on_one_line_do_not_say_enough() {
        let touches: Vec<_> = ["a", "b", "c", "d"]
            .iter()
            .zip([0.0, 10.0, 20.0, 30.0])
            .map(|(name, x)| touch(name, [x, x, 0.0], 0.1))
            .collect();
        let finding = Finding::of(&touches, &LIMITS);
        assert_eq!(finding.verdict, Verdict::Pending);
        assert!(
            finding.missing[0].starts_with("LANDMARKS_NOT_SPREAD"),
            "{:?}",
            finding.missing
        );
    }

    #[test]
    fn the_same_place_under_two_names_is_one_landmark() {
        let mut touches = triangle(0.1);
        touches.push(touch("horn again", [0.5, 0.0, 0.0], 0.1));
        let finding = Finding::of(&touches, &LIMITS);
        assert_eq!(finding.verdict, Verdict::Pending);
        assert!(finding.missing[0].contains("horn and horn again are 0.5 mm apart"));
    }

    #[test]
    fn a_landmark_touched_again_takes_the_place_of_the_first_touch() {
        let mut verification = Verification::new(Digest::from_bytes([1; 32]));
        assert!(verification.touch(touch("horn", [0.0; 3], 9.0)));
        assert!(verification.touch(touch("horn", [0.0; 3], 0.5)));
        assert_eq!(verification.touches.len(), 1);
        assert_eq!(verification.touches[0].distance_mm(), 0.5);
        assert!(verification.remove("horn") && !verification.remove("horn"));
    }

    #[test]
    fn a_case_holds_no_more_landmarks_than_its_limit() {
        let mut verification = Verification::new(Digest::from_bytes([1; 32]));
        for index in 0..TOUCHES_MAX {
            assert!(verification.touch(touch(&index.to_string(), [0.0; 3], 0.0)));
        }
        assert!(!verification.touch(touch("one more", [0.0; 3], 0.0)));
        assert!(verification.touch(touch("0", [0.0; 3], 0.0)));
    }
}
