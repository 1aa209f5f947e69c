//! The API: requests are checked and handed to the owner of the drives; operations are watched and told.

mod convert;
mod told;

use std::time::Duration;

use arthro_authority::OperationState;
use arthro_bootstrap::Drain;
use arthro_proto::instrument::v1 as proto;
use arthro_proto::instrument::v1::instrument_service_server::InstrumentService;
use tokio::sync::mpsc;
use tokio::time::{MissedTickBehavior, interval};
use tokio_stream::wrappers::ReceiverStream;
use tonic::{Request, Response, Status};

use self::convert as from;
use crate::axis::{Axis, Unit};
use crate::config::Cell;
use crate::drives::{Command, Handle, Report, Snapshot, Ticket};
use crate::error::Refusal;

/// Between two messages of an operation that goes on, s.
const PROGRESS_PERIOD: Duration = Duration::from_millis(100);
/// Messages that wait for a slow reader.
const STREAM_QUEUE_LEN: usize = 16;
/// Periods of `WatchState`, s: shortest, longest, and the one when none is given.
const WATCH_PERIODS_S: (f64, f64, f64) = (0.01, 10.0, 0.1);
/// How long one switch may take in commissioning, s: shortest, longest, and when none is given.
const COMMISSIONING_TIMEOUTS_S: (f64, f64, f64) = (1.0, 600.0, 60.0);
/// Time to live of a lease when none is given, s.
const DEFAULT_TTL_S: f64 = 2.0;

/// The served API.
pub struct Instrument {
    drives: Handle,
    drain: Drain,
}

type Stream<T> = ReceiverStream<Result<T, Status>>;

impl Instrument {
    /// Serves these drives until the drain.
    pub fn new(drives: Handle, drain: Drain) -> Self {
        Self { drives, drain }
    }

    async fn command(
        &self,
        authorization: Option<arthro_proto::common::v1::Authorization>,
        command: Command,
    ) -> Result<Ticket, Refusal> {
        self.drives
            .command(from::authorization(authorization)?, command)
            .await
    }

    /// A command that is over in a moment.
    async fn carry_out(
        &self,
        authorization: Option<arthro_proto::common::v1::Authorization>,
        command: Command,
    ) -> Result<(), Refusal> {
        let mut ticket = self.command(authorization, command).await?;
        let operation = ticket.ended().await.ok_or(Refusal::ShuttingDown)?.operation;
        match operation.state {
            OperationState::Done => Ok(()),
            _ => Err(Refusal::Failed {
                reason: operation.reason,
                detail: operation.detail,
            }),
        }
    }

    /// Tells how an operation goes until it has ended. When nobody listens any more the operation goes on.
    fn progress<T: Send + 'static>(
        &self,
        mut ticket: Ticket,
        message: impl Fn(&Cell, &Report, bool, &Snapshot) -> T + Send + 'static,
    ) -> Response<Stream<T>> {
        let (sender, receiver) = mpsc::channel(STREAM_QUEUE_LEN);
        let drives = self.drives.clone();
        tokio::spawn(async move {
            let mut tick = interval(PROGRESS_PERIOD);
            tick.set_missed_tick_behavior(MissedTickBehavior::Delay);
            loop {
                let report = ticket.reports.borrow_and_update().clone();
                let answer = message(drives.cell(), &report, ticket.repeated, &drives.snapshot());
                let ended = report.operation.state != OperationState::Running;
                if sender.send(Ok(answer)).await.is_err() || ended {
                    return;
                }
                tokio::select! {
                    _ = tick.tick() => {}
                    changed = ticket.reports.changed() => if changed.is_err() {
                        sender.send(Err(Refusal::ShuttingDown.into())).await.ok();
                        return;
                    }
                }
            }
        });
        Response::new(ReceiverStream::new(receiver))
    }
}

#[tonic::async_trait]
impl InstrumentService for Instrument {
    async fn list_axes(
        &self,
        _: Request<proto::ListAxesRequest>,
    ) -> Result<Response<proto::ListAxesResponse>, Status> {
        let lease = self.drives.lease().await?.as_ref().map(told::lease);
        let snapshot = self.drives.snapshot();
        let axes = self.drives.cell().axes.iter().zip(&snapshot.axes);
        let axes = axes
            .map(|(settings, state)| told::description(self.drives.cell(), settings, state))
            .collect();
        Ok(Response::new(proto::ListAxesResponse { axes, lease }))
    }

    type WatchStateStream = Stream<proto::WatchStateResponse>;

