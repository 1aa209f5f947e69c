//! A registration made ready: the model and the view about their own centres, what may be answered, and how a pose is
//! scored. Both pipelines search it, and the evidence is measured on it.

use arthro_geometry::frame::{Camera, Ct};
use arthro_geometry::{Cloud, Point3, Similarity};

use crate::contact::contacts;
use crate::model::Model;
use crate::scale::ScaleRange;
use crate::view::{Seen, View, extent_mm};
use crate::visibility::Visibility;

/// A distance beyond this counts as astray in a score, units: a stray point weighs little, a missed horn of the crescent much.
const STRAY_UNITS: f64 = 1.5;
/// Weight of free-space violations against residuals.
const VIOLATION_WEIGHT: f64 = 4.0;

/// Model and view about their centres.
#[derive(Clone, Debug)]
pub struct Problem {
    /// The preoperative surface.
    pub model: Model,
    /// What the camera saw.
    pub view: View,
    /// Free space in front of the view, if the viewpoint is known.
    pub visibility: Option<Visibility>,
    /// The scales that may be answered.
    pub allowed: ScaleRange,
    /// Scale by the sizes of model and view: independent of how they are turned, low where the view is a small part.
    pub scale_by_size: f64,
}

/// A pose from the view's centre to the model's.
pub type Pose = Similarity<Ct, Camera>;

/// A pose under way.
#[derive(Clone, Copy, Debug)]
pub struct Candidate {
    /// As the coarse stage found it.
    pub coarse: Pose,
    /// As refined.
    pub pose: Pose,
    /// Residual in mm of the view, strays cut short, raised by free-space violations; lower is better.
    pub score: f64,
}

impl Problem {
    /// Prepares `source`, the model in ct, and `target`, the view, seen from `viewpoint`.
    pub fn new(
        source: &Cloud,
        target: &Cloud,
        viewpoint: Option<Point3>,
        allowed: ScaleRange,
    ) -> Self {
        let (model, view) = rayon::join(|| Model::new(source), || View::new(target, viewpoint));
        Self::of(model, view, allowed)
    }

    /// The same with the view seen in a mirror. What fits it better than the view is a model of the other side.
    pub fn mirrored(&self, allowed: ScaleRange) -> Self {
        Self::of(self.model.clone(), self.view.mirrored(), allowed)
    }

    fn of(model: Model, view: View, allowed: ScaleRange) -> Self {
        Self {
            visibility: Visibility::new(&model, &view),
            scale_by_size: view.extent_mm / extent_mm(&model.points),
            allowed,
            model,
            view,
        }
    }

    /// Distance in the view beyond which a point counts as astray, mm.
    pub fn stray_view_mm(&self) -> f64 {
        STRAY_UNITS * self.model.unit_mm * self.allowed.clamp(self.scale_by_size)
    }

    /// A candidate with its score on `seen`.
    pub fn candidate(&self, coarse: Pose, pose: Pose, seen: &Seen) -> Candidate {
        let stray = self.stray_view_mm() * pose.scale;
        let contacts = contacts(&self.model, seen, &pose);
        let squares = contacts.iter().map(|contact| match contact.faces_camera {
            true => contact.foot.distance2.min(stray * stray),
            false => stray * stray,
        });
        let rms_mm = (squares.sum::<f64>() / contacts.len().max(1) as f64).sqrt() / pose.scale;
        Candidate {
            coarse,
            pose,
            score: rms_mm * (1.0 + VIOLATION_WEIGHT * self.violation_share(&pose)),
        }
    }

    /// Share of the model in front of what was seen, 0..1; 0 if the viewpoint is unknown.
    pub fn violation_share(&self, pose: &Pose) -> f64 {
        self.visibility
            .as_ref()
            .map_or(0.0, |visibility| visibility.violation_share(pose))
    }

    /// Whether two poses are nearer to each other than `limits`.
    pub fn alike(&self, a: &Pose, b: &Pose, limits: &Likeness) -> bool {
        a.rotation.angle_to(&b.rotation).to_degrees() < limits.degrees
            && (a.translation_mm - b.translation_mm).norm() < limits.units * self.model.unit_mm
            && (a.scale / b.scale).ln().abs() < limits.log_scale
    }

    /// The best of each group of like candidates, at most `count`, best first.
    pub fn distinct(
        &self,
        mut candidates: Vec<Candidate>,
        count: usize,
        limits: &Likeness,
    ) -> Vec<Candidate> {
        candidates.sort_by(|a, b| a.score.total_cmp(&b.score));
        let mut kept: Vec<Candidate> = Vec::new();
        for candidate in candidates {
            if kept.len() == count {
                break;
            }
            if !kept
                .iter()
                .any(|other| self.alike(&other.pose, &candidate.pose, limits))
            {
                kept.push(candidate);
            }
        }
        kept
    }

    /// A pose in the frames that model and view came in.
    pub fn camera_from_ct(&self, pose: &Pose) -> Similarity<Camera, Ct> {
        let about = pose.inverse();
        let moved =
            self.view.center.coords - about.rotation * self.model.center.coords * about.scale;
        Similarity::new(about.scale, about.rotation, about.translation_mm + moved)
    }

    /// The inverse of [`Self::camera_from_ct`].
    pub fn pose(&self, camera_from_ct: &Similarity<Camera, Ct>) -> Pose {
        let moved = camera_from_ct.rotation * self.model.center.coords * camera_from_ct.scale
            - self.view.center.coords;
        Similarity::<Camera, Ct>::new(
            camera_from_ct.scale,
            camera_from_ct.rotation,
            camera_from_ct.translation_mm + moved,
        )
        .inverse()
    }
}

/// How near two poses are that count as one.
#[derive(Clone, Copy, Debug)]
pub struct Likeness {
    /// Between their rotations.
    pub degrees: f64,
    /// Between the places where they put the view's centre, units.
    pub units: f64,
    /// Between the logarithms of their scales.
    pub log_scale: f64,
}
