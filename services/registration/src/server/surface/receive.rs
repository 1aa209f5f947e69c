//! Receives a volume: refused by its header before anything is buffered, unpacked as it comes.

use arthro_bootstrap::status::invalid;
use arthro_geometry::nalgebra::Matrix3;
use arthro_geometry::scan::{ByteOrder, Lattice, VoxelType, Voxels};
use arthro_geometry::{Point3, Scan, Vector3, scan};
use arthro_proto::common::v1::Point;
use arthro_proto::registration::v1 as api;
use arthro_proto::registration::v1::reconstruct_surface_request::Payload;
use arthro_proto::registration::v1::surface_options::{Decimation as Simplify, Inside as What};
use tonic::{Status, Streaming};

use crate::error::{Error, Violation};
use crate::input;
use crate::reconstruct::{Decimation, Inside, MIN_PIECE_SHARE, Options};
use crate::server::receive::{complete, count_in};

/// Most bytes of a volume's voxels.
const MAX_VOLUME_BYTES: usize = 256 << 20;

/// What a reconstruction starts from.
pub(super) struct Upload {
    pub(super) scan: Scan,
    pub(super) options: Options,
    pub(super) cloud_points: usize,
}

pub(super) async fn volume(
    mut messages: Streaming<api::ReconstructSurfaceRequest>,
) -> Result<Upload, Status> {
    let Some(Payload::Options(announced)) = messages.message().await?.and_then(|m| m.payload)
    else {
        return Err(invalid("options", "must come in the first message"));
    };
    let (options, cloud_points, mut chunks) = announced_volume(announced)?;
    while let Some(message) = messages.message().await? {
        match message.payload {
            Some(Payload::Voxels(bytes)) => chunks.push(&bytes)?,
            Some(Payload::Options(_)) => {
                return Err(invalid("options", "must come once, in the first message"));
            }
            None => return Err(invalid("payload", "is not set")),
        }
    }
    Ok(Upload {
        scan: chunks.finish()?,
        options,
        cloud_points,
    })
}

/// Checks all that the first message says.
fn announced_volume(
    announced: api::SurfaceOptions,
) -> Result<(Options, usize, VoxelChunks), Status> {
    let mut violations = Vec::new();
    let inside = match announced.inside {
        Some(What::Label(label)) => Some(Inside::Label(label)),
        Some(What::Threshold(threshold)) => Some(Inside::Threshold(threshold)),
        None => {
            violations.push(Violation::new(
                "inside",
                "is not set, must be label or threshold",
            ));
            None
        }
    };
    let options = Options {
        smoothing_passes: announced.smoothing_passes,
        min_piece_share: announced.min_piece_share.unwrap_or(MIN_PIECE_SHARE),
        decimation: match announced.decimation {
            Some(Simplify::Triangles(triangles)) => Decimation::Triangles(triangles as usize),
            Some(Simplify::MaxErrorMm(error_mm)) => Decimation::WithinMm(error_mm),
            None => Decimation::default(),
        },
        ..Options::new(inside.unwrap_or(Inside::Label(1)))
    };
    violations.extend(options.violations());
    if announced.cloud_points as usize > input::MAX_POINTS {
        violations.push(Violation::new(
            "cloud_points",
            format!(
                "is {}, must be at most {}",
                announced.cloud_points,
                input::MAX_POINTS
            ),
        ));
    }
    let chunks = chunks(announced.volume.unwrap_or_default(), &mut violations);
    match chunks {
        Some(chunks) if violations.is_empty() => {
            Ok((options, announced.cloud_points as usize, chunks))
        }
        _ => {
            let in_options =
                |v: Violation| Violation::new(format!("options.{}", v.field), v.description);
            Err(Error::Invalid(violations.into_iter().map(in_options).collect()).into())
        }
    }
}

