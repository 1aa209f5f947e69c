//! The API: requests are checked and handed to the owners of the arms; moves are watched and told.

mod check;
mod fields;
mod teach;
mod watch_state;

use std::sync::Arc;
use std::time::Duration;

use arthro_bootstrap::Drain;
use arthro_proto::common::v1 as common;
use arthro_proto::motion::v1 as proto;
use arthro_proto::motion::v1::motion_service_server::MotionService;
use tokio::sync::{mpsc, watch};
use tokio_stream::wrappers::ReceiverStream;
use tonic::{Request, Response, Status};

use self::fields::Fields;
use crate::arm::{Accepted, ArmHandle};
use crate::command::{Commander, Progress};
use crate::error::Error;
use crate::kinematics::Joints;
use crate::rcm::Portal;

/// Time to live of a lease when none is given, s.
const DEFAULT_TTL_S: f64 = 2.0;
/// Controller time between two messages of a move, s.
const PROGRESS_PERIOD_S: f64 = 0.1;
/// Messages that wait for a slow reader.
const STREAM_QUEUE: usize = 4;

/// The motion service. Clones serve the same cell.
#[derive(Clone)]
pub struct Motion {
    commander: Commander,
    arms: Arc<[Arm; 2]>,
    drain: Drain,
}

/// One arm as the server knows it.
pub struct Arm {
    /// Asks its owner.
    pub handle: ArmHandle,
    /// The controller's name and version, once known.
    pub controller: watch::Receiver<String>,
    /// For the dry run.
    pub neutral_joints_rad: Joints,
}

/// Which of the arms.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Which {
    /// Carries the forceps.
    Forceps,
    /// Carries the arthroscope.
    Arthroscope,
}

type Stream<T> = ReceiverStream<Result<T, Status>>;

impl Which {
    const BOTH: [Self; 2] = [Self::Forceps, Self::Arthroscope];

    fn on_the_wire(self) -> common::Arm {
        match self {
            Self::Forceps => common::Arm::Forceps,
            Self::Arthroscope => common::Arm::Arthroscope,
        }
    }
}

impl Motion {
    /// Serves a cell: the forceps arm and the arthroscope arm.
    pub fn new(commander: Commander, arms: [Arm; 2], drain: Drain) -> Self {
        Self {
            commander,
            arms: Arc::new(arms),
            drain,
        }
    }

    fn arm(&self, which: Which) -> &Arm {
        match which {
            Which::Forceps => &self.arms[0],
            Which::Arthroscope => &self.arms[1],
        }
    }

    /// Stops both arms.
    pub async fn stop_all(&self, reason: &str) {
        self.stop_arms(&Which::BOTH, reason).await;
    }

    /// Stops the arms named at the same time.
    async fn stop_arms(&self, which: &[Which], reason: &str) {
        let stops: Vec<_> = which
            .iter()
            .map(|which| {
                let handle = self.arm(*which).handle.clone();
                let reason = reason.to_owned();
                tokio::spawn(async move { handle.stop(reason).await })
            })
            .collect();
        for stop in stops {
            stop.await.ok();
        }
    }

    fn describe(&self, which: Which) -> proto::ArmDescription {
        let Arm {
            handle, controller, ..
        } = self.arm(which);
        let published = handle.published();
        let published = published.borrow();
        let options = handle.options();
        proto::ArmDescription {
            arm: which.on_the_wire().into(),
            address: options.address.clone(),
            controller: controller.borrow().clone(),
            connected: published.connected,
            flange_from_tool: Some(fields::pose(&options.arm.flange_from_tool())),
            portal: published.portal.map(|portal| fields::point(&portal.point)),
            limits: Some(fields::limits(&options.limits)),
            portal_axis: published
                .portal
                .and_then(|portal| portal.axis)
                .map(|axis| fields::direction(&axis)),
        }
    }
}

#[tonic::async_trait]
impl MotionService for Motion {
    type WatchStateStream = Stream<proto::WatchStateResponse>;
    type MoveStream = Stream<proto::MoveResponse>;

