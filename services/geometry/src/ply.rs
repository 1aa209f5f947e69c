//! PLY surface files (ascii, binary little and big endian) to and from [`Mesh`] and [`Cloud`].
//!
//! Inside the house coordinates are LPS and mm. PLY itself says neither, so a file states them in header
//! comments (`comment space RAS`, `comment unit m`; Slicer's `SPACE=RAS` counts too) or the caller states them
//! for the file. Nobody stating them is an error: a mix-up of LPS and RAS is a half turn that passes every shape check.

use ply_rs_bw::parser::{ParseError, Parser, Reader};
use ply_rs_bw::ply::{Header, Property, PropertyAccess, PropertyAccessResult};

use crate::{Cloud, Mesh, Point3, Vector3};

mod stated;

pub use stated::{Space, Stated, Unit};

/// Most vertices a file may have.
pub const MAX_VERTICES: usize = 2_000_000;
/// Most triangles a file may have, polygons counted as the triangles they fall into.
pub const MAX_TRIANGLES: usize = 4_000_000;

/// Why a PLY file was refused.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// Not a PLY file, or cut short.
    #[error("not a readable PLY file")]
    Format(#[source] ParseError),
    /// Neither the file nor the caller says it.
    #[error(
        "the file does not state its {0}: add `comment {1}` to its header or state it with the file"
    )]
    Unstated(&'static str, &'static str),
    /// The statement is not one of the known words.
    #[error("the file states {field} {value:?}, known are {known}")]
    UnknownStatement {
        /// `space` or `unit`.
        field: &'static str,
        /// What stands in the file.
        value: String,
        /// The words that are understood.
        known: &'static str,
    },
    /// Two statements contradict each other.
    #[error("{field} is stated as both {first} and {second}")]
    Contradiction {
        /// `space` or `unit`.
        field: &'static str,
        /// The first statement.
        first: String,
        /// The statement that contradicts it.
        second: String,
    },
    /// A part that the reader needs is absent.
    #[error("the file has no {0}")]
    Missing(&'static str),
    /// More elements than are accepted, or than the file can hold.
    #[error("the file announces {count} elements {element:?}, the limit is {limit}")]
    TooMany {
        /// Name of the element.
        element: String,
        /// Announced count.
        count: usize,
        /// Limit.
        limit: usize,
    },
    /// A coordinate is NaN or infinite.
    #[error("vertex[{vertex}].{field} is {value}, must be finite")]
    NotFinite {
        /// Index of the vertex.
        vertex: usize,
        /// Property.
        field: &'static str,
        /// Its value.
        value: f64,
    },
    /// A normal has no direction.
    #[error("vertex[{vertex}] has a normal of length {length}, must be 1")]
    NoDirection {
        /// Index of the vertex.
        vertex: usize,
        /// Length of the normal.
        length: f64,
    },
    /// A face names a vertex that is not there.
    #[error("face[{face}] names vertex {index}, the file has {vertices}")]
    IndexOutOfRange {
        /// Index of the face.
        face: usize,
        /// The vertex it names.
        index: i64,
        /// How many vertices there are.
        vertices: usize,
    },
    /// A face with fewer than three corners.
    #[error("face[{face}] has {corners} corners, needs at least 3")]
    TooFewCorners {
        /// Index of the face.
        face: usize,
        /// How many corners it has.
        corners: usize,
    },
}

/// Reads a surface into LPS and mm; polygons become fans of triangles.
pub fn read_mesh(bytes: &[u8], stated: Option<Stated>) -> Result<Mesh, Error> {
    let (vertices, faces) = read(bytes, stated)?;
    if faces.is_empty() {
        return Err(Error::Missing("faces"));
    }
    let triangles = triangles(&faces, vertices.points.len())?;
    Ok(Mesh {
        vertices: vertices.points,
        triangles,
    })
}

/// Reads the vertices of a file into LPS and mm, with unit normals if they have `nx ny nz`; faces are left out.
pub fn read_cloud(bytes: &[u8], stated: Option<Stated>) -> Result<Cloud, Error> {
    Ok(read(bytes, stated)?.0)
}

/// A binary little-endian file tagged LPS and mm, float32 coordinates.
pub fn write_mesh(mesh: &Mesh) -> Vec<u8> {
    let mut bytes = header(mesh.vertices.len(), false, Some(mesh.triangles.len()));
    for vertex in &mesh.vertices {
        put(&mut bytes, &vertex.coords);
    }
    for triangle in &mesh.triangles {
        bytes.push(3);
        for index in triangle {
            bytes.extend_from_slice(&index.to_le_bytes());
        }
    }
    bytes
}

