//! `RecordingService`.

use arthro_proto::gateway::v1 as proto;
use arthro_proto::gateway::v1::recording_service_server::RecordingService;
use tonic::{Request, Response, Status};

use crate::recording::Recorder;

/// Tells of the recorder, if there is one.
pub(super) struct RecordingApi(Option<Recorder>);

impl RecordingApi {
    pub(super) fn new(recorder: Option<Recorder>) -> Self {
        Self(recorder)
    }
}

#[tonic::async_trait]
impl RecordingService for RecordingApi {
    async fn get_recorder(
        &self,
        _: Request<proto::GetRecorderRequest>,
    ) -> Result<Response<proto::GetRecorderResponse>, Status> {
        let Some(recorder) = &self.0 else {
            return Ok(Response::new(proto::GetRecorderResponse::default()));
        };
        let state = recorder.state();
        let (alarm_reason, alarm_detail) = state
            .alarm
            .map(|(reason, detail)| (reason.to_owned(), detail))
            .unwrap_or_default();
        Ok(Response::new(proto::GetRecorderResponse {
            configured: true,
            file: state
                .file
                .map(|path| path.display().to_string())
                .unwrap_or_default(),
            file_bytes: state.file_bytes,
            dropped_messages: state.dropped_lines,
            alarm_reason,
            alarm_detail,
        }))
    }
}
