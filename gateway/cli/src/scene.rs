//! What the camera saw: one RGB-D frame of the simulated camera, with the meniscus told from the
//! rest by its colour.

use arthro_proto::registration::v1::{DepthHeader, Intrinsics};
use arthro_proto::simulator::v1::camera_service_client::CameraServiceClient;
use arthro_proto::simulator::v1::{CaptureRequest, FrameHeader, capture_response};

use crate::connection;
use crate::exit::Failure;

/// A depth image with the meniscus masked.
#[derive(Debug)]
pub struct Scene {
    /// The image as announced to the gateway.
    pub header: DepthHeader,
    /// Little-endian uint16 depth units, row by row.
    pub depth: Vec<u8>,
    /// One byte a pixel, non-zero on the meniscus.
    pub mask: Vec<u8>,
    /// Three bytes a pixel, for the report.
    pub color: Vec<u8>,
}

/// Takes one frame from the simulated camera at `address`.
pub async fn capture(address: &str, seed: u64) -> Result<Scene, Failure> {
    let mut camera = CameraServiceClient::new(connection::open(address).await?);
    let mut stream = camera.capture(CaptureRequest { seed }).await?.into_inner();
    let (mut header, mut depth, mut color) = (FrameHeader::default(), Vec::new(), Vec::new());
    while let Some(message) = stream.message().await? {
        match message.payload {
            Some(capture_response::Payload::Header(announced)) => header = announced,
            Some(capture_response::Payload::Depth(bytes)) => depth.extend_from_slice(&bytes),
            Some(capture_response::Payload::Color(bytes)) => color.extend_from_slice(&bytes),
            None => {}
        }
    }
    let pixels = header.width_px as usize * header.height_px as usize;
    if depth.len() != 2 * pixels || color.len() != 3 * pixels {
        return Err(Failure::failed(
            "FRAME_INCOMPLETE",
            format!(
                "{} depth bytes and {} colour bytes for {pixels} pixels",
                depth.len(),
                color.len()
            ),
        ));
    }
    let mask: Vec<u8> = color.chunks_exact(3).map(is_meniscus).collect();
    if mask.iter().all(|pixel| *pixel == 0) {
        return Err(Failure::refused(
            "NO_MENISCUS_IN_VIEW",
            "no pixel of the frame has the colour of a meniscus",
        ));
    }
    Ok(Scene {
        header: DepthHeader {
            intrinsics: Some(Intrinsics {
                width_px: header.width_px,
                height_px: header.height_px,
                fx_px: header.fx_px,
                fy_px: header.fy_px,
                cx_px: header.cx_px,
                cy_px: header.cy_px,
                distortion: None,
            }),
            depth_unit_mm: header.depth_unit_mm,
            has_mask: true,
            ..DepthHeader::default()
        },
        depth,
        mask,
        color,
    })
}

/// Fibrocartilage is ivory: bright, and redder than it is blue; hyaline cartilage and background are not.
pub fn is_meniscus(pixel: &[u8]) -> u8 {
    let (red, green, blue) = (
        i32::from(pixel[0]),
        i32::from(pixel[1]),
        i32::from(pixel[2]),
    );
    u8::from(red > 90 && red > green - 10 && red - blue > 15)
}
