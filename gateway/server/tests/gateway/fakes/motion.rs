//! The motion service's stand-in: arms that are wherever they were told to be.

use std::pin::Pin;
use std::sync::Arc;

use arthro_bootstrap::status;
use arthro_gateway::procedure::poses::upright;
use arthro_geometry::{Point3, Rotation, Vector3};
use arthro_proto::common::v1::{self as common, OperationState};
use arthro_proto::motion::v1::motion_service_server::MotionService;
use arthro_proto::motion::v1::*;
use tokio::sync::mpsc;
use tokio_stream::Stream;
use tokio_stream::wrappers::ReceiverStream;
use tonic::{Request, Response, Status};

use super::{FakeArm, World, operation};

pub struct FakeMotion(pub Arc<World>);

/// Where the tip is in the flange of both arms, mm.
pub const TIP_IN_FLANGE: Point3 = Point3::new(0.0, 0.0, 450.0);

type Answers<T> = Pin<Box<dyn Stream<Item = Result<T, Status>> + Send>>;

impl FakeArm {
    pub fn shaft(&self) -> Vector3 {
        self.rotation * Vector3::x()
    }

    pub fn depth_mm(&self) -> Option<f64> {
        self.portal
            .map(|portal| (self.tip - portal).dot(&self.shaft()))
    }

    fn inside(&self) -> bool {
        self.depth_mm().is_some_and(|depth| depth > 0.0)
    }

    fn state(&self, arm: common::Arm, time_s: f64) -> ArmState {
        ArmState {
            arm: arm.into(),
            controller_time_s: time_s,
            base_from_tool: Some(arthro_gateway::wire::pose_message(
                &self.rotation,
                &self.tip,
            )),
            inside: self.inside(),
            depth_mm: self.depth_mm().unwrap_or_default(),
            fault_reason: if self.faulty { "PROTECTIVE_STOP" } else { "" }.to_owned(),
            connected: self.connected,
            ..ArmState::default()
        }
    }

    fn go(&mut self, motion: &move_request::Motion) -> Result<(), Status> {
        use move_request::Motion;
        match motion {
            Motion::Free(free) => {
                if self.inside() {
                    return Err(status::refused("TOOL_INSIDE", "the tip is inside", &[]));
                }
                let pose = free.base_from_tool.unwrap();
                let rotation = pose.rotation.unwrap();
                self.rotation =
                    Rotation::from_quaternion(arthro_geometry::nalgebra::Quaternion::new(
                        rotation.w, rotation.x, rotation.y, rotation.z,
                    ));
                self.tip = point(pose.translation);
            }
            Motion::Pivot(pivot) => {
                let portal = self.portal.unwrap();
                let depth = self.depth_mm().unwrap();
                self.rotation = upright((point(pivot.aim) - portal).normalize());
                self.tip = portal + self.shaft() * depth;
            }
            Motion::Rcm(rcm) => {
                let portal = self.portal.unwrap();
                if let Some(rcm_move::Target::Aim(aim)) = rcm.target {
                    self.rotation = upright((point(Some(aim)) - portal).normalize());
                }
                self.tip = portal + self.shaft() * rcm.depth_mm;
            }
            Motion::Insert(insert) => self.advance(insert.depth_mm),
            Motion::Retract(retract) => self.advance(retract.depth_mm),
            Motion::Joint(_) => panic!("no such moves are expected"),
        }
        Ok(())
    }

    /// A stop ends a move along the shaft halfway; of other moves it leaves nothing.
    fn go_halfway(&mut self, motion: &move_request::Motion) {
        use move_request::Motion;
        let end_mm = match motion {
            Motion::Insert(insert) => insert.depth_mm,
            Motion::Retract(retract) => retract.depth_mm,
            _ => return,
        };
        let depth_mm = self.depth_mm().unwrap();
        self.advance((depth_mm + end_mm) / 2.0);
    }

    fn advance(&mut self, depth_mm: f64) {
        let portal = self.portal.unwrap();
        let off = (self.tip - portal).cross(&self.shaft()).norm();
        assert!(off < 1e-6, "the shaft is {off} mm off the portal");
        self.tip = portal + self.shaft() * depth_mm;
    }
}

