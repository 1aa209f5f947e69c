//! One case for the simulated cell: what the system is given before the operation, and the truth that
//! only the simulator knows.
//!
//! A scenario follows from a [`Spec`] and a model alone, so a seed is a whole case. What leaves the
//! simulator is [`Scenario::preoperative`] and [`Scenario::system_view`]; the pose of the knee does not.

pub mod crescent;
mod folder;
pub mod layout;
pub mod mounting;
pub mod spec;
mod tear;

use std::sync::Arc;

use arthro_geometry::frame::{
    ArthroscopeBase, Board, Camera, Ct, Flange, ForcepsBase, Frame, Tool,
};
use arthro_geometry::{Mesh, Point3, Rigid, Rotation, Vector3, phantom};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

pub use self::layout::Layout;
pub use self::mounting::Mounting;
pub use self::spec::{Intrinsics, Spec};
pub use self::tear::Tear;
use crate::Error;
use crate::scenario::crescent::Crescent;
use crate::scenario::mounting::Mounted;
use crate::voxels::Voxels;

/// The frame of the knee: see [`Crescent::ct_from_knee`].
#[derive(Copy, Clone, Debug, PartialEq, Eq)]
pub struct KneeFrame;

impl Frame for KneeFrame {
    const NAME: &'static str = "knee";
}

/// One case.
#[derive(Clone, Debug)]
pub struct Scenario {
    /// Which meniscus it is about.
    pub source: Source,
    /// What it was made from.
    pub spec: Spec,
    /// What the system is given.
    pub preoperative: Preoperative,
    /// What only the simulator knows.
    pub(crate) truth: Arc<Truth>,
}

/// Which meniscus a case is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Source {
    /// The built-in phantom, with the paper's start, goal and target box.
    Phantom,
    /// A given surface.
    Mesh,
}

/// The data of the case before the operation, all in ct.
#[derive(Clone, Debug, PartialEq)]
pub struct Preoperative {
    /// The meniscus: a closed surface.
    pub model: Mesh,
    /// The damaged tissue as points on a grid of [`LESION_SPACING_MM`].
    pub lesion: Vec<Point3>,
    /// Where the new contour leaves the free edge.
    pub start: Point3,
    /// Where it meets it again.
    pub goal: Point3,
    /// Lowest and highest corner of the box that the targets stay inside.
    pub target_box: (Point3, Point3),
}

/// Distance between the points of [`Preoperative::lesion`], mm.
pub const LESION_SPACING_MM: f64 = 0.5;

/// What is true in the cell.
#[derive(Clone, Debug)]
pub(crate) struct Truth {
    /// Where the knee really lies.
    pub forceps_base_from_ct: Rigid<ForcepsBase, Ct>,
    /// The meniscus in its own coordinates.
    pub crescent: Crescent,
    /// The tissue.
    pub voxels: Voxels,
    /// The damage.
    pub tear: Tear,
    /// The portals in the skin, forceps and arthroscope.
    pub portals: [Point3; 2],
    /// Where camera, tools, board and divot really are.
    pub mounted: Mounted,
}

/// What the configuration of the services says about the cell. Portals are what a surgeon would teach
/// by touching them; the pose of the knee is not here.
#[derive(Clone, Debug, PartialEq)]
pub struct SystemView {
    /// Where the other arm stands.
    pub forceps_base_from_arthroscope_base: Rigid<ForcepsBase, ArthroscopeBase>,
    /// Both tools: x along the shaft, origin at the tip.
    pub flange_from_tool: Rigid<Flange, Tool>,
    /// The forceps' portal in its arm's base.
    pub portal_in_forceps_base: Point3,
    /// The arthroscope's portal in its arm's base.
    pub portal_in_arthroscope_base: Point3,
    /// The hand-eye transform of the cell's calibration.
    pub forceps_base_from_camera: Rigid<ForcepsBase, Camera>,
    /// The calibration board on the forceps arm, as drawn.
    pub flange_from_board: Rigid<Flange, Board>,
    /// The divot at rest, as drawn.
    pub divot_in_forceps_base: Point3,
    /// Tool pose over the tray at which the jaw lets go.
    pub forceps_base_from_tool_at_tray: Rigid<ForcepsBase, Tool>,
    /// How far the joint is opened: between the top of the meniscus and the condyle, mm.
    pub joint_gap_mm: f64,
    /// Across the shaft and along it, mm.
    pub jaw_width_mm: f64,
    /// Along the shaft, mm.
    pub jaw_length_mm: f64,
    /// Joints that both arms start at, rad: forceps, arthroscope.
    pub start_joints_rad: [[f64; 6]; 2],
}

