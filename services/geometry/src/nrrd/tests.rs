use std::io::Write as _;

use flate2::Compression;
use flate2::write::GzEncoder;
use proptest::prelude::*;

use super::*;
use crate::Vector3;
use crate::ply::{Space, Unit};
use crate::scan::Voxels;

const LPS_MM: Stated = Stated {
    space: Space::Lps,
    unit: Unit::Millimetre,
};
/// Two by two by one voxels; the fields that a test replaces stand on lines of their own.
const HEADER: &str = "NRRD0004\n# made for a test\ntype: unsigned char\ndimension: 3\n\
    space: left-posterior-superior\nsizes: 2 2 1\n\
    space directions: (0,0.5,0) (0,0,-0.5) (-0.75,0.125,0)\nkinds: domain domain domain\n\
    encoding: raw\nspace origin: (-6.5,-77,70)\nSegment0_Name:=meniscus\n\n";

fn file(from: &str, to: &str, voxels: &[u8]) -> Vec<u8> {
    let mut file = HEADER.replace(from, to).into_bytes();
    file.extend_from_slice(voxels);
    file
}

fn said(file: &[u8], stated: Option<Stated>) -> String {
    read(file, stated).unwrap_err().to_string()
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

/// The same values as raw bytes and as words.
fn written(voxels: &Voxels, is_big: bool) -> (&'static str, Vec<u8>, String) {
    macro_rules! each {
        ($name:literal, $values:expr) => {{
            let bytes = $values.iter().flat_map(|v| {
                if is_big {
                    v.to_be_bytes()
                } else {
                    v.to_le_bytes()
                }
            });
            let words: Vec<String> = $values.iter().map(ToString::to_string).collect();
            ($name, bytes.collect(), words.join(" "))
        }};
    }
    match voxels {
        Voxels::I8(values) => each!("signed char", values),
        Voxels::U8(values) => each!("uint8", values),
        Voxels::I16(values) => each!("short", values),
        Voxels::U16(values) => each!("uint16_t", values),
        Voxels::I32(values) => each!("int", values),
        Voxels::U32(values) => each!("unsigned int", values),
        Voxels::F32(values) => each!("float", values),
        Voxels::F64(values) => each!("double", values),
    }
}

fn any_voxels() -> impl Strategy<Value = Voxels> {
    prop_oneof![
        prop::collection::vec(any::<i8>(), 4).prop_map(Voxels::I8),
        prop::collection::vec(any::<u8>(), 4).prop_map(Voxels::U8),
        prop::collection::vec(any::<i16>(), 4).prop_map(Voxels::I16),
        prop::collection::vec(any::<u16>(), 4).prop_map(Voxels::U16),
        prop::collection::vec(any::<i32>(), 4).prop_map(Voxels::I32),
        prop::collection::vec(any::<u32>(), 4).prop_map(Voxels::U32),
        prop::collection::vec(-1e6f32..1e6, 4).prop_map(Voxels::F32),
        prop::collection::vec(-1e6f64..1e6, 4).prop_map(Voxels::F64),
    ]
}

proptest! {
    #[test]
    fn voxels_of_every_type_encoding_and_byte_order_read_back_the_same(voxels in any_voxels(), is_big: bool) {
        let (name, bytes, words) = written(&voxels, is_big);
        let endian = if is_big { "big" } else { "little" };
        for (encoding, data) in [("raw", bytes.clone()), ("gzip", gzip(&bytes)), ("text", words.into_bytes())] {
            let header = HEADER
                .replace("unsigned char", name)
                .replace("encoding: raw", &format!("encoding: {encoding}\nendian: {endian}"));
            let file = [header.as_bytes(), &data].concat();
            let scan = read(&file, None).unwrap();
            prop_assert_eq!(scan.voxels(), &voxels);
        }
    }

    #[test]
    fn no_bytes_make_the_reader_panic(bytes in prop::collection::vec(any::<u8>(), 0..300), cut in 0usize..400, at in 0usize..330) {
        let _ = read(&bytes, Some(LPS_MM));
        let mut whole = file("raw", "gzip", &gzip(&[1, 2, 3, 4]));
        for (offset, byte) in bytes.iter().take(3).enumerate() {
            let place = (at + 40 * offset) % whole.len();
            whole[place] = *byte;
        }
        let _ = read(&whole, None);
        whole.truncate(cut);
        whole.extend_from_slice(&bytes);
        let _ = read(&whole, None);
        let _ = read_detached(&whole, &bytes, None);
    }
}

#[test]
fn an_oblique_lattice_is_placed_in_lps() {
    let scan = read(&file("", "", &[0, 1, 2, 3]), None).unwrap();
    let point = scan.lattice().point(Vector3::new(1.0, 1.0, 2.0));
    assert_eq!(point, crate::Point3::new(-8.0, -76.25, 69.5));
    assert_eq!(scan.lattice().size(), [2, 2, 1]);
}

#[test]
fn ras_las_and_metres_become_lps_millimetres() {
    let at = |space: &str, units: &str| {
        let header = HEADER
            .replace("left-posterior-superior", space)
            .replace("kinds:", units);
        let scan = read(&[header.as_bytes(), &[0; 4]].concat(), None).unwrap();
        scan.lattice().point(Vector3::new(1.0, 0.0, 1.0))
    };
    assert_eq!(at("RAS", "kinds:"), crate::Point3::new(7.25, 76.375, 70.0));
    assert_eq!(
        at("left-anterior-superior", "kinds:"),
        crate::Point3::new(-7.25, 76.375, 70.0)
    );
    let header = "NRRD0004\ntype: uint8\ndimension: 3\nspace: LPS\nsizes: 2 2 1\n\
        space directions: (0.0005,0,0) (0,0.0005,0) (0,0,0.001)\nspace origin: (0.001,0,0)\n\
        space units: \"m\" \"m\" \"m\"\nencoding: raw\n\n\0\0\0\0";
    let scan = read(header.as_bytes(), None).unwrap();
    let point = scan.lattice().point(Vector3::new(1.0, 1.0, 1.0));
    assert!((point - crate::Point3::new(1.5, 0.5, 1.0)).norm() < 1e-12);
    let metres = header.replace("space units", "comment");
    assert!(said(metres.as_bytes(), None).contains("is it in another unit?"));
}

#[test]
fn a_file_that_states_no_space_is_refused_unless_the_caller_does() {
    let plain = "NRRD0001\ntype: uint8\ndimension: 3\nsizes: 2 2 1\nspacings: 0.5 0.5 2\nencoding: raw\n\n\0\0\0\0";
    assert!(said(plain.as_bytes(), None).contains("does not state its space"));
    let ras = Stated {
        space: Space::Ras,
        unit: Unit::Millimetre,
    };
    let scan = read(plain.as_bytes(), Some(ras)).unwrap();
    let point = scan.lattice().point(Vector3::new(1.0, 1.0, 1.0));
    assert_eq!(point, crate::Point3::new(-0.5, -0.5, 2.0));
    assert!(!scan.lattice().is_left_handed());
}

#[test]
fn a_caller_that_contradicts_the_file_is_refused() {
    let ras = Some(Stated {
        space: Space::Ras,
        unit: Unit::Millimetre,
    });
    assert!(said(&file("", "", &[0; 4]), ras).contains("by the caller"));
    let metres = Some(Stated {
        unit: Unit::Metre,
        ..LPS_MM
    });
    let stated = file(
        "kinds:",
        "space units: \"mm\" \"mm\" \"mm\"\nkinds:",
        &[0; 4],
    );
    assert!(said(&stated, metres).contains("unit is Millimetre in the file"));
}

#[test]
fn broken_headers_are_refused_by_name_value_and_limit() {
    for (from, to, expected) in [
        ("NRRD0004", "NRRD0009", "not an NRRD file"),
        ("dimension: 3", "dimension: 4", r#""dimension" is "4""#),
        ("sizes: 2 2 1\n", "", r#"no field "sizes""#),
        (
            "2 2 1",
            "2 2",
            r#""sizes" is "2 2", must be three whole numbers"#,
        ),
        ("2 2 1", "2 2 1 1", "three whole numbers"),
        ("2 2 1", "2 0 1", "sizes[1] is 0"),
        ("2 2 1", "2 -2 1", "three whole numbers"),
        (
            "left-posterior-superior",
            "scanner-xyz",
            r#""space" is "scanner-xyz""#,
        ),
        ("(0,0.5,0)", "none", "three vectors"),
        ("(0,0.5,0)", "(0,inf,0)", "finite"),
        ("(0,0.5,0)", "(0,0.5)", "three vectors"),
        ("(0,0.5,0)", "(0,0,-0.5)", "almost in a plane"),
        (
            "space origin: (-6.5,-77,70)\n",
            "",
            r#"no field "space origin""#,
        ),
        ("unsigned char", "block", r#""type" is "block""#),
        (
            "encoding: raw",
            "encoding: bzip2",
            "must be raw, gzip or text",
        ),
        ("unsigned char", "short", r#"no field "endian""#),
        ("# made", "made", "line 2 of the header"),
        ("kinds:", "encoding:", r#"two fields "encoding""#),
    ] {
        let error = said(&file(from, to, &[0; 8]), None);
        assert!(error.contains(expected), "{from} -> {to}: {error}");
    }
    let endless = [b"NRRD0004\n".as_slice(), &b"# a\n".repeat(400_000)].concat();
    assert!(said(&endless, None).contains("does not end within"));
}

#[test]
fn voxels_that_are_too_few_too_many_or_damaged_are_refused() {
    assert!(said(&file("", "", &[0; 3]), None).contains("end before the announced 4 values"));
    assert!(said(&file("", "", &[0; 5]), None).contains("do not end after the announced 4 values"));
    let text = |words: &str| said(&file("raw", "text", words.as_bytes()), None);
    assert!(text("1 2 3").contains("end before"));
    assert!(text("1 2 3 4 5").contains("do not end after"));
    assert!(text("1 2 256 4").contains(r#"voxel 2 is "256""#));
    let mut packed = gzip(&[1, 2, 3, 4]);
    for end in [packed.len() - 8, 6, 0] {
        let error = said(&file("raw", "gzip", &packed[..end]), None);
        assert!(error.starts_with("the voxels"), "{end}: {error}");
    }
    let last = packed.len() - 6;
    packed[last] ^= 1;
    assert!(said(&file("raw", "gzip", &packed), None).contains("cannot be read"));
}

#[test]
fn a_gzip_bomb_is_refused_before_it_is_unpacked() {
    // Announces few voxels and holds many.
    let bomb = gzip(&vec![0; 1 << 26]);
    assert!(said(&file("raw", "gzip", &bomb), None).contains("do not end after the announced 4"));
    // Announces many voxels that so few bytes cannot hold, and more than are accepted.
    let many = |sizes: &str| {
        let header = HEADER.replace("2 2 1", sizes).replace("raw", "gzip");
        said(&[header.as_bytes(), &gzip(&[0; 1000])].concat(), None)
    };
    assert!(many("512 512 512").contains("end before the announced 134217728 values"));
    assert!(many("5000 5000 5000").contains("must be at most"));
    assert!(many("99999999999999999999 1 1").contains("three whole numbers"));
}

#[test]
fn detached_voxels_are_refused_unless_the_caller_gives_them() {
    let header = HEADER.replace("kinds:", "data file: knee.raw\nkinds:");
    let header = header.trim_end_matches('\n').as_bytes();
    assert!(said(header, None).contains(r#"another file, "knee.raw""#));
    let scan = read_detached(header, &[5, 6, 7, 8], None).unwrap();
    assert_eq!(scan.voxels(), &Voxels::U8(vec![5, 6, 7, 8]));
    let attached = read_detached(HEADER.as_bytes(), &[5, 6, 7, 8], None).unwrap_err();
    assert!(attached.to_string().contains("no other file"));
}

#[test]
fn skips_pass_over_what_stands_before_the_voxels() {
    let voxels = |fields: &str, data: &[u8]| {
        let file = file("kinds:", &format!("{fields}\nkinds:"), data);
        read(&file, None).map(|scan| scan.voxels().clone())
    };
    let expected = Voxels::U8(vec![1, 2, 3, 4]);
    assert_eq!(
        voxels("byte skip: -1", b"head\x01\x02\x03\x04").unwrap(),
        expected
    );
    assert_eq!(
        voxels("byteskip: 4", b"head\x01\x02\x03\x04").unwrap(),
        expected
    );
    assert_eq!(
        voxels("line skip: 2", b"a\nb\n\x01\x02\x03\x04").unwrap(),
        expected
    );
    for (fields, data) in [
        ("line skip: 2", "a\n1234"),
        ("byte skip: 9", "1234"),
        ("byte skip: -2", "1234"),
    ] {
        assert!(
            voxels(fields, data.as_bytes())
                .unwrap_err()
                .to_string()
                .contains("skip"),
            "{fields}"
        );
    }
}
