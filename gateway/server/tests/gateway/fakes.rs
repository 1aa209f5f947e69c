//! Stand-ins of the four services behind one address. They keep just enough of a world to refuse
//! what the real ones refuse, note every command, and look into the gateway's journal when a command
//! arrives.

pub mod computing;
mod instrument;
pub mod motion;
pub mod replica;

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use arthro_bootstrap::status;
use arthro_gateway::journal::Place;
use arthro_geometry::{Point3, Rotation, Vector3};
use arthro_proto::common::v1::{Authorization, Operation, OperationState};
use arthro_proto::instrument::v1::JawState;
use arthro_proto::instrument::v1::instrument_service_server::InstrumentServiceServer;
use arthro_proto::motion::v1::motion_service_server::MotionServiceServer;
use arthro_proto::planning::v1::PlanResectionOptions;
use arthro_proto::planning::v1::planning_service_server::PlanningServiceServer;
use arthro_proto::registration::v1::Verdict;
use arthro_proto::registration::v1::registration_service_server::RegistrationServiceServer;
use sqlx::{AnyConnection, Connection as _};
use tokio::sync::watch;
use tonic::Status;
use tonic::transport::server::TcpIncoming;

/// No event of a test takes longer.
pub const PATIENCE: Duration = Duration::from_secs(20);

/// What the stand-ins know and have seen.
pub struct World {
    /// The gateway's journal, read when a command arrives.
    pub journal: Place,
    /// Whether it is read: where time is measured, it is not.
    pub reads_journal: AtomicBool,
    /// Every command in order, e.g. "INSERT FORCEPS".
    pub commands: watch::Sender<Vec<String>>,
    /// Commands that arrived before their intention was in the journal.
    pub unjournalled: Mutex<Vec<String>>,
    /// Commands named here wait, once they have begun.
    pub held: watch::Sender<Vec<String>>,
    /// Counts dry runs.
    pub checks: watch::Sender<u32>,
    /// Counts stops.
    pub stops: watch::Sender<u32>,
    /// Counts renewals of both leases.
    pub renewals: watch::Sender<u32>,
    /// Whether renewals are refused.
    pub refuse_renewals: Mutex<bool>,
    /// The motion service's answer about targets that are unreachable: index and reason.
    pub unreachable: Mutex<Option<(usize, &'static str)>>,
    /// The registration's verdict.
    pub verdict: Mutex<Verdict>,
    /// The tip at each bite, forceps arm's base.
    pub bitten_at: Mutex<Vec<Point3>>,
    /// The arthroscope's tip at each bite, its arm's base.
    pub watched_from: Mutex<Vec<Point3>>,
    /// The angle of the jaw's opening direction at each bite.
    pub bitten_along: Mutex<Vec<Vector3>>,
    /// What planning was asked last.
    pub plan_options: Mutex<Option<PlanResectionOptions>>,
    /// The portal of the last planned bite.
    pub last_bites_portal: Mutex<u32>,
    /// Every computation that began, e.g. "REGISTER". They wait while they are held, once the first event is sent.
    pub computations: watch::Sender<Vec<String>>,
    /// What computations are refused with.
    pub computing_refusal: Mutex<Option<Status>>,
    /// Points of the model that the registration received.
    pub source_points: watch::Sender<u32>,
    /// Both arms: forceps, arthroscope.
    pub arms: Mutex<[FakeArm; 2]>,
    pub rotation_deg: Mutex<f64>,
    pub homed: Mutex<bool>,
    pub jaw: Mutex<JawState>,
    /// Whether a fault is latched on the drives.
    pub drives_faulty: Mutex<bool>,
    pub tokens: Mutex<Tokens>,
}

#[derive(Clone, Copy)]
pub struct FakeArm {
    pub rotation: Rotation,
    pub tip: Point3,
    pub portal: Option<Point3>,
    pub faulty: bool,
    pub connected: bool,
    /// How far the tip goes on between two readings, mm.
    pub drift_mm: f64,
}

#[derive(Default)]
pub struct Tokens {
    pub last: u64,
    pub motion: Option<u64>,
    pub instrument: Option<u64>,
}

impl World {
    pub fn new(journal: Place) -> Arc<Self> {
        let arm = |x: f64| FakeArm {
            rotation: Rotation::identity(),
            tip: Point3::new(x, -300.0, 400.0),
            portal: None,
            faulty: false,
            connected: true,
            drift_mm: 0.0,
        };
        Arc::new(Self {
            journal,
            reads_journal: AtomicBool::new(true),
            commands: watch::Sender::default(),
            unjournalled: Mutex::default(),
            held: watch::Sender::default(),
            checks: watch::Sender::default(),
            stops: watch::Sender::default(),
            renewals: watch::Sender::default(),
            refuse_renewals: Mutex::new(false),
            unreachable: Mutex::default(),
            verdict: Mutex::new(Verdict::Accept),
            bitten_at: Mutex::default(),
            watched_from: Mutex::default(),
            bitten_along: Mutex::default(),
            plan_options: Mutex::default(),
            last_bites_portal: Mutex::default(),
            computations: watch::Sender::default(),
            computing_refusal: Mutex::default(),
            source_points: watch::Sender::default(),
            arms: Mutex::new([arm(400.0), arm(0.0)]),
            rotation_deg: Mutex::new(10.0),
            homed: Mutex::new(false),
            jaw: Mutex::new(JawState::Open),
            drives_faulty: Mutex::new(false),
            tokens: Mutex::default(),
        })
    }

