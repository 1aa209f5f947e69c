//! gRPC in and out of a replay: what watches is answered from the recording, what commands is refused.

mod instrument;
mod motion;
mod procedure;

use std::pin::Pin;

use arthro_bootstrap::status;
use arthro_proto::gateway::v1::procedure_service_server::ProcedureServiceServer;
use arthro_proto::instrument::v1::instrument_service_server::InstrumentServiceServer;
use arthro_proto::motion::v1::motion_service_server::MotionServiceServer;
use tokio::sync::watch;
use tokio_stream::wrappers::WatchStream;
use tokio_stream::{Stream, StreamExt as _};
use tonic::service::Routes;
use tonic::{Response, Status};

use super::player::Player;

/// A stream of answers.
type Answers<T> = Pin<Box<dyn Stream<Item = Result<T, Status>> + Send>>;

/// What a watch without a period gets, s.
const PERIOD_S: f64 = 0.1;

/// All three services.
pub(super) fn routes(player: Player) -> Routes {
    Routes::new(ProcedureServiceServer::new(procedure::ProcedureApi(
        player.clone(),
    )))
    .add_service(MotionServiceServer::new(motion::MotionApi(player.clone())))
    .add_service(InstrumentServiceServer::new(instrument::InstrumentApi(
        player,
    )))
}

/// What every command is answered.
fn refused<T>() -> Result<Response<T>, Status> {
    Err(status::refused(
        "REPLAY",
        "this is a recording; nothing can be commanded",
        &[],
    ))
}

/// Something that stands in no file.
fn not_recorded(what: &str) -> Status {
    status::refused(
        "NOT_RECORDED",
        format!("the recording does not hold {what}, or not yet at this moment"),
        &[],
    )
}

/// The states as they come, none sooner than `period_s` of recorded time after the one before.
fn states<T: Clone + Send + Sync + 'static>(
    states: watch::Receiver<(u64, T)>,
    period_s: f64,
    lowest_s: f64,
) -> Result<Response<Answers<T>>, Status> {
    let period_s = match period_s {
        0.0 => PERIOD_S,
        stated if (lowest_s..=10.0).contains(&stated) => stated,
        stated => {
            return Err(status::invalid(
                "period_s",
                format!("is {stated} s; must be within {lowest_s} .. 10 s, or 0"),
            ));
        }
    };
    // States came a little unevenly.
    let period_ns = (period_s * 1e9 * 0.9) as u64;
    let mut last_ns = None;
    let due = WatchStream::new(states).filter_map(move |(at_ns, state)| {
        // Time 0 is before the first state; time that runs back is a recording that begins again.
        let due = at_ns > 0 && last_ns.is_none_or(|last| at_ns < last || at_ns - last >= period_ns);
        due.then(|| {
            last_ns = Some(at_ns);
            Ok(state)
        })
    });
    Ok(Response::new(Box::pin(due)))
}
