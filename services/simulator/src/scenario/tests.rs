use std::path::PathBuf;

use arthro_geometry::ply;

use super::*;

/// The menisci of the shared data folder; none, said loudly, where there is no such folder.
pub(crate) fn shared_menisci() -> Vec<(String, Mesh)> {
    let root = std::env::var_os("ARTHRO_DATA").map_or_else(
        || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data"),
        PathBuf::from,
    );
    let Ok(entries) = std::fs::read_dir(root.join("menisci")) else {
        eprintln!("SKIPPED: no menisci in {}, set ARTHRO_DATA", root.display());
        return Vec::new();
    };
    let stated = Some(ply::Stated {
        space: ply::Space::Lps,
        unit: ply::Unit::Millimetre,
    });
    let mut menisci: Vec<(String, Mesh)> = entries
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|extension| extension == "ply"))
        .map(|path| {
            let mesh = ply::read_mesh(&std::fs::read(&path).unwrap(), stated).unwrap();
            (
                path.file_stem().unwrap().to_string_lossy().into_owned(),
                mesh,
            )
        })
        .collect();
    menisci.sort_by(|a, b| a.0.cmp(&b.0));
    menisci
}

#[test]
fn the_phantom_is_recognised_from_its_surface_alone() {
    let phantom = Scenario::phantom(Spec::default()).unwrap();
    let guessed = Crescent::of_mesh(&phantom.preoperative.model, &phantom.truth.voxels).unwrap();
    let known = &phantom.truth.crescent;
    let apart = known.ct_from_knee.inverse() * guessed.ct_from_knee;
    assert!(apart.rotation().angle().to_degrees() < 6.0, "{apart:?}");
    // The phantom's own centre is a parameter, not the middle of a circle.
    assert!(apart.translation_mm().norm() < 6.0, "{apart:?}");
}

#[test]
fn every_shared_meniscus_is_laid_superior_side_up() {
    for (name, mesh) in shared_menisci() {
        let superior_in_ct = if name.starts_with("smith2019") {
            Vector3::y()
        } else {
            Vector3::z()
        };
        let scenario = Scenario::of_mesh(Spec::default(), mesh).unwrap();
        let crescent = &scenario.truth.crescent;
        let superior = crescent.ct_from_knee.direction(&Vector3::z());
        assert!(superior.dot(&superior_in_ct) > 0.85, "{name}: {superior:?}");
        assert!(scenario.preoperative.lesion.len() > 10, "{name}");
    }
}

#[test]
fn the_papers_start_and_goal_are_kept_on_the_phantom() {
    let scenario = Scenario::phantom(Spec::default()).unwrap();
    let case = &scenario.preoperative;
    assert_eq!((case.start, case.goal), (phantom::START, phantom::GOAL));
    assert_eq!(case.target_box, phantom::TARGET_BOX);
    let knee_from_ct = scenario.truth.crescent.ct_from_knee.inverse();
    let portal = knee_from_ct * phantom::PORTAL_ANTEROLATERAL;
    let [forceps, _] = scenario
        .spec
        .layout
        .portals_in_knee(&scenario.truth.crescent);
    assert!((forceps - portal).norm() < 0.5, "{forceps} is not {portal}");
}

#[test]
fn the_lesion_of_a_mesh_lies_between_the_ends_of_its_contour_and_in_the_box() {
    for (name, mesh) in shared_menisci() {
        let scenario = Scenario::of_mesh(Spec::default(), mesh).unwrap();
        let case = &scenario.preoperative;
        let knee_from_ct = scenario.truth.crescent.ct_from_knee.inverse();
        let phi_deg = |point: &Point3| crescent::polar(&(knee_from_ct * *point)).0.to_degrees();
        assert!((phi_deg(&case.start) - 28.0).abs() < 1.0, "{name}");
        assert!((phi_deg(&case.goal) + 28.0).abs() < 1.0, "{name}");
        let (low, high) = case.target_box;
        for point in case.lesion.iter().chain([&case.start, &case.goal]) {
            assert!(phi_deg(point).abs() < 29.0, "{name}: {point}");
            assert!((0..3).all(|axis| (low[axis]..=high[axis]).contains(&point[axis])));
        }
    }
}

