use super::*;
use crate::rcm::Placement;

fn tool_and_target(degrees: f64, depth_mm: f64) -> (Rigid<Base, Tool>, Point3, Point3) {
    let portal = Point3::new(700.0, 0.0, 265.0);
    let tool = Rigid::new(Rotation::identity(), portal.coords);
    let (sine, cosine) = degrees.to_radians().sin_cos();
    let target = portal + Vector3::new(cosine, 0.6 * sine, 0.8 * sine) * depth_mm;
    (tool, portal, target)
}

fn misses_mm(formula: Formula, degrees: f64, depth_mm: f64) -> f64 {
    let (tool, portal, target) = tool_and_target(degrees, depth_mm);
    let [_, insertion] = formula.moves(&tool, &portal, &target).unwrap();
    Placement::of(&insertion.to, &portal).deviation_mm()
}

/// The table of docs/rcm-paper.md.
#[test]
fn as_printed_the_shaft_misses_the_portal() {
    for (degrees, at_30_mm, at_60_mm) in [
        (5.0, 2.39, 4.77),
        (10.0, 4.30, 8.61),
        (20.0, 6.70, 13.40),
        (30.0, 7.21, 14.41),
    ] {
        let found = [30.0, 60.0].map(|depth_mm| misses_mm(Formula::AsPrinted, degrees, depth_mm));
        assert!((found[0] - at_30_mm).abs() < 0.006, "{degrees} {found:?}");
        assert!((found[1] - at_60_mm).abs() < 0.006, "{degrees} {found:?}");
    }
}

#[test]
fn as_printed_the_matrix_is_no_rotation() {
    for (degrees, determinant) in [(5.0_f64, 0.989), (30.0, 0.731)] {
        let (sine, cosine) = degrees.to_radians().sin_cos();
        let (x1, x2) = (Vector3::x(), Vector3::new(cosine, sine, 0.0));
        let found = Formula::AsPrinted.matrix(&x1, &x2).determinant();
        assert!((found - determinant).abs() < 2e-3, "{degrees} {found}");
        assert!((Formula::Corrected.matrix(&x1, &x2).determinant() - 1.0).abs() < 1e-12);
    }
}

#[test]
fn corrected_both_moves_stay_on_the_portal() {
    for degrees in [0.0, 5.0, 30.0, 80.0] {
        let (tool, portal, target) = tool_and_target(degrees, 60.0);
        let moves = Formula::Corrected.moves(&tool, &portal, &target).unwrap();
        for line in moves {
            assert!(line.deviation_mm(&portal, 200) < 1e-9, "{degrees}");
        }
        assert!((moves[1].to.origin() - target).norm() < 1e-9);
    }
}

#[test]
fn the_portal_itself_is_no_target() {
    let (tool, portal, _) = tool_and_target(0.0, 60.0);
    assert!(Formula::Corrected.moves(&tool, &portal, &portal).is_none());
}
