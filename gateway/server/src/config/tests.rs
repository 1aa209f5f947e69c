use super::*;

pub(super) fn calibration() -> Calibration {
    let pose = Pose {
        rotation: [1.0, 0.0, 0.0, 0.0],
        translation_mm: [0.0; 3],
    };
    Calibration {
        forceps_base_from_camera: pose,
        forceps_base_from_arthroscope_base: pose,
        forceps_portal_mm: [700.0, 0.0, 250.0],
        arthroscope_portal_mm: [0.0; 3],
        forceps_base_from_tool_at_tray: pose,
        arthroscope_rest_mm: [0.0; 3],
        valid_until: None,
        hand_eye_covariance: None,
        tool_tip_covariance_mm2: None,
    }
}

#[test]
fn a_covariance_that_no_measurement_has_is_refused() {
    let with = |rows: Vec<f64>| Config {
        calibration: Some(Calibration {
            tool_tip_covariance_mm2: Some(rows),
            ..calibration()
        }),
        ..Config::default()
    };
    let rows = |off: f64, other: f64| vec![0.01, off, 0.0, other, 0.04, 0.0, 0.0, 0.0, 0.01];
    assert!(with(rows(0.01, 0.01)).cell().is_ok());
    for (rows, expected) in [
        (vec![1.0; 8], "holds 8 numbers; must hold 9"),
        (rows(f64::NAN, 0.0), "must hold finite numbers"),
        (rows(0.01, 0.0), "is not symmetric"),
        (rows(0.03, 0.03), "must be at most 0.02"),
        (vec![-1.0; 9], "must be 0 or more"),
    ] {
        let problem = problem(&with(rows));
        assert!(problem.contains(expected), "{problem}");
    }
}

#[test]
fn an_end_that_is_no_day_is_refused() {
    let config = Config {
        calibration: Some(Calibration {
            valid_until: Some("31.01.2027".to_owned()),
            ..calibration()
        }),
        ..Config::default()
    };
    assert!(problem(&config).contains("valid_until is \"31.01.2027\"; must be a day"));
}

#[test]
fn a_list_that_names_a_replica_twice_is_refused() {
    let twice = vec!["127.0.0.1:1".to_owned(), "127.0.0.1:1".to_owned()];
    let config = Config {
        planning: Addresses::List(twice),
        ..Config::default()
    };
    let refusal = config.replicas().unwrap_err().to_string();
    assert_eq!(refusal, "gateway.planning lists \"127.0.0.1:1\" twice");
}

fn problem(config: &Config) -> String {
    config.cell().unwrap_err().to_string()
}

#[test]
fn a_non_unit_hand_eye_rotation_is_refused() {
    let mut calibration = calibration();
    calibration.forceps_base_from_camera.rotation = [1.0, 0.1, 0.0, 0.0];
    let config = Config {
        calibration: Some(calibration),
        ..Config::default()
    };
    assert!(problem(&config).contains("forceps_base_from_camera has a rotation of norm 1.00498"));
}

#[test]
fn a_portal_that_is_not_a_number_is_refused() {
    let mut calibration = calibration();
    calibration.forceps_portal_mm[1] = f64::NAN;
    let config = Config {
        calibration: Some(calibration),
        ..Config::default()
    };
    assert!(problem(&config).contains("forceps_portal_mm is 700, NaN, 250; must be finite"));
}

#[test]
fn a_jaw_in_metres_is_refused() {
    let config = Config {
        jaw: Jaw {
            width_mm: 0.003,
            length_mm: 0.0045,
            ..Jaw::default()
        },
        ..Config::default()
    };
    assert!(problem(&config).contains("jaw.width_mm is 0.003; must be within 0.5 .. 10"));
}

#[test]
fn a_tolerance_that_would_take_any_pose_is_refused() {
    let config = Config {
        pose_tolerance_mm: 1000.0,
        ..Config::default()
    };
    assert_eq!(
        config.rules().unwrap_err().to_string(),
        "gateway.pose_tolerance_mm is 1000; must be within 0.01 .. 10"
    );
}

#[test]
fn without_calibration_there_is_no_cell() {
    assert_eq!(Config::default().cell(), Ok(None));
}

impl Cell {
    /// A cell for tests that do not care where things are.
    pub(crate) fn for_tests() -> Self {
        let calibration = calibration();
        let config = Config {
            calibration: Some(calibration),
            ..Config::default()
        };
        config.cell().unwrap().unwrap()
    }
}
