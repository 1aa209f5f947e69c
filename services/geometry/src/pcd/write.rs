//! Writes PCD files tagged LPS and mm, with float32 coordinates.

use super::{Encoding, FIELDS, lzf};
use crate::{Cloud, Point3};

/// A binary file tagged LPS and mm, with normals if the cloud has them, seen from `viewpoint` (mm).
pub fn write_cloud(cloud: &Cloud, viewpoint: Option<Point3>) -> Vec<u8> {
    write_cloud_as(cloud, viewpoint, Encoding::Binary)
}

/// As [`write_cloud`], in any encoding. A packed file holds at most 4 GiB.
pub fn write_cloud_as(cloud: &Cloud, viewpoint: Option<Point3>, encoding: Encoding) -> Vec<u8> {
    let has_normals = !cloud.points.is_empty() && cloud.normals.len() == cloud.points.len();
    let fields = &FIELDS[..if has_normals { 6 } else { 3 }];
    let mut bytes = header(fields, cloud.points.len(), viewpoint, encoding).into_bytes();
    let value = |point: usize, field: usize| match field {
        0..3 => cloud.points[point][field] as f32,
        _ => cloud.normals[point][field - 3] as f32,
    };
    let points = 0..cloud.points.len();
    match encoding {
        Encoding::Ascii => {
            for point in points {
                let words: Vec<String> = (0..fields.len())
                    .map(|field| value(point, field).to_string())
                    .collect();
                bytes.extend_from_slice(words.join(" ").as_bytes());
                bytes.push(b'\n');
            }
        }
        Encoding::Binary => {
            for point in points {
                for field in 0..fields.len() {
                    bytes.extend_from_slice(&value(point, field).to_le_bytes());
                }
            }
        }
        Encoding::BinaryCompressed => {
            let unpacked: Vec<u8> = (0..fields.len())
                .flat_map(|field| points.clone().map(move |point| (point, field)))
                .flat_map(|(point, field)| value(point, field).to_le_bytes())
                .collect();
            let packed = lzf::pack(&unpacked);
            for length in [packed.len(), unpacked.len()] {
                bytes.extend_from_slice(&(length as u32).to_le_bytes());
            }
            bytes.extend_from_slice(&packed);
        }
    }
    bytes
}

fn header(fields: &[&str], points: usize, viewpoint: Option<Point3>, encoding: Encoding) -> String {
    let each = |word: &str| vec![word; fields.len()].join(" ");
    let mut text = String::from("# .PCD v0.7 - Point Cloud Data file format\n");
    text.push_str("# space LPS\n# unit mm\nVERSION 0.7\n");
    text.push_str(&format!("FIELDS {}\n", fields.join(" ")));
    text.push_str(&format!("SIZE {}\n", each("4")));
    text.push_str(&format!("TYPE {}\n", each("F")));
    text.push_str(&format!("COUNT {}\n", each("1")));
    text.push_str(&format!("WIDTH {points}\nHEIGHT 1\n"));
    if let Some(Point3 { coords }) = viewpoint {
        let [x, y, z] = [coords.x as f32, coords.y as f32, coords.z as f32];
        text.push_str(&format!("VIEWPOINT {x} {y} {z} 1 0 0 0\n"));
    }
    text.push_str(&format!("POINTS {points}\nDATA {}\n", encoding.word()));
    text
}