/// A binary little-endian file tagged LPS and mm, float32 coordinates, with normals if the cloud has them.
pub fn write_cloud(cloud: &Cloud) -> Vec<u8> {
    let has_normals = !cloud.points.is_empty() && cloud.normals.len() == cloud.points.len();
    let mut bytes = header(cloud.points.len(), has_normals, None);
    for (index, point) in cloud.points.iter().enumerate() {
        put(&mut bytes, &point.coords);
        if has_normals {
            put(&mut bytes, &cloud.normals[index]);
        }
    }
    bytes
}

// === reading ===

fn read(bytes: &[u8], stated: Option<Stated>) -> Result<(Cloud, Vec<Face>), Error> {
    let mut reader = Reader::new(bytes);
    let header = Parser::<Skipped>::new()
        .read_header(&mut reader)
        .map_err(Error::Format)?;
    check_counts(&header, bytes.len())?;
    let to_lps_mm = stated::to_lps_mm(&header, stated)?;

    let (mut vertices, mut faces) = (Vec::new(), Vec::new());
    for (name, element) in &header.elements {
        match name.as_str() {
            "vertex" => {
                for property in ["x", "y", "z"] {
                    if !element.properties.contains_key(property) {
                        return Err(Error::Missing("vertex properties x, y and z"));
                    }
                }
                vertices = Parser::<Vertex>::new()
                    .read_payload_for_element(&mut reader, element, &header)
                    .map_err(Error::Format)?;
            }
            "face" => {
                faces = Parser::<Face>::new()
                    .read_payload_for_element(&mut reader, element, &header)
                    .map_err(Error::Format)?;
            }
            _ => {
                Parser::<Skipped>::new()
                    .read_payload_for_element(&mut reader, element, &header)
                    .map_err(Error::Format)?;
            }
        }
    }
    if vertices.is_empty() {
        return Err(Error::Missing("vertices"));
    }
    Ok((cloud(&vertices, to_lps_mm)?, faces))
}

/// Refuses by the header, before anything is allocated. An element takes at least one byte of the file.
fn check_counts(header: &Header, file_bytes: usize) -> Result<(), Error> {
    for (name, element) in &header.elements {
        let limit = match name.as_str() {
            "vertex" => MAX_VERTICES,
            "face" => MAX_TRIANGLES,
            _ => file_bytes,
        };
        if element.count > limit.min(file_bytes) {
            return Err(Error::TooMany {
                element: name.clone(),
                count: element.count,
                limit: limit.min(file_bytes),
            });
        }
    }
    Ok(())
}

fn cloud(vertices: &[Vertex], to_lps_mm: Vector3) -> Result<Cloud, Error> {
    let has_normals = vertices[0].values[3..].iter().all(Option::is_some);
    let axes = to_lps_mm.map(f64::signum);
    let mut cloud = Cloud::default();
    for (index, vertex) in vertices.iter().enumerate() {
        let mut values = [0.0; 6];
        for ((value, read), field) in values.iter_mut().zip(vertex.values).zip(VERTEX_FIELDS) {
            *value = read.unwrap_or_default();
            if !value.is_finite() {
                return Err(Error::NotFinite {
                    vertex: index,
                    field,
                    value: *value,
                });
            }
        }
        let [x, y, z, nx, ny, nz] = values;
        cloud.points.push(Point3::from(
            Vector3::new(x, y, z).component_mul(&to_lps_mm),
        ));
        if has_normals {
            let normal = Vector3::new(nx, ny, nz).component_mul(&axes);
            cloud
                .normals
                .push(normal.try_normalize(1e-6).ok_or(Error::NoDirection {
                    vertex: index,
                    length: normal.norm(),
                })?);
        }
    }
    Ok(cloud)
}

fn triangles(faces: &[Face], vertices: usize) -> Result<Vec<[u32; 3]>, Error> {
    let mut triangles = Vec::with_capacity(faces.len());
    for (index, face) in faces.iter().enumerate() {
        if face.corners.len() < 3 {
            return Err(Error::TooFewCorners {
                face: index,
                corners: face.corners.len(),
            });
        }
        let mut corners = Vec::with_capacity(face.corners.len());
        for corner in &face.corners {
            match u32::try_from(*corner) {
                Ok(valid) if (valid as usize) < vertices => corners.push(valid),
                _ => {
                    return Err(Error::IndexOutOfRange {
                        face: index,
                        index: *corner,
                        vertices,
                    });
                }
            }
        }
        triangles.extend(
            corners[1..]
                .windows(2)
                .map(|edge| [corners[0], edge[0], edge[1]]),
        );
        if triangles.len() > MAX_TRIANGLES {
            return Err(Error::TooMany {
                element: "triangle".to_owned(),
                count: triangles.len(),
                limit: MAX_TRIANGLES,
            });
        }
    }
    Ok(triangles)
}

