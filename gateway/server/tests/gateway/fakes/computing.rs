//! Stand-ins of registration and planning: fixed answers, honest about what they received.

use std::pin::Pin;
use std::sync::Arc;

use arthro_bootstrap::status;
use arthro_gateway::wire;
use arthro_geometry::{Point3, Vector3};
use arthro_proto::common::v1 as common;
use arthro_proto::planning::v1 as planning;
use arthro_proto::planning::v1::planning_service_server::PlanningService;
use arthro_proto::registration::v1 as registration;
use arthro_proto::registration::v1::registration_service_server::RegistrationService;
use tokio_stream::Stream;
use tonic::{Request, Response, Status, Streaming};

use super::World;

#[derive(Clone)]
pub struct Fake(pub Arc<World>);

type Answers<T> = Pin<Box<dyn Stream<Item = Result<T, Status>> + Send>>;

/// Where the bites are, ct.
pub const CENTERS: [[f64; 3]; 3] = [[53.0, 48.0, 61.0], [54.0, 50.0, 50.0], [54.0, 53.0, 36.0]];
/// Where ct lies in the view: translation of camera_from_ct.
pub const CAMERA_FROM_CT_MM: [f64; 3] = [-53.0, -50.0, 250.0];

/// The events, the first at once and the others once the computation is not held any more.
fn held_answers<T: Send + 'static>(
    world: Arc<World>,
    computation: &'static str,
    messages: Vec<T>,
) -> Answers<T> {
    use tokio_stream::StreamExt as _;
    let events = tokio_stream::iter(messages.into_iter().enumerate());
    Box::pin(events.then(move |(index, message)| {
        let world = world.clone();
        async move {
            if index > 0 {
                world.wait_while_held(computation).await;
            }
            Ok(message)
        }
    }))
}

fn answers<T: Send + 'static>(messages: Vec<T>) -> Answers<T> {
    Box::pin(tokio_stream::iter(messages.into_iter().map(Ok)))
}

#[tonic::async_trait]
impl RegistrationService for Fake {
    type RegisterStream = Answers<registration::RegisterResponse>;
    async fn register(
        &self,
        request: Request<Streaming<registration::RegisterRequest>>,
    ) -> Result<Response<Self::RegisterStream>, Status> {
        use registration::register_request::Payload;
        use registration::register_response::Event;
        self.0.computes("REGISTER")?;
        let mut stream = request.into_inner();
        let (mut source, mut target, mut announced) = (0, 0, (0, 0));
        while let Some(message) = stream.message().await? {
            match message.payload.unwrap() {
                Payload::Options(options) => {
                    announced = (
                        options.source.unwrap().point_count as usize * 24,
                        options.target.unwrap().point_count as usize * 12,
                    );
                }
                Payload::Source(bytes) => source += bytes.len(),
                Payload::Target(bytes) => target += bytes.len(),
            }
        }
        assert_eq!((source, target), announced, "everything announced arrived");
        self.0.source_points.send_replace((source / 24) as u32);
        let [x_mm, y_mm, z_mm] = CAMERA_FROM_CT_MM;
        let result = registration::RegistrationResult {
            camera_from_ct: Some(common::Similarity {
                scale: 1.0,
                rotation: Some(common::Quaternion {
                    w: 1.0,
                    ..common::Quaternion::default()
                }),
                translation: Some(common::Point { x_mm, y_mm, z_mm }),
            }),
            verdict: (*self.0.verdict.lock().unwrap()).into(),
            reasons: vec!["OVERLAP_LOW".to_owned()],
            mse_mm2: 0.02,
            residuals_mm: vec![1, 2, 3, 4].into(),
            ..registration::RegistrationResult::default()
        };
        let event = |event| registration::RegisterResponse { event: Some(event) };
        let events = vec![
            event(Event::Stage(registration::StageStarted {
                stage: registration::Stage::Coarse.into(),
                seconds: 0.0,
            })),
            event(Event::Result(result)),
        ];
        Ok(Response::new(held_answers(
            self.0.clone(),
            "REGISTER",
            events,
        )))
    }

    async fn solve_hand_eye(
        &self,
        _request: Request<registration::SolveHandEyeRequest>,
    ) -> Result<Response<registration::SolveHandEyeResponse>, Status> {
        Err(Status::unimplemented("the gateway does not calibrate"))
    }

    async fn solve_tool_tip(
        &self,
        _request: Request<registration::SolveToolTipRequest>,
    ) -> Result<Response<registration::SolveToolTipResponse>, Status> {
        Err(Status::unimplemented("the gateway does not calibrate"))
    }

    type DeprojectDepthStream = Answers<registration::DeprojectDepthResponse>;
    async fn deproject_depth(
        &self,
        request: Request<Streaming<registration::DeprojectDepthRequest>>,
    ) -> Result<Response<Self::DeprojectDepthStream>, Status> {
        use registration::deproject_depth_response::Payload;
        let mut stream = request.into_inner();
        while stream.message().await?.is_some() {}
        let points = super::super::bench::scene_points();
        let message = |payload| registration::DeprojectDepthResponse {
            payload: Some(payload),
        };
        Ok(Response::new(answers(vec![
            message(Payload::Header(common::CloudHeader {
                frame: common::Frame::Camera.into(),
                point_count: (points.len() / 12) as u32,
                has_normals: false,
            })),
            message(Payload::Points(points.into())),
        ])))
    }

