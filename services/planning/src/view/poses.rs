//! The places from which one bite is seen.

use std::f64::consts::PI;

use arthro_geometry::{Point3, Vector3};

use crate::jaw::Bite;

use super::relief::Relief;
use super::segment::{Segment, behind};
use super::{Look, Reason, SHAFT_LENGTH_MM, Scene, View};

/// Poses of a bite that are weighed against those of its neighbours: the work grows with their square.
const POSES: usize = 160;
/// The lattice's step is this share of the farthest distance to the bite: some four thousand places a
/// bite whatever the arthroscope, 3 mm apart for the default one.
const LATTICE_SHARE: f64 = 0.1;
/// The jaw's footprint is looked at on so many points along and across it.
const SIGHTS: i32 = 3;
/// A jaw half as far from the middle of the image as it may be costs a quarter of this, a distance
/// half way between best and limit likewise.
const OFFSET_COST: f64 = 1.0;
const DISTANCE_COST: f64 = 1.0;
/// What a clearance at its limit costs; twice as wide costs half.
const CLEARANCE_COST: f64 = 0.5;
/// What a jaw hidden altogether would cost.
const OCCLUSION_COST: f64 = 4.0;

/// A place that shows the bite.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Pose {
    /// How it looks from there.
    pub(super) view: View,
    /// How badly it shows the bite: 0 is best.
    pub(super) cost: f64,
}

/// The scene with what does not change from bite to bite.
pub(super) struct Surroundings<'a> {
    scene: &'a Scene<'a>,
    surface: Relief,
    /// Where the axis of the arthroscope's shaft may be at the lowest.
    clear_of_shaft: Relief,
}

/// The bite as an obstacle and as what is to be seen.
struct Site<'a> {
    bite: &'a Bite,
    /// Points of the jaw's footprint, on the tissue.
    sights: Vec<Point3>,
    /// The forceps' shaft and jaw.
    forceps: Segment,
    /// The shaft alone: the jaw does not hide itself.
    forceps_shaft: Segment,
}

impl<'a> Surroundings<'a> {
    pub(super) fn of(scene: &'a Scene<'a>) -> Self {
        let surface = Relief::of(scene.tissue);
        let clear_of_shaft = surface.raised(scene.optics.shaft_radius_mm);
        Self {
            scene,
            surface,
            clear_of_shaft,
        }
    }

    /// The best places of the lattice that show the bite, best first; if there is none, what the
    /// closest one fails on.
    pub(super) fn poses(&self, bite: &Bite) -> Result<Vec<Pose>, Reason> {
        let range = &self.scene.optics.distance_mm;
        let site = self.site(bite);
        let mut closest = Reason::NoRoom {
            near_mm: *range.start(),
            far_mm: *range.end(),
        };
        let mut fail = |reason| closest = closest.of_the_closer_place(reason);
        let mut stands = Vec::new();
        for tip in lattice(&bite.center, *range.end()) {
            let in_range = range.contains(&(tip - bite.center).norm());
            if !in_range || self.clear_of_shaft.buries(&tip) {
                continue;
            }
            match self.stand(&site, tip) {
                Ok(stand) => stands.push(stand),
                Err(reason) => fail(reason),
            }
        }
        // What hides the bite only adds to the cost: once enough poses cost less than the next stand
        // alone, no later one is among the best.
        stands.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        let mut poses: Vec<Pose> = Vec::with_capacity(POSES + 1);
        for stand in &stands {
            if poses.len() == POSES && poses[POSES - 1].cost <= stand.cost {
                break;
            }
            match self.look(&site, stand) {
                Ok(pose) => {
                    let rank = poses.partition_point(|other| other.cost <= pose.cost);
                    poses.insert(rank, pose);
                    poses.truncate(POSES);
                }
                Err(reason) => fail(reason),
            }
        }
        if poses.is_empty() {
            return Err(closest);
        }
        Ok(poses)
    }

