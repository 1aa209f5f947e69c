//! The RGB-D camera above the bench: renders what it would see of the meniscus on the tibial plateau,
//! with the noise of a stereo depth camera.
//!
//! The phantom is imaged before the femoral condyle is lowered onto it and before the instruments
//! come in, so neither is in view. A bite does not show.

use arthro_geometry::frame::Camera as CameraFrame;
use arthro_geometry::{Mesh, Point3, Rigid, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::scenario::{Intrinsics, KneeFrame, Scenario};

/// What the camera of one case sees, still without noise.
#[derive(Clone, Debug)]
pub struct Camera {
    intrinsics: Intrinsics,
    seed: u64,
    view: Vec<Option<Seen>>,
}

/// One picture, rows from the top.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Picture {
    /// Depth units; 0 where there is no measurement.
    pub depth: Vec<u16>,
    /// Red, green, blue.
    pub color: Vec<[u8; 3]>,
}

/// What a pixel meets.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Seen {
    depth_mm: f64,
    material: Material,
    /// Cosine between the ray and the surface's normal.
    facing: f64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Material {
    Meniscus,
    Cartilage,
    Drape,
}

impl Material {
    /// Meniscus is ivory, cartilage bluish, the drape dark.
    fn color(self) -> [f64; 3] {
        match self {
            Self::Meniscus => [232.0, 218.0, 186.0],
            Self::Cartilage => [150.0, 180.0, 214.0],
            Self::Drape => [24.0, 34.0, 44.0],
        }
    }
}

/// The drape lies this far below the plateau.
const DRAPE_MM: f64 = 60.0;
/// Flatter than this to the ray, a surface gives no depth.
const GRAZING: f64 = 0.15;
/// Deviation of a colour channel.
const COLOR_NOISE: f64 = 3.0;

impl Camera {
    /// Renders the untouched knee of a case.
    pub fn new(scenario: &Scenario) -> Self {
        let intrinsics = scenario.spec.camera.clone();
        let camera_from_ct = scenario.camera_from_ct();
        let camera_from_knee = camera_from_ct * scenario.truth.crescent.ct_from_knee;
        let pixels = intrinsics.width_px as usize * intrinsics.height_px as usize;
        let mut camera = Self {
            intrinsics,
            seed: scenario.spec.seed,
            view: vec![None; pixels],
        };
        let plateau_mm = scenario.spec.knee.plateau_radius_mm;
        camera.draw_disc(&camera_from_knee, 0.0, plateau_mm, Material::Cartilage);
        camera.draw_disc(&camera_from_knee, -DRAPE_MM, f64::INFINITY, Material::Drape);
        let vertices = scenario.preoperative.model.vertices.iter();
        camera.draw_mesh(
            &Mesh {
                vertices: vertices.map(|vertex| camera_from_ct * *vertex).collect(),
                triangles: scenario.preoperative.model.triangles.clone(),
            },
            Material::Meniscus,
        );
        camera
    }

    /// The lens.
    pub fn intrinsics(&self) -> &Intrinsics {
        &self.intrinsics
    }

    /// Column and row of the optical axis, pixels.
    pub fn principal_point_px(&self) -> [f64; 2] {
        self.intrinsics.principal_point_px()
    }

    /// Takes a picture. The same seed gives the same noise.
    pub fn capture(&self, seed: u64) -> Picture {
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        rng.set_stream(seed);
        let lens = &self.intrinsics;
        let mut picture = Picture {
            depth: Vec::with_capacity(self.view.len()),
            color: Vec::with_capacity(self.view.len()),
        };
        for seen in &self.view {
            let [first, second] = normal_pair(&mut rng);
            let Some(seen) = seen else {
                picture.depth.push(0);
                picture.color.push([0; 3]);
                continue;
            };
            let deviation_mm =
                seen.depth_mm.powi(2) * lens.subpixel_px / (lens.focal_px * lens.baseline_mm);
            let depth_mm = seen.depth_mm + deviation_mm * first;
            picture.depth.push(if seen.facing < GRAZING {
                0
            } else {
                // A cast saturates: farther than the unit can say is the largest value.
                (depth_mm / lens.depth_unit_mm).round() as u16
            });
            let light = 0.45 + 0.55 * seen.facing;
            picture.color.push(
                seen.material
                    .color()
                    .map(|channel| (channel * light + COLOR_NOISE * second).round() as u8),
            );
        }
        picture
    }