impl FakeMotion {
    fn token(&self) -> Option<u64> {
        self.0.tokens.lock().unwrap().motion
    }

    /// A clock that each command moves on by a second.
    fn time_s(&self) -> f64 {
        100.0 + self.0.commands.borrow().len() as f64
    }
}

fn index(arm: common::Arm) -> usize {
    match arm {
        common::Arm::Forceps => 0,
        common::Arm::Arthroscope => 1,
        common::Arm::Unspecified => panic!("an arm is named"),
    }
}

fn name(arm: common::Arm) -> String {
    arm.as_str_name().replace("ARM_", "")
}

fn point(message: Option<common::Point>) -> Point3 {
    let point = message.unwrap();
    Point3::new(point.x_mm, point.y_mm, point.z_mm)
}

#[tonic::async_trait]
impl MotionService for FakeMotion {
    async fn get_cell(
        &self,
        _: Request<GetCellRequest>,
    ) -> Result<Response<GetCellResponse>, Status> {
        let arms = self.0.arms.lock().unwrap();
        let describe = |arm: common::Arm| ArmDescription {
            arm: arm.into(),
            portal: arms[index(arm)]
                .portal
                .as_ref()
                .map(arthro_gateway::wire::point_message),
            flange_from_tool: Some(arthro_gateway::wire::pose_message(
                &Rotation::identity(),
                &TIP_IN_FLANGE,
            )),
            ..ArmDescription::default()
        };
        Ok(Response::new(GetCellResponse {
            arms: vec![
                describe(common::Arm::Forceps),
                describe(common::Arm::Arthroscope),
            ],
            lease: None,
        }))
    }

    type WatchStateStream = Answers<WatchStateResponse>;
    async fn watch_state(
        &self,
        request: Request<WatchStateRequest>,
    ) -> Result<Response<Self::WatchStateStream>, Status> {
        let period_s = request.into_inner().period_s;
        let mut arms = *self.0.arms.lock().unwrap();
        let began_s = self.time_s();
        let states = (0..20).map(move |reading| {
            let time_s = began_s + period_s * f64::from(reading);
            let states = [common::Arm::Forceps, common::Arm::Arthroscope]
                .map(|arm| arms[index(arm)].state(arm, time_s));
            for arm in &mut arms {
                arm.tip.z += arm.drift_mm;
            }
            Ok(WatchStateResponse {
                arms: states.to_vec(),
            })
        });
        Ok(Response::new(Box::pin(tokio_stream::iter(states))))
    }

    async fn acquire_lease(
        &self,
        _: Request<AcquireLeaseRequest>,
    ) -> Result<Response<AcquireLeaseResponse>, Status> {
        let mut tokens = self.0.tokens.lock().unwrap();
        tokens.last += 1;
        tokens.motion = Some(tokens.last);
        Ok(Response::new(AcquireLeaseResponse {
            lease: Some(common::Lease {
                fencing_token: tokens.last,
                ..common::Lease::default()
            }),
        }))
    }

    async fn renew_lease(
        &self,
        _: Request<RenewLeaseRequest>,
    ) -> Result<Response<RenewLeaseResponse>, Status> {
        if *self.0.refuse_renewals.lock().unwrap() {
            return Err(status::refused("LEASE_EXPIRED", "the lease ran out", &[]));
        }
        self.0.renewals.send_modify(|renewals| *renewals += 1);
        Ok(Response::new(RenewLeaseResponse { lease: None }))
    }

    async fn release_lease(
        &self,
        _: Request<ReleaseLeaseRequest>,
    ) -> Result<Response<ReleaseLeaseResponse>, Status> {
        self.0.tokens.lock().unwrap().motion = None;
        Ok(Response::new(ReleaseLeaseResponse {}))
    }

