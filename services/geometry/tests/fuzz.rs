//! Files of every kind, broken at random: no reader panics, and what is read in spite of it is sound.
//!
//! `ARTHRO_FUZZ_ITERATIONS` says how many files are broken and `ARTHRO_FUZZ_SEED` which one is the first, so that a
//! failure, which names its seed, is repeated with one iteration.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::str::FromStr;

use arthro_geometry::surface::{MAX_TRIANGLES, MAX_VERTICES, Surface};
use arthro_geometry::{Cloud, Mesh, Point3, Vector3, obj, pcd, ply, stl, surface_file};
use rand::Rng;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

const DEFAULT_ITERATIONS: u64 = 100_000;

#[test]
fn broken_files_of_every_kind_are_refused_or_read_soundly() {
    let first: u64 = from_environment("ARTHRO_FUZZ_SEED").unwrap_or_default();
    let iterations = from_environment("ARTHRO_FUZZ_ITERATIONS").unwrap_or(DEFAULT_ITERATIONS);
    let files = files();
    for seed in first..first + iterations {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let broken = broken(&files, &mut rng);
        let outcome = catch_unwind(AssertUnwindSafe(|| assert_sound(&broken)));
        assert!(
            outcome.is_ok(),
            "repeat with ARTHRO_FUZZ_SEED={seed} ARTHRO_FUZZ_ITERATIONS=1, the file is\n{}",
            broken.escape_ascii()
        );
    }
}

#[test]
fn the_files_are_accepted_before_they_are_broken() {
    for file in files() {
        let name = if file.starts_with(b"#") || file.starts_with(b"mtllib") {
            "a.obj"
        } else {
            "a"
        };
        let read = surface_file::read_as_it_stands(name, &file);
        assert!(read.is_ok(), "{read:?}: {}", file.escape_ascii());
    }
}

fn from_environment<T: FromStr>(name: &str) -> Option<T> {
    let number = std::env::var(name).ok()?.parse().ok();
    Some(number.expect("the variable holds a count"))
}

// === what must hold ===

fn assert_sound(file: &[u8]) {
    for read in [ply::read, pcd::read, stl::read, obj::read] {
        if let Ok(surface) = read(file) {
            assert_surface(surface);
        }
    }
    let _ = surface_file::read_as_it_stands("a", file);
}

fn assert_surface(surface: Surface) {
    let Surface {
        cloud, triangles, ..
    } = surface.clone();
    assert!((1..=MAX_VERTICES).contains(&cloud.points.len()));
    assert!(triangles.len() <= MAX_TRIANGLES);
    for coordinate in cloud.points.iter().flat_map(|point| point.iter()) {
        assert!(coordinate.is_finite());
    }
    assert!(cloud.normals.is_empty() || cloud.normals.len() == cloud.points.len());
    for normal in &cloud.normals {
        assert!((normal.norm() - 1.0).abs() < 1e-9);
    }
    for vertex in triangles.iter().flatten() {
        assert!((*vertex as usize) < cloud.points.len());
    }

    // OBJ keeps every digit, so what was read once reads back the same.
    let again = obj::read(&obj::write_cloud(&cloud))
        .expect("a cloud that was read is written soundly")
        .cloud;
    assert_eq!(again.points, cloud.points);
    assert_eq!(again.normals.len(), cloud.normals.len());
    if let Ok(mesh) = surface.into_mesh() {
        let again =
            obj::read(&obj::write_mesh(&mesh)).expect("a mesh that was read is written soundly");
        assert_eq!(again.triangles, mesh.triangles);
    }
}

// === whole files ===

fn files() -> Vec<Vec<u8>> {
    let points = [
        [4.0, 0.0, 0.0],
        [-4.0, 0.0, 0.0],
        [0.0, 3.5, 0.0],
        [0.0, -3.5, 0.0],
        [0.0, 0.0, 2.25],
        [0.0, 0.0, -2.25],
    ]
    .map(Point3::from);
    let mesh = Mesh {
        vertices: points.to_vec(),
        triangles: vec![
            [0, 2, 4],
            [2, 1, 4],
            [1, 3, 4],
            [3, 0, 4],
            [2, 0, 5],
            [1, 2, 5],
            [3, 1, 5],
            [0, 3, 5],
        ],
    };
    let with_normals = Cloud {
        points: points.to_vec(),
        normals: points
            .iter()
            .map(|point| point.coords.normalize())
            .collect(),
    };
    let without_normals = Cloud::new(points.to_vec());
    let mut files = vec![obj::write_mesh(&mesh), obj::write_cloud(&with_normals)];
    for encoding in [
        ply::Encoding::Ascii,
        ply::Encoding::BinaryLittleEndian,
        ply::Encoding::BinaryBigEndian,
    ] {
        files.push(ply::write_mesh_as(&mesh, encoding));
        files.push(ply::write_cloud_as(&with_normals, encoding));
    }
    for encoding in [
        pcd::Encoding::Ascii,
        pcd::Encoding::Binary,
        pcd::Encoding::BinaryCompressed,
    ] {
        let viewpoint = Some(Point3::from(Vector3::new(0.0, 0.0, 350.0)));
        files.push(pcd::write_cloud_as(&with_normals, viewpoint, encoding));
        files.push(pcd::write_cloud_as(&without_normals, None, encoding));
    }
    for encoding in [stl::Encoding::Ascii, stl::Encoding::Binary] {
        files.push(stl::write_mesh_as(&mesh, encoding));
    }
    files.extend(FOREIGN.map(|file| file.as_bytes().to_vec()));
    files
}

