//! Any list of bites scored by the planning service on the case of a demo, and the paper's list on the same contour.
//!
//! The paper reports 39 bites, centred on its path. Here they are centred on the plan's own contour at equal arc length,
//! which is what its search would find at best.

use arthro_geometry::frame::{Camera, Ct, ForcepsBase};
use arthro_geometry::nalgebra::Quaternion;
use arthro_geometry::{Cloud, Point3, Rotation, Similarity, Vector3};
use arthro_planning::paper::PAPERS_BITES;
use arthro_proto::common::v1::{Direction, Frame, Point};
use arthro_proto::planning::v1::evaluate_resection_request::Payload;
use arthro_proto::planning::v1::planning_service_client::PlanningServiceClient;
use arthro_proto::planning::v1::{
    Bite, EvaluateResectionOptions, EvaluateResectionRequest, Jaw, ResectionEvaluation,
    ResectionPlan,
};
use arthro_proto::registration::v1::RegistrationResult;
use arthro_simulator::scenario::{LESION_SPACING_MM, Scenario};
use tonic::transport::Channel;

use crate::commands::point;
use crate::connection;
use crate::exit::Failure;
use crate::upload;

/// Shorter than this, a shaft has no direction, mm.
const UNDEFINED_MM: f64 = 1e-6;

/// Scores lists of bites that aim at one contour.
pub struct Judge<'a> {
    planning: PlanningServiceClient<Channel>,
    scenario: &'a Scenario,
    contour: Vec<Point>,
    /// Where the forceps enter, ct.
    portal: Point3,
}

impl<'a> Judge<'a> {
    /// A judge of bites that aim at the contour of `plan`, on what the system was given.
    pub async fn of(
        planning: String,
        scenario: &'a Scenario,
        registration: &RegistrationResult,
        plan: &ResectionPlan,
    ) -> Result<Self, Failure> {
        Ok(Self {
            planning: PlanningServiceClient::new(connection::open(&planning).await?),
            scenario,
            contour: plan.contour.clone(),
            portal: portal_in_ct(scenario, registration),
        })
    }

    /// What `bites` do to the tissue.
    pub async fn score(&mut self, bites: Vec<Bite>) -> Result<ResectionEvaluation, Failure> {
        let marked = &self.scenario.preoperative;
        let view = self.scenario.system_view();
        let lesion = Cloud::new(marked.lesion.clone());
        let options = EvaluateResectionOptions {
            model: Some(upload::mesh_header(&marked.model)),
            lesion: Some(upload::cloud_header(&lesion, Frame::Ct)),
            lesion_spacing_mm: LESION_SPACING_MM,
            contour: self.contour.clone(),
            bites,
            jaw: Some(Jaw {
                width_mm: view.jaw_width_mm,
                length_mm: view.jaw_length_mm,
                throat_mm: None,
            }),
            portals: vec![point(&self.portal)],
            ..EvaluateResectionOptions::default()
        };
        let payloads = std::iter::once(Payload::Options(options))
            .chain(upload::mesh_chunks(&marked.model).map(Payload::Model))
            .chain(upload::cloud_chunks(&lesion).map(Payload::Lesion));
        let requests = payloads.map(|payload| EvaluateResectionRequest {
            payload: Some(payload),
        });
        let stream = tokio_stream::iter(requests.collect::<Vec<_>>());
        let answer = self.planning.evaluate_resection(stream).await?;
        answer.into_inner().evaluation.ok_or_else(|| {
            Failure::failed(
                "ANSWER_INCOMPLETE",
                "planning sent no evaluation".to_owned(),
            )
        })
    }

    /// The paper's bites on the contour.
    pub fn papers_bites(&self) -> Vec<Bite> {
        let contour: Vec<Point3> = self.contour.iter().map(bare).collect();
        let centers = equally_spaced(&contour, PAPERS_BITES);
        centers
            .iter()
            .filter_map(|center| centred(center, &self.portal))
            .collect()
    }
}

/// A bite whose jaw is centred on `center` and opens upwards; `None` on the portal itself.
fn centred(center: &Point3, portal: &Point3) -> Option<Bite> {
    let approach = (center - portal).try_normalize(UNDEFINED_MM)?;
    Some(Bite {
        center: Some(point(center)),
        approach: Some(direction(&approach)),
        opening: None,
        contour_point: Some(point(center)),
        portal: 0,
    })
}

/// `count` points at equal arc length on a polyline, both of its ends included.
fn equally_spaced(line: &[Point3], count: usize) -> Vec<Point3> {
    let lengths = line.windows(2).map(|ends| (ends[1] - ends[0]).norm());
    let total_mm: f64 = lengths.sum();
    let last = count.saturating_sub(1).max(1) as f64;
    let steps = (0..count).map(|step| total_mm * step as f64 / last);
    steps.filter_map(|along_mm| at(line, along_mm)).collect()
}

/// The point `along_mm` from the beginning of a polyline; its end beyond it.
fn at(line: &[Point3], along_mm: f64) -> Option<Point3> {
    let mut left_mm = along_mm;
    for ends in line.windows(2) {
        let length_mm = (ends[1] - ends[0]).norm();
        if left_mm <= length_mm && length_mm > 0.0 {
            return Some(ends[0] + (ends[1] - ends[0]) * (left_mm / length_mm));
        }
        left_mm -= length_mm;
    }
    line.last().copied()
}

/// Where the forceps enter as the system believes it: the taught portal through hand-eye and registration.
fn portal_in_ct(scenario: &Scenario, registration: &RegistrationResult) -> Point3 {
    let view = scenario.system_view();
    let found = registration.camera_from_ct.unwrap_or_default();
    let rotation = found.rotation.unwrap_or_default();
    let camera_from_ct: Similarity<Camera, Ct> = Similarity::new(
        found.scale,
        Rotation::from_quaternion(Quaternion::new(
            rotation.w, rotation.x, rotation.y, rotation.z,
        )),
        bare(&found.translation.unwrap_or_default()).coords,
    );
    let base_from_ct: Similarity<ForcepsBase, Ct> =
        Similarity::from(view.forceps_base_from_camera) * camera_from_ct;
    base_from_ct.inverse() * view.portal_in_forceps_base
}

fn bare(point: &Point) -> Point3 {
    Point3::new(point.x_mm, point.y_mm, point.z_mm)
}

fn direction(vector: &Vector3) -> Direction {
    Direction {
        x: vector.x,
        y: vector.y,
        z: vector.z,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_are_spread_evenly_over_segments_of_any_length() {
        let line = [0.0, 1.0, 5.0, 6.0].map(|x| Point3::new(x, 0.0, 0.0));
        let points = equally_spaced(&line, 4);
        let expected = [0.0, 2.0, 4.0, 6.0].map(|x| Point3::new(x, 0.0, 0.0));
        assert_eq!(points.len(), expected.len());
        for (point, expected) in points.iter().zip(&expected) {
            assert!((point - expected).norm() < 1e-9, "{point} {expected}");
        }
    }

    #[test]
    fn a_bite_points_from_the_portal_to_its_center() {
        let center = Point3::new(3.0, 0.0, 4.0);
        let bite = centred(&center, &Point3::origin()).unwrap();
        assert_eq!(bite.approach.map(|approach| approach.z), Some(0.8));
        assert!(centred(&center, &center).is_none());
    }
}
