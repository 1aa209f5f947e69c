//! The service as its clients see it.

mod reach;

use std::net::SocketAddr;

use arthro_bootstrap::status;
use arthro_geometry::{Point3, phantom};
use arthro_planning::plan::Request;
use arthro_planning::server::Planning;
use arthro_planning::target::Aim;
use arthro_proto::common::v1 as common;
use arthro_proto::planning::v1 as proto;
use arthro_proto::planning::v1::planning_service_client::PlanningServiceClient;
use arthro_proto::planning::v1::planning_service_server::PlanningServiceServer;
use proto::check_reachability_request::Payload as ReachPayload;
use proto::evaluate_resection_request::Payload as EvaluatePayload;
use proto::plan_resection_request::Payload;
use proto::plan_resection_response::Event;
use tokio::net::TcpListener;
use tokio::task::JoinHandle;
use tokio_stream::StreamExt as _;
use tonic::transport::Channel;
use tonic::transport::server::TcpIncoming;
use tonic::{Code, Status};

use crate::world::{LESION_SPACING_MM, papers_case};

const CHUNK_BYTES: usize = 256 * 1024;

/// A server on a free port and a client of it.
struct Context {
    client: PlanningServiceClient<Channel>,
    server: JoinHandle<()>,
}

impl Context {
    async fn start() -> Self {
        let listener = TcpListener::bind(SocketAddr::from(([127, 0, 0, 1], 0)))
            .await
            .unwrap();
        let address = listener.local_addr().unwrap();
        let planning = Planning::new(&arthro_planning::Config {
            max_computations: 1,
        });
        let server = tokio::spawn(async move {
            tonic::transport::Server::builder()
                .add_service(PlanningServiceServer::new(planning))
                .serve_with_incoming(TcpIncoming::from(listener).with_nodelay(Some(true)))
                .await
                .unwrap();
        });
        let client = PlanningServiceClient::connect(format!("http://{address}"))
            .await
            .unwrap();
        Self { client, server }
    }

    /// Plans and returns the events.
    async fn plan(&mut self, messages: Vec<Payload>) -> Result<Vec<Event>, Status> {
        let messages = messages
            .into_iter()
            .map(|payload| proto::PlanResectionRequest {
                payload: Some(payload),
            });
        let stream = tokio_stream::iter(messages.collect::<Vec<_>>());
        let mut answer = self.client.plan_resection(stream).await?.into_inner();
        let mut events = Vec::new();
        while let Some(response) = answer.message().await? {
            events.push(response.event.unwrap());
        }
        Ok(events)
    }

    async fn refusal(&mut self, messages: Vec<Payload>) -> Status {
        self.plan(messages).await.unwrap_err()
    }

    async fn evaluate(
        &mut self,
        messages: Vec<EvaluatePayload>,
    ) -> Result<proto::ResectionEvaluation, Status> {
        let messages = messages
            .into_iter()
            .map(|payload| proto::EvaluateResectionRequest {
                payload: Some(payload),
            });
        let stream = tokio_stream::iter(messages.collect::<Vec<_>>());
        let answer = self.client.evaluate_resection(stream).await?;
        Ok(answer.into_inner().evaluation.unwrap())
    }
}

impl Context {
    async fn reach(
        &mut self,
        messages: Vec<ReachPayload>,
    ) -> Result<proto::CheckReachabilityResponse, Status> {
        let messages = messages
            .into_iter()
            .map(|payload| proto::CheckReachabilityRequest {
                payload: Some(payload),
            });
        let stream = tokio_stream::iter(messages.collect::<Vec<_>>());
        Ok(self.client.check_reachability(stream).await?.into_inner())
    }
}

impl Drop for Context {
    fn drop(&mut self) {
        self.server.abort();
    }
}

fn point(point: Point3) -> Option<common::Point> {
    Some(common::Point {
        x_mm: point.x,
        y_mm: point.y,
        z_mm: point.z,
    })
}

fn mesh_header(case: &Request) -> common::MeshHeader {
    common::MeshHeader {
        frame: common::Frame::Ct as i32,
        vertex_count: case.model.vertices.len() as u32,
        triangle_count: case.model.triangles.len() as u32,
    }
}

fn lesion_header(case: &Request) -> common::CloudHeader {
    common::CloudHeader {
        frame: common::Frame::Ct as i32,
        point_count: case.lesion.len() as u32,
        has_normals: false,
    }
}