/// Files with what the own writers do not write.
const FOREIGN: [&str; 4] = [
    "mtllib knee.mtl\no m\nv 0 0 0\nv 1 0 0 0.5 0.5 0.5\nv 1 1 0\nv 0 1 0\nvt 0 0\nvn 0 0 2\nvn 1 0 0\n\
     usemtl t\ns off\nf 1/1/1 2/1/1 3/1/1 4/1/1\nf -4//-2 -3//-2 -1//-2\nf 1 2/1 3\n",
    "ply\r\nformat ascii 1.0\r\nobj_info x\r\ncomment 3D Slicer output. SPACE=RAS\r\ncomment unit=m\r\n\
     element camera 1\r\nproperty float f\r\nelement vertex 4\r\nproperty list uchar float h\r\n\
     property double x\r\nproperty short y\r\nproperty uint8 z\r\nelement face 1\r\nproperty uchar c\r\n\
     property list ushort int vertex_index\r\nelement edge 1\r\nproperty int a\r\nend_header\r\n35\r\n\
     2 0.5 0.25 1e2 -2 3\r\n0 4 5 6\r\n1 1 7 8 9\r\n0 0 1 2\r\n7 4 0 1 2 3\r\n-1\r\n",
    "# .PCD v.7 - Point Cloud Data file format\n# space RAS\n# unit m\nVERSION .7\nFIELDS rgb x y _ z\n\
     SIZE 4 8 2 1 1\nTYPE F F I U U\nCOUNT 1 1 1 3 1\nWIDTH 2\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\n\
     POINTS 2\nDATA ascii\n4.2108e+06 1.5 -2 0 0 0 3\n4.808e+06 4.5 -5 1 2 3 6\n",
    "solid 3D Slicer output. SPACE=RAS\n facet normal 0 0 1\n  outer loop\n   vertex 0 0 0\n   vertex 1e1 0 0\n   \
     vertex 0 2.5 -3\n  endloop\n endfacet\nendsolid a\nsolid UNIT=mm\nendsolid",
];

// === and how they are broken ===

fn broken(files: &[Vec<u8>], rng: &mut ChaCha8Rng) -> Vec<u8> {
    let mut file = files[rng.random_range(0..files.len())].clone();
    for _ in 0..rng.random_range(1..=4) {
        break_once(&mut file, files, rng);
    }
    file
}

fn break_once(file: &mut Vec<u8>, files: &[Vec<u8>], rng: &mut ChaCha8Rng) {
    let mut place = |length: usize| rng.random_range(0..=length);
    let (a, b) = (place(file.len()), place(file.len()));
    let (start, end) = (a.min(b), a.max(b));
    match rng.random_range(0..9) {
        0 => file.truncate(a),
        1 => drop(file.drain(start..end.min(start + 40))),
        2 => {
            let part = file[start..end.min(start + 80)].to_vec();
            file.splice(b..b, part);
        }
        3 => {
            let other = &files[rng.random_range(0..files.len())];
            let from = rng.random_range(0..=other.len());
            file.splice(start..end, other[from..].iter().copied());
        }
        4 => file.insert(a, rng.random()),
        5 | 6 => replace_number(file, rng),
        7 if file.len() >= 4 => {
            let at = rng.random_range(0..=file.len() - 4);
            let number = [
                0,
                1,
                0x7FFF_FFFF,
                u32::MAX,
                f32::NAN.to_bits(),
                rng.random(),
            ];
            let number = number[rng.random_range(0..number.len())];
            file[at..at + 4].copy_from_slice(&number.to_le_bytes());
        }
        _ => {
            if let Some(byte) = file.get_mut(a) {
                *byte ^= 1 << rng.random_range(0..8);
            }
        }
    }
}

/// Puts another number in the place of one that is spelt out.
fn replace_number(file: &mut Vec<u8>, rng: &mut ChaCha8Rng) {
    const NUMBERS: [&str; 22] = [
        "0",
        "1",
        "-1",
        "2",
        "3",
        "4",
        "5",
        "7",
        "8",
        "255",
        "256",
        "4096",
        "65536",
        "2000000",
        "2000001",
        "4294967295",
        "9223372036854775807",
        "-9223372036854775808",
        "18446744073709551616",
        "1e400",
        "nan",
        "-1e-310",
    ];
    let is_digit = |at: usize| file.get(at).is_some_and(u8::is_ascii_digit);
    let starts: Vec<usize> = (0..file.len())
        .filter(|at| is_digit(*at) && (*at == 0 || !is_digit(at - 1)))
        .collect();
    if starts.is_empty() {
        return;
    }
    let start = starts[rng.random_range(0..starts.len())];
    let end = (start..file.len())
        .find(|at| !is_digit(*at))
        .unwrap_or(file.len());
    let number = NUMBERS[rng.random_range(0..NUMBERS.len())];
    file.splice(start..end, number.bytes());
}
