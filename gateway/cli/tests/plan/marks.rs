//! Lesions that somebody painted and contours that somebody drew.

use std::f64::consts::TAU;

use arthro_geometry::Point3;
use arthro_geometry::phantom::{Coordinates, Phantom};
use serde_json::{Value, json};

use crate::{Folder, arthro, done, written};

/// A point of the phantom's tissue: degrees from the middle of the body, and share of the width.
fn tissue(phi_deg: f64, width_fraction: f64) -> Point3 {
    Phantom::default().point(Coordinates {
        phi_rad: phi_deg.to_radians(),
        width_fraction,
        height_fraction: 0.5,
    })
}

/// A markup of 3D Slicer.
fn markup(folder: &Folder, name: &str, kind: &str, space: &str, points: &[Point3]) -> String {
    let turn = if space == "RAS" { -1.0 } else { 1.0 };
    let control = points.iter().enumerate().map(|(index, point)| {
        json!({
            "id": (index + 1).to_string(),
            "position": [point.x * turn, point.y * turn, point.z],
            "positionStatus": "defined",
        })
    });
    let file = json!({
        "@schema": "https://raw.githubusercontent.com/slicer/slicer/master/Modules/Loadable/Markups/Resources/Schema/markups-schema-v1.0.3.json#",
        "markups": [{
            "type": kind,
            "coordinateSystem": space,
            "coordinateUnits": "mm",
            "controlPoints": control.collect::<Vec<Value>>(),
        }],
    });
    folder.write(name, &file.to_string())
}

fn plan(arguments: &[&str]) -> Value {
    let mut all = vec!["plan", "phantom"];
    all.extend(arguments);
    done(&all)
}

#[test]
fn a_curve_drawn_in_ras_gives_the_plan_of_the_same_curve_in_lps() {
    let folder = Folder::new();
    let curve: Vec<Point3> = (-4..=4)
        .map(|step| {
            let step = f64::from(step);
            tissue(6.0 * step, 0.34 * (1.0 - step * step / 16.0) + 0.01)
        })
        .collect();
    let lists = ["LPS", "RAS"].map(|space| {
        let curve = markup(
            &folder,
            &format!("{space}.mrk.json"),
            "Curve",
            space,
            &curve,
        );
        let out = folder.path(&format!("{space}.json"));
        let planned = plan(&["--contour", &curve, "--out", &out]);
        assert!(
            planned["region_covered_percent"].as_f64().unwrap() >= 94.5,
            "{planned}"
        );
        std::fs::read(out).unwrap()
    });
    assert!(lists[0] == lists[1]);
}

#[test]
fn a_lesion_that_is_painted_is_covered() {
    let folder = Folder::new();
    let outline: Vec<Point3> = (0..8)
        .map(|step| {
            let (sin, cos) = (f64::from(step) * TAU / 8.0).sin_cos();
            tissue(4.0 * cos, 0.2 + 0.16 * sin)
        })
        .collect();
    let outline = markup(&folder, "lesion.mrk.json", "ClosedCurve", "LPS", &outline);
    let planned = plan(&["--lesion", &outline]);
    let number = |key: &str| planned[key].as_f64().unwrap();
    assert!((5.0..30.0).contains(&number("lesion_mm3")), "{planned}");
    assert!(number("lesion_covered_percent") >= 99.0, "{planned}");
}

#[test]
fn points_and_the_tissue_around_them_are_covered() {
    let folder = Folder::new();
    let points = [tissue(-5.0, 0.15), tissue(4.0, 0.2)];
    let points = markup(&folder, "lesion.mrk.json", "Fiducial", "RAS", &points);
    let planned = plan(&["--lesion", &points, "--lesion-radius-mm", "1.5"]);
    assert!(
        planned["lesion_covered_percent"].as_f64().unwrap() >= 99.0,
        "{planned}"
    );
    let (code, refused) = arthro(&["plan", "phantom", "--lesion", &points]);
    assert_eq!(code, 3, "{refused}");
    assert!(
        refused.to_string().contains("--lesion-radius-mm"),
        "{refused}"
    );
}

/// A segmentation with steps of 1 mm over the middle of the body, in which `label` marks some damage.
fn label_map(folder: &Folder, label: u8) -> String {
    let middle = tissue(0.0, 0.2);
    let corner = middle.map(|value| value.round() - 8.0);
    let header = format!(
        "NRRD0004\ntype: uint8\ndimension: 3\nspace: left-posterior-superior\nsizes: 17 17 17\n\
         space directions: (1,0,0) (0,1,0) (0,0,1)\nspace origin: ({},{},{})\nencoding: raw\n\n",
        corner.x, corner.y, corner.z
    );
    let mut bytes = header.into_bytes();
    for k in 0..17 {
        for j in 0..17 {
            for i in 0..17 {
                let offset =
                    Point3::new(f64::from(i), f64::from(j), f64::from(k)) + corner.coords - middle;
                let is_damaged = offset.norm() < 2.0;
                bytes.push(if is_damaged { label } else { 0 });
            }
        }
    }
    let path = folder.path("lesion.nrrd");
    std::fs::write(&path, bytes).unwrap();
    path
}

#[test]
fn a_label_of_a_segmentation_is_covered() {
    let folder = Folder::new();
    let map = label_map(&folder, 7);
    let planned = plan(&["--lesion", &map, "--label", "7"]);
    let number = |key: &str| planned[key].as_f64().unwrap();
    assert!((10.0..40.0).contains(&number("lesion_mm3")), "{planned}");
    assert!(number("lesion_covered_percent") >= 99.0, "{planned}");
    for (label, words) in [(None, "--label"), (Some("3"), "label 3")] {
        let mut arguments = vec!["plan", "phantom", "--lesion", &map];
        arguments.extend(label.iter().flat_map(|label| ["--label", label]));
        let (code, refused) = arthro(&arguments);
        assert_eq!(code, 3, "{refused}");
        assert!(refused.to_string().contains(words), "{refused}");
    }
}

#[test]
fn each_bite_comes_through_one_of_the_portals() {
    let folder = Folder::new();
    let out = folder.path("bites.json");
    let planned = plan(&[
        "--scenario",
        "tear",
        "--portal=62,12,94.5",
        "--portal=62,48,94.5",
        "--out",
        &out,
    ]);
    let count = |portal: usize| planned["portals"][portal].as_u64().unwrap();
    assert_eq!(count(0) + count(1), planned["bites"].as_u64().unwrap());
    let list = written(&out);
    let portals: Vec<Point3> = serde_json::from_value::<Vec<[f64; 3]>>(list["portals"].clone())
        .unwrap()
        .into_iter()
        .map(Point3::from)
        .collect();
    for bite in list["bites"].as_array().unwrap() {
        let [center, axis] = ["center_mm", "long_axis"]
            .map(|key| serde_json::from_value::<[f64; 3]>(bite[key].clone()).unwrap());
        let portal = portals[bite["portal"].as_u64().unwrap() as usize];
        let way = (Point3::from(center) - portal).normalize();
        assert!((way - Point3::from(axis).coords).norm() < 1e-6, "{bite}");
    }
}