    /// A horizontal disc of the knee's frame.
    fn draw_disc(
        &mut self,
        camera_from_knee: &Rigid<CameraFrame, KneeFrame>,
        height_mm: f64,
        radius_mm: f64,
        material: Material,
    ) {
        let knee_from_camera = camera_from_knee.inverse();
        let eye = knee_from_camera.origin();
        for row in 0..self.intrinsics.height_px {
            for column in 0..self.intrinsics.width_px {
                let ray = self.ray(column, row);
                let along = knee_from_camera.direction(&ray);
                let depth_mm = (height_mm - eye.z) / along.z;
                let at = eye + along * depth_mm;
                if depth_mm > 0.0 && at.x.hypot(at.y) <= radius_mm {
                    let facing = along.z.abs() / ray.norm();
                    self.put(
                        column,
                        row,
                        Seen {
                            depth_mm,
                            material,
                            facing,
                        },
                    );
                }
            }
        }
    }

    /// A mesh in the camera's frame.
    fn draw_mesh(&mut self, mesh: &Mesh, material: Material) {
        for index in 0..mesh.triangles.len() {
            let corners = mesh.corners(index);
            if corners.iter().any(|corner| corner.z <= 1.0) {
                continue;
            }
            let normal = (corners[1] - corners[0])
                .cross(&(corners[2] - corners[0]))
                .try_normalize(0.0)
                .unwrap_or_else(Vector3::zeros);
            self.draw_triangle(&corners, &normal, material);
        }
    }

    fn draw_triangle(&mut self, corners: &[Point3; 3], normal: &Vector3, material: Material) {
        let lens = &self.intrinsics;
        let [center_x, center_y] = self.principal_point_px();
        let flat = corners.map(|corner| {
            [
                center_x + lens.focal_px * corner.x / corner.z,
                center_y + lens.focal_px * corner.y / corner.z,
            ]
        });
        let span = |axis: usize, count: u32| {
            let low = flat.iter().map(|p| p[axis]).fold(f64::INFINITY, f64::min);
            let high = flat
                .iter()
                .map(|p| p[axis])
                .fold(f64::NEG_INFINITY, f64::max);
            // Casts saturate at 0.
            low.ceil() as u32..((high.floor() + 1.0) as u32).min(count)
        };
        let (columns, rows) = (span(0, lens.width_px), span(1, lens.height_px));
        let offset = normal.dot(&corners[0].coords);
        for row in rows {
            for column in columns.clone() {
                if !holds(&flat, [f64::from(column), f64::from(row)]) {
                    continue;
                }
                // The ray meets the triangle's plane at n.p = offset.
                let ray = self.ray(column, row);
                let depth_mm = offset / normal.dot(&ray);
                if depth_mm.is_finite() && depth_mm > 0.0 {
                    let facing = normal.dot(&ray).abs() / ray.norm();
                    self.put(
                        column,
                        row,
                        Seen {
                            depth_mm,
                            material,
                            facing,
                        },
                    );
                }
            }
        }
    }

    /// Through the middle of a pixel, 1 along z.
    fn ray(&self, column: u32, row: u32) -> Vector3 {
        let [center_x, center_y] = self.principal_point_px();
        Vector3::new(
            (f64::from(column) - center_x) / self.intrinsics.focal_px,
            (f64::from(row) - center_y) / self.intrinsics.focal_px,
            1.0,
        )
    }

    /// Keeps the nearer of two.
    fn put(&mut self, column: u32, row: u32, seen: Seen) {
        let pixel = &mut self.view[(row * self.intrinsics.width_px + column) as usize];
        if pixel.is_none_or(|there| seen.depth_mm < there.depth_mm) {
            *pixel = Some(seen);
        }
    }
}

/// Whether a point lies in a flat triangle of either turn.
fn holds([a, b, c]: &[[f64; 2]; 3], at: [f64; 2]) -> bool {
    let side = |p: &[f64; 2], q: &[f64; 2]| {
        (q[0] - p[0]) * (at[1] - p[1]) - (q[1] - p[1]) * (at[0] - p[0])
    };
    let sides = [side(a, b), side(b, c), side(c, a)];
    sides.iter().all(|side| *side >= 0.0) || sides.iter().all(|side| *side <= 0.0)
}