fn options(case: &Request) -> proto::PlanResectionOptions {
    let Aim::Ends { start, goal } = case.aim else {
        panic!("{:?}", case.aim);
    };
    let (low, high) = case.target_box.unwrap();
    proto::PlanResectionOptions {
        model: Some(mesh_header(case)),
        lesion: Some(lesion_header(case)),
        lesion_spacing_mm: LESION_SPACING_MM,
        start: point(start),
        goal: point(goal),
        target_box: Some(common::Box {
            min: point(low),
            max: point(high),
        }),
        portal: point(case.portals[0]),
        jaw: Some(proto::Jaw {
            width_mm: case.jaw.width_mm,
            length_mm: case.jaw.length_mm,
            throat_mm: None,
        }),
        seed: case.seed,
        ..Default::default()
    }
}

/// The options of the scenario TEAR: no ends, the contour comes from the lesion.
fn tear_options(case: &Request) -> proto::PlanResectionOptions {
    proto::PlanResectionOptions {
        start: None,
        goal: None,
        ..options(case)
    }
}

/// The options of the paper's own planner.
fn papers_options(case: &Request) -> proto::PlanResectionOptions {
    proto::PlanResectionOptions {
        planner: proto::Planner::Paper.into(),
        ..options(case)
    }
}

fn packed(points: &[Point3]) -> Vec<u8> {
    let values = points
        .iter()
        .flat_map(|point| point.coords.into_iter().copied().collect::<Vec<_>>());
    values
        .flat_map(|value| (value as f32).to_le_bytes())
        .collect()
}

fn chunks(bytes: &[u8]) -> impl Iterator<Item = tonic::codegen::Bytes> + '_ {
    // Not a multiple of a point: chunks may end anywhere.
    bytes
        .chunks(CHUNK_BYTES.min(10_001))
        .map(tonic::codegen::Bytes::copy_from_slice)
}

fn model_chunks(case: &Request) -> Vec<common::MeshChunk> {
    use common::mesh_chunk::Part;
    let triangles: Vec<u8> = case
        .model
        .triangles
        .iter()
        .flatten()
        .flat_map(|vertex| vertex.to_le_bytes())
        .collect();
    let vertices = packed(&case.model.vertices);
    let parts = chunks(&vertices)
        .map(Part::Vertices)
        .chain(chunks(&triangles).map(Part::Triangles));
    parts
        .map(|part| common::MeshChunk { part: Some(part) })
        .collect()
}

fn messages(options: proto::PlanResectionOptions, case: &Request) -> Vec<Payload> {
    let mut messages = vec![Payload::Options(options)];
    messages.extend(model_chunks(case).into_iter().map(Payload::Model));
    messages.extend(chunks(&packed(&case.lesion)).map(Payload::Lesion));
    messages
}

fn violated_fields(status: &Status) -> Vec<String> {
    assert_eq!(status.code(), Code::InvalidArgument, "{status:?}");
    let violations = status::violations(status).into_iter();
    violations.map(|(field, _)| field).collect()
}

#[tokio::test]
async fn a_plan_streams_its_progress_and_ends_in_one_plan_that_scores_the_same() {
    let mut context = Context::start().await;
    let case = papers_case();
    let mut asked = tear_options(&case);
    asked.arthroscope = Some(proto::ArthroscopeViewOptions {
        portal: point(Point3::new(62.0, 48.0, 94.5)),
        ..Default::default()
    });
    let mut events = context.plan(messages(asked, &case)).await.unwrap();
    let Some(Event::Plan(plan)) = events.pop() else {
        panic!("the last event is no plan");
    };
    assert!(events.len() >= 5);
    assert!(
        events
            .iter()
            .all(|event| matches!(event, Event::Progress(_)))
    );
    let evaluation = plan.evaluation.clone().unwrap();
    assert!(evaluation.lesion_covered_percent >= 98.0);
    assert_eq!(evaluation.bites as usize, plan.bites.len());
    assert_eq!(plan.views.len(), plan.bites.len());
    assert_eq!(evaluation.accounts.len(), plan.bites.len());
    assert!(plan.complete && evaluation.order_feasible && plan.bound <= evaluation.bites);
    assert!(plan.planner() == proto::Planner::Bites);

    let mut messages = vec![EvaluatePayload::Options(proto::EvaluateResectionOptions {
        model: Some(mesh_header(&case)),
        lesion: Some(lesion_header(&case)),
        contour: plan.contour,
        bites: plan.bites,
        jaw: options(&case).jaw,
        ..Default::default()
    })];
    messages.extend(model_chunks(&case).into_iter().map(EvaluatePayload::Model));
    messages.extend(chunks(&packed(&case.lesion)).map(EvaluatePayload::Lesion));
    let scored = context.evaluate(messages).await.unwrap();
    assert_eq!(
        scored.lesion_covered_percent,
        evaluation.lesion_covered_percent
    );
    assert!((scored.healthy_removed_mm3 - evaluation.healthy_removed_mm3).abs() < 2.0);
}