#[test]
fn a_saved_case_is_read_back_equal() {
    let folder = tempfile::tempdir().unwrap();
    let spec = Spec {
        seed: 5,
        ..Spec::default()
    };
    let phantom = Scenario::phantom(spec.clone()).unwrap();
    let as_mesh = Scenario::of_mesh(spec, phantom.preoperative.model.clone()).unwrap();
    for (name, case) in [("phantom", phantom), ("mesh", as_mesh)] {
        let folder = folder.path().join(name);
        case.save(&folder).unwrap();
        let read = Scenario::load(&folder).unwrap();
        assert_eq!(read.source, case.source);
        assert_eq!(read.spec, case.spec);
        assert_eq!(read.preoperative, case.preoperative);
        assert_eq!(read.system_view(), case.system_view());
        assert_eq!(read.camera_from_ct(), case.camera_from_ct());
    }
}

#[test]
fn an_unknown_key_in_a_scenario_file_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    Scenario::phantom(Spec::default())
        .unwrap()
        .save(folder.path())
        .unwrap();
    let path = folder.path().join("scenario.toml");
    let text = std::fs::read_to_string(&path).unwrap();
    std::fs::write(&path, text.replace("reach_deg", "reach_degrees")).unwrap();
    assert!(matches!(
        Scenario::load(folder.path()),
        Err(Error::ScenarioText { .. })
    ));
}

#[test]
fn the_seed_moves_the_knee_within_its_bounds_and_the_system_is_not_told() {
    let case = |seed: u64| {
        Scenario::phantom(Spec {
            seed,
            ..Spec::default()
        })
        .unwrap()
    };
    let nominal = case(0);
    let poses: Vec<_> = (0..20)
        .map(|seed| case(seed).truth.forceps_base_from_ct)
        .collect();
    for (seed, pose) in poses.iter().enumerate() {
        let case = case(seed as u64);
        let moved = case.spec.knee_displacement();
        assert!(moved.rotation().angle().to_degrees() <= 10.0);
        assert!(moved.translation_mm().amax() <= 8.0);
        assert!(seed == 0 || pose != &poses[0]);
        // All that the system gets of the knee is where its two portals are.
        assert_eq!(case.preoperative, nominal.preoperative);
        let portals = nominal.system_view();
        let told = SystemView {
            portal_in_forceps_base: portals.portal_in_forceps_base,
            portal_in_arthroscope_base: portals.portal_in_arthroscope_base,
            ..case.system_view()
        };
        assert_eq!(told, nominal.system_view());
    }
}

#[test]
fn what_is_no_crescent_is_refused_with_its_figure() {
    let ring = |gap_deg: f64| {
        let phantom = phantom::Phantom {
            horn_rad: (180.0 - 0.5 * gap_deg).to_radians(),
            ..phantom::Phantom::default()
        };
        Scenario::of_mesh(Spec::default(), phantom.mesh())
    };
    assert!(ring(60.0).is_ok());
    let refusal = ring(4.0).unwrap_err();
    assert!(
        matches!(refusal, Error::Model(crescent::NotACrescent::Gap { .. })),
        "{refusal:?}"
    );
    for scale in [1e-3, 1e3] {
        let mut mistaken = phantom::mesh();
        for vertex in &mut mistaken.vertices {
            *vertex *= scale;
        }
        let refusal = Scenario::of_mesh(Spec::default(), mistaken).unwrap_err();
        assert!(
            matches!(refusal, Error::Model(crescent::NotACrescent::Size { .. })),
            "{refusal:?}"
        );
    }
    let mut open = phantom::mesh();
    open.triangles.truncate(100);
    let refusal = Scenario::of_mesh(Spec::default(), open).unwrap_err();
    assert!(
        matches!(refusal, Error::Model(crescent::NotACrescent::Volume { .. })),
        "{refusal:?}"
    );
}