/// Two independent values of deviation 1 (Box and Muller).
pub(crate) fn normal_pair(rng: &mut ChaCha8Rng) -> [f64; 2] {
    let (uniform, turn): (f64, f64) = (rng.random(), rng.random());
    let radius = (-2.0 * (1.0 - uniform).ln()).sqrt();
    let (sine, cosine) = (std::f64::consts::TAU * turn).sin_cos();
    [radius * cosine, radius * sine]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::Spec;

    fn camera(edit: impl FnOnce(&mut Spec)) -> (Scenario, Camera) {
        let mut spec = Spec::default();
        edit(&mut spec);
        let scenario = Scenario::phantom(spec).unwrap();
        let camera = Camera::new(&scenario);
        (scenario, camera)
    }

    /// Pixels that show the meniscus by their colour, back in the camera's frame.
    fn meniscus(camera: &Camera, picture: &Picture) -> Vec<Point3> {
        let width = camera.intrinsics.width_px as usize;
        let unit_mm = camera.intrinsics.depth_unit_mm;
        (0..picture.depth.len())
            .filter(|&pixel| picture.depth[pixel] > 0)
            .filter(|&pixel| picture.color[pixel][0] > picture.color[pixel][2])
            .map(|pixel| {
                let ray = camera.ray((pixel % width) as u32, (pixel / width) as u32);
                Point3::from(ray * f64::from(picture.depth[pixel]) * unit_mm)
            })
            .collect()
    }

    #[test]
    fn the_same_seed_gives_the_same_picture_and_another_seed_another_noise() {
        let (_, camera) = camera(|_| ());
        let picture = camera.capture(7);
        assert_eq!(picture, camera.capture(7));
        assert_ne!(picture.depth, camera.capture(8).depth);
    }

    #[test]
    fn without_noise_every_meniscus_pixel_lies_on_the_model() {
        let (scenario, camera) = camera(|spec| {
            spec.camera.subpixel_px = 0.0;
            spec.camera.depth_unit_mm = 0.01;
        });
        let points = meniscus(&camera, &camera.capture(0));
        assert!(
            (1500..6000).contains(&points.len()),
            "{} points",
            points.len()
        );
        let phantom = arthro_geometry::phantom::Phantom::default();
        let ct_from_camera = scenario.camera_from_ct().inverse();
        for point in points {
            let at = phantom.coordinates(&(ct_from_camera * point));
            assert!((-0.05..1.05).contains(&at.width_fraction), "{at:?}");
            assert!((-0.05..1.05).contains(&at.height_fraction), "{at:?}");
        }
    }

    #[test]
    fn the_noise_follows_the_law_of_a_stereo_camera() {
        let (_, noisy) = camera(|spec| spec.camera.depth_unit_mm = 0.01);
        let picture = noisy.capture(1);
        let (mut sum, mut count) = (0.0, 0.0);
        for (seen, depth) in noisy.view.iter().zip(&picture.depth) {
            if let Some(seen) =
                seen.filter(|seen| seen.material == Material::Meniscus && *depth > 0)
            {
                let law_mm = seen.depth_mm.powi(2) * 0.08 / (700.0 * 50.0);
                sum += ((f64::from(*depth) * 0.01 - seen.depth_mm) / law_mm).powi(2);
                count += 1.0_f64;
            }
        }
        let deviation = (sum / count).sqrt();
        assert!(
            (deviation - 1.0).abs() < 0.05,
            "{deviation} of the law over {count} pixels"
        );
    }

    #[test]
    fn the_knee_is_in_the_middle_of_the_picture() {
        let (scenario, camera) = camera(|spec| {
            spec.displacement.translation_mm = 0.0;
            spec.displacement.rotation_deg = 0.0;
        });
        let hole = scenario.camera_from_ct() * scenario.truth.crescent.ct_from_knee.origin();
        assert!(
            (hole - Point3::new(0.0, 0.0, 350.0)).norm() < 1e-6,
            "{hole}"
        );
        let picture = camera.capture(0);
        let measured = picture.depth.iter().filter(|depth| **depth > 0).count();
        assert!(measured > picture.depth.len() / 2);
    }
}
