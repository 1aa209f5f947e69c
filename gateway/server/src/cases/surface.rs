//! The model as registration wants it: points spread evenly over the surface, each with its outward
//! normal, because a mesh's vertices are dense where it is curved and sparse where it is flat.

use arthro_geometry::{Mesh, Point3};
use bytes::{BufMut as _, Bytes, BytesMut};

use crate::cases::upload;

/// Distance between neighbouring points, mm.
const SPACING_MM: f64 = 0.5;
/// Most points, so that a large mesh given in a wrong unit does not fill the memory.
const POINTS_MAX: usize = 500_000;

/// Points on a surface as packed bytes with normals.
#[derive(Clone, Debug, PartialEq)]
pub struct SurfaceCloud {
    /// How many points.
    pub point_count: u32,
    /// Packed points with normals.
    pub packed: Bytes,
}

/// Unpacks a stored mesh.
pub fn mesh(vertices: &[u8], triangles: &[u8]) -> Mesh {
    Mesh {
        vertices: upload::positions(vertices, false),
        triangles: upload::triangles(triangles).collect(),
    }
}

/// Spreads points over the surface, at most [`SPACING_MM`] apart.
pub fn sample(mesh: &Mesh) -> SurfaceCloud {
    let mut spacing_mm = SPACING_MM;
    while point_count(mesh, spacing_mm) > POINTS_MAX {
        spacing_mm *= 1.5;
        // Even one point a triangle would be too many: every triangle keeps its centroid, and their number is limited
        // by the upload.
        if spacing_mm > 100.0 {
            break;
        }
    }
    let mut packed = BytesMut::new();
    let mut count = 0;
    for index in 0..mesh.triangles.len() {
        let [a, b, c] = mesh.corners(index);
        let Some(normal) = (b - a).cross(&(c - a)).try_normalize(1e-12) else {
            continue;
        };
        for point in centroids([a, b, c], divisions([a, b, c], spacing_mm)) {
            for value in point.coords.iter().chain(normal.iter()) {
                packed.put_f32_le(*value as f32);
            }
            count += 1;
        }
    }
    SurfaceCloud {
        point_count: count,
        packed: packed.freeze(),
    }
}

fn point_count(mesh: &Mesh, spacing_mm: f64) -> usize {
    (0..mesh.triangles.len())
        .map(|index| divisions(mesh.corners(index), spacing_mm).saturating_pow(2))
        .fold(0, usize::saturating_add)
}

/// How many parts an edge is cut into.
fn divisions([a, b, c]: [Point3; 3], spacing_mm: f64) -> usize {
    let longest = (b - a).norm().max((c - b).norm()).max((a - c).norm());
    (longest / spacing_mm).ceil().max(1.0) as usize
}

/// The centroids of the `n * n` equal triangles that a triangle is cut into.
fn centroids([a, b, c]: [Point3; 3], n: usize) -> impl Iterator<Item = Point3> {
    let at = move |i: f64, j: f64| a + (b - a) * (i / n as f64) + (c - a) * (j / n as f64);
    (0..n).flat_map(move |i| {
        (0..n - i).flat_map(move |j| {
            let (i_, j_) = (i as f64, j as f64);
            let pointing_up = Some(at(i_ + 1.0 / 3.0, j_ + 1.0 / 3.0));
            // Triangles standing on their tips lie between those of a row, one fewer than they.
            let pointing_down = (i + j + 1 < n).then(|| at(i_ + 2.0 / 3.0, j_ + 2.0 / 3.0));
            pointing_up.into_iter().chain(pointing_down)
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use arthro_geometry::Vector3;

    fn square(edge_mm: f64) -> Mesh {
        Mesh {
            vertices: [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]
                .map(|[x, y]| Point3::new(x * edge_mm, y * edge_mm, 0.0))
                .to_vec(),
            triangles: vec![[0, 1, 2], [0, 2, 3]],
        }
    }

    #[test]
    fn the_points_lie_evenly_on_the_surface_and_look_outwards() {
        let cloud = sample(&square(10.0));
        // 10 mm * sqrt 2 / 0.5 mm = 28.3, so 29 divisions of two triangles.
        assert_eq!(cloud.point_count, 2 * 29 * 29);
        let points = upload::positions(&cloud.packed, true);
        assert_eq!(points.len(), 2 * 29 * 29);
        let middle: Vector3 =
            points.iter().map(|point| point.coords).sum::<Vector3>() / points.len() as f64;
        assert!((middle - Vector3::new(5.0, 5.0, 0.0)).norm() < 1e-4);
        let normal_z = f32::from_le_bytes(cloud.packed[20..24].try_into().unwrap());
        assert!((normal_z - 1.0).abs() < 1e-6);
    }

    #[test]
    fn a_huge_surface_is_thinned_instead_of_filling_the_memory() {
        assert!(sample(&square(10_000.0)).point_count as usize <= POINTS_MAX);
    }
}