    /// Serves all four services; answers the address.
    pub async fn serve(self: &Arc<Self>) -> String {
        let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = listener.local_addr().unwrap().to_string();
        let server = tonic::transport::Server::builder()
            .add_service(MotionServiceServer::new(motion::FakeMotion(self.clone())))
            .add_service(InstrumentServiceServer::new(instrument::FakeInstrument(
                self.clone(),
            )))
            .add_service(RegistrationServiceServer::new(computing::Fake(
                self.clone(),
            )))
            .add_service(PlanningServiceServer::new(computing::Fake(self.clone())))
            .serve_with_incoming(TcpIncoming::from(listener).with_nodelay(Some(true)));
        tokio::spawn(server);
        address
    }

    /// Lets nothing named `command` go on until it is released.
    pub fn hold(&self, command: &str) {
        self.held.send_modify(|held| held.push(command.to_owned()));
    }

    pub fn let_go(&self) {
        self.held.send_modify(Vec::clear);
    }

    /// Resolves when `command` has arrived `times` times.
    pub async fn arrived(&self, command: &str, times: usize) {
        let mut commands = self.commands.subscribe();
        let all = commands.wait_for(|commands| count(commands, command) >= times);
        tokio::time::timeout(PATIENCE, all)
            .await
            .unwrap_or_else(|_| panic!("{times} x {command} did not arrive: {:?}", self.commands()))
            .unwrap();
    }

    pub fn commands(&self) -> Vec<String> {
        self.commands.borrow().clone()
    }

    pub fn count(&self, command: &str) -> usize {
        count(&self.commands.borrow(), command)
    }

    /// Notes a command, after checking its lease and the journal.
    async fn note(
        &self,
        command: String,
        authorization: Option<Authorization>,
        token: Option<u64>,
    ) -> Result<String, Status> {
        let authorization = authorization.expect("a command carries its authorization");
        if token != Some(authorization.fencing_token) {
            return Err(status::refused(
                "STALE_FENCING_TOKEN",
                format!("token {} is stale", authorization.fencing_token),
                &[],
            ));
        }
        let step_id = authorization
            .operation_id
            .split('.')
            .next()
            .unwrap()
            .to_owned();
        if self.reads_journal.load(Ordering::Relaxed) && !self.is_intended(&step_id).await {
            self.unjournalled.lock().unwrap().push(command.clone());
        }
        self.commands.send_modify(|commands| commands.push(command));
        Ok(authorization.operation_id)
    }

    /// A connection beside the gateway's, "ro" or "rw".
    async fn journal_connection(&self, mode: &str) -> AnyConnection {
        sqlx::any::install_default_drivers();
        let url = match &self.journal {
            Place::File(path) => format!("sqlite:{}?mode={mode}", path.display()),
            Place::Postgres(address) => address.clone(),
        };
        AnyConnection::connect(&url).await.unwrap()
    }

    /// Whether the journal, read by a connection of its own, holds the step as INTENDED.
    async fn is_intended(&self, step_id: &str) -> bool {
        let mut connection = self.journal_connection("ro").await;
        let state: Option<String> =
            sqlx::query_scalar("SELECT state FROM steps WHERE operation_id = $1")
                .bind(step_id)
                .fetch_optional(&mut connection)
                .await
                .unwrap();
        connection.close().await.unwrap();
        state.as_deref() == Some("INTENDED")
    }

    /// Notes a computation, and refuses it if that is what the test wants.
    fn computes(&self, what: &str) -> Result<(), Status> {
        self.computations
            .send_modify(|computations| computations.push(what.to_owned()));
        match &*self.computing_refusal.lock().unwrap() {
            Some(refusal) => Err(refusal.clone()),
            None => Ok(()),
        }
    }

    /// Takes the journal's write lock until the connection is dropped.
    pub async fn lock_journal(&self) -> AnyConnection {
        let mut connection = self.journal_connection("rw").await;
        sqlx::query("BEGIN IMMEDIATE")
            .execute(&mut connection)
            .await
            .unwrap();
        connection
    }

    /// Waits while `command` is held; says whether a stop came first.
    async fn wait_while_held(&self, command: &str) -> bool {
        let mut held = self.held.subscribe();
        let mut stops = self.stops.subscribe();
        let before = *stops.borrow_and_update();
        tokio::select! {
            _ = held.wait_for(|held| !held.iter().any(|name| name == command)) => false,
            _ = stops.wait_for(|stops| *stops > before) => true,
        }
    }
}

fn count(commands: &[String], command: &str) -> usize {
    commands.iter().filter(|noted| *noted == command).count()
}

fn operation(operation_id: &str, state: OperationState) -> Option<Operation> {
    Some(Operation {
        operation_id: operation_id.to_owned(),
        state: state.into(),
        reason: match state {
            OperationState::Stopped => "STOPPED".to_owned(),
            _ => String::new(),
        },
        detail: String::new(),
        repeated: false,
    })
}
