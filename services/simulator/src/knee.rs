//! The knee: tissue that can be taken away cell by cell, the bones around it, and the skin with its
//! two portals. Everything here is the truth.

use std::sync::Arc;

use arthro_geometry::frame::{Ct, ForcepsBase, Tool};
use arthro_geometry::{Point3, Rigid, Vector3};

use crate::scenario::crescent::{Sector, polar};
use crate::scenario::{KneeFrame, Scenario, Truth};

/// The knee of one case.
#[derive(Clone, Debug)]
pub struct Knee {
    truth: Arc<Truth>,
    tissue: Vec<Tissue>,
    bones: Bones,
    forceps_base_from_knee: Rigid<ForcepsBase, KneeFrame>,
    skin_mm: f64,
    intact: Volume,
}

/// What a cell of the grid holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Tissue {
    Nothing,
    Healthy,
    Damaged,
    Removed,
}

/// An amount of tissue.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Volume {
    /// mm3 of healthy tissue.
    pub healthy_mm3: f64,
    /// mm3 of damaged tissue.
    pub damaged_mm3: f64,
}

impl Volume {
    /// Both kinds together, mm3.
    pub fn total_mm3(&self) -> f64 {
        self.healthy_mm3 + self.damaged_mm3
    }

    fn add(&mut self, tissue: Tissue, mm3: f64) {
        match tissue {
            Tissue::Healthy => self.healthy_mm3 += mm3,
            Tissue::Damaged => self.damaged_mm3 += mm3,
            Tissue::Nothing | Tissue::Removed => {}
        }
    }
}

impl std::ops::AddAssign for Volume {
    fn add_assign(&mut self, other: Self) {
        self.healthy_mm3 += other.healthy_mm3;
        self.damaged_mm3 += other.damaged_mm3;
    }
}

/// A box: the space between the open jaws.
#[derive(Clone, Copy, Debug)]
pub struct JawBox {
    /// Origin in the middle of the box, x along the shaft, z the direction in which the jaw opens.
    pub forceps_base_from_jaw: Rigid<ForcepsBase, Tool>,
    /// Half of the length, the width and the opening, mm.
    pub half_mm: Vector3,
}

/// The tissue between the jaws.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Bitten {
    /// How much.
    pub volume: Volume,
    /// Extent in the direction in which the jaw opens, mm.
    pub thickness_mm: f64,
}

/// Bones in the knee's frame.
#[derive(Clone, Copy, Debug)]
pub struct Bones {
    /// Middle of the sphere that stands for the femoral condyle.
    pub condyle_center: Point3,
    /// Its radius, mm.
    pub condyle_radius_mm: f64,
    /// Height of the tibial bone's surface, mm: below the cartilage that the meniscus lies on.
    pub tibia_mm: f64,
    /// Radius of the plateau about the hole, mm.
    pub plateau_radius_mm: f64,
}

impl Knee {
    /// The knee of a case, untouched.
    pub fn new(scenario: &Scenario) -> Self {
        let truth = Arc::clone(&scenario.truth);
        let spec = &scenario.spec.knee;
        let knee_from_ct = truth.crescent.ct_from_knee.inverse();
        let mut intact = Volume::default();
        let tissue = (0..truth.voxels.len())
            .map(|cell| {
                let tissue = if !truth.voxels.solid(cell) {
                    Tissue::Nothing
                } else if truth
                    .tear
                    .contains(&(knee_from_ct * truth.voxels.center(cell)))
                {
                    Tissue::Damaged
                } else {
                    Tissue::Healthy
                };
                intact.add(tissue, truth.voxels.cell_mm3());
                tissue
            })
            .collect();
        let forceps_base_from_knee = truth.forceps_base_from_ct * truth.crescent.ct_from_knee;
        let lowest_mm = truth.crescent.height_mm + spec.joint_gap_mm;
        Self {
            bones: Bones {
                condyle_center: Point3::new(0.0, 0.0, lowest_mm + spec.condyle_radius_mm),
                condyle_radius_mm: spec.condyle_radius_mm,
                tibia_mm: -spec.cartilage_mm,
                plateau_radius_mm: spec.plateau_radius_mm,
            },
            skin_mm: (truth.portals[0] - forceps_base_from_knee.origin()).norm(),
            truth,
            tissue,
            forceps_base_from_knee,
            intact,
        }
    }

    /// Where the knee really lies.
    pub fn forceps_base_from_ct(&self) -> &Rigid<ForcepsBase, Ct> {
        &self.truth.forceps_base_from_ct
    }

    /// The same, to the knee's own frame.
    pub fn forceps_base_from_knee(&self) -> &Rigid<ForcepsBase, KneeFrame> {
        &self.forceps_base_from_knee
    }

    /// The bones, in the knee's frame.
    pub fn bones(&self) -> &Bones {
        &self.bones
    }

