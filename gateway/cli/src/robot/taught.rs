//! The JSON file of taught poses.

use std::path::Path;

use arthro_proto::common::v1 as common;
use arthro_proto::motion::v1::{TaughtPose, taught_pose};
use serde::{Deserialize, Serialize};

use crate::commands::{read, unreadable};
use crate::exit::Failure;

/// Poses of the flange, in the order in which they were taught.
#[derive(Debug, Default, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct TaughtFile {
    poses: Vec<FlangePose>,
}

/// base_from_flange.
#[derive(Clone, Copy, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
struct FlangePose {
    /// Unit quaternion.
    rotation_wxyz: [f64; 4],
    translation_mm: [f64; 3],
}

impl TaughtFile {
    /// From a file that is there.
    pub fn read(path: &Path) -> Result<Self, Failure> {
        serde_json::from_slice(&read(path)?).map_err(|error| unreadable(path, &error))
    }

    /// From a file, or empty where there is none yet.
    pub fn read_or_begin(path: &Path) -> Result<Self, Failure> {
        if path.exists() {
            Self::read(path)
        } else {
            Ok(Self::default())
        }
    }

    /// Writes beside the file first, so that no pose is lost when that fails.
    pub fn write(&self, path: &Path) -> Result<(), Failure> {
        let text = serde_json::to_string_pretty(self)
            .map_err(|error| Failure::failed("FILE_UNWRITABLE", error))?;
        let beside = path.with_extension("json.new");
        std::fs::write(&beside, text)?;
        Ok(std::fs::rename(&beside, path)?)
    }

    /// How many.
    pub fn len(&self) -> usize {
        self.poses.len()
    }

    /// One more.
    pub fn add(&mut self, pose: &common::Pose) {
        let rotation = pose.rotation.unwrap_or_default();
        let place = pose.translation.unwrap_or_default();
        self.poses.push(FlangePose {
            rotation_wxyz: [rotation.w, rotation.x, rotation.y, rotation.z],
            translation_mm: [place.x_mm, place.y_mm, place.z_mm],
        });
    }

    /// As the teaching service takes them.
    pub fn messages(&self) -> Vec<TaughtPose> {
        let message = |pose: &FlangePose| {
            let [w, x, y, z] = pose.rotation_wxyz;
            let [x_mm, y_mm, z_mm] = pose.translation_mm;
            let pose = common::Pose {
                rotation: Some(common::Quaternion { w, x, y, z }),
                translation: Some(common::Point { x_mm, y_mm, z_mm }),
            };
            TaughtPose {
                pose: Some(taught_pose::Pose::BaseFromFlange(pose)),
            }
        };
        self.poses.iter().map(message).collect()
    }
}
