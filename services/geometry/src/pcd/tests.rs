use proptest::prelude::*;

use super::*;
use crate::surface::samples;
use crate::{Point3, Vector3};

const ENCODINGS: [Encoding; 3] = [
    Encoding::Ascii,
    Encoding::Binary,
    Encoding::BinaryCompressed,
];
/// As PCL writes a cloud of two points with a colour, two columns and one row.
const COLOURED: &str = "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS x y z rgb\nSIZE 4 4 4 4\n\
    TYPE F F F F\nCOUNT 1 1 1 1\nWIDTH 2\nHEIGHT 1\nVIEWPOINT 1 2 3 1 0 0 0\nPOINTS 2\nDATA ascii\n\
    1 2 3 4.2108e+06\n4 5 6 4.808e+06\n";

fn refused(file: &str) -> String {
    read_cloud(file.as_bytes(), Some(Stated::LPS_MM))
        .unwrap_err()
        .to_string()
}

proptest! {
    #[test]
    fn a_written_cloud_reads_back_the_same_with_normals_and_viewpoint(
        cloud in samples::cloud(),
        viewpoint in prop::option::of(samples::point()),
    ) {
        for encoding in ENCODINGS {
            let file = write_cloud_as(&cloud, viewpoint, encoding);
            let surface = read(&file).unwrap().into_lps_mm(None).unwrap();
            prop_assert_eq!(&surface.cloud, &cloud);
            prop_assert_eq!(surface.viewpoint, viewpoint);
        }
    }

    #[test]
    fn a_binary_file_cut_short_anywhere_is_refused(
        cloud in samples::cloud(),
        cut in any::<prop::sample::Index>(),
    ) {
        for encoding in [Encoding::Binary, Encoding::BinaryCompressed] {
            let file = write_cloud_as(&cloud, None, encoding);
            prop_assert!(read(&file[..cut.index(file.len())]).is_err());
        }
    }

    #[test]
    fn no_bytes_make_the_reader_panic(
        mut bytes in prop::collection::vec(any::<u8>(), 0..200),
        cloud in samples::cloud(),
        cut in any::<prop::sample::Index>(),
    ) {
        let _ = read(&bytes);
        for encoding in ENCODINGS {
            let mut file = write_cloud_as(&cloud, None, encoding);
            file.truncate(cut.index(file.len()));
            file.append(&mut bytes.clone());
            let _ = read(&file);
        }
        bytes.splice(0..0, *b"DATA ascii\n");
        let _ = read(&bytes);
    }
}

#[test]
fn a_file_of_pcl_is_read_and_its_colours_are_skipped() {
    let surface = read(COLOURED.as_bytes()).unwrap();
    assert_eq!(
        surface.cloud.points,
        [Point3::new(1.0, 2.0, 3.0), Point3::new(4.0, 5.0, 6.0)]
    );
    assert!(surface.cloud.normals.is_empty());
    assert_eq!(surface.viewpoint, Some(Point3::new(1.0, 2.0, 3.0)));
}

#[test]
fn a_file_that_states_neither_space_nor_unit_is_refused_unless_the_caller_does() {
    let error = read_cloud(COLOURED.as_bytes(), None).unwrap_err();
    assert_eq!(
        error.to_string(),
        "the file does not state its space: add `# space LPS` to its header or state it with the file"
    );
    assert!(read_cloud(COLOURED.as_bytes(), Some(Stated::LPS_MM)).is_ok());
}

#[test]
fn ras_metres_become_lps_millimetres_with_normals_and_viewpoint() {
    let file = "# space RAS\n# unit m\nFIELDS x y z normal_x normal_y normal_z\nSIZE 8 8 8 4 4 4\n\
        TYPE F F F F F F\nWIDTH 1\nVIEWPOINT 1 1 1 1 0 0 0\nDATA ascii\n1 2 3 0 2 0\n";
    let surface = read(file.as_bytes()).unwrap().into_lps_mm(None).unwrap();
    assert_eq!(
        surface.cloud.points,
        [Point3::new(-1000.0, -2000.0, 3000.0)]
    );
    assert_eq!(surface.cloud.normals, [-Vector3::y()]);
    assert_eq!(
        surface.viewpoint,
        Some(Point3::new(-1000.0, -1000.0, 1000.0))
    );
}

#[test]
fn every_number_type_is_read_in_both_binary_layouts() {
    let header = |data: &str| {
        format!(
            "VERSION .7\nFIELDS _ x y z\nSIZE 1 8 2 4\nTYPE U F I U\nCOUNT 3 1 1 1\nWIDTH 2\nHEIGHT 1\nPOINTS 2\nDATA {data}\n"
        )
        .into_bytes()
    };
    let (x, y, z) = ([0.5_f64, -0.25], [-7_i16, 8], [9_u32, 4_000_000_000]);

    let mut by_point = header("binary");
    let mut by_field = vec![0; 6];
    for point in 0..2 {
        by_point.extend_from_slice(&[0; 3]);
        by_point.extend_from_slice(&x[point].to_le_bytes());
        by_point.extend_from_slice(&y[point].to_le_bytes());
        by_point.extend_from_slice(&z[point].to_le_bytes());
    }
    by_field.extend(x.iter().flat_map(|x| x.to_le_bytes()));
    by_field.extend(y.iter().flat_map(|y| y.to_le_bytes()));
    by_field.extend(z.iter().flat_map(|z| z.to_le_bytes()));
    let packed = lzf::pack(&by_field);
    let mut compressed = header("binary_compressed");
    compressed.extend_from_slice(&(packed.len() as u32).to_le_bytes());
    compressed.extend_from_slice(&(by_field.len() as u32).to_le_bytes());
    compressed.extend_from_slice(&packed);

    for file in [by_point, compressed] {
        assert_eq!(
            read(&file).unwrap().cloud.points,
            [Point3::new(0.5, -7.0, 9.0), Point3::new(-0.25, 8.0, 4e9)]
        );
    }
}

