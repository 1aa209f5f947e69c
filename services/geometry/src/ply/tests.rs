use proptest::prelude::*;

use super::*;
use crate::Point3;
use crate::surface::samples;
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

const ENCODINGS: [Encoding; 3] = [
    Encoding::Ascii,
    Encoding::BinaryLittleEndian,
    Encoding::BinaryBigEndian,
];

proptest! {
    #[test]
    fn a_written_mesh_reads_back_the_same_without_being_told_its_space(mesh in samples::mesh()) {
        prop_assert_eq!(&read_mesh(&write_mesh(&mesh), None).unwrap(), &mesh);
        for encoding in ENCODINGS {
            prop_assert_eq!(&read_mesh(&write_mesh_as(&mesh, encoding), None).unwrap(), &mesh);
        }
    }

    #[test]
    fn a_written_cloud_reads_back_the_same_with_its_normals(cloud in samples::cloud()) {
        prop_assert_eq!(&read_cloud(&write_cloud(&cloud), None).unwrap(), &cloud);
        for encoding in ENCODINGS {
            prop_assert_eq!(&read_cloud(&write_cloud_as(&cloud, encoding), None).unwrap(), &cloud);
        }
    }

    #[test]
    fn a_file_cut_short_anywhere_is_refused(mesh in samples::mesh(), cut in any::<prop::sample::Index>()) {
        for encoding in ENCODINGS {
            let file = write_mesh_as(&mesh, encoding);
            // The last number of a text may lose digits and is a number still.
            let last_line = file[..file.len() - 1].iter().rposition(|byte| *byte == b'\n');
            let whole = match encoding {
                Encoding::Ascii => last_line.unwrap() + 1,
                _ => file.len(),
            };
            prop_assert!(read(&file[..cut.index(whole)]).is_err());
        }
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

#[test]
fn what_the_header_does_not_describe_is_refused_with_its_line() {
    let error = |from: &str, to: &str| {
        let file = String::from_utf8(ascii("", TRIANGLE)).unwrap();
        let file = file.replace(from, to);
        read(file.as_bytes()).unwrap_err().to_string()
    };
    assert_eq!(
        error("1 0 0\n", "1 0\n"),
        "line 11: the line ends before \"z\""
    );
    assert_eq!(
        error("1 0 0\n", "1 0 0 9\n"),
        "line 11: \"9\" is one word too many"
    );
    assert_eq!(
        error("1 0 0\n", "1 zero 0\n"),
        "line 11: \"y\" is \"zero\", must be a number of type float32"
    );
    assert_eq!(
        error("property float y", "property real y"),
        "line 5: \"real\" is no type of number"
    );
    assert_eq!(
        error("property float y", "property float x"),
        "line 5: property \"x\" is there twice"
    );
    assert_eq!(
        error("format ascii 1.0", "format ascii 2.0"),
        "line 2: the version is \"2.0\", known is 1.0"
    );
    assert_eq!(
        error("format ascii 1.0\n", ""),
        "the file has no `format` line"
    );
    assert!(error("list uchar", "list float").contains("length of a list"));
    assert!(error("3 0 1 2", "3 0 1 1.5").contains("must be a number of type int32"));
    assert!(error("ply\n", "plow\n").contains("must be `ply`"));
}

#[test]
fn line_ends_and_blank_lines_do_not_matter() {
    let file = String::from_utf8(ascii("comment space LPS\ncomment unit mm\n", TRIANGLE)).unwrap();
    let plain = read_mesh(file.as_bytes(), None).unwrap();
    for other in [
        file.replace('\n', "\r\n"),
        file.trim_end().to_owned(),
        file.replace("end_header\n", "end_header\n\n"),
    ] {
        assert_eq!(read_mesh(other.as_bytes(), None).unwrap(), plain);
    }
}

#[test]
fn a_comment_need_not_be_utf8() {
    let mut file = b"ply\nformat ascii 1.0\ncomment Universit\xE4t\n".to_vec();
    file.extend_from_slice(TRIANGLE.as_bytes());
    assert!(read(&file).is_ok());
}

#[test]
fn lists_and_elements_that_nobody_asked_for_are_skipped() {
    let file = b"ply\nformat ascii 1.0\nelement camera 1\nproperty float f\nelement vertex 1\n\
        property list uchar float history\nproperty float x\nproperty float y\nproperty float z\n\
        element edge 1\nproperty int a\nproperty int b\nend_header\n35\n2 0.5 0.25 1 2 3\n0 0\n";
    let cloud = read_cloud(file, Some(LPS_MM)).unwrap();
    assert_eq!(cloud.points, [Point3::new(1.0, 2.0, 3.0)]);
}

#[test]
fn counts_beyond_the_limit_or_the_file_are_refused_before_anything_is_read() {
    for count in [2_000_001, 150] {
        let file = format!(
            "ply\nformat binary_little_endian 1.0\nelement vertex {count:07}\nproperty float x\n\
            property float y\nproperty float z\nend_header\n"
        );
        let error = read(file.as_bytes()).unwrap_err();
        assert_eq!(
            error,
            Error::TooMany {
                element: "\"vertex\"".to_owned(),
                count,
                limit: file.len()
            }
        );
    }
}
