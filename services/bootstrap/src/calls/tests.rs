use std::convert::Infallible;

use http_body::Body as _;
use tower::{ServiceExt as _, service_fn};

use super::*;

const PATH: &str = "/arthro.test.v1.TestService/Work";
const STOP: &str = "/arthro.motion.v1.MotionService/Stop";

fn request(path: &str, timeout: Option<&str>) -> Request<Body> {
    let mut request = Request::builder().uri(path);
    if let Some(timeout) = timeout {
        request = request.header("grpc-timeout", timeout);
    }
    request.body(Body::empty()).unwrap()
}

fn limits(max_calls: usize) -> CallLayer {
    layer(max_calls, 100)
}

fn layer(max_calls: usize, max_streams: usize) -> CallLayer {
    let limits = Limits {
        max_calls,
        max_streams,
        default_deadline: Duration::from_millis(30),
    };
    CallLayer::new(limits, Reports::new())
}

/// Never answers.
async fn busy(_request: Request<Body>) -> Result<Response<Body>, Infallible> {
    std::future::pending().await
}

/// Answers at once with a stream that never ends.
async fn streaming(_request: Request<Body>) -> Result<Response<Body>, Infallible> {
    Ok(Response::new(Body::new(NeverEnding)))
}

async fn answering(_request: Request<Body>) -> Result<Response<Body>, Infallible> {
    Ok(Response::new(Body::empty()))
}

struct NeverEnding;

impl http_body::Body for NeverEnding {
    type Data = bytes::Bytes;
    type Error = Status;
    fn poll_frame(
        self: Pin<&mut Self>,
        _context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Self::Data>, Status>>> {
        Poll::Pending
    }
}

fn grpc_status(headers: &HeaderMap) -> Option<Code> {
    headers
        .get("grpc-status")
        .map(|code| Code::from_bytes(code.as_bytes()))
}

fn timeout_of(value: &str) -> Option<Duration> {
    let mut headers = HeaderMap::new();
    headers.insert("grpc-timeout", value.parse().unwrap());
    grpc_timeout(&headers)
}

#[test]
fn a_timeout_header_is_read_in_every_unit() {
    assert_eq!(timeout_of("2S"), Some(Duration::from_millis(1999)));
    assert_eq!(timeout_of("50m"), Some(Duration::from_millis(49)));
    assert_eq!(timeout_of("1H"), Some(Duration::from_millis(3_599_999)));
    assert_eq!(timeout_of("1n"), Some(Duration::ZERO));
}

#[test]
fn a_malformed_timeout_header_is_ignored() {
    for value in ["", "S", "123456789S", "5x", "-5S"] {
        assert_eq!(timeout_of(value), None, "{value:?}");
    }
}

#[test]
fn only_the_stops_of_the_table_pass_the_limit() {
    assert!(is_stop(STOP));
    assert!(is_stop("/arthro.gateway.v1.ProcedureService/StopProcedure"));
    assert!(!is_stop("/arthro.test.v1.TestService/StopNothing"));
    assert!(!is_stop(PATH));
}

#[tokio::test]
async fn a_call_past_its_deadline_is_answered_deadline_exceeded() {
    let service = limits(1).layer(service_fn(busy));
    let answer = service.oneshot(request(PATH, Some("20m"))).await.unwrap();
    assert_eq!(grpc_status(answer.headers()), Some(Code::DeadlineExceeded));
}

#[tokio::test]
async fn a_call_without_a_deadline_gets_the_default_one() {
    let service = limits(1).layer(service_fn(busy));
    let answer = service.oneshot(request(PATH, None)).await.unwrap();
    assert_eq!(grpc_status(answer.headers()), Some(Code::DeadlineExceeded));
}

#[tokio::test]
async fn a_stream_past_its_deadline_ends_with_deadline_exceeded() {
    let service = limits(1).layer(service_fn(streaming));
    let answer = service.oneshot(request(PATH, Some("20m"))).await.unwrap();
    let mut body = answer.into_body();
    let frame = std::future::poll_fn(|context| Pin::new(&mut body).poll_frame(context)).await;
    let trailers = frame.unwrap().unwrap().into_trailers().unwrap();
    assert_eq!(grpc_status(&trailers), Some(Code::DeadlineExceeded));
    assert!(body.is_end_stream());
}

#[tokio::test]
async fn a_call_over_the_limit_is_refused_at_once_but_a_stop_is_not() {
    let limits = limits(1);
    let mut occupied = limits.layer(service_fn(busy));
    let first = occupied.call(request(PATH, None));

    let second = limits.layer(service_fn(answering));
    let refusal = second.oneshot(request(PATH, None)).await.unwrap();
    assert_eq!(
        grpc_status(refusal.headers()),
        Some(Code::ResourceExhausted)
    );
    let stop = limits.layer(service_fn(answering));
    let answer = stop.oneshot(request(STOP, None)).await.unwrap();
    assert_eq!(grpc_status(answer.headers()), None);

    drop(first);
    let third = limits.layer(service_fn(answering));
    let answer = third.oneshot(request(PATH, None)).await.unwrap();
    assert_eq!(grpc_status(answer.headers()), None);
}

#[tokio::test]
async fn an_idle_stream_counts_until_it_is_dropped_and_a_stop_passes_it() {
    let limits = layer(100, 1);
    let watching = limits.layer(service_fn(streaming));
    let open = watching.oneshot(request(PATH, None)).await.unwrap();

    let second = limits.layer(service_fn(streaming));
    let refusal = second.oneshot(request(PATH, None)).await.unwrap();
    assert_eq!(
        grpc_status(refusal.headers()),
        Some(Code::ResourceExhausted)
    );
    let stop = limits.layer(service_fn(answering));
    let answer = stop.oneshot(request(STOP, None)).await.unwrap();
    assert_eq!(grpc_status(answer.headers()), None);

    drop(open);
    let third = limits.layer(service_fn(streaming));
    let answer = third.oneshot(request(PATH, None)).await.unwrap();
    assert_eq!(grpc_status(answer.headers()), None);
}
