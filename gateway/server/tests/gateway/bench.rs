//! The bench of every test: stand-ins, a gateway in a runtime of its own that can be killed, and a
//! client that has taken a case as far as the test needs it.

use std::path::Path;
use std::sync::Arc;

use arthro_bootstrap::{Host, Service as _, status};
use arthro_gateway::config::{AuditConfig, Calibration, Config, Pose};
use arthro_gateway::journal::Place;
use arthro_geometry::{Point3, Vector3};
use arthro_proto::common::v1 as common;
use arthro_proto::gateway::v1 as proto;
use arthro_proto::gateway::v1::audit_service_client::AuditServiceClient;
use arthro_proto::gateway::v1::calibration_service_client::CalibrationServiceClient;
use arthro_proto::gateway::v1::case_service_client::CaseServiceClient;
use arthro_proto::gateway::v1::procedure_service_client::ProcedureServiceClient;
use sqlx::{Connection as _, SqliteConnection};
use tempfile::TempDir;
use tokio::runtime::Runtime;
use tonic::Status;
use tonic::transport::Channel;
use tonic::transport::server::TcpIncoming;

use super::fakes::{PATIENCE, World};

pub struct Bench {
    pub world: Arc<World>,
    pub cases: CaseServiceClient<Channel>,
    pub calibrations: CalibrationServiceClient<Channel>,
    pub procedures: ProcedureServiceClient<Channel>,
    pub channel: Channel,
    pub audit: AuditServiceClient<Channel>,
    pub config: Config,
    runtime: Option<Runtime>,
    _folder: TempDir,
}

impl Bench {
    pub async fn new() -> Self {
        Self::with(|_| {}).await
    }

