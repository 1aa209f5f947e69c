//! Connections that withhold something: their reading, the rest of a header, the rest of a preface.

use arthro_proto::gateway::v1::WatchProcedureRequest;
use tokio::io::AsyncWriteExt as _;
use tokio::net::TcpStream;

use super::{Crowd, http2};

const WATCH_PROCEDURE: &str = "/arthro.gateway.v1.ProcedureService/WatchProcedure";

/// They stay connected until this is dropped.
#[derive(Debug)]
pub struct Withholding(Vec<TcpStream>);

impl Withholding {
    /// How many there are; the gateway may have closed its end.
    pub fn count(&self) -> usize {
        self.0.len()
    }
}

impl Crowd {
    /// So many who watch, grant the server the largest window, and never read a byte.
    pub async fn watch_without_reading(&self, clients: usize, period_s: f64) -> Withholding {
        let request = WatchProcedureRequest {
            procedure_id: self.procedure_id.clone(),
            period_s,
        };
        let call = http2::call(WATCH_PROCEDURE, &encoded(&request));
        self.withhold(clients, &call).await
    }

    /// So many who stop in the middle of a request's headers.
    pub async fn begin_headers(&self, clients: usize) -> Withholding {
        self.withhold(clients, &http2::half_a_header(WATCH_PROCEDURE))
            .await
    }

    /// So many who stop in the middle of the preface.
    pub async fn begin_prefaces(&self, clients: usize) -> Withholding {
        self.withhold(clients, http2::half_a_preface()).await
    }

    async fn withhold(&self, clients: usize, said: &[u8]) -> Withholding {
        let mut connections = Vec::with_capacity(clients);
        for _ in 0..clients {
            let mut connection = TcpStream::connect(self.address())
                .await
                .expect("the gateway takes a connection");
            connection
                .write_all(said)
                .await
                .expect("the gateway takes a few bytes");
            connections.push(connection);
        }
        Withholding(connections)
    }
}

fn encoded(request: &WatchProcedureRequest) -> Vec<u8> {
    use prost::Message as _;
    request.encode_to_vec()
}