    async fn watch_state(
        &self,
        request: Request<proto::WatchStateRequest>,
    ) -> Result<Response<Self::WatchStateStream>, Status> {
        let (shortest, longest, default) = WATCH_PERIODS_S;
        let period_s = from::optional_within(
            "period_s",
            request.into_inner().period_s,
            shortest,
            longest,
            default,
        )?;
        let (sender, receiver) = mpsc::channel(STREAM_QUEUE_LEN);
        let (drives, drain) = (self.drives.clone(), self.drain.clone());
        tokio::spawn(async move {
            let draining = drain.started();
            tokio::pin!(draining);
            let mut tick = interval(Duration::from_secs_f64(period_s));
            tick.set_missed_tick_behavior(MissedTickBehavior::Skip);
            loop {
                tokio::select! {
                    _ = tick.tick() => {}
                    () = &mut draining => return,
                }
                if sender
                    .send(Ok(told::state(drives.cell(), &drives.snapshot())))
                    .await
                    .is_err()
                {
                    return;
                }
            }
        });
        Ok(Response::new(ReceiverStream::new(receiver)))
    }

    async fn acquire_lease(
        &self,
        request: Request<proto::AcquireLeaseRequest>,
    ) -> Result<Response<proto::AcquireLeaseResponse>, Status> {
        let proto::AcquireLeaseRequest { holder, ttl_s } = request.into_inner();
        let ttl_s = from::optional_within("ttl_s", ttl_s, 0.2, 60.0, DEFAULT_TTL_S)?;
        let lease = self
            .drives
            .acquire(holder, Duration::from_secs_f64(ttl_s))
            .await?;
        Ok(Response::new(proto::AcquireLeaseResponse {
            lease: Some(told::lease(&lease)),
        }))
    }

    async fn renew_lease(
        &self,
        request: Request<proto::RenewLeaseRequest>,
    ) -> Result<Response<proto::RenewLeaseResponse>, Status> {
        let lease = self
            .drives
            .renew(request.into_inner().fencing_token)
            .await?;
        Ok(Response::new(proto::RenewLeaseResponse {
            lease: Some(told::lease(&lease)),
        }))
    }

    async fn release_lease(
        &self,
        request: Request<proto::ReleaseLeaseRequest>,
    ) -> Result<Response<proto::ReleaseLeaseResponse>, Status> {
        self.drives
            .release(request.into_inner().fencing_token)
            .await?;
        Ok(Response::new(proto::ReleaseLeaseResponse {}))
    }

    type HomeStream = Stream<proto::HomeResponse>;

    async fn home(
        &self,
        request: Request<proto::HomeRequest>,
    ) -> Result<Response<Self::HomeStream>, Status> {
        let proto::HomeRequest {
            authorization,
            axes,
        } = request.into_inner();
        let ticket = self
            .command(authorization, Command::Home(from::axes_to_home(&axes)?))
            .await?;
        Ok(self.progress(ticket, |cell, report, repeated, snapshot| {
            proto::HomeResponse {
                operation: Some(told::operation(report, repeated)),
                axes: told::axes(cell, snapshot),
            }
        }))
    }

    type MoveAxisStream = Stream<proto::MoveAxisResponse>;

    async fn move_axis(
        &self,
        request: Request<proto::MoveAxisRequest>,
    ) -> Result<Response<Self::MoveAxisStream>, Status> {
        let proto::MoveAxisRequest {
            authorization,
            axis,
            target,
        } = request.into_inner();
        let axis = from::axis("axis", axis)?;
        let target = from::target(axis, target)?;
        let target = self.drives.cell().axes[axis.index()]
            .spec
            .check_target(target)
            .map_err(Refusal::from)?;
        let ticket = self
            .command(authorization, Command::Move { axis, target })
            .await?;
        Ok(
            self.progress(ticket, move |cell, report, repeated, snapshot| {
                proto::MoveAxisResponse {
                    operation: Some(told::operation(report, repeated)),
                    state: Some(told::axis_state(cell, axis, snapshot)),
                }
            }),
        )
    }

    type BiteStream = Stream<proto::BiteResponse>;

    async fn bite(
        &self,
        request: Request<proto::BiteRequest>,
    ) -> Result<Response<Self::BiteStream>, Status> {
        let proto::BiteRequest {
            authorization,
            current_limit_ma,
            force_limit_n,
        } = request.into_inner();
        let bite = &self.drives.cell().bite;
        let current_limit_ma = from::bite_limit_ma(bite, current_limit_ma, force_limit_n)?;
        let ticket = self
            .command(authorization, Command::Bite { current_limit_ma })
            .await?;
        Ok(self.progress(ticket, told::bite))
    }