#[test]
fn line_ends_and_comments_do_not_matter() {
    let plain = read(COLOURED.as_bytes()).unwrap();
    for other in [
        COLOURED.replace('\n', "\r\n"),
        COLOURED.trim_end().to_owned(),
        COLOURED.replace("TYPE", "# a remark\n\nTYPE"),
        COLOURED.replace("COUNT 1 1 1 1\n", ""),
        COLOURED.replace("POINTS 2\n", ""),
        COLOURED.replace("WIDTH 2\nHEIGHT 1\n", ""),
        COLOURED.replace("FIELDS", "COLUMNS"),
    ] {
        assert_eq!(read(other.as_bytes()).unwrap(), plain, "{other}");
    }
}

#[test]
fn contradictions_in_the_header_are_refused_by_name_and_value() {
    let error = |from: &str, to: &str| refused(&COLOURED.replace(from, to));
    assert_eq!(
        error("SIZE 4 4 4 4", "SIZE 4 4 4"),
        "line 11: SIZE has 3 words, FIELDS has 4"
    );
    assert_eq!(
        error("TYPE F F", "TYPE F S"),
        "line 11: field \"y\" is of TYPE \"S\" and SIZE \"4\", which is no type of number"
    );
    assert_eq!(
        error("POINTS 2", "POINTS 3"),
        "line 11: POINTS is 3, WIDTH x HEIGHT is 2"
    );
    assert_eq!(
        error("COUNT 1", "COUNT 2"),
        "line 11: field \"x\" has COUNT 2, must be 1"
    );
    assert_eq!(
        error("FIELDS x y z rgb", "FIELDS x y z z"),
        "line 11: field \"z\" is there twice"
    );
    assert_eq!(
        error("FIELDS x y z", "FIELDS x y w"),
        "the file has no fields x, y and z"
    );
    assert_eq!(
        error("DATA ascii", "DATA packed"),
        "line 11: DATA is \"packed\", which is not known"
    );
    assert!(error("VIEWPOINT 1", "VIEWPOINT inf").contains("VIEWPOINT has inf"));
    assert!(error("WIDTH 2", "BREADTH 2").contains("\"BREADTH\" is no word of a header"));
    assert!(error("DATA ascii", "# DATA").contains("is no word of a header"));
}

#[test]
fn broken_points_are_refused_by_index_and_field() {
    let error = |from: &str, to: &str| refused(&COLOURED.replace(from, to));
    assert_eq!(
        error("4 5 6", "4 nan 6"),
        "vertex[1].y is NaN, must be finite"
    );
    assert_eq!(
        error("4 5 6", "4 five 6"),
        "line 13: \"y\" is \"five\", must be a number of type float32"
    );
    assert_eq!(
        error("6 4.808e+06\n", "6"),
        "line 13: the line ends before \"rgb\""
    );
    assert_eq!(
        error("4 5 6 4.808e+06\n", ""),
        "line 12: the file ends here, before the last point"
    );
    assert_eq!(
        error("4 5 6", "4 5 6 7"),
        "line 13: \"4.808e+06\" is one word too many"
    );
    assert_eq!(
        refused(
            &COLOURED
                .replace("WIDTH 2", "WIDTH 0")
                .replace("POINTS 2", "POINTS 0")
        ),
        "the file has no points"
    );
}

#[test]
fn absurd_counts_are_refused_before_anything_is_read() {
    let error =
        |from: &str, to: &str| refused(&COLOURED.replace(from, to).replace("POINTS 2\n", ""));
    let limit = "the limit is 2000000";
    assert!(error("WIDTH 2", "WIDTH 2000001").ends_with(limit));
    assert!(error("WIDTH 2\nHEIGHT 1", "WIDTH 4294967296\nHEIGHT 4294967296").ends_with(limit));
    assert!(error("WIDTH 2", "WIDTH 99999999999999999999").contains("must be a count"));
    assert!(error("WIDTH 2", "WIDTH 2000000").ends_with("the limit is 33"));
    assert!(
        error("COUNT 1 1 1 1", "COUNT 1 1 1 18446744073709551615").ends_with("the limit is 4096")
    );
    let packed = COLOURED
        .replace("COUNT 1 1 1 1", "COUNT 1 1 1 4000")
        .replace("WIDTH 2", "WIDTH 2000000")
        .replace("POINTS 2\n", "")
        .replace("ascii", "binary_compressed");
    assert!(refused(&packed).ends_with("the limit is 256000000"));
}

#[test]
fn packed_data_that_are_not_what_is_announced_are_refused() {
    let cloud = Cloud::new(vec![Point3::new(1.0, 2.0, 3.0); 9]);
    let file = write_cloud_as(&cloud, None, Encoding::BinaryCompressed);
    let header = String::from_utf8_lossy(&file).find("compressed\n").unwrap() + 11;
    let error = |place: usize, byte: u8| {
        let mut file = file.clone();
        file[header + place] = byte;
        read(&file).unwrap_err().to_string()
    };
    assert!(error(0, 255).contains("255 packed bytes are announced"));
    assert!(error(4, 7).contains("7 unpacked bytes are announced, the points take 108"));
    assert!(error(8, 255).contains("byte"));
}
