//! Points spread evenly over a mesh, each with the outward normal of its triangle: a mesh's vertices are dense where it
//! is curved and sparse where it is flat.

use crate::{Cloud, Mesh, Point3};

/// Spreads points over the surface, at most `spacing_mm` apart, or farther apart if they were more than `points_max`:
/// then every triangle keeps at least its centroid.
pub fn sample(mesh: &Mesh, spacing_mm: f64, points_max: usize) -> Cloud {
    let mut spacing_mm = spacing_mm;
    while point_count(mesh, spacing_mm) > points_max.max(mesh.triangles.len()) {
        spacing_mm *= 1.5;
    }
    let mut cloud = Cloud::default();
    for index in 0..mesh.triangles.len() {
        let corners = mesh.corners(index);
        let [a, b, c] = corners;
        let Some(normal) = (b - a).cross(&(c - a)).try_normalize(1e-12) else {
            continue;
        };
        for point in centroids(corners, divisions(corners, spacing_mm)) {
            cloud.points.push(point);
            cloud.normals.push(normal);
        }
    }
    cloud
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
    use crate::Vector3;

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
        let cloud = sample(&square(10.0), 0.5, 500_000);
        // 10 mm * sqrt 2 / 0.5 mm = 28.3, so 29 divisions of two triangles.
        assert_eq!(cloud.points.len(), 2 * 29 * 29);
        let middle: Vector3 = cloud
            .points
            .iter()
            .map(|point| point.coords)
            .sum::<Vector3>()
            / cloud.points.len() as f64;
        assert!((middle - Vector3::new(5.0, 5.0, 0.0)).norm() < 1e-9);
        assert!(cloud.normals.iter().all(|normal| normal.z == 1.0));
    }

    #[test]
    fn a_huge_surface_is_thinned_instead_of_filling_the_memory() {
        assert!(sample(&square(10_000.0), 0.5, 500_000).points.len() <= 500_000);
    }
}
