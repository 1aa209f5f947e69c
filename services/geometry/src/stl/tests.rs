use proptest::prelude::*;

use super::*;
use crate::Point3;
use crate::surface::samples;

const ENCODINGS: [Encoding; 2] = [Encoding::Ascii, Encoding::Binary];
const TRIANGLE: &str = "solid meniscus\n  facet normal 0 0 1\n    outer loop\n      vertex 0 0 0\n      vertex 1 0 0\n\
    \x20     vertex 0 2 3\n    endloop\n  endfacet\nendsolid meniscus\n";

/// A binary file of one triangle with this header.
fn binary(header: &[u8]) -> Vec<u8> {
    let mut file = header.to_vec();
    file.resize(80, 0);
    file.extend_from_slice(&1_u32.to_le_bytes());
    for value in [
        0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 2.0, 3.0_f32,
    ] {
        file.extend_from_slice(&value.to_le_bytes());
    }
    file.extend_from_slice(&[0, 0]);
    file
}

fn refused(file: &[u8]) -> String {
    read_mesh(file, Some(Stated::LPS_MM))
        .unwrap_err()
        .to_string()
}

proptest! {
    #[test]
    fn a_written_mesh_reads_back_the_same_without_being_told_its_space(mesh in samples::mesh()) {
        prop_assert_eq!(&read_mesh(&write_mesh(&mesh), None).unwrap(), &mesh);
        for encoding in ENCODINGS {
            prop_assert_eq!(&read_mesh(&write_mesh_as(&mesh, encoding), None).unwrap(), &mesh);
        }
    }

    #[test]
    fn a_file_cut_short_anywhere_is_refused(mesh in samples::mesh(), cut in any::<prop::sample::Index>()) {
        for encoding in ENCODINGS {
            let file = write_mesh_as(&mesh, encoding);
            // Without the end of its last line a text is whole still.
            prop_assert!(read(&file[..cut.index(file.len() - 1)]).is_err());
        }
    }

    #[test]
    fn no_bytes_make_the_reader_panic(
        mut bytes in prop::collection::vec(any::<u8>(), 0..300),
        mesh in samples::mesh(),
        cut in any::<prop::sample::Index>(),
    ) {
        let _ = read(&bytes);
        for encoding in ENCODINGS {
            let mut file = write_mesh_as(&mesh, encoding);
            file.truncate(cut.index(file.len()));
            file.append(&mut bytes.clone());
            let _ = read(&file);
        }
        bytes.splice(0..0, *b"solid\nfacet\n");
        let _ = read(&bytes);
    }
}

#[test]
fn corners_that_coincide_are_one_vertex_in_the_order_of_the_file() {
    let [a, b, c, d] = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
    let soup = Mesh {
        vertices: [c, a, b, d, c, [-0.0, 0.0]]
            .map(|[x, y]| Point3::new(x, y, 0.0))
            .to_vec(),
        triangles: vec![[0, 1, 2], [3, 4, 5]],
    };
    let mesh = read_mesh(&write_mesh(&soup), None).unwrap();
    assert_eq!(mesh.vertices, soup.vertices[..4]);
    assert_eq!(mesh.triangles, [[0, 1, 2], [3, 0, 1]]);
}

#[test]
fn slicer_states_the_space_and_the_caller_must_agree() {
    let file = binary(b"3D Slicer output. SPACE=RAS");
    let surface = read(&file).unwrap();
    assert_eq!(surface.statements.space, Some(crate::stated::Space::Ras));
    assert_eq!(surface.statements.unit, None);
    assert_eq!(
        read_mesh(&file, None).unwrap_err().to_string(),
        "the file does not state its unit: add `UNIT=mm` to its header or state it with the file"
    );
    assert_eq!(refused(&file), "space is stated as both Ras and Lps");
    let ras = Stated {
        space: crate::stated::Space::Ras,
        ..Stated::LPS_MM
    };
    let mesh = read_mesh(&file, Some(ras)).unwrap();
    assert_eq!(mesh.vertices[2], Point3::new(0.0, -2.0, 3.0));
}

#[test]
fn an_ascii_file_states_it_in_the_name_of_its_solid() {
    let file = TRIANGLE.replace("solid meniscus", "solid meniscus SPACE=RAS UNIT=m");
    let mesh = read_mesh(file.as_bytes(), None).unwrap();
    assert_eq!(mesh.vertices[1], Point3::new(-1000.0, 0.0, 0.0));
    assert!(read_mesh(TRIANGLE.as_bytes(), None).is_err());
}

#[test]
fn a_binary_file_may_begin_with_solid() {
    let plain = read(&binary(b"")).unwrap();
    assert_eq!(read(&binary(b"solid\nfacet")).unwrap(), plain);
    assert_eq!(read(TRIANGLE.as_bytes()).unwrap(), plain);
}

#[test]
fn line_ends_case_and_several_solids_do_not_matter() {
    let plain = read(TRIANGLE.as_bytes()).unwrap();
    for other in [
        TRIANGLE.replace('\n', "\r\n"),
        TRIANGLE.trim_end().to_owned(),
        TRIANGLE.to_uppercase(),
        format!("\n{TRIANGLE}\nsolid\nendsolid\n"),
    ] {
        assert_eq!(read(other.as_bytes()).unwrap(), plain, "{other}");
    }
}

#[test]
fn broken_files_are_refused_by_name_value_and_limit() {
    let error = |from: &str, to: &str| refused(TRIANGLE.replace(from, to).as_bytes());
    assert_eq!(
        error("vertex 0 2 3", "endloop"),
        "line 6: \"endloop\" must be `vertex`"
    );
    assert_eq!(
        error("    endloop", "vertex 1 1 1"),
        "line 7: \"vertex\" must be `endloop`"
    );
    assert_eq!(error("2 3", "2"), "line 6: the line ends before \"z\"");
    assert_eq!(error("2 3", "2 3 4"), "line 6: \"4\" is one word too many");
    assert_eq!(
        error("2 3", "-inf 3"),
        "vertex[2].y is -inf, must be finite"
    );
    assert_eq!(
        error("endsolid meniscus\n", ""),
        "line 8: the file ends here, before `endsolid`"
    );
    assert_eq!(refused(b"solid\nendsolid\n"), "the file has no faces");

    let mut file = binary(b"");
    file.pop();
    assert_eq!(
        refused(&file),
        "byte 133: the file ends here, 1 announced triangles end at byte 134"
    );
    file[80..84].copy_from_slice(&u32::MAX.to_le_bytes());
    assert_eq!(
        refused(&file),
        "the file announces 4294967295 elements \"triangle\", the limit is 4000000"
    );
    assert!(refused(b"").contains("neither begins with `solid` nor holds a header"));
    assert_eq!(refused(&[0; 84]), "the file has no faces");
}