    pub async fn with(configure: impl FnOnce(&mut Config)) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let journal = folder.path().join("gateway.sqlite");
        Self::on(journal.into(), folder, configure).await
    }

    pub async fn on(journal: Place, folder: TempDir, configure: impl FnOnce(&mut Config)) -> Self {
        let world = World::new(journal.clone());
        let mut config = config(journal, &world).await;
        configure(&mut config);
        let (runtime, channel) = gateway(config.clone()).await;
        let mut bench = Self::at(channel, world, config, folder);
        bench.runtime = Some(runtime);
        bench
    }

    /// A client of a gateway that runs elsewhere.
    pub fn at(channel: Channel, world: Arc<World>, config: Config, folder: TempDir) -> Self {
        Self {
            world,
            cases: CaseServiceClient::new(channel.clone()),
            calibrations: CalibrationServiceClient::new(channel.clone()),
            procedures: ProcedureServiceClient::new(channel.clone()),
            audit: AuditServiceClient::new(channel.clone()),
            channel,
            config,
            runtime: None,
            _folder: folder,
        }
    }

    /// Ends the gateway without telling any of its tasks.
    pub async fn kill(&mut self) {
        let runtime = self.runtime.take().unwrap();
        tokio::task::spawn_blocking(move || runtime.shutdown_timeout(PATIENCE))
            .await
            .unwrap();
    }

    /// A new gateway on the same journal.
    pub async fn restart(&mut self, configure: impl FnOnce(&mut Config)) {
        configure(&mut self.config);
        let (runtime, channel) = gateway(self.config.clone()).await;
        self.runtime = Some(runtime);
        self.cases = CaseServiceClient::new(channel.clone());
        self.calibrations = CalibrationServiceClient::new(channel.clone());
        self.procedures = ProcedureServiceClient::new(channel.clone());
        self.audit = AuditServiceClient::new(channel.clone());
        self.channel = channel;
    }

    // === a case, step by step ===

    pub async fn case(&mut self) -> String {
        let request = proto::CreateCaseRequest {
            label: "left knee".to_owned(),
        };
        let case = self.cases.create_case(request).await.unwrap();
        case.into_inner().case.unwrap().case_id
    }

    pub async fn upload(&mut self, case_id: &str) {
        self.cases
            .upload_model(tokio_stream::iter(model(case_id)))
            .await
            .unwrap();
        self.cases
            .upload_scene(tokio_stream::iter(scene(case_id)))
            .await
            .unwrap();
    }

    pub async fn register(&mut self, case_id: &str) -> Vec<proto::RegisterCaseResponse> {
        let request = proto::RegisterCaseRequest {
            case_id: case_id.to_owned(),
            ..proto::RegisterCaseRequest::default()
        };
        let mut events = self
            .cases
            .register_case(request)
            .await
            .unwrap()
            .into_inner();
        let mut all = Vec::new();
        while let Some(event) = events.message().await.unwrap() {
            all.push(event);
        }
        all
    }

    pub async fn accept(&mut self, case_id: &str) -> Result<proto::Case, Status> {
        self.accept_as(case_id, "").await
    }

    /// The same by a surgeon, if one is named.
    pub async fn accept_as(&mut self, case_id: &str, surgeon: &str) -> Result<proto::Case, Status> {
        let request = proto::AcceptRegistrationRequest {
            case_id: case_id.to_owned(),
            operator: "operator".to_owned(),
            surgeon: surgeon.to_owned(),
        };
        let answer = self.cases.accept_registration(request).await?;
        Ok(answer.into_inner().case.unwrap())
    }

    pub async fn plan(&mut self, case_id: &str) -> Result<(), Status> {
        let mut events = self
            .cases
            .plan_case(plan_request(case_id))
            .await?
            .into_inner();
        while events.message().await?.is_some() {}
        Ok(())
    }

    pub async fn approve(&mut self, case_id: &str, digest: &str) -> Result<proto::Case, Status> {
        let request = proto::ApprovePlanRequest {
            case_id: case_id.to_owned(),
            plan_digest: digest.to_owned(),
            surgeon: "surgeon".to_owned(),
        };
        let answer = self.cases.approve_plan(request).await?;
        Ok(answer.into_inner().case.unwrap())
    }

    pub async fn get(&mut self, case_id: &str) -> proto::GetCaseResponse {
        let request = proto::GetCaseRequest {
            case_id: case_id.to_owned(),
        };
        self.cases.get_case(request).await.unwrap().into_inner()
    }

    /// A case with a plan that waits for approval: its id and digest.
    pub async fn planned(&mut self) -> (String, String) {
        let case_id = self.case().await;
        self.upload(&case_id).await;
        self.register(&case_id).await;
        self.accept(&case_id).await.unwrap();
        self.plan(&case_id).await.unwrap();
        let digest = self.get(&case_id).await.case.unwrap().plan_digest;
        (case_id, digest)
    }

    pub async fn approved(&mut self) -> (String, String) {
        let (case_id, digest) = self.planned().await;
        self.approve(&case_id, &digest).await.unwrap();
        (case_id, digest)
    }

    // === the audit ===

    /// All entries from the first on.
    pub async fn entries(&mut self) -> Vec<proto::AuditEntry> {
        let request = proto::ListEntriesRequest {
            page_size: 1000,
            ..proto::ListEntriesRequest::default()
        };
        let listed = self.audit.list_entries(request).await.unwrap();
        let entries = listed.into_inner().entries;
        entries
            .into_iter()
            .map(|listed| listed.entry.unwrap())
            .collect()
    }

    /// Reads the audit until there is an entry like this one. What ends a call is written after its answer.
    pub async fn entry(
        &mut self,
        wanted: impl Fn(&proto::AuditEntry) -> bool,
    ) -> proto::AuditEntry {
        let read = async {
            loop {
                let found = self.entries().await.into_iter().find(|entry| wanted(entry));
                match found {
                    Some(entry) => return entry,
                    None => tokio::task::yield_now().await,
                }
            }
        };
        match tokio::time::timeout(PATIENCE, read).await {
            Ok(entry) => entry,
            Err(_) => panic!("there is no such entry in {:#?}", self.entries().await),
        }
    }

    /// What the gateway itself finds.
    pub async fn verdict(&mut self) -> proto::AuditVerdict {
        let request = proto::VerifyChainRequest {};
        let mut answers = self.audit.verify_chain(request).await.unwrap().into_inner();
        let mut verdict = None;
        while let Some(answer) = answers.message().await.unwrap() {
            verdict = answer.verdict;
        }
        verdict.unwrap()
    }

    /// The journal's file, as somebody else on this machine opens it.
    pub async fn intrude(&self) -> SqliteConnection {
        let url = format!("sqlite://{}", self.config.journal);
        SqliteConnection::connect(&url).await.unwrap()
    }

    // === a procedure ===

    pub async fn start(&mut self, case_id: &str, digest: &str) -> Result<String, Status> {
        let request = proto::StartProcedureRequest {
            case_id: case_id.to_owned(),
            plan_digest: digest.to_owned(),
            operator: "operator".to_owned(),
        };
        let answer = self.procedures.start_procedure(request).await?;
        Ok(answer.into_inner().procedure.unwrap().procedure_id)
    }

    /// An approved plan under way.
    pub async fn started(&mut self) -> String {
        let (case_id, digest) = self.approved().await;
        self.start(&case_id, &digest).await.unwrap()
    }

    /// Watches until the procedure is in one of the states.
    pub async fn reaches(
        &mut self,
        procedure_id: &str,
        state: proto::ProcedureState,
    ) -> proto::Procedure {
        let request = proto::WatchProcedureRequest {
            procedure_id: procedure_id.to_owned(),
            ..proto::WatchProcedureRequest::default()
        };
        let mut watching = self
            .procedures
            .watch_procedure(request)
            .await
            .unwrap()
            .into_inner();
        let mut last = None;
        let watch = async {
            while let Some(message) = watching.message().await.unwrap() {
                let procedure = message.procedure.unwrap();
                if procedure.state() == state {
                    return procedure;
                }
                last = Some(procedure);
            }
            panic!("the watch ended before {state:?}: {last:?}");
        };
        match tokio::time::timeout(PATIENCE, watch).await {
            Ok(procedure) => procedure,
            Err(_) => panic!("never became {state:?}"),
        }
    }

    pub async fn pause(&mut self, procedure_id: &str) -> Result<proto::Procedure, Status> {
        let request = proto::PauseProcedureRequest {
            procedure_id: procedure_id.to_owned(),
        };
        let answer = self.procedures.pause_procedure(request).await?;
        Ok(answer.into_inner().procedure.unwrap())
    }

    /// With acknowledgement.
    pub async fn resume(&mut self, procedure_id: &str) -> Result<proto::Procedure, Status> {
        let request = proto::ResumeProcedureRequest {
            procedure_id: procedure_id.to_owned(),
            acknowledge: true,
        };
        let answer = self.procedures.resume_procedure(request).await?;
        Ok(answer.into_inner().procedure.unwrap())
    }

    pub async fn abort(&mut self, procedure_id: &str) -> Result<proto::Procedure, Status> {
        let request = proto::AbortProcedureRequest {
            procedure_id: procedure_id.to_owned(),
        };
        let answer = self.procedures.abort_procedure(request).await?;
        Ok(answer.into_inner().procedure.unwrap())
    }

    pub async fn recovery(&mut self, procedure_id: &str) -> proto::GetRecoveryResponse {
        let request = proto::GetRecoveryRequest {
            procedure_id: procedure_id.to_owned(),
        };
        let answer = self.procedures.get_recovery(request).await;
        answer.unwrap().into_inner()
    }

    /// With acknowledgement, and not of faults.
    pub async fn recover(
        &mut self,
        procedure_id: &str,
        action: proto::RecoveryAction,
    ) -> Result<proto::Procedure, Status> {
        let decision = proto::RecoverProcedureRequest {
            acknowledge: true,
            ..decision(procedure_id, action)
        };
        self.decide(decision).await
    }

    pub async fn decide(
        &mut self,
        request: proto::RecoverProcedureRequest,
    ) -> Result<proto::Procedure, Status> {
        let answer = self.procedures.recover_procedure(request).await?;
        Ok(answer.into_inner().procedure.unwrap())
    }

    pub async fn report(&mut self, procedure_id: &str) -> proto::GetReportResponse {
        let request = proto::GetReportRequest {
            procedure_id: procedure_id.to_owned(),
        };
        self.procedures
            .get_report(request)
            .await
            .unwrap()
            .into_inner()
    }
}