#[tokio::test]
async fn bad_options_are_refused_all_at_once() {
    let mut context = Context::start().await;
    let case = papers_case();
    let mut bad = options(&case);
    bad.jaw = Some(proto::Jaw::default());
    bad.start = Some(common::Point {
        x_mm: f64::NAN,
        ..Default::default()
    });
    bad.portal = None;
    bad.voxel_mm = -0.5;
    bad.step_mm = f64::INFINITY;
    bad.target_box = Some(common::Box {
        min: point(case.target_box.unwrap().1),
        max: point(case.target_box.unwrap().0),
    });
    let refusal = context.refusal(messages(bad, &case)).await;
    let fields = violated_fields(&refusal);
    for field in [
        "options.jaw.width_mm",
        "options.jaw.length_mm",
        "options.start.x_mm",
        "options.portal",
        "options.voxel_mm",
        "options.step_mm",
        "options.target_box",
    ] {
        assert!(
            fields.iter().any(|name| name == field),
            "{field} of {fields:?}"
        );
    }
}

#[tokio::test]
async fn bites_whose_axes_are_no_axes_are_refused() {
    let mut context = Context::start().await;
    let case = papers_case();
    let axis = |x: f64, y: f64| Some(common::Direction { x, y, z: 0.0 });
    let bite = |approach, opening| proto::Bite {
        center: point(phantom::START),
        approach,
        opening,
        contour_point: None,
        portal: 0,
    };
    let options = proto::EvaluateResectionOptions {
        model: Some(mesh_header(&case)),
        lesion: Some(lesion_header(&case)),
        bites: vec![
            bite(axis(1.0, 0.0), axis(0.0, 1.0)),
            bite(axis(1.0, 0.0), axis(1.0, 0.0)),
            bite(axis(1.1, 0.0), axis(0.0, 1.0)),
            bite(axis(1.0, 0.0), axis(f64::NAN, 0.0)),
        ],
        jaw: options(&case).jaw,
        ..Default::default()
    };
    let refusal = context
        .evaluate(vec![EvaluatePayload::Options(options)])
        .await
        .unwrap_err();
    assert_eq!(
        violated_fields(&refusal),
        [
            "options.bites[1].opening",
            "options.bites[2].approach",
            "options.bites[3].opening"
        ]
    );
}

#[tokio::test]
async fn ten_million_points_are_refused_by_their_header() {
    let mut context = Context::start().await;
    let case = papers_case();
    let mut large = options(&case);
    large.model.as_mut().unwrap().vertex_count = 10_000_000;
    let refusal = context.refusal(vec![Payload::Options(large)]).await;
    assert_eq!(violated_fields(&refusal), ["options.model.vertex_count"]);

    let mut large = options(&case);
    large.lesion.as_mut().unwrap().point_count = 10_000_000;
    let refusal = context.refusal(vec![Payload::Options(large)]).await;
    assert_eq!(violated_fields(&refusal), ["options.lesion.point_count"]);
}

#[tokio::test]
async fn more_or_fewer_bytes_than_announced_are_refused() {
    let mut context = Context::start().await;
    let case = papers_case();
    let mut short = messages(options(&case), &case);
    short.pop();
    assert_eq!(violated_fields(&context.refusal(short).await), ["lesion"]);

    let mut long = messages(options(&case), &case);
    long.push(Payload::Lesion(vec![0; 12].into()));
    assert_eq!(violated_fields(&context.refusal(long).await), ["lesion"]);
}

#[tokio::test]
async fn a_nan_vertex_and_an_index_out_of_range_are_refused() {
    let mut context = Context::start().await;
    let mut case = papers_case();
    case.model.vertices[5].z = f64::NAN;
    let refusal = context.refusal(messages(options(&case), &case)).await;
    assert_eq!(violated_fields(&refusal), ["model.vertices[5]"]);

    let mut case = papers_case();
    case.model.triangles[9][0] = 4_000_000_000;
    let refusal = context.refusal(messages(options(&case), &case)).await;
    assert_eq!(violated_fields(&refusal), ["model"]);
}

