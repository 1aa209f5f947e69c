//! `arthro requests`: uploads as `grpcurl -d @` takes them.

use std::path::PathBuf;

use clap::{Args, Subcommand};

use super::StatedSpace;

#[derive(Debug, Subcommand)]
pub enum Requests {
    /// The messages of CaseService/UploadModel.
    Model(ModelRequests),
    /// The messages of CaseService/UploadScene, from one frame of the simulated camera.
    Scene(SceneRequests),
}

#[derive(Debug, Args)]
pub struct ModelRequests {
    /// Of which case.
    #[arg(long)]
    pub case: String,
    /// Closed surface of the meniscus (PLY).
    #[arg(long, value_name = "FILE")]
    pub model: PathBuf,
    /// Points inside the damaged tissue on a regular grid (PLY).
    #[arg(long, value_name = "FILE")]
    pub lesion: Option<PathBuf>,
    /// Distance between the lesion's points, mm.
    #[arg(long, default_value_t = 0.5)]
    pub lesion_spacing_mm: f64,
    #[command(flatten)]
    pub stated: StatedSpace,
}

#[derive(Debug, Args)]
pub struct SceneRequests {
    /// Of which case.
    #[arg(long)]
    pub case: String,
    /// Where the simulated camera is.
    #[arg(long, value_name = "ADDRESS")]
    pub simulator: String,
    /// Seed of the camera's noise.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
}