impl Drop for Bench {
    fn drop(&mut self) {
        if let Some(runtime) = self.runtime.take() {
            runtime.shutdown_background();
        }
    }
}

/// An operator's decision that acknowledges nothing.
pub fn decision(
    procedure_id: &str,
    action: proto::RecoveryAction,
) -> proto::RecoverProcedureRequest {
    proto::RecoverProcedureRequest {
        procedure_id: procedure_id.to_owned(),
        action: action.into(),
        operator: "operator".to_owned(),
        ..proto::RecoverProcedureRequest::default()
    }
}

/// Serves a gateway on a runtime of its own.
async fn gateway(config: Config) -> (Runtime, Channel) {
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .worker_threads(1)
        .enable_all()
        .build()
        .unwrap();
    let address = runtime
        .spawn(async move {
            let routes = arthro_gateway::Server::build(config, Host::alone())
                .await
                .unwrap();
            let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
            let address = listener.local_addr().unwrap();
            let server = tonic::transport::Server::builder()
                .add_routes(routes)
                .serve_with_incoming(TcpIncoming::from(listener).with_nodelay(Some(true)));
            tokio::spawn(server);
            address
        })
        .await
        .unwrap();
    let channel = Channel::from_shared(format!("http://{address}"))
        .unwrap()
        .connect()
        .await
        .unwrap();
    (runtime, channel)
}

