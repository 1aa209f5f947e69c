//! Reconstruction over a real connection.

use arthro_bootstrap::{Host, Service as _};
use arthro_geometry::scan::{Lattice, Scan, Voxels};
use arthro_geometry::{Mesh, Point3};
use arthro_proto::common::v1::mesh_chunk::Part;
use arthro_proto::common::v1::{Frame, MeshHeader, Point};
use arthro_proto::registration::v1 as api;
use arthro_proto::registration::v1::reconstruct_surface_request::Payload;
use arthro_proto::registration::v1::reconstruct_surface_response::Payload as Answer;
use arthro_proto::registration::v1::registration_service_client::RegistrationServiceClient;
use arthro_proto::registration::v1::surface_options::{Decimation, Inside};
use arthro_registration::reconstruct::{Inside as What, Options};
use arthro_registration::{Config, Server};
use tokio::net::TcpListener;
use tonic::transport::server::TcpIncoming;
use tonic::transport::{Channel, server};
use tonic::{Code, Status};

use crate::shapes::{LABEL, TORUS, label_map, lattice, surface};

/// A server on a free port, ended with its runtime.
async fn client(config: Config) -> RegistrationServiceClient<Channel> {
    let routes = Server::build(config, Host::alone()).await.unwrap();
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = listener.local_addr().unwrap();
    tokio::spawn(
        server::Server::builder()
            .add_routes(routes)
            .serve_with_incoming(TcpIncoming::from(listener).with_nodelay(Some(true))),
    );
    RegistrationServiceClient::connect(format!("http://{address}"))
        .await
        .unwrap()
}

fn point(point: &Point3) -> Point {
    Point {
        x_mm: point.x,
        y_mm: point.y,
        z_mm: point.z,
    }
}

fn header(lattice: &Lattice) -> api::VolumeHeader {
    let steps = lattice.steps().column_iter();
    api::VolumeHeader {
        voxel_type: api::VoxelType::Uint8.into(),
        sizes: lattice.size().map(|count| count as u32).to_vec(),
        origin: Some(point(&lattice.origin())),
        steps: steps
            .map(|step| point(&Point3::from(step.into_owned())))
            .collect(),
    }
}

fn options(scan: &Scan) -> api::SurfaceOptions {
    api::SurfaceOptions {
        volume: Some(header(scan.lattice())),
        inside: Some(Inside::Label(LABEL)),
        ..api::SurfaceOptions::default()
    }
}

fn voxels(scan: &Scan) -> Vec<Payload> {
    let Voxels::U8(values) = scan.voxels() else {
        panic!("a label map has bytes");
    };
    let chunks = values.chunks(33_333);
    chunks
        .map(|chunk| Payload::Voxels(chunk.to_vec().into()))
        .collect()
}

fn requests(
    options: api::SurfaceOptions,
    voxels: Vec<Payload>,
) -> impl tonic::IntoStreamingRequest<Message = api::ReconstructSurfaceRequest> {
    let payloads = std::iter::once(Payload::Options(options)).chain(voxels);
    let messages = payloads.map(|payload| api::ReconstructSurfaceRequest {
        payload: Some(payload),
    });
    tokio_stream::iter(messages.collect::<Vec<_>>())
}

async fn answers(
    client: &mut RegistrationServiceClient<Channel>,
    options: api::SurfaceOptions,
    voxels: Vec<Payload>,
) -> Result<Vec<Answer>, Status> {
    let call = client.reconstruct_surface(requests(options, voxels));
    let mut stream = call.await?.into_inner();
    let mut answers = Vec::new();
    while let Some(message) = stream.message().await? {
        answers.push(message.payload.unwrap());
    }
    Ok(answers)
}

fn floats(bytes: &[u8]) -> Vec<f64> {
    let words = bytes.as_chunks::<4>().0.iter();
    words.map(|word| f32::from_le_bytes(*word).into()).collect()
}

fn unpacked(header: &MeshHeader, chunks: &[Answer]) -> Mesh {
    let (mut coordinates, mut corners) = (Vec::new(), Vec::new());
    for chunk in chunks {
        let Answer::Chunk(chunk) = chunk else {
            continue;
        };
        match chunk.part.as_ref().unwrap() {
            Part::Vertices(bytes) => coordinates.extend(floats(bytes)),
            Part::Triangles(bytes) => {
                assert!(bytes.len() <= 256 * 1024);
                let words = bytes.as_chunks::<4>().0.iter();
                corners.extend(words.map(|word| u32::from_le_bytes(*word)));
            }
        }
    }
    let mesh = Mesh {
        vertices: coordinates
            .as_chunks()
            .0
            .iter()
            .map(|xyz: &[f64; 3]| Point3::from(*xyz))
            .collect(),
        triangles: corners.as_chunks().0.to_vec(),
    };
    let announced = (header.vertex_count as usize, header.triangle_count as usize);
    assert_eq!((mesh.vertices.len(), mesh.triangles.len()), announced);
    mesh
}