    async fn get_cell(
        &self,
        _request: Request<proto::GetCellRequest>,
    ) -> Result<Response<proto::GetCellResponse>, Status> {
        Ok(Response::new(proto::GetCellResponse {
            arms: Which::BOTH.map(|which| self.describe(which)).to_vec(),
            lease: self.commander.lease().as_ref().map(fields::lease),
        }))
    }

    async fn watch_state(
        &self,
        request: Request<proto::WatchStateRequest>,
    ) -> Result<Response<Self::WatchStateStream>, Status> {
        let period_s = watch_state::period_s(request.into_inner().period_s)?;
        let arms = Which::BOTH.map(|which| (which, self.arm(which).handle.published()));
        let (sender, receiver) = mpsc::channel(STREAM_QUEUE);
        let drain = self.drain.clone();
        tokio::spawn(async move {
            tokio::select! {
                () = drain.started() => {}
                () = watch_state::tell(arms, period_s, sender) => {}
            }
        });
        Ok(Response::new(ReceiverStream::new(receiver)))
    }

    async fn acquire_lease(
        &self,
        request: Request<proto::AcquireLeaseRequest>,
    ) -> Result<Response<proto::AcquireLeaseResponse>, Status> {
        let proto::AcquireLeaseRequest { holder, ttl_s } = request.into_inner();
        let ttl_s = if ttl_s == 0.0 { DEFAULT_TTL_S } else { ttl_s };
        let ttl = Duration::try_from_secs_f64(ttl_s)
            .map_err(|_| Error::invalid("ttl_s", format!("is {ttl_s} s; must be 0.2 .. 60 s")))?;
        let lease = self.commander.acquire(&holder, ttl).map_err(Error::from)?;
        tracing::info!(holder, token = lease.fencing_token, "lease granted");
        Ok(Response::new(proto::AcquireLeaseResponse {
            lease: Some(fields::lease(&lease)),
        }))
    }

    async fn renew_lease(
        &self,
        request: Request<proto::RenewLeaseRequest>,
    ) -> Result<Response<proto::RenewLeaseResponse>, Status> {
        let token = request.into_inner().fencing_token;
        let lease = self.commander.renew(token).map_err(Error::from)?;
        Ok(Response::new(proto::RenewLeaseResponse {
            lease: Some(fields::lease(&lease)),
        }))
    }

    async fn release_lease(
        &self,
        request: Request<proto::ReleaseLeaseRequest>,
    ) -> Result<Response<proto::ReleaseLeaseResponse>, Status> {
        self.commander.release(request.into_inner().fencing_token)?;
        Ok(Response::new(proto::ReleaseLeaseResponse {}))
    }

    async fn set_portal(
        &self,
        request: Request<proto::SetPortalRequest>,
    ) -> Result<Response<proto::SetPortalResponse>, Status> {
        let request = request.into_inner();
        let (arm, portal, axis) = (request.arm, request.portal, request.axis);
        let command = format!("set portal {arm:?} {portal:?} {axis:?}");
        let mut found = Fields::default();
        let (by, which, point) = (
            found.authorization(request.authorization),
            found.arm(arm),
            found.point("portal", portal),
        );
        let axis = axis.and_then(|axis| found.direction("axis", axis));
        let whole = by.zip(which).zip(point);
        let ((by, which), point) = found.finish(whole)?;
        let portal = Portal::new(point, axis)?;
        let arm = self.arm(which);
        arm.handle
            .set_portal(by, command.as_bytes(), portal)
            .await?;
        Ok(Response::new(proto::SetPortalResponse {}))
    }

    async fn check_motion(
        &self,
        request: Request<proto::CheckMotionRequest>,
    ) -> Result<Response<proto::CheckMotionResponse>, Status> {
        let (which, checking) = check::read(request.into_inner())?;
        let answer = checking.run(self.arm(which)).await?;
        Ok(Response::new(answer))
    }