    fn site<'b>(&self, bite: &'b Bite) -> Site<'b> {
        let scene = self.scene;
        let half_length_mm = 0.5 * scene.jaw.length_mm;
        let end = |along_mm: f64| {
            let end = bite.center + bite.approach * along_mm;
            behind(end, &bite.approach, SHAFT_LENGTH_MM)
        };
        Site {
            bite,
            sights: self.sights(bite),
            forceps: end(half_length_mm),
            forceps_shaft: end(-half_length_mm - scene.forceps_radius_mm),
        }
    }

    /// Points of the jaw's footprint from corner to corner. What is watched there is the surface that
    /// the jaw closes on, not the tissue below it.
    fn sights(&self, bite: &Bite) -> Vec<Point3> {
        let jaw = &self.scene.jaw;
        let across = bite.opening.cross(&bite.approach);
        let share = |step: i32| f64::from(step) / f64::from(SIGHTS - 1) - 0.5;
        let steps = (0..SIGHTS).flat_map(|i| (0..SIGHTS).map(move |j| (i, j)));
        let points = steps.map(|(i, j)| {
            let mut point = bite.center
                + bite.approach * (share(i) * jaw.length_mm)
                + across * (share(j) * jaw.width_mm);
            let surface_mm = self.surface.height_mm(point.x, point.y);
            point.z = point.z.max(surface_mm + 0.5 * self.surface.column_mm());
            point
        });
        points.collect()
    }

    /// The arthroscope turned to the bite with its tip at a place clear of the tissue; what hides the
    /// bite is left open.
    fn stand(&self, site: &Site<'_>, tip: Point3) -> Result<Pose, Reason> {
        let (approach, depth_mm) = self.insertion(&tip)?;
        let look = self.look_at(site, &tip, &approach)?;
        let forceps_clearance_mm = self.forceps_clearance_mm(site, tip, &approach)?;
        self.check_tissue(&tip)?;
        let view = View {
            tip,
            approach,
            optical_axis: look.optical_axis,
            roll_rad: look.roll_rad,
            depth_mm,
            bite_offset_rad: look.offset_rad,
            distance_mm: (site.bite.center - tip).norm(),
            forceps_clearance_mm,
            occluded_percent: 0.0,
        };
        let cost = self.cost(&view);
        Ok(Pose { view, cost })
    }

    /// What a stand shows of the bite.
    fn look(&self, site: &Site<'_>, stand: &Pose) -> Result<Pose, Reason> {
        self.check_bones(&stand.view.tip)?;
        let view = View {
            occluded_percent: self.occluded_percent(site, &stand.view.tip)?,
            ..stand.view
        };
        let cost = self.cost(&view);
        Ok(Pose { view, cost })
    }

    /// Direction and length of the shaft from the portal to the tip.
    fn insertion(&self, tip: &Point3) -> Result<(Vector3, f64), Reason> {
        let range = &self.scene.optics.depth_mm;
        let inwards = tip - self.scene.portal;
        let depth_mm = inwards.norm();
        // A tip in its portal has no shaft.
        inwards
            .try_normalize(1e-6)
            .filter(|_| range.contains(&depth_mm))
            .map(|approach| (approach, depth_mm))
            .ok_or(Reason::DepthRange {
                depth_mm,
                low_mm: *range.start(),
                high_mm: *range.end(),
            })
    }

    /// The optics turned to the middle of the jaw, all of it in view.
    fn look_at(&self, site: &Site<'_>, tip: &Point3, approach: &Vector3) -> Result<Look, Reason> {
        let optics = self.scene.optics;
        let limit_rad = optics.reach_rad();
        let out_of_view = |angle_rad| Reason::OutOfView {
            angle_rad,
            limit_rad,
        };
        let look = optics
            .look_at(tip, approach, &Vector3::z(), &site.bite.center)
            .ok_or(out_of_view(PI))?;
        let cosines = site.sights.iter().map(|sight| {
            let towards = sight - tip;
            look.optical_axis.dot(&towards) / towards.norm()
        });
        let angle_rad = cosines.fold(1.0, f64::min).max(-1.0).acos();
        if angle_rad <= limit_rad {
            Ok(look)
        } else {
            Err(out_of_view(angle_rad))
        }
    }

    /// Between the surfaces of both shafts, mm.
    fn forceps_clearance_mm(
        &self,
        site: &Site<'_>,
        tip: Point3,
        approach: &Vector3,
    ) -> Result<f64, Reason> {
        let optics = self.scene.optics;
        let axes_mm = behind(tip, approach, SHAFT_LENGTH_MM).distance_mm(&site.forceps);
        let clearance_mm = axes_mm - optics.shaft_radius_mm - self.scene.forceps_radius_mm;
        if clearance_mm >= optics.clearance_min_mm {
            return Ok(clearance_mm);
        }
        Err(Reason::ShaftsTooClose {
            clearance_mm,
            limit_mm: optics.clearance_min_mm,
        })
    }

    fn check_tissue(&self, tip: &Point3) -> Result<(), Reason> {
        let limit_mm = self.scene.optics.through_tissue_max_mm;
        let through_mm = self.clear_of_shaft.buried_mm(&self.scene.portal, tip);
        if through_mm <= limit_mm {
            return Ok(());
        }
        Err(Reason::ThroughTissue {
            through_mm,
            limit_mm,
        })
    }

    fn check_bones(&self, tip: &Point3) -> Result<(), Reason> {
        let optics = self.scene.optics;
        let axis_mm = (self.scene.bone_mm)(&Segment {
            from: self.scene.portal,
            to: *tip,
        });
        let clearance_mm = axis_mm - optics.shaft_radius_mm;
        if clearance_mm >= optics.bone_clearance_min_mm {
            return Ok(());
        }
        Err(Reason::ShaftHitsBone {
            clearance_mm,
            limit_mm: optics.bone_clearance_min_mm,
        })
    }

    /// Share of the sights that tissue or the forceps' shaft hide, percent.
    fn occluded_percent(&self, site: &Site<'_>, tip: &Point3) -> Result<f64, Reason> {
        let hidden = site.sights.iter().filter(|&&sight| {
            let ray = Segment {
                from: sight,
                to: *tip,
            };
            ray.distance_mm(&site.forceps_shaft) < self.scene.forceps_radius_mm
                || self.surface.hides(&sight, tip)
        });
        let percent = 100.0 * hidden.count() as f64 / site.sights.len() as f64;
        let limit_percent = self.scene.optics.occluded_max_percent;
        if percent <= limit_percent {
            return Ok(percent);
        }
        Err(Reason::Occluded {
            percent,
            limit_percent,
        })
    }

    fn cost(&self, view: &View) -> f64 {
        let optics = self.scene.optics;
        let (near_mm, far_mm) = (optics.distance_mm.start(), optics.distance_mm.end());
        let half_mm = (0.5 * (far_mm - near_mm)).max(1.0);
        let offset = view.bite_offset_rad / optics.reach_rad();
        let distance = (view.distance_mm - optics.best_distance_mm()) / half_mm;
        let limit_mm = optics.clearance_min_mm.max(1.0);
        let nearness = limit_mm / view.forceps_clearance_mm.max(limit_mm);
        OFFSET_COST * offset * offset
            + DISTANCE_COST * distance * distance
            + CLEARANCE_COST * nearness
            + OCCLUSION_COST * view.occluded_percent / 100.0
    }
}

/// The places within `far_mm` of a point on the one lattice that all bites share.
fn lattice(around: &Point3, far_mm: f64) -> impl Iterator<Item = Point3> {
    let step_mm = far_mm * LATTICE_SHARE;
    let steps = |axis: usize| {
        let low = ((around[axis] - far_mm) / step_mm).ceil();
        let count = ((around[axis] + far_mm) / step_mm).floor() - low;
        (0..=count as usize).map(move |step| (low + step as f64) * step_mm)
    };
    let (columns, rows, layers) = (steps(0), steps(1), steps(2));
    columns.flat_map(move |x| {
        let layers = layers.clone();
        rows.clone()
            .flat_map(move |y| layers.clone().map(move |z| Point3::new(x, y, z)))
    })
}