const VERTEX_FIELDS: [&str; 6] = ["x", "y", "z", "nx", "ny", "nz"];

/// A vertex as it stands in the file: values of [`VERTEX_FIELDS`].
#[derive(Default)]
struct Vertex {
    values: [Option<f64>; 6],
}

impl PropertyAccess for Vertex {
    fn new() -> Self {
        Self::default()
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        let Some(field) = VERTEX_FIELDS.iter().position(|field| *field == name) else {
            return PropertyAccessResult::Ignored;
        };
        let value = match property {
            Property::Float(value) => f64::from(value),
            Property::Double(value) => value,
            Property::Char(value) => f64::from(value),
            Property::UChar(value) => f64::from(value),
            Property::Short(value) => f64::from(value),
            Property::UShort(value) => f64::from(value),
            Property::Int(value) => f64::from(value),
            Property::UInt(value) => f64::from(value),
            _ => return PropertyAccessResult::UnsupportedType,
        };
        self.values[field] = Some(value);
        PropertyAccessResult::Set
    }
}

/// A face as it stands in the file; indices may be out of range.
#[derive(Default)]
struct Face {
    corners: Vec<i64>,
}

impl PropertyAccess for Face {
    fn new() -> Self {
        Self::default()
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        if !matches!(name, "vertex_indices" | "vertex_index") {
            return PropertyAccessResult::Ignored;
        }
        self.corners = match property {
            Property::ListInt(list) => list.into_iter().map(i64::from).collect(),
            Property::ListUInt(list) => list.into_iter().map(i64::from).collect(),
            Property::ListShort(list) => list.into_iter().map(i64::from).collect(),
            Property::ListUShort(list) => list.into_iter().map(i64::from).collect(),
            Property::ListChar(list) => list.into_iter().map(i64::from).collect(),
            Property::ListUChar(list) => list.into_iter().map(i64::from).collect(),
            _ => return PropertyAccessResult::UnsupportedType,
        };
        PropertyAccessResult::Set
    }
}

/// An element nobody asked for.
struct Skipped;

impl PropertyAccess for Skipped {
    fn new() -> Self {
        Self
    }
}

// === writing ===

fn header(vertices: usize, has_normals: bool, faces: Option<usize>) -> Vec<u8> {
    let mut text =
        String::from("ply\nformat binary_little_endian 1.0\ncomment space LPS\ncomment unit mm\n");
    text.push_str(&format!("element vertex {vertices}\n"));
    for field in &VERTEX_FIELDS[..if has_normals { 6 } else { 3 }] {
        text.push_str(&format!("property float {field}\n"));
    }
    if let Some(faces) = faces {
        text.push_str(&format!("element face {faces}\n"));
        text.push_str("property list uchar uint vertex_indices\n");
    }
    text.push_str("end_header\n");
    text.into_bytes()
}