impl Scenario {
    /// The built-in phantom with the paper's start, goal and target box.
    ///
    /// # Errors
    /// When a number of the spec is out of range.
    pub fn phantom(spec: Spec) -> Result<Self, Error> {
        let model = as_a_file_carries_it(phantom::mesh());
        let voxels = Voxels::from_mesh(&model, spec.checked()?.knee.voxel_mm);
        let crescent = Crescent::of_phantom(&voxels);
        let tear = Tear::in_body(&crescent, &spec.tear);
        let preoperative = Preoperative {
            lesion: lesion_points(&model, &crescent, &tear),
            start: phantom::START,
            goal: phantom::GOAL,
            target_box: phantom::TARGET_BOX,
            model,
        };
        Ok(Self::assemble(
            Source::Phantom,
            spec,
            preoperative,
            crescent,
            voxels,
            tear,
        ))
    }

    /// Any meniscus: the surface gets a small radial tear in the middle of its body and a generic
    /// joint around it.
    ///
    /// # Errors
    /// When a number of the spec is out of range or the surface is not a crescent.
    pub fn of_mesh(spec: Spec, model: Mesh) -> Result<Self, Error> {
        crescent::check_size(&model)?;
        let model = as_a_file_carries_it(model);
        let voxels = Voxels::from_mesh(&model, spec.checked()?.knee.voxel_mm);
        let crescent = Crescent::of_mesh(&model, &voxels)?;
        let tear = Tear::in_body(&crescent, &spec.tear);
        let preoperative = Preoperative {
            lesion: lesion_points(&model, &crescent, &tear),
            start: tear.end_of_contour(&crescent, &voxels, spec.tear.reach_deg),
            goal: tear.end_of_contour(&crescent, &voxels, -spec.tear.reach_deg),
            target_box: tear.neighbourhood(&crescent, &voxels, spec.tear.reach_deg),
            model,
        };
        Ok(Self::assemble(
            Source::Mesh,
            spec,
            preoperative,
            crescent,
            voxels,
            tear,
        ))
    }

    fn assemble(
        source: Source,
        spec: Spec,
        preoperative: Preoperative,
        crescent: Crescent,
        voxels: Voxels,
        tear: Tear,
    ) -> Self {
        let forceps_base_from_knee = spec.layout.nominal_knee() * spec.knee_displacement();
        let portals = spec
            .layout
            .portals_in_knee(&crescent)
            .map(|portal| forceps_base_from_knee * portal);
        let truth = Truth {
            forceps_base_from_ct: forceps_base_from_knee * crescent.ct_from_knee.inverse(),
            crescent,
            voxels,
            tear,
            portals,
            mounted: Mounted::of(&spec),
        };
        Self {
            source,
            spec,
            preoperative,
            truth: Arc::new(truth),
        }
    }

    /// What the services' configuration needs.
    pub fn system_view(&self) -> SystemView {
        let layout = &self.spec.layout;
        let forceps_base_from_arthroscope_base = layout.forceps_base_from_arthroscope_base();
        let [forceps, arthroscope] = self.truth.portals;
        SystemView {
            forceps_base_from_arthroscope_base,
            flange_from_tool: layout.flange_from_tool(),
            portal_in_forceps_base: forceps,
            portal_in_arthroscope_base: forceps_base_from_arthroscope_base.inverse() * arthroscope,
            forceps_base_from_camera: layout.forceps_base_from_camera(),
            flange_from_board: layout.flange_from_board(),
            divot_in_forceps_base: layout.divot_mm.into(),
            forceps_base_from_tool_at_tray: layout.forceps_base_from_tool_at_tray(),
            joint_gap_mm: self.spec.knee.joint_gap_mm,
            jaw_width_mm: self.spec.jaw.width_mm,
            jaw_length_mm: self.spec.jaw.length_mm,
            start_joints_rad: layout.start_joints_rad,
        }
    }
}

impl Spec {
    /// How far the knee lies from where the nominal layout has it, drawn from the seed.
    fn knee_displacement(&self) -> Rigid<KneeFrame, KneeFrame> {
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        let mut draw = || rng.random_range(-1.0..=1.0);
        let translation = Vector3::new(draw(), draw(), draw()) * self.displacement.translation_mm;
        let axis = Vector3::new(draw(), draw(), draw())
            .try_normalize(1e-6)
            .unwrap_or_else(Vector3::z);
        let angle_rad = draw() * self.displacement.rotation_deg.to_radians();
        Rigid::new(Rotation::from_scaled_axis(axis * angle_rad), translation)
    }
}

/// Surface files hold float32: rounding once makes the case read from a folder equal to the one
/// written to it.
fn as_a_file_carries_it(mut mesh: Mesh) -> Mesh {
    for vertex in &mut mesh.vertices {
        *vertex = vertex.map(|value| f64::from(value as f32));
    }
    mesh
}

/// The points of the planning grid that lie in damaged tissue.
fn lesion_points(model: &Mesh, crescent: &Crescent, tear: &Tear) -> Vec<Point3> {
    let grid = Voxels::from_mesh(model, LESION_SPACING_MM);
    let knee_from_ct = crescent.ct_from_knee.inverse();
    grid.solid_cells()
        .map(|cell| grid.center(cell))
        .filter(|point| tear.contains(&(knee_from_ct * *point)))
        .collect()
}

#[cfg(test)]
pub(crate) mod tests;
