//! The commands about recordings.

use std::net::SocketAddr;
use std::path::PathBuf;

use clap::{Args, Subcommand};

#[derive(Debug, Subcommand)]
pub enum Record {
    /// Tells what a recording holds, also one that a crash cut off.
    Info {
        /// The recording (MCAP).
        file: PathBuf,
    },
}

#[derive(Debug, Args)]
pub struct Replay {
    /// The recordings (MCAP), in the order in which they are shown.
    #[arg(required = true, value_name = "FILE")]
    pub files: Vec<PathBuf>,
    /// Where to listen.
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:50050")]
    pub listen: SocketAddr,
    /// How fast the recorded time passes, 0.01 .. 1000.
    #[arg(long, default_value_t = 1.0)]
    pub speed: f64,
    /// Where to begin, s after the first line.
    #[arg(long, value_name = "S", default_value_t = 0.0)]
    pub from: f64,
    /// Begins again at the end.
    #[arg(long)]
    pub repeat: bool,
    /// Ends when standard input closes, so that it never outlives what started it.
    #[arg(long)]
    pub until_stdin_closes: bool,
}