    /// The portals in the forceps arm's base: forceps, arthroscope.
    pub fn portals(&self) -> &[Point3; 2] {
        &self.truth.portals
    }

    /// The tissue before the first bite.
    pub fn intact(&self) -> Volume {
        self.intact
    }

    /// Whether a point of the forceps arm's base is under the skin.
    pub fn under_skin(&self, at: &Point3) -> bool {
        (at - self.forceps_base_from_knee.origin()).norm_squared() < self.skin_mm * self.skin_mm
    }

    /// The tissue inside a box.
    pub fn between(&self, jaw: &JawBox) -> Bitten {
        let mut bitten = Bitten::default();
        let (mut lowest, mut highest) = (f64::INFINITY, f64::NEG_INFINITY);
        for (cell, height_mm) in self.cells_in(jaw) {
            bitten
                .volume
                .add(self.tissue[cell], self.truth.voxels.cell_mm3());
            lowest = lowest.min(height_mm);
            highest = highest.max(height_mm);
        }
        if highest >= lowest {
            bitten.thickness_mm = highest - lowest + self.truth.voxels.edge_mm();
        }
        bitten
    }

    /// Takes the tissue inside a box away.
    pub fn cut(&mut self, jaw: &JawBox) -> Volume {
        let mut volume = Volume::default();
        let cells: Vec<usize> = self.cells_in(jaw).map(|(cell, _)| cell).collect();
        for cell in cells {
            volume.add(self.tissue[cell], self.truth.voxels.cell_mm3());
            self.tissue[cell] = Tissue::Removed;
        }
        volume
    }

    /// Radial width left where the crescent is narrowest, mm: along each ray round the hole, from the
    /// rim inwards to the first place where more than half of the thickness is gone. The tapering
    /// horns, narrower than half of the median from the start, are left out.
    pub fn rim_min_mm(&self) -> f64 {
        let crescent = &self.truth.crescent;
        let mut widths: Vec<f64> = crescent.sectors().map(|s| s.width_mm()).collect();
        widths.sort_by(f64::total_cmp);
        let narrow_mm = 0.5 * widths.get(widths.len() / 2).copied().unwrap_or_default();
        let knee_from_ct = crescent.ct_from_knee.inverse();

        // Columns of cells along each ray: how many there were and how many are left.
        let edge_mm = 2.0 * self.truth.voxels.edge_mm();
        let mut columns: std::collections::BTreeMap<u64, Vec<[u32; 2]>> =
            std::collections::BTreeMap::new();
        for cell in self.truth.voxels.solid_cells() {
            let (phi_rad, radius_mm) = polar(&(knee_from_ct * self.truth.voxels.center(cell)));
            let Some(sector) = crescent.sector(phi_rad) else {
                continue;
            };
            if sector.width_mm() < narrow_mm {
                continue;
            }
            let ray = columns.entry(sector.phi_rad.to_bits()).or_default();
            let step = ((sector.rim_mm - radius_mm) / edge_mm).max(0.0) as usize;
            if ray.len() <= step {
                ray.resize(step + 1, [0, 0]);
            }
            ray[step][0] += 1;
            ray[step][1] += u32::from(self.tissue[cell] != Tissue::Removed);
        }
        let left = |phi_bits: &u64, ray: &Vec<[u32; 2]>| {
            let gone = |[were, are]: &[u32; 2]| 2 * are < *were;
            match ray.iter().position(gone) {
                Some(steps) => steps as f64 * edge_mm,
                None => crescent
                    .sector(f64::from_bits(*phi_bits))
                    .as_ref()
                    .map_or(f64::INFINITY, Sector::width_mm),
            }
        };
        let narrowest = columns
            .iter()
            .map(|(phi_bits, ray)| left(phi_bits, ray))
            .fold(f64::INFINITY, f64::min);
        if narrowest.is_finite() {
            narrowest
        } else {
            0.0
        }
    }

    /// Cells with tissue inside a box, and their height in the direction in which the jaw opens.
    fn cells_in(&self, jaw: &JawBox) -> impl Iterator<Item = (usize, f64)> + '_ {
        let ct_from_jaw = self.truth.forceps_base_from_ct.inverse() * jaw.forceps_base_from_jaw;
        let jaw_from_ct = ct_from_jaw.inverse();
        let half_mm = jaw.half_mm;
        let reach = ct_from_jaw
            .rotation()
            .to_rotation_matrix()
            .matrix()
            .map(f64::abs)
            * half_mm;
        let middle = ct_from_jaw.origin();
        self.truth
            .voxels
            .cells_in(middle - reach, middle + reach)
            .filter(|&cell| matches!(self.tissue[cell], Tissue::Healthy | Tissue::Damaged))
            .filter_map(move |cell| {
                let at = jaw_from_ct * self.truth.voxels.center(cell);
                (0..3)
                    .all(|axis| at[axis].abs() <= half_mm[axis])
                    .then_some((cell, at.z))
            })
    }
}

#[cfg(test)]
mod tests;
