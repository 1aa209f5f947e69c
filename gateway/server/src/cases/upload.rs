//! Uploads: packed bytes that were announced, collected up to what was announced, and checked before
//! anything is kept.

use arthro_geometry::{Point3, cloud};
use bytes::{Bytes, BytesMut};

use crate::error::{Error, Result, Violation};

/// Most points of a cloud.
pub const POINTS_MAX: u32 = 2_000_000;
/// Most vertices of a model.
pub const VERTICES_MAX: u32 = 500_000;
/// Most triangles of a model.
pub const TRIANGLES_MAX: u32 = 500_000;
/// Most pixels of a depth image.
pub const PIXELS_MAX: u64 = 8_000_000;
/// Most depth values of all frames of a scene.
pub const DEPTHS_MAX: u64 = 32_000_000;
/// Fewest points that can be registered.
pub const POINTS_MIN: u32 = 100;
/// No meniscus is smaller in its longest extent; a smaller one was given in metres, mm.
pub const EXTENT_MIN_MM: f64 = 5.0;
/// A normal's length may differ from 1 by this much.
const UNIT_TOLERANCE: f64 = 1e-2;

/// Packed bytes of which the header says how many there are. Holds no more than that.
#[derive(Debug)]
pub struct Announced {
    field: &'static str,
    expected: usize,
    received: BytesMut,
}

impl Announced {
    /// Waits for `expected` bytes in the field named.
    pub fn new(field: &'static str, expected: usize) -> Self {
        Self {
            field,
            expected,
            received: BytesMut::new(),
        }
    }

    /// Takes the next chunk; refuses more than was announced.
    pub fn push(&mut self, chunk: &[u8]) -> Result<()> {
        let total = self.received.len() + chunk.len();
        if total > self.expected {
            return Err(Error::invalid(
                self.field,
                format!(
                    "holds at least {total} bytes; the header announced {}",
                    self.expected
                ),
            ));
        }
        self.received.extend_from_slice(chunk);
        Ok(())
    }

    /// All bytes; refuses less than was announced.
    pub fn finish(self) -> Result<Bytes> {
        if self.received.len() < self.expected {
            return Err(Error::invalid(
                self.field,
                format!(
                    "holds {} bytes; the header announced {}",
                    self.received.len(),
                    self.expected
                ),
            ));
        }
        Ok(self.received.freeze())
    }
}

/// Refuses a count outside its limits, before anything is received.
pub fn check_count(field: &str, count: u32, lowest: u32, highest: u32) -> Result<(), Violation> {
    if (lowest..=highest).contains(&count) {
        return Ok(());
    }
    Err(Violation::new(
        field,
        format!("is {count}; must be within {lowest} .. {highest}"),
    ))
}

/// Checks packed points: every number finite, every normal unit.
pub fn check_points(field: &str, packed: &[u8], has_normals: bool) -> Result<(), Violation> {
    let floats_per_point = if has_normals { 6 } else { 3 };
    for (index, record) in packed.chunks_exact(4 * floats_per_point).enumerate() {
        let values = floats(record);
        if let Some(value) = values.clone().find(|value| !value.is_finite()) {
            return Err(Violation::new(
                format!("{field}[{index}]"),
                format!("holds {value}; must be finite"),
            ));
        }
        if has_normals {
            let length = values
                .skip(3)
                .map(|value| value * value)
                .sum::<f64>()
                .sqrt();
            if (length - 1.0).abs() > UNIT_TOLERANCE {
                return Err(Violation::new(
                    format!("{field}[{index}].normal"),
                    format!("has the length {length}; must be 1 within {UNIT_TOLERANCE}"),
                ));
            }
        }
    }
    Ok(())
}

/// Refuses points whose longest extent is below [`EXTENT_MIN_MM`].
pub fn check_extent(field: &str, points: &[Point3]) -> Result<(), Violation> {
    let longest = cloud::bounds(points).map_or(0.0, |(low, high)| (high - low).max());
    if longest >= EXTENT_MIN_MM {
        return Ok(());
    }
    Err(Violation::new(
        field,
        format!(
            "spans {longest} mm in its longest direction; must be at least {EXTENT_MIN_MM} mm: are these metres?"
        ),
    ))
}

