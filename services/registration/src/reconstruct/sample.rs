//! Clouds out of meshes: points spread evenly over a surface, each with its normal.

use arthro_geometry::{Cloud, Mesh, Point3};

/// The fractional parts of these multiples fill the unit square evenly (Roberts, "The unreasonable effectiveness of
/// quasirandom sequences", 2018): inverses of the plastic number and of its square.
const R2: [f64; 2] = [0.754_877_666_246_692_7, 0.569_840_290_998_053_3];

/// `count` points at equal steps of area, with the normals of the vertices interpolated. The same mesh gives the same
/// cloud. Empty for a mesh without area.
pub fn sample(mesh: &Mesh, count: usize) -> Cloud {
    let normals = mesh.vertex_normals();
    let step_mm2 = mesh.area_mm2() / count as f64;
    let mut cloud = Cloud::default();
    if !(step_mm2 > 0.0 && step_mm2.is_finite()) {
        return cloud;
    }
    let mut passed_mm2 = 0.0;
    for (index, triangle) in mesh.triangles.iter().enumerate() {
        let [a, b, c] = mesh.corners(index);
        let (along, up) = (b - a, c - a);
        let facing = along.cross(&up).try_normalize(0.0).unwrap_or_default();
        passed_mm2 += along.cross(&up).norm() / 2.0;
        while cloud.points.len() < count
            && (cloud.points.len() as f64 + 0.5) * step_mm2 <= passed_mm2
        {
            let number = cloud.points.len() as f64 + 0.5;
            let [mut s, mut t] = R2.map(|r| (number * r).fract());
            // The half of the parallelogram beyond the triangle is turned onto it.
            if s + t > 1.0 {
                (s, t) = (1.0 - s, 1.0 - t);
            }
            let [na, nb, nc] = triangle.map(|corner| normals[corner as usize]);
            let normal = na * (1.0 - s - t) + nb * s + nc * t;
            cloud.points.push(Point3::from(a + along * s + up * t));
            cloud
                .normals
                .push(normal.try_normalize(1e-9).unwrap_or(facing));
        }
    }
    cloud
}