    type OpenJawStream = Stream<proto::OpenJawResponse>;

    async fn open_jaw(
        &self,
        request: Request<proto::OpenJawRequest>,
    ) -> Result<Response<Self::OpenJawStream>, Status> {
        let ticket = self
            .command(request.into_inner().authorization, Command::OpenJaw)
            .await?;
        Ok(self.progress(ticket, |cell, report, repeated, snapshot| {
            proto::OpenJawResponse {
                operation: Some(told::operation(report, repeated)),
                state: Some(told::axis_state(cell, Axis::ForcepsFeed, snapshot)),
                jaw: told::jaw(snapshot.jaw).into(),
            }
        }))
    }

    async fn stop(
        &self,
        request: Request<proto::StopRequest>,
    ) -> Result<Response<proto::StopResponse>, Status> {
        self.drives.stop(request.into_inner().reason).await?;
        Ok(Response::new(proto::StopResponse {}))
    }

    async fn recover_fault(
        &self,
        request: Request<proto::RecoverFaultRequest>,
    ) -> Result<Response<proto::RecoverFaultResponse>, Status> {
        let proto::RecoverFaultRequest {
            authorization,
            axis,
        } = request.into_inner();
        let axes = if axis == 0 {
            Axis::ALL.to_vec()
        } else {
            vec![from::axis("axis", axis)?]
        };
        self.carry_out(authorization, Command::Recover(axes))
            .await?;
        Ok(Response::new(proto::RecoverFaultResponse {}))
    }

    type CommissionSwitchesStream = Stream<proto::CommissionSwitchesResponse>;

    async fn commission_switches(
        &self,
        request: Request<proto::CommissionSwitchesRequest>,
    ) -> Result<Response<Self::CommissionSwitchesStream>, Status> {
        let proto::CommissionSwitchesRequest {
            authorization,
            axis,
            timeout_s,
        } = request.into_inner();
        let axis = from::axis("axis", axis)?;
        let (shortest, longest, default) = COMMISSIONING_TIMEOUTS_S;
        let timeout_s = from::optional_within("timeout_s", timeout_s, shortest, longest, default)?;
        let timeout = Duration::from_secs_f64(timeout_s);
        let command = Command::CommissionSwitches { axis, timeout };
        let ticket = self.command(authorization, command).await?;
        Ok(
            self.progress(ticket, move |cell, report, repeated, snapshot| {
                proto::CommissionSwitchesResponse {
                    operation: Some(told::operation(report, repeated)),
                    state: Some(told::axis_state(cell, axis, snapshot)),
                    switches: report.switches.iter().map(told::commissioning).collect(),
                }
            }),
        )
    }

    async fn read_object(
        &self,
        request: Request<proto::ReadObjectRequest>,
    ) -> Result<Response<proto::ReadObjectResponse>, Status> {
        let proto::ReadObjectRequest {
            axis,
            index,
            subindex,
        } = request.into_inner();
        let (axis, address) = (
            from::axis("axis", axis)?,
            from::object_address(index, subindex)?,
        );
        let data = self.drives.read(axis, address).await?;
        Ok(Response::new(proto::ReadObjectResponse {
            data: data.into(),
        }))
    }

    async fn write_object(
        &self,
        request: Request<proto::WriteObjectRequest>,
    ) -> Result<Response<proto::WriteObjectResponse>, Status> {
        let proto::WriteObjectRequest {
            authorization,
            axis,
            index,
            subindex,
            data,
        } = request.into_inner();
        let (axis, address) = (
            from::axis("axis", axis)?,
            from::object_address(index, subindex)?,
        );
        if !(1..=4).contains(&data.len()) {
            let problem = format!("has {} bytes; 1 to 4 are written", data.len());
            return Err(Refusal::Invalid {
                field: "data",
                problem,
            }
            .into());
        }
        let command = Command::Write {
            axis,
            address,
            data: data.to_vec(),
        };
        self.carry_out(authorization, command).await?;
        Ok(Response::new(proto::WriteObjectResponse {}))
    }
}

/// The word for what is expected of an axis of this unit.
fn field_of(unit: Unit) -> &'static str {
    match unit {
        Unit::Degree => "angle_deg",
        Unit::Millimetre => "feed_mm",
    }
}