/// Of a gateway between the stand-ins, which are served from now on.
pub async fn config(journal: Place, world: &Arc<World>) -> Config {
    let address = world.serve().await;
    Config {
        journal,
        registration: address.clone().into(),
        planning: address.clone().into(),
        motion: address.clone(),
        instrument: address,
        calibration: Some(calibration()),
        ..Config::default()
    }
}

/// The audit's files in a folder: beside a database there is no place for them.
pub fn audit_in(folder: &Path) -> AuditConfig {
    AuditConfig {
        key: Some(folder.join("audit-key")),
        heads: Some(folder.join("audit-heads")),
        ..AuditConfig::default()
    }
}

/// The camera looks down on the knee; the arthroscope comes from the side.
pub fn calibration() -> Calibration {
    Calibration {
        forceps_base_from_camera: Pose {
            rotation: [0.0, 1.0, 0.0, 0.0],
            translation_mm: [750.0, 0.0, 550.0],
        },
        forceps_base_from_arthroscope_base: Pose {
            rotation: [
                std::f64::consts::FRAC_1_SQRT_2,
                0.0,
                0.0,
                -std::f64::consts::FRAC_1_SQRT_2,
            ],
            translation_mm: [350.0, 750.0, 0.0],
        },
        forceps_portal_mm: [700.0, -20.0, 260.0],
        arthroscope_portal_mm: [700.0, 380.0, 260.0],
        forceps_base_from_tool_at_tray: Pose {
            rotation: [1.0, 0.0, 0.0, 0.0],
            translation_mm: [450.0, -250.0, 350.0],
        },
        arthroscope_rest_mm: [550.0, 380.0, 350.0],
        valid_until: None,
        hand_eye_covariance: None,
        tool_tip_covariance_mm2: None,
    }
}