/// Checks packed triangles: every index names a vertex.
pub fn check_triangles(field: &str, packed: &[u8], vertex_count: u32) -> Result<(), Violation> {
    let out_of_range = triangles(packed)
        .enumerate()
        .find(|(_, triangle)| triangle.iter().any(|index| *index >= vertex_count));
    match out_of_range {
        None => Ok(()),
        Some((index, triangle)) => Err(Violation::new(
            format!("{field}[{index}]"),
            format!("is {triangle:?}; indices must be below {vertex_count}"),
        )),
    }
}

/// Unpacks positions, leaving normals out.
pub fn positions(packed: &[u8], has_normals: bool) -> Vec<Point3> {
    let floats_per_point = if has_normals { 6 } else { 3 };
    packed
        .chunks_exact(4 * floats_per_point)
        .map(|record| Point3::from_slice(&floats(record).take(3).collect::<Vec<_>>()))
        .collect()
}

/// Unpacks triangles.
pub fn triangles(packed: &[u8]) -> impl Iterator<Item = [u32; 3]> {
    packed.chunks_exact(12).map(|record| {
        [0, 4, 8].map(|at| {
            u32::from_le_bytes([record[at], record[at + 1], record[at + 2], record[at + 3]])
        })
    })
}

fn floats(packed: &[u8]) -> impl Iterator<Item = f64> + Clone {
    packed
        .chunks_exact(4)
        .map(|word| f64::from(f32::from_le_bytes([word[0], word[1], word[2], word[3]])))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn packed(values: &[f32]) -> Vec<u8> {
        values
            .iter()
            .flat_map(|value| value.to_le_bytes())
            .collect()
    }

    #[test]
    fn more_than_was_announced_is_refused_at_once() {
        let mut announced = Announced::new("points", 8);
        announced.push(&[0; 6]).unwrap();
        let error = announced.push(&[0; 6]).unwrap_err().to_string();
        assert_eq!(
            error,
            "points: holds at least 12 bytes; the header announced 8"
        );
    }

    #[test]
    fn less_than_was_announced_is_refused() {
        let mut announced = Announced::new("points", 8);
        announced.push(&[0; 6]).unwrap();
        assert!(announced.finish().is_err());
    }

    #[test]
    fn a_point_that_is_not_a_number_is_named() {
        let cloud = packed(&[0.0, 0.0, 0.0, 1.0, f32::NAN, 0.0]);
        let violation = check_points("points", &cloud, false).unwrap_err();
        assert_eq!(violation.field, "points[1]");
        assert_eq!(violation.description, "holds NaN; must be finite");
    }

    #[test]
    fn a_normal_that_is_not_unit_is_named() {
        let cloud = packed(&[0.0, 0.0, 0.0, 0.0, 0.0, 2.0]);
        let violation = check_points("points", &cloud, true).unwrap_err();
        assert_eq!(violation.field, "points[0].normal");
    }

    #[test]
    fn a_meniscus_in_metres_is_refused() {
        let points = positions(&packed(&[0.0, 0.0, 0.0, 0.04, 0.03, 0.01]), false);
        let violation = check_extent("mesh.vertices", &points).unwrap_err();
        assert!(violation.description.contains("are these metres?"));
    }

    #[test]
    fn a_triangle_without_its_vertex_is_named() {
        let packed: Vec<u8> = [0u32, 1, 2, 0, 1, 3]
            .iter()
            .flat_map(|index| index.to_le_bytes())
            .collect();
        let violation = check_triangles("mesh.triangles", &packed, 3).unwrap_err();
        assert_eq!(violation.field, "mesh.triangles[1]");
        assert_eq!(
            violation.description,
            "is [0, 1, 3]; indices must be below 3"
        );
    }
}