/// The volume that a header announces; `None` if it violates anything.
fn chunks(header: api::VolumeHeader, violations: &mut Vec<Violation>) -> Option<VoxelChunks> {
    let before = violations.len();
    let kind = voxel_type(header.voxel_type());
    if kind.is_none() {
        violations.push(Violation::new(
            "volume.voxel_type",
            "is not set, must be a known type",
        ));
    }
    let size = three("volume.sizes", header.sizes, violations).map(|size| size.map(|n| n as usize));
    let steps = three("volume.steps", header.steps, violations);
    let origin = header.origin;
    if origin.is_none() {
        violations.push(Violation::new("volume.origin", "is not set"));
    }
    let vector = |point: Point| Vector3::new(point.x_mm, point.y_mm, point.z_mm);
    let lattice = Lattice::new(
        size?,
        Point3::from(vector(origin?)),
        Matrix3::from_columns(&steps?.map(vector)),
    );
    let lattice = lattice
        .map_err(|error| violations.extend(in_volume(error)))
        .ok()?;
    let bytes = lattice.len() * kind?.bytes();
    if bytes > MAX_VOLUME_BYTES {
        violations.push(Violation::new(
            "volume.sizes",
            format!(
                "make {bytes} bytes of voxels, must be at most {MAX_VOLUME_BYTES}; crop the volume"
            ),
        ));
    }
    (violations.len() == before).then(|| VoxelChunks::new(lattice, kind.unwrap_or(VoxelType::U8)))
}

fn three<T>(field: &str, values: Vec<T>, violations: &mut Vec<Violation>) -> Option<[T; 3]> {
    let count = values.len();
    let three = values.try_into().ok();
    if three.is_none() {
        violations.push(Violation::new(
            field,
            format!("has {count} entries, must have 3"),
        ));
    }
    three
}

fn in_volume(error: scan::Error) -> impl Iterator<Item = Violation> {
    let faults = error.faults.into_iter();
    faults.map(|fault| Violation::new(format!("volume.{}", fault.field), fault.description))
}

fn voxel_type(kind: api::VoxelType) -> Option<VoxelType> {
    Some(match kind {
        api::VoxelType::Unspecified => return None,
        api::VoxelType::Int8 => VoxelType::I8,
        api::VoxelType::Uint8 => VoxelType::U8,
        api::VoxelType::Int16 => VoxelType::I16,
        api::VoxelType::Uint16 => VoxelType::U16,
        api::VoxelType::Int32 => VoxelType::I32,
        api::VoxelType::Uint32 => VoxelType::U32,
        api::VoxelType::Float32 => VoxelType::F32,
        api::VoxelType::Float64 => VoxelType::F64,
    })
}

/// A volume under way. What is announced is not allocated before it comes.
struct VoxelChunks {
    lattice: Lattice,
    announced: usize,
    voxel_bytes: usize,
    received: usize,
    /// The beginning of a voxel whose end is in the next chunk.
    pending: Vec<u8>,
    voxels: Voxels,
}

impl VoxelChunks {
    fn new(lattice: Lattice, kind: VoxelType) -> Self {
        Self {
            announced: lattice.len() * kind.bytes(),
            lattice,
            voxel_bytes: kind.bytes(),
            received: 0,
            pending: Vec::new(),
            voxels: Voxels::with_capacity(kind, 0),
        }
    }

    fn push(&mut self, mut bytes: &[u8]) -> Result<(), Status> {
        self.received = count_in("voxels", self.received, bytes.len(), self.announced)?;
        if !self.pending.is_empty() {
            let missing = (self.voxel_bytes - self.pending.len()).min(bytes.len());
            self.pending.extend_from_slice(&bytes[..missing]);
            bytes = &bytes[missing..];
            if self.pending.len() < self.voxel_bytes {
                return Ok(());
            }
            self.voxels.append(&self.pending, ByteOrder::Little);
            self.pending.clear();
        }
        let (whole, rest) = bytes.split_at(bytes.len() - bytes.len() % self.voxel_bytes);
        self.voxels.append(whole, ByteOrder::Little);
        self.pending.extend_from_slice(rest);
        Ok(())
    }

    fn finish(self) -> Result<Scan, Status> {
        complete("voxels", self.received, self.announced)?;
        Scan::new(self.lattice, self.voxels).map_err(|error| {
            let faults = error.faults.into_iter();
            let violations = faults.map(|fault| Violation::new(fault.field, fault.description));
            Error::Invalid(violations.collect()).into()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn voxels_cut_anywhere_come_out_whole() {
        let lattice = || Lattice::new([3, 2, 1], Point3::origin(), Matrix3::identity()).unwrap();
        let packed: Vec<u8> = (-3i32..3).flat_map(|i| (i * 1000).to_le_bytes()).collect();
        for size in 1..=packed.len() {
            let mut volume = VoxelChunks::new(lattice(), VoxelType::I32);
            for chunk in packed.chunks(size) {
                volume.push(chunk).unwrap();
            }
            let expected = Voxels::I32((-3..3).map(|i| i * 1000).collect());
            assert_eq!(
                volume.finish().unwrap().voxels(),
                &expected,
                "chunks of {size}"
            );
        }
    }
}