/// Where a point of ct is in the forceps arm's base, by hand: camera = ct + t, base = (750 + x, -y, 550 - z).
pub fn in_base(ct: [f64; 3]) -> Point3 {
    let [tx, ty, tz] = super::fakes::computing::CAMERA_FROM_CT_MM;
    Point3::new(750.0 + ct[0] + tx, -(ct[1] + ty), 550.0 - (ct[2] + tz))
}

/// A point of the arthroscope arm's base in the forceps arm's, as the bench has them.
pub fn arthroscope_in_forceps_base(point: &Point3) -> Point3 {
    Point3::new(350.0 + point.y, 750.0 - point.x, point.z)
}

/// The same for a direction.
pub fn direction_in_base(ct: &common::Direction) -> Vector3 {
    Vector3::new(ct.x, -ct.y, -ct.z)
}

pub fn plan_request(case_id: &str) -> proto::PlanCaseRequest {
    let point = |x_mm, y_mm, z_mm| Some(common::Point { x_mm, y_mm, z_mm });
    proto::PlanCaseRequest {
        case_id: case_id.to_owned(),
        start: point(53.0, 48.0, 61.0),
        goal: point(54.0, 53.0, 36.0),
        target_box: Some(common::Box {
            min: point(50.0, 40.0, 30.0),
            max: point(60.0, 70.0, 70.0),
        }),
        ..proto::PlanCaseRequest::default()
    }
}

/// A tetrahedron of 30 mm.
pub fn model(case_id: &str) -> Vec<proto::UploadModelRequest> {
    use arthro_proto::common::v1::mesh_chunk::Part;
    use proto::upload_model_request::Payload;
    let vertices = packed(&[0., 0., 0., 30., 0., 0., 0., 30., 0., 0., 0., 30.]);
    let triangles: Vec<u8> = [0u32, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3]
        .iter()
        .flat_map(|index| index.to_le_bytes())
        .collect();
    let header = proto::ModelHeader {
        case_id: case_id.to_owned(),
        mesh: Some(common::MeshHeader {
            frame: common::Frame::Ct.into(),
            vertex_count: 4,
            triangle_count: 4,
        }),
        lesion: None,
        lesion_spacing_mm: 0.5,
    };
    let mesh = |part| Payload::Mesh(common::MeshChunk { part: Some(part) });
    [
        Payload::Header(header),
        mesh(Part::Vertices(vertices.into())),
        mesh(Part::Triangles(triangles.into())),
    ]
    .map(|payload| proto::UploadModelRequest {
        payload: Some(payload),
    })
    .to_vec()
}

/// 200 points on a line of 40 mm.
pub fn scene_points() -> Vec<u8> {
    let values: Vec<f32> = (0..200)
        .flat_map(|index| [index as f32 * 0.2, 0.0, 250.0])
        .collect();
    packed(&values)
}

pub fn scene(case_id: &str) -> Vec<proto::UploadSceneRequest> {
    use proto::upload_scene_request::Payload;
    let header = proto::SceneHeader {
        case_id: case_id.to_owned(),
        scene: Some(proto::scene_header::Scene::Cloud(common::CloudHeader {
            frame: common::Frame::Camera.into(),
            point_count: 200,
            has_normals: false,
        })),
    };
    [
        Payload::Header(header),
        Payload::Points(scene_points().into()),
    ]
    .map(|payload| proto::UploadSceneRequest {
        payload: Some(payload),
    })
    .to_vec()
}

pub fn packed(values: &[f32]) -> Vec<u8> {
    values
        .iter()
        .flat_map(|value| value.to_le_bytes())
        .collect()
}

/// The reason word of a refusal.
pub fn reason<T: std::fmt::Debug>(answer: Result<T, Status>) -> String {
    let refusal = answer.expect_err("the call is refused");
    status::reason(&refusal).unwrap_or_else(|| panic!("no reason in {refusal:?}"))
}