    type ReconstructSurfaceStream = Answers<registration::ReconstructSurfaceResponse>;
    async fn reconstruct_surface(
        &self,
        _: Request<Streaming<registration::ReconstructSurfaceRequest>>,
    ) -> Result<Response<Self::ReconstructSurfaceStream>, Status> {
        Err(Status::unimplemented("the gateway reconstructs no surface"))
    }
}

/// Bites whose approach points from the portal and whose opening is as upright as it goes, ct.
pub fn bites(portal: &Point3) -> Vec<planning::Bite> {
    CENTERS
        .iter()
        .map(|&[x, y, z]| {
            let center = Point3::new(x, y, z);
            let approach = (center - portal).normalize();
            let opening = approach.cross(&Vector3::new(0.3, 0.5, 0.7)).normalize();
            planning::Bite {
                center: Some(wire::point_message(&center)),
                approach: Some(wire::direction_message(&approach)),
                opening: Some(wire::direction_message(&opening)),
                contour_point: Some(wire::point_message(&center)),
                portal: 0,
            }
        })
        .collect()
}

/// A view from three quarters of the way from `portal` to `center`.
fn view(portal: &Point3, center: Point3) -> planning::ArthroscopeView {
    let approach = (center - portal).normalize();
    planning::ArthroscopeView {
        tip: Some(wire::point_message(&(portal + (center - portal) * 0.75))),
        approach: Some(wire::direction_message(&approach)),
        optical_axis: Some(wire::direction_message(&approach)),
        ..planning::ArthroscopeView::default()
    }
}

#[tonic::async_trait]
impl PlanningService for Fake {
    async fn fit_contour(
        &self,
        _: Request<planning::FitContourRequest>,
    ) -> Result<Response<planning::FitContourResponse>, Status> {
        Err(Status::unimplemented("the gateway fits no contours"))
    }

    async fn check_reachability(
        &self,
        _: Request<Streaming<planning::CheckReachabilityRequest>>,
    ) -> Result<Response<planning::CheckReachabilityResponse>, Status> {
        Err(Status::unimplemented("the gateway checks no reachability"))
    }

    type PlanResectionStream = Answers<planning::PlanResectionResponse>;
    async fn plan_resection(
        &self,
        request: Request<Streaming<planning::PlanResectionRequest>>,
    ) -> Result<Response<Self::PlanResectionStream>, Status> {
        use planning::plan_resection_request::Payload;
        use planning::plan_resection_response::Event;
        self.0.computes("PLAN")?;
        let mut stream = request.into_inner();
        let mut options = planning::PlanResectionOptions::default();
        while let Some(message) = stream.message().await? {
            if let Some(Payload::Options(received)) = message.payload {
                options = received;
            }
        }
        if options.region_percent > 100.0 {
            return Err(status::invalid(
                "options.region_percent",
                format!("is {}; must be 50 .. 100", options.region_percent),
            ));
        }
        let portal = wire::point(options.portal, "portal").unwrap();
        let mut bites = bites(&portal);
        bites[2].portal = *self.0.last_bites_portal.lock().unwrap();
        let views = options.arthroscope.iter().flat_map(|arthroscope| {
            let portal = wire::point(arthroscope.portal, "portal").unwrap();
            CENTERS.map(|[x, y, z]| view(&portal, Point3::new(x, y, z)))
        });
        let views = views.collect();
        *self.0.plan_options.lock().unwrap() = Some(options);
        let event = |event| planning::PlanResectionResponse { event: Some(event) };
        let events = vec![
            event(Event::Progress(planning::PlanProgress {
                stage: "rrt".to_owned(),
                iterations: 10,
                fraction: 0.5,
                ..planning::PlanProgress::default()
            })),
            event(Event::Plan(planning::ResectionPlan {
                bites,
                views,
                contour: vec![wire::point_message(&Point3::new(53.0, 48.0, 61.0))],
                ..planning::ResectionPlan::default()
            })),
        ];
        Ok(Response::new(held_answers(self.0.clone(), "PLAN", events)))
    }

    async fn evaluate_resection(
        &self,
        request: Request<Streaming<planning::EvaluateResectionRequest>>,
    ) -> Result<Response<planning::EvaluateResectionResponse>, Status> {
        use planning::evaluate_resection_request::Payload;
        self.0.computes("EVALUATE")?;
        let mut stream = request.into_inner();
        let mut bites = 0;
        while let Some(message) = stream.message().await? {
            if let Some(Payload::Options(options)) = message.payload {
                bites = options.bites.len() as u32;
            }
        }
        Ok(Response::new(planning::EvaluateResectionResponse {
            evaluation: Some(planning::ResectionEvaluation {
                bites,
                ..planning::ResectionEvaluation::default()
            }),
        }))
    }
}
