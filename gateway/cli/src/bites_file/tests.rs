use super::*;

const LPS_MM: &str = r#""space":"LPS","unit":"mm""#;
const BITE: &str = r#"{"center_mm":[1,2,3],"long_axis":[0,2,0]}"#;

fn refused(text: &str) -> String {
    match BitesFile::parse(text.as_bytes(), None) {
        Ok(file) => format!("accepted: {file:?}"),
        Err(problem) => format!("{} {}", problem.field, problem.problem),
    }
}

#[test]
fn what_is_wrong_is_named_by_field_value_and_limit() {
    let long = vec![BITE; 1001].join(",");
    for (text, expected) in [
        (format!("{{\"bites\":[{BITE}]}}"), "space is not stated"),
        (
            format!("{{\"space\":\"LPS\",\"bites\":[{BITE}]}}"),
            "unit is not stated",
        ),
        (
            r#"{"space":"RAI","unit":"mm","bites":[]}"#.to_owned(),
            "space is \"RAI\"",
        ),
        (
            r#"{"space":"LPS","unit":"m","bites":[]}"#.to_owned(),
            "unit is \"m\"",
        ),
        (format!("{{{LPS_MM}}}"), "missing field `bites`"),
        (
            format!("{{{LPS_MM},\"format\":\"x\",\"bites\":[]}}"),
            "format is \"x\"",
        ),
        (
            format!("{{{LPS_MM},\"bites\":[],\"byte\":1}}"),
            "unknown field `byte`",
        ),
        (
            format!("{{{LPS_MM},\"bites\":[{long}]}}"),
            "bites are 1001; must be at most 1000",
        ),
        (
            format!(
                "{{{LPS_MM},\"bites\":[{BITE},{{\"center_mm\":[1,2,3],\"long_axis\":[0,0,0]}}]}}"
            ),
            "bites[1].long_axis has length 0",
        ),
        (
            format!("{{{LPS_MM},\"bites\":[{{\"center_mm\":[1,2,NaN],\"long_axis\":[0,0,1]}}]}}"),
            "center_mm holds what is no number (line 1 column",
        ),
        (
            format!("{{{LPS_MM},\"bites\":[{{\"center_mm\":[1,2,2e5],\"long_axis\":[0,0,1]}}]}}"),
            "bites[0].center_mm is 200000; must be -10000 .. 10000",
        ),
        (
            format!("{{{LPS_MM},\"bites\":[{{\"center_mm\":[1,2,3],\"axis\":[0,0,1]}}]}}"),
            "bites[0] unknown field `axis`",
        ),
        (
            format!(
                "{{{LPS_MM},\"bites\":[{{\"center_mm\":[1,2,3],\"long_axis\":[0,0,1],\"opening\":[0,1,1]}}]}}"
            ),
            "bites[0].opening is 45.00 deg from the long axis",
        ),
        (
            format!(
                "{{{LPS_MM},\"bites\":[{{\"center_mm\":[1,2,3],\"long_axis\":[0,0,1],\"portal\":0}}]}}"
            ),
            "bites[0].portal is 0; the file has 0 portals",
        ),
        (
            format!("{{{LPS_MM},\"jaw\":{{\"width_mm\":0,\"length_mm\":4}},\"bites\":[]}}"),
            "jaw.width_mm is 0; must be 0.5 .. 10",
        ),
        (
            format!(
                "{{{LPS_MM},\"jaw\":{{\"width_mm\":3,\"length_mm\":4,\"throat_mm\":0}},\"bites\":[]}}"
            ),
            "jaw.throat_mm is 0; must be 0.1 .. 10",
        ),
        (
            format!(
                "{{{LPS_MM},\"bites\":[],\"views\":[{{\"tip_mm\":[1,2,3],\"approach\":[0,0,1],\"optical_axis\":[0,1,0],\"roll_rad\":0,\"depth_mm\":1,\"distance_mm\":1,\"occluded_percent\":0}}]}}"
            ),
            "views are 1; must be one for each of the 0 bites",
        ),
    ] {
        let answer = refused(&text);
        assert!(answer.contains(expected), "{answer}, expected {expected}");
    }
}

#[test]
fn ras_is_lps_turned_by_half_a_turn_about_z() {
    let text = format!("{{\"space\":\"RAS\",\"unit\":\"mm\",\"bites\":[{BITE}]}}");
    let file = BitesFile::parse(text.as_bytes(), None).unwrap();
    assert_eq!(file.bites[0].center, Point3::new(-1.0, -2.0, 3.0));
    assert_eq!(file.bites[0].long_axis, Vector3::new(0.0, -1.0, 0.0));
}

#[test]
fn a_jaw_without_a_throat_has_the_usual_one() {
    let text =
        format!("{{{LPS_MM},\"jaw\":{{\"width_mm\":3,\"length_mm\":4.5}},\"bites\":[{BITE}]}}");
    let file = BitesFile::parse(text.as_bytes(), None).unwrap();
    assert_eq!(file.jaw, Some(Jaw::new(3.0, 4.5)));
}

#[test]
fn a_list_that_is_written_reads_back() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bites.json");
    let nothing = StatedSpace {
        space: None,
        unit: None,
    };
    let file = BitesFile {
        jaw: Some(Jaw {
            throat_mm: 0.8,
            ..Jaw::new(3.0, 4.5)
        }),
        portals: vec![Point3::new(62.0, 12.0, 94.5)],
        contour: vec![Point3::new(53.0, 48.0, 61.0)],
        lesion: Some(LesionPoints {
            spacing_mm: 0.5,
            points: vec![Point3::new(1.0, 2.0, 3.0)],
        }),
        bites: vec![ListedBite {
            center: Point3::new(0.1, 0.2, 0.3),
            long_axis: Vector3::x(),
            opening: Some(Vector3::z()),
            portal: Some(0),
        }],
        views: vec![ListedView {
            tip: Point3::new(4.0, 5.0, 6.0),
            approach: -Vector3::x(),
            optical_axis: Vector3::y(),
            roll_rad: 0.25,
            depth_mm: 40.0,
            distance_mm: 10.0,
            occluded_percent: 2.5,
        }],
    };
    file.write(&path).unwrap();
    assert_eq!(BitesFile::read(&path, nothing).unwrap(), file);
}