#[test]
fn a_number_out_of_range_is_refused_by_name_value_and_limit() {
    let mut spec = Spec::default();
    spec.knee.voxel_mm = 0.0;
    let refusal = Scenario::phantom(spec).unwrap_err();
    let expected = "scenario.knee.voxel_mm is 0, must be 0.1 .. 1 mm";
    assert_eq!(refusal.to_string(), expected);
}

fn mounted_off(seed: u64, mounting: Mounting) -> Scenario {
    let spec = Spec {
        seed,
        mounting,
        ..Spec::default()
    };
    Scenario::phantom(spec).unwrap()
}

#[test]
fn a_cell_is_mounted_as_drawn_unless_it_is_said_otherwise() {
    let scenario = mounted_off(3, Mounting::default());
    let (view, mounted) = (scenario.system_view(), &scenario.truth.mounted);
    let camera = view.forceps_base_from_camera.inverse() * mounted.forceps_base_from_camera;
    assert!(camera.translation_mm().norm() + camera.rotation().angle() < 1e-9);
    assert_eq!(mounted.divot, view.divot_in_forceps_base);
}

#[test]
fn an_uncalibrated_cell_is_off_its_drawing_and_has_the_same_knee() {
    let drawn = mounted_off(3, Mounting::default());
    let off = mounted_off(3, Mounting::uncalibrated());
    assert_eq!(
        off.truth.forceps_base_from_ct,
        drawn.truth.forceps_base_from_ct
    );
    // What the services are told does not give the truth away.
    assert_eq!(off.system_view(), drawn.system_view());
    let (real, view) = (&off.truth.mounted, off.system_view());
    let camera = view.forceps_base_from_camera.inverse() * real.forceps_base_from_camera;
    assert!(
        (1.0..20.0 * 3f64.sqrt()).contains(&camera.translation_mm().norm()),
        "{camera:?}"
    );
    assert!(camera.rotation().angle().to_degrees() <= 4.0);
    for tool in real.flange_from_tools {
        let tip_mm = (tool.origin() - view.flange_from_tool.origin()).norm();
        assert!((0.01..2.0 * 3f64.sqrt()).contains(&tip_mm), "{tip_mm}");
    }
    let other = mounted_off(4, Mounting::uncalibrated());
    assert_ne!(other.truth.mounted.divot, real.divot);
}

#[test]
fn a_mounting_out_of_range_is_refused_by_name() {
    let mounting = Mounting {
        tool_deg: 21.0,
        ..Mounting::default()
    };
    let spec = Spec {
        mounting,
        ..Spec::default()
    };
    let refused = Scenario::phantom(spec).unwrap_err().to_string();
    assert_eq!(
        refused,
        "scenario.mounting.tool_deg is 21, must be 0 .. 20 degrees"
    );
}

#[test]
fn a_deep_tear_still_leaves_the_rim_that_a_resection_needs() {
    let tear = |depth_fraction| {
        let mut spec = Spec::default();
        spec.tear.depth_fraction = depth_fraction;
        Scenario::phantom(spec).unwrap().truth
    };
    let (deep, rim_min_mm) = (tear(0.9), Spec::default().tear.rim_min_mm);
    let widest_mm = deep
        .crescent
        .sectors()
        .filter(|sector| sector.phi_rad.abs() < 0.07)
        .map(|sector| sector.rim_mm)
        .fold(0.0, f64::max);
    assert!(deep.tear.end_mm <= widest_mm - rim_min_mm);
    assert!(tear(0.2).tear.end_mm < tear(0.3).tear.end_mm);
}
