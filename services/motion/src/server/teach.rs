//! Teaching: poses are taken in and solved; nothing moves and nothing is kept.

use arthro_geometry::Rigid;
use arthro_geometry::frame::{Base, Flange};
use arthro_geometry::nalgebra::Matrix3;
use arthro_proto::motion::v1 as proto;
use arthro_proto::motion::v1::teaching_service_server::TeachingService;
use tonic::{Request, Response, Status};

use super::fields::{self, Fields};
use super::{Arm, Motion, Which};
use crate::error::Error;
use crate::teach::{Agreement, Demands, portal, shaft};

/// Most poses of one call.
const POSES_MAX: usize = 500;
/// Largest of a noise or a limit that is no mistake, mm.
const MM_MAX: f64 = 100.0;

#[tonic::async_trait]
impl TeachingService for Motion {
    async fn solve_portal(
        &self,
        request: Request<proto::SolvePortalRequest>,
    ) -> Result<Response<proto::SolvePortalResponse>, Status> {
        let request = request.into_inner();
        let mut found = Fields::default();
        let which = found.arm(request.arm);
        let demands = found.demands(
            &portal::DEMANDS,
            ("line_noise_mm", request.line_noise_mm),
            ("residual_limit_mm", request.residual_limit_mm),
            ("uncertainty_limit_mm", request.uncertainty_limit_mm),
        );
        let poses = self.poses(&mut found, which, &request.poses, 2)?;
        let ((which, demands), poses) = found.finish(which.zip(demands).zip(poses))?;
        let flange_from_tool = self.arm(which).handle.options().arm.flange_from_tool();
        let answer = blocking(move || {
            let tools: Vec<_> = poses.iter().map(|pose| *pose * flange_from_tool).collect();
            let taught = portal::solve(&tools, &demands).map_err(Error::from)?;
            Ok(proto::SolvePortalResponse {
                portal: Some(fields::point(&taught.portal)),
                portal_covariance_mm2: taught.covariance_mm2.as_ref().map_or_else(Vec::new, rows),
                axis: Some(fields::direction(&taught.axis)),
                lines: lines(&poses, &taught.agreements),
                residual_rms_mm: taught.residual_rms_mm,
                portal_deviation_mm: taught
                    .covariance_mm2
                    .as_ref()
                    .map_or(0.0, crate::teach::deviation),
                spread_rad: taught.spread_rad,
            })
        });
        Ok(Response::new(answer.await?))
    }

    async fn calibrate_shaft(
        &self,
        request: Request<proto::CalibrateShaftRequest>,
    ) -> Result<Response<proto::CalibrateShaftResponse>, Status> {
        let request = request.into_inner();
        let mut found = Fields::default();
        let which = found.arm(request.arm);
        let demands = found.demands(
            &shaft::DEMANDS,
            ("line_noise_mm", request.line_noise_mm),
            ("residual_limit_mm", request.residual_limit_mm),
            ("uncertainty_limit_rad", request.uncertainty_limit_rad),
        );
        let poses = self.poses(&mut found, which, &request.poses, 5)?;
        let ((which, demands), poses) = found.finish(which.zip(demands).zip(poses))?;
        let configured = self.arm(which).handle.options().arm.flange_from_tool();
        let answer = blocking(move || {
            let found = shaft::solve(&poses, &configured, &demands).map_err(Error::from)?;
            let correction = configured
                .rotation()
                .angle_to(&found.flange_from_tool.rotation());
            Ok(proto::CalibrateShaftResponse {
                direction: Some(fields::direction(&found.direction_in_flange)),
                direction_covariance_rad2: rows(&found.direction_covariance_rad2),
                point: Some(fields::point(&found.point_in_flange)),
                point_covariance_mm2: rows(&found.point_covariance_mm2),
                portal: Some(fields::point(&found.portal)),
                portal_covariance_mm2: rows(&found.portal_covariance_mm2),
                lines: lines(&poses, &found.agreements),
                residual_rms_mm: found.residual_rms_mm,
                estimated_noise_mm: found.estimated_noise_mm,
                direction_deviation_rad: found.direction_deviation_rad(),
                correction_rad: correction,
                configured_residual_rms_mm: shaft::residual_rms_mm(
                    &poses,
                    &configured,
                    &found.portal,
                ),
                flange_from_tool: Some(fields::pose(&found.flange_from_tool)),
            })
        });
        Ok(Response::new(answer.await?))
    }
}

