use arthro_geometry::{Rotation, Vector3};

use super::*;
use crate::scenario::{Scenario, Spec};

fn knee() -> Knee {
    Knee::new(&Scenario::phantom(Spec::default()).unwrap())
}

/// A box at a point of the knee's frame, its axes those of the knee.
fn jaw_at(knee: &Knee, at: Point3, half_mm: Vector3) -> JawBox {
    let knee_from_jaw = Rigid::<KneeFrame, Tool>::new(Rotation::identity(), at.coords);
    JawBox {
        forceps_base_from_jaw: *knee.forceps_base_from_knee() * knee_from_jaw,
        half_mm,
    }
}

#[test]
fn the_phantom_has_the_tissue_of_its_surface() {
    let intact = knee().intact();
    assert!((1900.0..2100.0).contains(&intact.total_mm3()), "{intact:?}");
    assert!((13.0..20.0).contains(&intact.damaged_mm3), "{intact:?}");
}

#[test]
fn tissue_is_cut_once() {
    let mut knee = knee();
    let jaw = jaw_at(
        &knee,
        Point3::new(0.0, 15.0, 2.0),
        Vector3::new(2.25, 1.5, 5.0),
    );
    let between = knee.between(&jaw);
    assert!(
        between.volume.total_mm3() > 10.0 && between.thickness_mm > 2.0,
        "{between:?}"
    );
    assert_eq!(knee.cut(&jaw), between.volume);
    assert_eq!(knee.cut(&jaw), Volume::default());
    assert_eq!(knee.between(&jaw), Bitten::default());
}

#[test]
fn a_box_askew_to_the_grid_takes_its_own_volume() {
    let mut knee = knee();
    let mut jaw = jaw_at(
        &knee,
        Point3::new(0.0, 19.0, 2.2),
        Vector3::new(1.2, 1.2, 0.6),
    );
    let turn = Rotation::from_scaled_axis(Vector3::new(0.3, -0.2, 0.7));
    jaw.forceps_base_from_jaw =
        jaw.forceps_base_from_jaw * Rigid::<Tool, Tool>::new(turn, Vector3::zeros());
    let volume = knee.cut(&jaw).total_mm3();
    let expected = 2.4 * 2.4 * 1.2;
    assert!(
        (volume - expected).abs() < 0.15 * expected,
        "{volume} of {expected} mm3"
    );
}

#[test]
fn the_rim_narrows_to_what_a_cut_leaves() {
    let mut knee = knee();
    let intact_mm = knee.rim_min_mm();
    assert!((7.0..9.0).contains(&intact_mm), "{intact_mm} mm");
    // The rim of the body is at 22.5 mm.
    let jaw = jaw_at(
        &knee,
        Point3::new(0.0, 14.5, 3.0),
        Vector3::new(2.0, 4.0, 6.0),
    );
    knee.cut(&jaw);
    let left_mm = knee.rim_min_mm();
    assert!((left_mm - 4.0).abs() < 0.7, "{left_mm} mm");
}

#[test]
fn the_portals_are_in_the_skin() {
    let knee = knee();
    let middle = knee.forceps_base_from_knee().origin();
    for portal in knee.portals() {
        assert!(knee.under_skin(&(portal + (middle - portal) * 1e-6)));
        assert!(!knee.under_skin(&(portal - (middle - portal) * 1e-6)));
    }
}
