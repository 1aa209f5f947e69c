//! One replica of registration and planning on a runtime of its own, so that it can be killed with every connection it has.

use std::net::SocketAddr;
use std::sync::Arc;

use arthro_proto::planning::v1::planning_service_server::PlanningServiceServer;
use arthro_proto::registration::v1::registration_service_server::RegistrationServiceServer;
use tokio::runtime::Runtime;
use tonic::transport::server::TcpIncoming;
use tonic_health::ServingStatus;
use tonic_health::server::HealthReporter;

use super::{PATIENCE, World, computing};

pub struct Replica {
    pub world: Arc<World>,
    pub address: String,
    health: HealthReporter,
    runtime: Option<Runtime>,
}

impl Replica {
    pub async fn new() -> Self {
        Self::at("127.0.0.1:0".parse().unwrap()).await
    }

    pub async fn at(address: SocketAddr) -> Self {
        // It commands nothing, so it looks into no journal.
        let world = World::new(std::path::PathBuf::from("no journal").into());
        let runtime = tokio::runtime::Builder::new_multi_thread()
            .worker_threads(1)
            .enable_all()
            .build()
            .unwrap();
        let (health, health_service) = tonic_health::server::health_reporter();
        let serving = world.clone();
        let address = runtime
            .spawn(async move {
                let listener = tokio::net::TcpListener::bind(address).await.unwrap();
                let address = listener.local_addr().unwrap();
                let server = tonic::transport::Server::builder()
                    .add_service(health_service)
                    .add_service(RegistrationServiceServer::new(computing::Fake(
                        serving.clone(),
                    )))
                    .add_service(PlanningServiceServer::new(computing::Fake(serving)))
                    .serve_with_incoming(TcpIncoming::from(listener).with_nodelay(Some(true)));
                tokio::spawn(server);
                address
            })
            .await
            .unwrap();
        let this = Self {
            world,
            address: address.to_string(),
            health,
            runtime: Some(runtime),
        };
        this.says(ServingStatus::Serving).await;
        this
    }

    /// What it tells of its health from now on.
    pub async fn says(&self, status: ServingStatus) {
        for service in [
            "arthro.registration.v1.RegistrationService",
            "arthro.planning.v1.PlanningService",
        ] {
            self.health.set_service_status(service, status).await;
        }
    }

    /// Ends it in the middle of whatever it does; its connections break.
    pub async fn kill(&mut self) {
        let runtime = self.runtime.take().unwrap();
        tokio::task::spawn_blocking(move || runtime.shutdown_timeout(PATIENCE))
            .await
            .unwrap();
    }

    /// A new process at the address of one that was killed.
    pub async fn rebirth(&mut self) {
        *self = Self::at(self.address.parse().unwrap()).await;
    }

    pub fn count(&self, computation: &str) -> usize {
        self.world
            .computations
            .borrow()
            .iter()
            .filter(|noted| *noted == computation)
            .count()
    }

    /// Resolves when a computation of this name has begun here.
    pub async fn computes(&self, computation: &str) {
        let mut computations = self.world.computations.subscribe();
        computations
            .wait_for(|noted| noted.iter().any(|noted| noted == computation))
            .await
            .unwrap();
    }
}

impl Drop for Replica {
    fn drop(&mut self) {
        if let Some(runtime) = self.runtime.take() {
            runtime.shutdown_background();
        }
    }
}