fn put(bytes: &mut Vec<u8>, values: &Vector3) {
    for value in values.iter() {
        bytes.extend_from_slice(&(*value as f32).to_le_bytes());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const LPS_MM: Stated = Stated {
        space: Space::Lps,
        unit: Unit::Millimetre,
    };
    const TRIANGLE: &str = "element vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
        element face 1\nproperty list uchar int vertex_indices\nend_header\n\
        0 0 0\n1 0 0\n0 2 3\n3 0 1 2\n";

    fn ascii(comments: &str, body: &str) -> Vec<u8> {
        format!("ply\nformat ascii 1.0\n{comments}{body}").into_bytes()
    }

    fn coordinate() -> impl Strategy<Value = f64> {
        (-500.0..500.0f32).prop_map(f64::from)
    }

    proptest! {
        #[test]
        fn a_written_mesh_reads_back_the_same_without_being_told_its_space(
            vertices in prop::collection::vec((coordinate(), coordinate(), coordinate()), 3..40),
        ) {
            let count = vertices.len() as u32;
            let mesh = Mesh {
                vertices: vertices.into_iter().map(|(x, y, z)| Point3::new(x, y, z)).collect(),
                triangles: (2..count).map(|i| [0, i - 1, i]).collect(),
            };
            prop_assert_eq!(read_mesh(&write_mesh(&mesh), None).unwrap(), mesh);
        }

        #[test]
        fn no_bytes_make_the_reader_panic(mut bytes in prop::collection::vec(any::<u8>(), 0..200), cut in 0usize..400) {
            let _ = read_mesh(&bytes, Some(LPS_MM));
            let mut file = ascii("", TRIANGLE);
            file.truncate(cut);
            file.append(&mut bytes);
            let _ = read_mesh(&file, Some(LPS_MM));
        }
    }

    #[test]
    fn a_written_cloud_keeps_its_normals() {
        let cloud = Cloud {
            points: vec![Point3::new(1.0, 2.0, 3.0), Point3::new(4.0, 5.0, 6.0)],
            normals: vec![Vector3::x(), -Vector3::z()],
        };
        assert_eq!(read_cloud(&write_cloud(&cloud), None).unwrap(), cloud);
    }

    #[test]
    fn a_file_that_states_neither_space_nor_unit_is_refused_unless_the_caller_does() {
        let file = ascii("comment made by someone\n", TRIANGLE);
        let error = read_mesh(&file, None).unwrap_err().to_string();
        assert!(error.contains("does not state its space"), "{error}");
        let error = read_mesh(&ascii("comment space LPS\n", TRIANGLE), None)
            .unwrap_err()
            .to_string();
        assert!(error.contains("does not state its unit"), "{error}");
        assert_eq!(
            read_mesh(&file, Some(LPS_MM)).unwrap().triangles,
            [[0, 1, 2]]
        );
    }

    #[test]
    fn ras_metres_become_lps_millimetres() {
        for comments in [
            "comment space RAS\ncomment unit m\n",
            "comment 3D Slicer output. SPACE=RAS\ncomment unit=m\n",
        ] {
            let mesh = read_mesh(&ascii(comments, TRIANGLE), None).unwrap();
            assert_eq!(mesh.vertices[1], Point3::new(-1000.0, 0.0, 0.0));
            assert_eq!(mesh.vertices[2], Point3::new(0.0, -2000.0, 3000.0));
        }
    }

    #[test]
    fn statements_that_contradict_or_are_unknown_are_refused() {
        let error = |comments: &str, stated| {
            read_mesh(&ascii(comments, TRIANGLE), stated)
                .unwrap_err()
                .to_string()
        };
        assert!(error("comment space RAS\ncomment unit mm\n", Some(LPS_MM)).contains("both"));
        assert!(error("comment space XYZ\ncomment unit mm\n", None).contains("XYZ"));
        assert!(error("comment space LPS\ncomment unit inch\n", None).contains("inch"));
    }

    #[test]
    fn big_endian_files_and_polygons_are_read() {
        let mut file = b"ply\nformat binary_big_endian 1.0\nelement vertex 4\nproperty double x\nproperty double y\n\
            property double z\nproperty uchar red\nelement face 1\nproperty list uchar int vertex_index\nend_header\n"
            .to_vec();
        for [x, y] in [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0f64]] {
            for value in [x, y, 7.5] {
                file.extend_from_slice(&value.to_be_bytes());
            }
            file.push(255);
        }
        file.push(4);
        for index in 0..4i32 {
            file.extend_from_slice(&index.to_be_bytes());
        }
        let mesh = read_mesh(&file, Some(LPS_MM)).unwrap();
        assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3]]);
        assert_eq!(mesh.vertices[2], Point3::new(1.0, 1.0, 7.5));
    }

    #[test]
    fn a_nan_is_refused_by_name() {
        let cloud = Cloud::new(vec![Point3::origin(), Point3::new(0.0, f64::NAN, 0.0)]);
        let error = read_cloud(&write_cloud(&cloud), None).unwrap_err();
        assert_eq!(error.to_string(), "vertex[1].y is NaN, must be finite");
    }

    #[test]
    fn broken_files_are_refused_by_name_value_and_limit() {
        let error = |from: &str, to: &str| {
            read_mesh(&ascii("", &TRIANGLE.replace(from, to)), Some(LPS_MM))
                .unwrap_err()
                .to_string()
        };
        assert!(error("3 0 1 2", "3 0 1 3").contains("vertex 3, the file has 3"));
        assert!(error("3 0 1 2", "3 0 1 -1").contains("vertex -1"));
        assert!(error("3 0 1 2", "2 0 1").contains("2 corners"));
        assert!(error("vertex 3", "vertex 10000000").contains("10000000"));
        assert!(error("float z", "float w").contains("x, y and z"));
        assert!(read_mesh(b"", Some(LPS_MM)).is_err());
        let whole = ascii("", TRIANGLE);
        assert!(read_mesh(&whole[..whole.len() - 12], Some(LPS_MM)).is_err());
    }
}