#[tokio::test]
async fn the_wrong_order_and_the_wrong_frame_are_refused() {
    let mut context = Context::start().await;
    let case = papers_case();
    let mut turned = messages(options(&case), &case);
    turned.swap(0, 1);
    assert_eq!(violated_fields(&context.refusal(turned).await), ["options"]);

    let mut camera = options(&case);
    camera.model.as_mut().unwrap().frame = common::Frame::Camera as i32;
    let refusal = context.refusal(messages(camera, &case)).await;
    assert_eq!(violated_fields(&refusal), ["options.model.frame"]);
    assert_eq!(violated_fields(&context.refusal(vec![]).await), ["options"]);
}

#[tokio::test]
async fn what_cannot_be_planned_is_refused_with_reason_and_numbers() {
    let mut context = Context::start().await;
    let case = papers_case();
    let mut strict = options(&case);
    strict.rim_min_mm = 5.0;
    let refusal = context.refusal(messages(strict, &case)).await;
    assert_eq!(refusal.code(), Code::FailedPrecondition);
    assert_eq!(status::reason(&refusal).as_deref(), Some("RIM_BELOW_LIMIT"));

    let mut strict = papers_options(&case);
    (strict.curvature_cost_limit, strict.max_iterations) = (0.01, 2_000);
    let refusal = context.refusal(messages(strict, &case)).await;
    assert_eq!(status::reason(&refusal).as_deref(), Some("NO_PATH"));
}

#[tokio::test]
async fn a_client_that_goes_frees_the_computation() {
    let mut context = Context::start().await;
    let case = papers_case();
    let mut endless = papers_options(&case);
    // Many iterations that find no path: minutes of work unless it is stopped.
    (endless.curvature_cost_limit, endless.max_iterations) = (0.01, 1_000_000);
    let stream =
        tokio_stream::iter(messages(endless, &case)).map(|payload| proto::PlanResectionRequest {
            payload: Some(payload),
        });
    let mut answer = context
        .client
        .plan_resection(stream)
        .await
        .unwrap()
        .into_inner();
    answer.message().await.unwrap();
    drop(answer);
    // The server computes one plan at a time: this one must get its turn.
    let events = context
        .plan(messages(tear_options(&case), &case))
        .await
        .unwrap();
    assert!(matches!(events.last(), Some(Event::Plan(_))));
}

#[tokio::test]
async fn a_contour_is_fitted_and_sampled_at_equal_distances() {
    let mut context = Context::start().await;
    let points: Vec<common::Point> = (0..14)
        .map(|step| {
            let (sin, cos) = (f64::from(step) * 0.2).sin_cos();
            common::Point {
                x_mm: 3.0,
                y_mm: 13.0 * cos,
                z_mm: 13.0 * sin,
            }
        })
        .collect();
    let request = proto::FitContourRequest {
        points: points.clone(),
        ..Default::default()
    };
    let fit = context
        .client
        .fit_contour(request)
        .await
        .unwrap()
        .into_inner();
    assert!((fit.length_mm - 33.8).abs() < 0.2, "{} mm", fit.length_mm);
    assert_eq!(fit.samples.len(), 35);
    assert!(fit.fit_rms_mm < 0.05);
    assert!(
        fit.samples
            .iter()
            .all(|sample| (sample.curvature_per_mm - 1.0 / 13.0).abs() < 0.03)
    );

    for (broken, field) in [
        (
            proto::FitContourRequest {
                points: points[..3].to_vec(),
                ..Default::default()
            },
            "points",
        ),
        (
            proto::FitContourRequest {
                points: vec![points[0]; 8],
                ..Default::default()
            },
            "points",
        ),
        (
            proto::FitContourRequest {
                points: points.clone(),
                control_point_count: 15,
                ..Default::default()
            },
            "control_point_count",
        ),
        (
            proto::FitContourRequest {
                points,
                spacing_mm: 1e-9,
                ..Default::default()
            },
            "spacing_mm",
        ),
    ] {
        let refusal = context.client.fit_contour(broken).await.unwrap_err();
        assert_eq!(violated_fields(&refusal), [field]);
    }
}
