//! The four axes of the instruments, through the instrument service.

use arthro_proto::common::v1 as common;
use arthro_proto::instrument::v1 as proto;
use arthro_proto::instrument::v1::instrument_service_client::InstrumentServiceClient;
use tonic::Streaming;
use tonic::transport::Channel;

use super::{
    Failure, Fault, MOTION_DEADLINE, Peer, SHORT_DEADLINE, STOP_DEADLINE, ask, first, follow,
    within,
};
use crate::words::words;

const PEER: Peer = Peer::Instrument;

/// A client of the instrument service; clones share one connection.
#[derive(Clone, Debug)]
pub struct Instrument(InstrumentServiceClient<Channel>);

/// What was measured of the axes.
#[derive(Clone, Debug, PartialEq)]
pub struct Axes {
    /// Axes without a reference, as the service names them.
    unreferenced: Vec<i32>,
    /// The latched faults, each with the word of its axis.
    pub faults: Vec<(&'static str, Fault)>,
    /// The jaw.
    pub jaw: Jaw,
    /// Where the forceps' rotation stands, deg; unset until its drive was read.
    forceps_rotation_deg: Option<f64>,
}

words! {
    /// How the jaw stands.
    Jaw {
        /// Open.
        Open = "OPEN",
        /// On its way.
        Moving = "MOVING",
        /// Closed with nothing between the blades.
        ClosedEmpty = "CLOSED_EMPTY",
        /// Closed, and something was felt on the way.
        ClosedOnTissue = "CLOSED_ON_TISSUE",
        /// Nobody knows, until it is opened or homed.
        Unknown = "UNKNOWN",
    }
}

/// What the jaw did in a bite.
#[derive(Clone, Debug, PartialEq)]
pub struct Bitten {
    /// The jaw's state in the service's word, e.g. "CLOSED_ON_TISSUE".
    pub jaw: String,
    /// Highest current seen, mA.
    pub peak_current_ma: f64,
}

impl Jaw {
    /// Whether it is known to be at one end of its way, so that it may be drawn through tissue as it is.
    pub const fn is_known(self) -> bool {
        matches!(self, Self::Open | Self::ClosedEmpty | Self::ClosedOnTissue)
    }
}

impl Axes {
    /// Referenced axes that stand.
    #[cfg(test)]
    pub fn standing(jaw: Jaw, faults: Vec<(&'static str, Fault)>) -> Self {
        Self {
            unreferenced: Vec::new(),
            faults,
            jaw,
            forceps_rotation_deg: Some(0.0),
        }
    }

    /// Whether all axes have their reference.
    pub fn referenced(&self) -> bool {
        self.unreferenced.is_empty()
    }

    /// Where the forceps' rotation stands, deg.
    pub fn forceps_rotation_deg(&self) -> Result<f64, Failure> {
        self.forceps_rotation_deg
            .ok_or_else(|| Failure::unusable(PEER, "forceps_rotation was not read yet"))
    }

    /// The words of the axes without a reference.
    pub fn unreferenced(&self) -> Vec<&'static str> {
        let named = self.unreferenced.iter().copied();
        named.map(axis_word).collect()
    }
}

impl Instrument {
    pub(super) fn new(channel: Channel) -> Self {
        Self(InstrumentServiceClient::new(channel))
    }

    /// The measured state of all axes now.
    pub async fn axes(&self) -> Result<Axes, Failure> {
        let request = within(SHORT_DEADLINE, proto::WatchStateRequest { period_s: 0.0 });
        let state = first(PEER, self.0.clone().watch_state(request)).await?;
        let forceps_rotation_deg = state
            .axes
            .iter()
            .find(|axis| axis.axis() == proto::Axis::ForcepsRotation)
            .and_then(|axis| angle_deg(axis.position));
        Ok(Axes {
            unreferenced: state
                .axes
                .iter()
                .filter(|axis| !axis.homed)
                .map(|axis| axis.axis)
                .collect(),
            faults: state
                .axes
                .iter()
                .filter_map(|axis| {
                    let fault = Fault::of(&axis.fault_reason, &axis.fault_detail)?;
                    Some((axis_word(axis.axis), fault))
                })
                .collect(),
            jaw: match state.jaw() {
                proto::JawState::Open => Jaw::Open,
                proto::JawState::Moving => Jaw::Moving,
                proto::JawState::ClosedEmpty => Jaw::ClosedEmpty,
                proto::JawState::ClosedOnTissue => Jaw::ClosedOnTissue,
                proto::JawState::Unknown | proto::JawState::Unspecified => Jaw::Unknown,
            },
            forceps_rotation_deg,
        })
    }

    /// The measured states as they come, every `period_s`, for the record.
    pub async fn watch(
        &self,
        period_s: f64,
    ) -> Result<Streaming<proto::WatchStateResponse>, Failure> {
        let request = proto::WatchStateRequest { period_s };
        ask(PEER, self.0.clone().watch_state(request)).await
    }

    /// What the axes are, for the record.
    pub async fn describe(&self) -> Result<proto::ListAxesResponse, Failure> {
        let request = within(SHORT_DEADLINE, proto::ListAxesRequest {});
        ask(PEER, self.0.clone().list_axes(request)).await
    }