    async fn r#move(
        &self,
        request: Request<proto::MoveRequest>,
    ) -> Result<Response<Self::MoveStream>, Status> {
        let request = request.into_inner();
        let command = format!("move {:?} {:?}", request.arm, request.motion);
        let mut found = Fields::default();
        let by = found.authorization(request.authorization);
        let which = found.arm(request.arm);
        let limits = &self
            .arm(which.unwrap_or(Which::Forceps))
            .handle
            .options()
            .limits;
        let wanted = found.motion(request.motion.as_ref(), limits);
        let whole = by.zip(which).zip(wanted);
        let ((by, which), wanted) = found.finish(whole)?;
        let handle = self.arm(which).handle.clone();
        let accepted = handle.begin(by, command.as_bytes(), wanted).await?;
        let (sender, receiver) = mpsc::channel(STREAM_QUEUE);
        tokio::spawn(tell_move(which, handle, accepted, sender));
        Ok(Response::new(ReceiverStream::new(receiver)))
    }

    async fn stop(
        &self,
        request: Request<proto::StopRequest>,
    ) -> Result<Response<proto::StopResponse>, Status> {
        let proto::StopRequest { arm, reason } = request.into_inner();
        // A stop that names no arm, or one that does not exist, stops both: better than none.
        let which = match common::Arm::try_from(arm) {
            Ok(common::Arm::Forceps) => &[Which::Forceps][..],
            Ok(common::Arm::Arthroscope) => &[Which::Arthroscope],
            Ok(common::Arm::Unspecified) | Err(_) => &Which::BOTH,
        };
        let reason: String = reason.chars().take(500).collect();
        self.stop_arms(which, &reason).await;
        Ok(Response::new(proto::StopResponse {}))
    }

    async fn recover_fault(
        &self,
        request: Request<proto::RecoverFaultRequest>,
    ) -> Result<Response<proto::RecoverFaultResponse>, Status> {
        let request = request.into_inner();
        let command = format!("recover fault {:?}", request.arm);
        let mut found = Fields::default();
        let by = found.authorization(request.authorization);
        let which = found.arm(request.arm);
        let (by, which) = found.finish(by.zip(which))?;
        let arm = self.arm(which);
        arm.handle.recover_fault(by, command.as_bytes()).await?;
        Ok(Response::new(proto::RecoverFaultResponse {}))
    }
}

/// Tells how a move goes until it has ended. When nobody listens any more the move goes on.
async fn tell_move(
    which: Which,
    handle: ArmHandle,
    accepted: Accepted,
    sender: mpsc::Sender<Result<proto::MoveResponse, Status>>,
) {
    let published = handle.published();
    let message = |progress: &Progress, repeated: bool| {
        let state = published.borrow().state.clone();
        proto::MoveResponse {
            operation: Some(fields::operation(&progress.operation, repeated)),
            fraction: progress.fraction,
            rcm_deviation_max_mm: progress.rcm_deviation_max_mm,
            state: state.map(|state| fields::arm_state(which, &state)),
        }
    };
    let (mut progress, repeated) = match accepted {
        Accepted::Running { progress, repeated } => (progress, repeated),
        Accepted::Ended(operation) => {
            let done = operation.state == arthro_authority::OperationState::Done;
            let progress = Progress {
                operation,
                fraction: f64::from(u8::from(done)),
                rcm_deviation_max_mm: 0.0,
            };
            sender.send(Ok(message(&progress, true))).await.ok();
            return;
        }
    };
    let mut told_at_s = f64::NEG_INFINITY;
    loop {
        let now = progress.borrow_and_update().clone();
        let running = now.operation.state == arthro_authority::OperationState::Running;
        let message = message(&now, repeated);
        let time_s = message
            .state
            .as_ref()
            .map_or(told_at_s, |state| state.controller_time_s);
        if !running || time_s - told_at_s >= PROGRESS_PERIOD_S {
            told_at_s = time_s;
            if sender.send(Ok(message)).await.is_err() || !running {
                return;
            }
        }
        if progress.changed().await.is_err() {
            // The owner is gone without having ended it.
            sender.send(Err(Error::Gone.into())).await.ok();
            return;
        }
    }
}

#[cfg(test)]
mod tests;