#[tokio::test(flavor = "multi_thread")]
async fn a_label_map_comes_back_as_figures_mesh_and_cloud() {
    let scan = label_map(&TORUS, &lattice([0.36, 0.36, 0.7], [0.2, 0.5, -0.3].into()));
    let mut client = client(Config::default()).await;
    let wanted = api::SurfaceOptions {
        cloud_points: 12_000,
        ..options(&scan)
    };
    let answers = answers(&mut client, wanted, voxels(&scan)).await.unwrap();
    let [Answer::Figures(figures), Answer::Mesh(header), rest @ ..] = &answers[..] else {
        panic!("figures and the mesh's header come first");
    };
    assert_eq!(header.frame(), Frame::Ct);
    let mesh = unpacked(header, rest);
    let expected = surface(&scan, &Options::new(What::Label(LABEL)));
    assert!(mesh.is_watertight());
    assert_eq!(mesh.triangles, expected.mesh.triangles);
    for (sent, made) in mesh.vertices.iter().zip(&expected.mesh.vertices) {
        assert!((sent - made).norm() < 1e-5);
    }
    assert!((figures.volume_mm3 - expected.mesh.volume_mm3()).abs() < 1e-9);
    assert!((figures.voxel_volume_mm3 - expected.voxel_volume_mm3).abs() < 1e-9);
    assert!(!figures.touches_border);

    let at = rest
        .iter()
        .position(|answer| matches!(answer, Answer::Cloud(_)))
        .unwrap();
    let Answer::Cloud(cloud) = &rest[at] else {
        panic!("no cloud");
    };
    assert_eq!(
        (cloud.point_count, cloud.has_normals, cloud.frame()),
        (12_000, true, Frame::Ct)
    );
    let bytes: usize = rest[at + 1..]
        .iter()
        .map(|answer| match answer {
            Answer::Points(points) => points.len(),
            other => panic!("{other:?} after the cloud's header"),
        })
        .sum();
    assert_eq!(bytes, 12_000 * 24);
}

#[tokio::test]
async fn bad_input_is_refused_by_field_value_and_limit() {
    let scan = label_map(&TORUS, &lattice([1.0; 3], [0.0; 3].into()));
    let good = || options(&scan);
    let with_volume = |change: fn(&mut api::VolumeHeader)| {
        let mut options = good();
        change(options.volume.as_mut().unwrap());
        options
    };
    let cases: [(api::SurfaceOptions, Vec<Payload>, &str); 9] = [
        (
            api::SurfaceOptions {
                inside: None,
                decimation: Some(Decimation::Triangles(5)),
                ..good()
            },
            vec![],
            "options.inside: is not set, must be label or threshold; options.triangles: is 5, must be at least 100",
        ),
        (
            api::SurfaceOptions::default(),
            vec![],
            "options.volume.voxel_type: is not set",
        ),
        (
            with_volume(|volume| volume.sizes = vec![4, 4]),
            vec![],
            "options.volume.sizes: has 2 entries, must have 3",
        ),
        (
            with_volume(|volume| volume.sizes = vec![1000, 1000, 300]),
            vec![],
            "make 300000000 bytes of voxels, must be at most 268435456",
        ),
        (
            with_volume(|volume| volume.steps[1].y_mm = 0.0),
            vec![],
            "options.volume.steps[1]: is 0 mm long, must be 0.01 to 50 mm",
        ),
        (good(), vec![], "voxels: ended after 0 bytes"),
        (
            good(),
            [voxels(&scan), voxels(&scan)].concat(),
            "are announced",
        ),
        (
            api::SurfaceOptions {
                inside: Some(Inside::Label(4)),
                ..good()
            },
            voxels(&scan),
            "label: is 4, there are 3, 7",
        ),
        (
            api::SurfaceOptions {
                inside: Some(Inside::Threshold(8.0)),
                ..good()
            },
            voxels(&scan),
            "threshold: is 8, the values are 0 to 7",
        ),
    ];
    let mut client = client(Config::default()).await;
    for (options, voxels, expected) in cases {
        let status = answers(&mut client, options, voxels).await.unwrap_err();
        assert_eq!(status.code(), Code::InvalidArgument, "{expected}: {status}");
        assert!(
            status.message().contains(expected),
            "{} lacks {expected}",
            status.message()
        );
        assert!(!status.details().is_empty());
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_client_that_goes_frees_its_computation() {
    let scan = label_map(&TORUS, &lattice([0.12; 3], [0.0; 3].into()));
    let mut client = client(Config {
        max_computations: 1,
    })
    .await;
    let long = api::SurfaceOptions {
        smoothing_passes: Some(1000),
        ..options(&scan)
    };
    let first = client
        .reconstruct_surface(requests(long.clone(), voxels(&scan)))
        .await
        .unwrap();
    let second = client
        .reconstruct_surface(requests(long.clone(), voxels(&scan)))
        .await;
    assert_eq!(second.unwrap_err().code(), Code::ResourceExhausted);
    drop(first);
    let freed = async {
        while client
            .reconstruct_surface(requests(long.clone(), vec![]))
            .await
            .unwrap_err()
            .code()
            == Code::ResourceExhausted
        {
            tokio::task::yield_now().await;
        }
    };
    tokio::time::timeout(std::time::Duration::from_secs(60), freed)
        .await
        .unwrap();
}
