//! The kinds of file a surface comes in.

use std::fmt;

/// A file format.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Stanford's polygon file: clouds and meshes.
    Ply,
    /// The point cloud file of PCL: clouds.
    Pcd,
    /// Stereolithography: meshes.
    Stl,
    /// Wavefront's object file: clouds and meshes.
    Obj,
}

impl Kind {
    /// Every kind.
    pub const ALL: [Self; 4] = [Self::Ply, Self::Pcd, Self::Stl, Self::Obj];

    /// The ending of such a file's name, without the dot.
    pub const fn extension(self) -> &'static str {
        match self {
            Self::Ply => "ply",
            Self::Pcd => "pcd",
            Self::Stl => "stl",
            Self::Obj => "obj",
        }
    }

    /// What is added to such a file's header so that it states `field`.
    pub(crate) fn header_comment(self, field: &str, word: &str) -> String {
        match self {
            Self::Ply => format!("comment {field} {word}"),
            Self::Pcd | Self::Obj => format!("# {field} {word}"),
            Self::Stl => format!("{}={word}", field.to_uppercase()),
        }
    }
}

impl fmt::Display for Kind {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.pad(match self {
            Self::Ply => "PLY",
            Self::Pcd => "PCD",
            Self::Stl => "STL",
            Self::Obj => "OBJ",
        })
    }
}