    /// The travel of the forceps' rotation, deg.
    pub async fn forceps_rotation_travel_deg(&self) -> Result<(f64, f64), Failure> {
        let axes = ask(
            PEER,
            self.0
                .clone()
                .list_axes(within(SHORT_DEADLINE, proto::ListAxesRequest {})),
        )
        .await?
        .axes;
        axes.iter()
            .find(|axis| axis.axis() == proto::Axis::ForcepsRotation)
            .and_then(|axis| Some((angle_deg(axis.lowest)?, angle_deg(axis.highest)?)))
            .ok_or_else(|| Failure::unusable(PEER, "the travel of forceps_rotation is missing"))
    }

    /// Takes command; answers the fencing token.
    pub async fn acquire(&self, holder: &str, ttl_s: f64) -> Result<u64, Failure> {
        let request = proto::AcquireLeaseRequest {
            holder: holder.to_owned(),
            ttl_s,
        };
        ask(
            PEER,
            self.0
                .clone()
                .acquire_lease(within(SHORT_DEADLINE, request)),
        )
        .await?
        .lease
        .map(|lease| lease.fencing_token)
        .ok_or_else(|| Failure::unusable(PEER, "no lease was sent"))
    }

    /// Keeps command.
    pub async fn renew(&self, fencing_token: u64) -> Result<(), Failure> {
        let request = proto::RenewLeaseRequest { fencing_token };
        let call = within(SHORT_DEADLINE, request);
        ask(PEER, self.0.clone().renew_lease(call)).await.map(drop)
    }

    /// Gives command back.
    pub async fn release(&self, fencing_token: u64) -> Result<(), Failure> {
        let request = proto::ReleaseLeaseRequest { fencing_token };
        let call = within(SHORT_DEADLINE, request);
        ask(PEER, self.0.clone().release_lease(call))
            .await
            .map(drop)
    }

    /// Finds the reference of the axes that lack it.
    pub async fn home(
        &self,
        authorization: common::Authorization,
        axes: &Axes,
    ) -> Result<(), Failure> {
        let request = proto::HomeRequest {
            authorization: Some(authorization),
            axes: axes.unreferenced.clone(),
        };
        let call = within(MOTION_DEADLINE, request);
        follow(PEER, self.0.clone().home(call), |message| {
            message.operation.clone()
        })
        .await
        .map(drop)
    }

    /// Turns the forceps about its shaft.
    pub async fn turn_forceps(
        &self,
        authorization: common::Authorization,
        angle_deg: f64,
    ) -> Result<(), Failure> {
        let request = proto::MoveAxisRequest {
            authorization: Some(authorization),
            axis: proto::Axis::ForcepsRotation.into(),
            target: Some(proto::AxisPosition {
                value: Some(proto::axis_position::Value::AngleDeg(angle_deg)),
            }),
        };
        let call = within(MOTION_DEADLINE, request);
        follow(PEER, self.0.clone().move_axis(call), |message| {
            message.operation.clone()
        })
        .await
        .map(drop)
    }

    /// Closes the jaw, at the configured current limit.
    pub async fn bite(&self, authorization: common::Authorization) -> Result<Bitten, Failure> {
        let request = proto::BiteRequest {
            authorization: Some(authorization),
            ..proto::BiteRequest::default()
        };
        let call = within(MOTION_DEADLINE, request);
        let last = follow(PEER, self.0.clone().bite(call), |message| {
            message.operation.clone()
        })
        .await?;
        Ok(Bitten {
            jaw: last.jaw().as_str_name().replace("JAW_STATE_", ""),
            peak_current_ma: last.peak_current_ma,
        })
    }

    /// Opens the jaw.
    pub async fn open_jaw(&self, authorization: common::Authorization) -> Result<(), Failure> {
        let request = proto::OpenJawRequest {
            authorization: Some(authorization),
        };
        let call = within(MOTION_DEADLINE, request);
        follow(PEER, self.0.clone().open_jaw(call), |message| {
            message.operation.clone()
        })
        .await
        .map(drop)
    }

    /// Quick-stops all drives.
    pub async fn stop(&self, reason: &str) -> Result<(), Failure> {
        let request = proto::StopRequest {
            reason: reason.to_owned(),
        };
        let call = within(STOP_DEADLINE, request);
        ask(PEER, self.0.clone().stop(call)).await.map(drop)
    }

    /// Acknowledges the faults of all axes.
    pub async fn recover_fault(&self, authorization: common::Authorization) -> Result<(), Failure> {
        let request = proto::RecoverFaultRequest {
            authorization: Some(authorization),
            axis: proto::Axis::Unspecified.into(),
        };
        let call = within(SHORT_DEADLINE * 6, request);
        ask(PEER, self.0.clone().recover_fault(call))
            .await
            .map(drop)
    }
}

/// An axis as the service names it; one of a newer service has no word here.
fn axis_word(axis: i32) -> &'static str {
    proto::Axis::try_from(axis)
        .unwrap_or_default()
        .as_str_name()
        .trim_start_matches("AXIS_")
}

fn angle_deg(position: Option<proto::AxisPosition>) -> Option<f64> {
    match position?.value? {
        proto::axis_position::Value::AngleDeg(angle_deg) => Some(angle_deg),
        proto::axis_position::Value::FeedMm(_) => None,
    }
}
