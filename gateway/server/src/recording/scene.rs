//! Arms and bites as viewers of recordings draw them: frames, shafts, portals and what was bitten. Metres, as viewers expect.

use arthro_geometry::frame::Frame;
use arthro_geometry::{Rigid, Vector3};
use arthro_proto::common::v1 as common;
use arthro_proto::foxglove;
use arthro_proto::gateway::v1 as gateway;
use arthro_proto::motion::v1 as motion;
use prost_types::Timestamp;

use crate::config::Cell;

const M_PER_MM: f64 = 1e-3;
/// How much of a shaft is drawn, mm.
const SHAFT_MM: f64 = 250.0;
const SHAFT_THICK_MM: f64 = 4.0;
const PORTAL_WIDE_MM: f64 = 8.0;
const BITE_WIDE_MM: f64 = 3.0;

/// Names of the frames.
const FORCEPS_BASE: &str = "forceps_base";
const ARTHROSCOPE_BASE: &str = "arthroscope_base";

/// The frames that do not move: bases of the arms and the camera.
pub fn standing(cell: &Cell, at_ns: u64) -> foxglove::FrameTransforms {
    foxglove::FrameTransforms {
        transforms: vec![
            fixed(
                ARTHROSCOPE_BASE,
                &cell.forceps_base_from_arthroscope_base,
                at_ns,
            ),
            fixed("camera", &cell.forceps_base_from_camera, at_ns),
        ],
    }
}

/// The portals, where they do not move either.
pub fn portals(cell: &Cell, at_ns: u64) -> foxglove::SceneUpdate {
    let portal = |frame: &str, at: [f64; 3]| foxglove::SceneEntity {
        spheres: vec![sphere(at, PORTAL_WIDE_MM, [0.2, 0.6, 1.0, 0.6])],
        ..entity(format!("{frame}/portal"), frame, at_ns)
    };
    foxglove::SceneUpdate {
        entities: vec![
            portal(FORCEPS_BASE, cell.forceps_portal.into()),
            portal(ARTHROSCOPE_BASE, cell.arthroscope_portal.into()),
        ],
    }
}

/// Where the tools are.
pub fn tools(arms: &motion::WatchStateResponse, at_ns: u64) -> foxglove::FrameTransforms {
    let transforms = arms.arms.iter().filter_map(|arm| {
        let (base, tool) = frames(arm.arm())?;
        let pose = arm.base_from_tool?;
        let (rotation, translation) = (pose.rotation?, pose.translation?);
        Some(foxglove::FrameTransform {
            timestamp: Some(timestamp(at_ns)),
            parent_frame_id: base.to_owned(),
            child_frame_id: tool.to_owned(),
            translation: Some(vector(translation.x_mm, translation.y_mm, translation.z_mm)),
            rotation: Some(foxglove::Quaternion {
                x: rotation.x,
                y: rotation.y,
                z: rotation.z,
                w: rotation.w,
            }),
        })
    });
    foxglove::FrameTransforms {
        transforms: transforms.collect(),
    }
}

/// The shafts, which lie along x of the tools and follow them.
pub fn shafts(at_ns: u64) -> foxglove::SceneUpdate {
    let entities = [common::Arm::Forceps, common::Arm::Arthroscope]
        .into_iter()
        .filter_map(|arm| {
            let (_, tool) = frames(arm)?;
            let line = foxglove::LinePrimitive {
                pose: Some(still()),
                thickness: SHAFT_THICK_MM * M_PER_MM,
                points: vec![
                    foxglove::Point3::default(),
                    foxglove::Point3 {
                        x: -SHAFT_MM * M_PER_MM,
                        ..foxglove::Point3::default()
                    },
                ],
                color: Some(color([0.75, 0.75, 0.8, 1.0])),
                ..foxglove::LinePrimitive::default()
            };
            Some(foxglove::SceneEntity {
                frame_locked: true,
                lines: vec![line],
                ..entity(format!("{tool}/shaft"), tool, at_ns)
            })
        });
    foxglove::SceneUpdate {
        entities: entities.collect(),
    }
}

/// A bite that was taken.
pub fn bite(outcome: &gateway::BiteOutcome, at_ns: u64) -> Option<foxglove::SceneUpdate> {
    let tip = outcome.tip?;
    let at = [tip.x_mm, tip.y_mm, tip.z_mm];
    Some(foxglove::SceneUpdate {
        entities: vec![foxglove::SceneEntity {
            spheres: vec![sphere(at, BITE_WIDE_MM, [0.9, 0.2, 0.2, 0.9])],
            ..entity(format!("bite/{}", outcome.bite), FORCEPS_BASE, at_ns)
        }],
    })
}

fn frames(arm: common::Arm) -> Option<(&'static str, &'static str)> {
    match arm {
        common::Arm::Forceps => Some((FORCEPS_BASE, "forceps_tool")),
        common::Arm::Arthroscope => Some((ARTHROSCOPE_BASE, "arthroscope_tool")),
        common::Arm::Unspecified => None,
    }
}

fn fixed<A: Frame, B: Frame>(
    child: &str,
    parent_from_child: &Rigid<A, B>,
    at_ns: u64,
) -> foxglove::FrameTransform {
    let rotation = parent_from_child.rotation();
    let [x, y, z] = Vector3::into(parent_from_child.translation_mm());
    foxglove::FrameTransform {
        timestamp: Some(timestamp(at_ns)),
        parent_frame_id: FORCEPS_BASE.to_owned(),
        child_frame_id: child.to_owned(),
        translation: Some(vector(x, y, z)),
        rotation: Some(foxglove::Quaternion {
            x: rotation.i,
            y: rotation.j,
            z: rotation.k,
            w: rotation.w,
        }),
    }
}

fn entity(id: String, frame: &str, at_ns: u64) -> foxglove::SceneEntity {
    foxglove::SceneEntity {
        timestamp: Some(timestamp(at_ns)),
        frame_id: frame.to_owned(),
        id,
        ..foxglove::SceneEntity::default()
    }
}

fn sphere([x, y, z]: [f64; 3], wide_mm: f64, rgba: [f64; 4]) -> foxglove::SpherePrimitive {
    foxglove::SpherePrimitive {
        pose: Some(foxglove::Pose {
            position: Some(vector(x, y, z)),
            ..still()
        }),
        size: Some(vector(wide_mm, wide_mm, wide_mm)),
        color: Some(color(rgba)),
    }
}

fn still() -> foxglove::Pose {
    foxglove::Pose {
        position: Some(foxglove::Vector3::default()),
        orientation: Some(foxglove::Quaternion {
            w: 1.0,
            ..foxglove::Quaternion::default()
        }),
    }
}

fn color([r, g, b, a]: [f64; 4]) -> foxglove::Color {
    foxglove::Color { r, g, b, a }
}

fn vector(x_mm: f64, y_mm: f64, z_mm: f64) -> foxglove::Vector3 {
    foxglove::Vector3 {
        x: x_mm * M_PER_MM,
        y: y_mm * M_PER_MM,
        z: z_mm * M_PER_MM,
    }
}

fn timestamp(at_ns: u64) -> Timestamp {
    Timestamp {
        seconds: (at_ns / 1_000_000_000) as i64,
        nanos: (at_ns % 1_000_000_000) as i32,
    }
}
