use super::*;
use proptest::prelude::*;

const FILE: &[u8] = include_bytes!("../../tests/data/resection.mrk.json");

fn file_of(markup: &str) -> Vec<u8> {
    format!(r#"{{"@schema": "markups-schema-v1.0.0.json#", "markups": [{markup}]}}"#).into_bytes()
}

fn refusal_of(markup: &str) -> String {
    read(&file_of(markup)).unwrap_err().to_string()
}

#[test]
fn a_curve_in_ras_becomes_lps_and_points_that_are_not_placed_are_counted() {
    let curve = read_one(FILE, Some("new edge")).unwrap();
    assert_eq!(curve.kind, Kind::Curve);
    let expected = [[53.0, 48.0, 61.0], [53.2, 56.5, 60.0], [54.0, 53.0, 36.0]];
    assert_eq!(curve.points, expected.map(Point3::from));
    assert_eq!(curve.skipped, 2);
}

#[test]
fn a_markup_that_states_no_axes_is_in_lps_as_the_schema_says() {
    let tear = read_one(FILE, Some("tear")).unwrap();
    assert_eq!(tear.kind, Kind::Fiducial);
    assert_eq!(tear.points[0], Point3::new(53.5, 58.5, 50.0));
}

#[test]
fn a_markup_that_is_no_curve_and_no_points_is_refused_by_its_type() {
    let refusal = read(FILE).unwrap_err().to_string();
    assert!(refusal.starts_with("markups[2].type is"), "{refusal}");
    assert!(refusal.contains("ROI"), "{refusal}");
}

#[test]
fn which_markup_is_meant_must_be_clear() {
    let refusal = read_one(FILE, None).unwrap_err();
    assert!(
        matches!(refusal, Error::Ambiguous { count: 3, .. }),
        "{refusal}"
    );
    let refusal = read_one(FILE, Some("absent")).unwrap_err();
    assert!(refusal.to_string().contains("tear"), "{refusal}");
    let only = file_of(r#"{"type": "Line", "name": "a", "controlPoints": []}"#);
    assert_eq!(read_one(&only, None).unwrap().kind, Kind::Line);
    let twice = r#"{"type": "Line", "name": "a"}, {"type": "Line", "name": "a"}"#;
    let refusal = read_one(&file_of(twice), Some("a")).unwrap_err();
    assert!(
        matches!(refusal, Error::Ambiguous { count: 2, .. }),
        "{refusal}"
    );
}

#[test]
fn what_is_wrong_is_named_with_its_path() {
    let control = |control: &str| {
        format!(r#"{{"type": "Curve", "controlPoints": [{{"position": [1, 2, 3]}}, {control}]}}"#)
    };
    for (markup, path) in [
        (
            control(r#"{"position": [1, 2, "NaN"]}"#),
            "markups[0].controlPoints[1].position[2] is the string",
        ),
        (
            control(r#"{"position": [1, null, 2]}"#),
            "markups[0].controlPoints[1].position[1] is null",
        ),
        (
            control(r#"{"position": [1e9, 1, 2]}"#),
            "markups[0].controlPoints[1].position[0] is 1000000000 mm",
        ),
        (
            control(r#"{"position": [1, 2]}"#),
            "markups[0].controlPoints[1].position has 2 values",
        ),
        (
            control("{}"),
            "markups[0].controlPoints[1].position is missing",
        ),
        (control("7"), "markups[0].controlPoints[1] is 7"),
        (
            control(r#"{"position": [1, 2, 3], "positionStatus": "maybe"}"#),
            "markups[0].controlPoints[1].positionStatus",
        ),
        (r#"{"name": "a"}"#.into(), "markups[0].type is missing"),
        (r#"{"type": "Plane"}"#.into(), "markups[0].type"),
        (
            r#"{"type": "Curve", "coordinateSystem": "IJK"}"#.into(),
            "markups[0].coordinateSystem",
        ),
        (
            r#"{"type": "Curve", "coordinateSystem": 1}"#.into(),
            "markups[0].coordinateSystem is 1",
        ),
        (
            r#"{"type": "Curve", "coordinateUnits": "um"}"#.into(),
            "markups[0].coordinateUnits",
        ),
        (
            r#"{"type": "Curve", "coordinateUnits": ["m", "UCUM", "meter"]}"#.into(),
            "markups[0].coordinateUnits",
        ),
        (
            r#"{"type": "Curve", "coordinateUnits": ["mm", "other", "?"]}"#.into(),
            "markups[0].coordinateUnits",
        ),
        (
            r#"{"type": "Curve", "controlPoints": {}}"#.into(),
            "markups[0].controlPoints is an object",
        ),
        (String::new(), "markups has 0 entries"),
    ] {
        let refusal = refusal_of(&markup);
        assert!(refusal.starts_with(path), "{markup}: {refusal}");
    }
}

#[test]
fn more_points_than_the_limit_are_refused() {
    let point = r#"{"position": [0, 0, 0]},"#.repeat(MAX_POINTS);
    let refusal = refusal_of(&format!(
        r#"{{"type": "Curve", "controlPoints": [{point} {{}}]}}"#
    ));
    assert!(refusal.contains("has 10001 points"), "{refusal}");
}

#[test]
fn a_file_of_another_schema_is_refused() {
    for (file, said) in [
        (r#"{"markups": []}"#, "@schema is missing"),
        (
            r#"{"@schema": "markups-schema-v2.0.0.json#", "markups": []}"#,
            "@schema is",
        ),
        (
            r#"{"@schema": "markups-schema-v1.0.3.json#"}"#,
            "markups is missing",
        ),
        ("[]", "the file is a list"),
        (r#"{"@schema": NaN}"#, "the file is no JSON"),
        ("", "the file is no JSON"),
    ] {
        let refusal = read(file.as_bytes()).unwrap_err().to_string();
        assert!(refusal.starts_with(said), "{refusal}");
    }
    let deep = "[".repeat(100_000);
    assert!(matches!(read(deep.as_bytes()), Err(Error::Json(_))));
    assert!(matches!(
        read(&vec![b' '; MAX_BYTES + 1]),
        Err(Error::TooLarge { .. })
    ));
}

fn any_markup() -> impl Strategy<Value = Markup> {
    let coordinate_mm = -MAX_COORDINATE_MM..MAX_COORDINATE_MM;
    let point =
        [coordinate_mm.clone(), coordinate_mm.clone(), coordinate_mm].prop_map(Point3::from);
    let kind = prop::sample::select(&Kind::ALL[..]);
    (".{0,12}", kind, prop::collection::vec(point, 0..20)).prop_map(|(name, kind, points)| Markup {
        name,
        kind,
        points,
        skipped: 0,
    })
}

proptest! {
    #[test]
    fn what_is_written_is_read_again(markups in prop::collection::vec(any_markup(), 1..4)) {
        prop_assert_eq!(read(&write(&markups)).unwrap(), markups);
    }

    #[test]
    fn the_same_points_in_ras_are_the_half_turn_about_superior(markup in any_markup()) {
        let lps = String::from_utf8(write(std::slice::from_ref(&markup))).unwrap();
        let ras = lps.replace(r#""coordinateSystem": "LPS""#, r#""coordinateSystem": "RAS""#);
        let turned = read_one(ras.as_bytes(), None).unwrap();
        let expected: Vec<_> = markup.points.iter().map(|p| Point3::new(-p.x, -p.y, p.z)).collect();
        prop_assert_eq!(&turned.points, &expected);
        let back = read_one(&write(&[Markup { points: turned.points.iter().map(|p| Point3::new(-p.x, -p.y, p.z)).collect(), ..turned }]), None);
        prop_assert_eq!(back.unwrap(), markup);
    }

    #[test]
    fn no_bytes_make_the_reader_panic(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
        let _ = read(&bytes);
    }

    #[test]
    fn no_broken_file_makes_the_reader_panic(
        end in 0..FILE.len(),
        changes in prop::collection::vec((0..FILE.len(), any::<u8>()), 0..6),
    ) {
        let mut file = FILE.to_vec();
        for (at, byte) in changes {
            file[at] = byte;
        }
        let _ = read_one(&file, Some("new edge"));
        prop_assert!(matches!(read(&file[..end]), Err(Error::Json(_))));
    }
}