impl Motion {
    /// The poses base_from_flange of a request; `None` beside the violations noted.
    fn poses(
        &self,
        found: &mut Fields,
        which: Option<Which>,
        taught: &[proto::TaughtPose],
        least: usize,
    ) -> Result<Option<Vec<Rigid<Base, Flange>>>, Error> {
        if !(least..=POSES_MAX).contains(&taught.len()) {
            let fault = format!("has {}; must have {least} .. {POSES_MAX}", taught.len());
            return Ok(found.wrong("poses", fault));
        }
        let Some(which) = which else {
            return Ok(None);
        };
        let mut poses = Vec::with_capacity(taught.len());
        for (index, taught) in taught.iter().enumerate() {
            let field = format!("poses[{index}]");
            match base_from_flange(found, self.arm(which), &field, taught)? {
                Some(pose) => poses.push(pose),
                None => return Ok(None),
            }
        }
        Ok(Some(poses))
    }
}

fn base_from_flange(
    found: &mut Fields,
    arm: &Arm,
    field: &str,
    taught: &proto::TaughtPose,
) -> Result<Option<Rigid<Base, Flange>>, Error> {
    use proto::taught_pose::Pose;
    let options = arm.handle.options();
    let tool_from_flange = options.arm.flange_from_tool().inverse();
    Ok(match &taught.pose {
        None => found.wrong(field, "is empty; must be base_from_flange, joints or now"),
        Some(Pose::BaseFromFlange(pose)) => {
            found.pose(&format!("{field}.base_from_flange"), Some(*pose))
        }
        Some(Pose::Joints(joints)) => found
            .joints(&format!("{field}.joints.joints_rad"), &joints.joints_rad)
            .map(|joints| options.arm.base_from_tool(&joints) * tool_from_flange),
        Some(Pose::Now(_)) => {
            let published = arm.handle.published();
            let published = published.borrow();
            let state = published.state.as_ref().filter(|_| published.connected);
            let state = state.ok_or_else(|| Error::NotConnected {
                arm: options.name,
                address: options.address.clone(),
            })?;
            if state.moving {
                return Err(Error::Moving);
            }
            Some(state.base_from_tool * tool_from_flange)
        }
    })
}

impl Fields {
    /// What is demanded; 0 takes what is usual.
    fn demands(
        &mut self,
        usual: &Demands,
        noise: (&str, f64),
        residual: (&str, f64),
        uncertainty: (&str, f64),
    ) -> Option<Demands> {
        let line_noise_mm = self.or_usual(noise, None);
        let residual_limit_mm = self.or_usual(residual, Some(usual.residual_limit_mm));
        let uncertainty_limit = self.or_usual(uncertainty, Some(usual.uncertainty_limit));
        Some(Demands {
            line_noise_mm: line_noise_mm?,
            residual_limit_mm: residual_limit_mm??,
            uncertainty_limit: uncertainty_limit??,
        })
    }

    fn or_usual(&mut self, (field, value): (&str, f64), usual: Option<f64>) -> Option<Option<f64>> {
        if value == 0.0 {
            Some(usual)
        } else if (f64::MIN_POSITIVE..=MM_MAX).contains(&value) {
            Some(Some(value))
        } else {
            let fault = format!("is {value}; must be 0 or within 0 .. {MM_MAX}");
            self.wrong(field, fault)
        }
    }
}

/// Solves off the threads that carry the stop.
async fn blocking<T: Send + 'static>(
    solve: impl FnOnce() -> Result<T, Error> + Send + 'static,
) -> Result<T, Error> {
    tokio::task::spawn_blocking(solve)
        .await
        .map_err(|_| Error::Gone)?
}

fn lines(poses: &[Rigid<Base, Flange>], agreements: &[Agreement]) -> Vec<proto::TaughtLine> {
    poses
        .iter()
        .zip(agreements)
        .map(|(pose, agreement)| proto::TaughtLine {
            base_from_flange: Some(fields::pose(pose)),
            distance_mm: agreement.distance_mm,
            deviations: agreement.deviations,
            depth_mm: agreement.depth_mm,
        })
        .collect()
}

/// Nine numbers row by row.
fn rows(matrix: &Matrix3<f64>) -> Vec<f64> {
    matrix.transpose().as_slice().to_vec()
}
