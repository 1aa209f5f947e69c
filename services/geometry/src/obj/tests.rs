use proptest::prelude::*;

use super::*;
use crate::surface::samples;
use crate::{Point3, Vector3};

const TAGGED: &str = "# space LPS\n# unit mm\n";
const QUAD: &str = "mtllib knee.mtl\no meniscus\nv 0 0 0\nv 1 0 0 0.5 0.5 0.5\nv 1 1 0\nv 0 1 0 1.0\n\
    vt 0 0\nvn 0 0 2\nusemtl tissue\ns off\nf 1/1/1 2/1/1 3/1/1 4/1/1\n";

fn refused(file: &str) -> String {
    read_mesh(file.as_bytes(), Some(Stated::LPS_MM))
        .unwrap_err()
        .to_string()
}

proptest! {
    #[test]
    fn a_written_mesh_reads_back_the_same_without_being_told_its_space(mesh in samples::mesh()) {
        prop_assert_eq!(read_mesh(&write_mesh(&mesh), None).unwrap(), mesh);
    }

    #[test]
    fn a_written_cloud_reads_back_the_same_with_its_normals(cloud in samples::cloud()) {
        prop_assert_eq!(read_cloud(&write_cloud(&cloud), None).unwrap(), cloud);
    }

    #[test]
    fn every_digit_of_a_coordinate_is_kept(x in any::<f64>().prop_filter("finite", |x| x.is_finite())) {
        let cloud = Cloud::new(vec![Point3::new(x, -x, 0.1)]);
        prop_assert_eq!(read_cloud(&write_cloud(&cloud), None).unwrap(), cloud);
    }

    #[test]
    fn indices_from_the_front_and_from_the_back_mean_the_same(mesh in samples::mesh()) {
        let front = String::from_utf8(write_mesh(&mesh)).unwrap();
        let (vertices, faces) = front.split_at(front.find("f ").unwrap());
        let back: Vec<String> = faces
            .split_whitespace()
            .map(|word| match word.parse::<i64>() {
                Ok(index) => (index - 1 - mesh.vertices.len() as i64).to_string(),
                Err(_) => format!("\n{word}"),
            })
            .collect();
        let back = format!("{vertices}{}", back.join(" "));
        prop_assert_eq!(read_mesh(back.as_bytes(), None).unwrap(), mesh);
    }

    #[test]
    fn no_bytes_make_the_reader_panic(
        bytes in prop::collection::vec(any::<u8>(), 0..300),
        text in "([vf#/ \n0-9.-]|vn ){0,60}",
        mesh in samples::mesh(),
        cut in any::<prop::sample::Index>(),
    ) {
        let _ = read(&bytes);
        let _ = read(text.as_bytes());
        let mut file = write_mesh(&mesh);
        file.truncate(cut.index(file.len()));
        file.extend_from_slice(&bytes);
        let _ = read(&file);
    }
}

#[test]
fn polygons_become_fans_and_everything_else_is_skipped() {
    let surface = read(QUAD.as_bytes()).unwrap();
    assert_eq!(surface.triangles, [[0, 1, 2], [0, 2, 3]]);
    assert_eq!(surface.cloud.points[3], Point3::new(0.0, 1.0, 0.0));
    assert_eq!(surface.cloud.normals, [Vector3::z(); 4]);
}

#[test]
fn normals_are_kept_only_where_each_vertex_has_exactly_one() {
    let normals = |from: &str, to: &str| {
        let file = QUAD.replace(from, to);
        read(file.as_bytes()).unwrap().cloud.normals.len()
    };
    assert_eq!(normals("1/1/1 2/1/1", "1//1 2//1"), 4);
    assert_eq!(normals("4/1/1", "4/1"), 0);
    assert_eq!(normals("s off", "vn 1 0 0\nf 1//2 2//1 3//1"), 0);
    assert_eq!(normals("f 1/1/1 2/1/1 3/1/1 4/1/1", "f 1 2 3"), 0);
    assert_eq!(
        normals(
            "f 1/1/1 2/1/1 3/1/1 4/1/1",
            "vn 1 0 0\nvn 1 0 0\nvn 0 1 0\n"
        ),
        4
    );
    assert_eq!(normals("v 0 1 0 1.0", "v 0 1 0\nv 9 9 9"), 0);
}

#[test]
fn space_and_unit_are_stated_before_the_first_vertex() {
    let file = format!("# 3D Slicer output. SPACE=RAS\n# unit m\n{QUAD}# unit cubes\n");
    let mesh = read_mesh(file.as_bytes(), None).unwrap();
    assert_eq!(mesh.vertices[2], Point3::new(-1000.0, -1000.0, 0.0));
    let error = read_mesh(QUAD.as_bytes(), None).unwrap_err().to_string();
    assert!(error.contains("add `# space LPS`"), "{error}");
    let file = format!("{QUAD}{TAGGED}");
    assert!(read_mesh(file.as_bytes(), None).is_err());
}

#[test]
fn line_ends_and_comments_do_not_matter() {
    let plain = read(QUAD.as_bytes()).unwrap();
    for other in [
        QUAD.replace('\n', "\r\n"),
        QUAD.trim_end().to_owned(),
        QUAD.replace("usemtl", "  # a remark\n\nusemtl"),
        QUAD.replace("v 1 1 0", "\tv  1\t1 0 "),
    ] {
        assert_eq!(read(other.as_bytes()).unwrap(), plain, "{other}");
    }
}

#[test]
fn broken_files_are_refused_by_name_value_and_limit() {
    let error = |from: &str, to: &str| refused(&QUAD.replace(from, to));
    assert_eq!(
        error("4/1/1", "5/1/1"),
        "face[0] names vertex 5, the file has 4"
    );
    assert_eq!(
        error("4/1/1", "0/1/1"),
        "face[0] names vertex 0, the file has 4"
    );
    assert_eq!(
        error("4/1/1", "-5/1/1"),
        "face[0] names vertex -5, the file has 4"
    );
    assert_eq!(
        error("4/1/1", "4/1/2"),
        "line 11: corner \"4/1/2\" names normal 2, the file has 1"
    );
    assert_eq!(error("4/1/1", "d"), "line 11: corner \"d\" is no index");
    assert_eq!(
        error("3/1/1 4/1/1", ""),
        "face[0] has 2 corners, needs at least 3"
    );
    assert_eq!(
        error("v 1 1 0", "v 1 NaN 0"),
        "vertex[2].y is NaN, must be finite"
    );
    assert_eq!(
        error("v 1 1 0", "v 1 1"),
        "line 5: the line ends before \"z\""
    );
    assert_eq!(
        error("vn 0 0 2", "vn 0 0 0"),
        "vertex[0] has a normal of length 0, must be 1"
    );
    assert_eq!(
        error("vn 0 0 2", "vn 1e200 0 1e200"),
        "vertex[0] has a normal of length inf, must be 1"
    );
    assert_eq!(refused("v 1 1 1\n"), "the file has no faces");
    assert_eq!(refused(""), "the file has no vertices");
    let far = format!("f {}", i64::MIN);
    assert!(error("f 1/1/1", &far).contains("-9223372036854775808"));
}

#[test]
fn more_vertices_than_the_limit_are_refused() {
    let file = "v 0 0 0\n".repeat(MAX_VERTICES + 1);
    assert_eq!(
        refused(&file),
        "the file announces 2000001 elements \"v\", the limit is 2000000"
    );
}