    async fn set_portal(
        &self,
        request: Request<SetPortalRequest>,
    ) -> Result<Response<SetPortalResponse>, Status> {
        let request = request.into_inner();
        let arm = request.arm();
        let command = format!("SET_PORTAL {}", name(arm));
        self.0
            .note(command, request.authorization, self.token())
            .await?;
        let mut arms = self.0.arms.lock().unwrap();
        if arms[index(arm)].inside() {
            return Err(status::refused("TOOL_INSIDE", "the tip is inside", &[]));
        }
        arms[index(arm)].portal = Some(point(request.portal));
        Ok(Response::new(SetPortalResponse {}))
    }

    async fn check_motion(
        &self,
        request: Request<CheckMotionRequest>,
    ) -> Result<Response<CheckMotionResponse>, Status> {
        let request = request.into_inner();
        self.0.checks.send_modify(|checks| *checks += 1);
        self.0.wait_while_held("CHECK").await;
        let unreachable = *self.0.unreachable.lock().unwrap();
        let checks = (0..request.targets.len())
            .map(|target| match unreachable {
                Some((bad, reason)) if bad == target && request.arm() == common::Arm::Forceps => {
                    MotionCheck {
                        reachable: false,
                        reason: reason.to_owned(),
                        detail: "depth is 131 mm; must be at most 120 mm".to_owned(),
                        ..MotionCheck::default()
                    }
                }
                _ => MotionCheck {
                    reachable: true,
                    ..MotionCheck::default()
                },
            })
            .collect();
        Ok(Response::new(CheckMotionResponse {
            checks,
            ..CheckMotionResponse::default()
        }))
    }

    type MoveStream = Answers<MoveResponse>;
    async fn r#move(
        &self,
        request: Request<MoveRequest>,
    ) -> Result<Response<Self::MoveStream>, Status> {
        use move_request::Motion;
        let request = request.into_inner();
        let arm = request.arm();
        let motion = request.motion.unwrap();
        let verb = match motion {
            Motion::Free(_) => "FREE",
            Motion::Pivot(_) => "PIVOT",
            Motion::Insert(_) => "INSERT",
            Motion::Retract(_) => "RETRACT",
            Motion::Joint(_) => "JOINT",
            Motion::Rcm(_) => "RCM",
        };
        let command = format!("{verb} {}", name(arm));
        let id = self
            .0
            .note(command.clone(), request.authorization, self.token())
            .await?;
        let (answers, receiver) = mpsc::channel(8);
        let world = self.0.clone();
        let time_s = self.time_s();
        // As in the real service, the motion does not belong to the call.
        tokio::spawn(async move {
            let message = |state: OperationState, world: &World| MoveResponse {
                operation: operation(&id, state),
                fraction: 0.5,
                rcm_deviation_max_mm: 0.25,
                state: Some(world.arms.lock().unwrap()[index(arm)].state(arm, time_s)),
            };
            answers
                .send(Ok(message(OperationState::Running, &world)))
                .await
                .ok();
            if world.wait_while_held(&command).await {
                world.arms.lock().unwrap()[index(arm)].go_halfway(&motion);
                answers
                    .send(Ok(message(OperationState::Stopped, &world)))
                    .await
                    .ok();
                return;
            }
            let gone = world.arms.lock().unwrap()[index(arm)].go(&motion);
            let last = match gone {
                Ok(()) => Ok(message(OperationState::Done, &world)),
                Err(status) => Err(status),
            };
            answers.send(last).await.ok();
        });
        Ok(Response::new(Box::pin(ReceiverStream::new(receiver))))
    }

    async fn stop(&self, _: Request<StopRequest>) -> Result<Response<StopResponse>, Status> {
        self.0.stops.send_modify(|stops| *stops += 1);
        Ok(Response::new(StopResponse {}))
    }

    async fn recover_fault(
        &self,
        request: Request<RecoverFaultRequest>,
    ) -> Result<Response<RecoverFaultResponse>, Status> {
        let request = request.into_inner();
        let arm = request.arm();
        let command = format!("RECOVER_FAULT {}", name(arm));
        self.0
            .note(command, request.authorization, self.token())
            .await?;
        self.0.arms.lock().unwrap()[index(arm)].faulty = false;
        Ok(Response::new(RecoverFaultResponse {}))
    }
}
