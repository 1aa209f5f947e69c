//! Partial, noisy views of real menisci with known truth (`registration/cases.json` of the data folder).

use arthro_registration::gate::Verdict;

use crate::world::cases;

#[test]
fn every_easy_case_is_solved() {
    for case in cases("easy") {
        let outcome = case.solve();
        assert!(
            outcome.is_success(),
            "{}: {:.2} deg, {:.2} mm",
            case.name,
            outcome.rotation_deg,
            outcome.centroid_mm
        );
        assert!(
            outcome.answer.mse_mm2 < outcome.answer.coarse_mse_mm2,
            "{}",
            case.name
        );
    }
}

#[test]
fn nine_tenths_of_the_medium_cases_are_solved_and_no_wrong_one_is_accepted() {
    let cases = cases("medium");
    let mut solved = 0;
    for case in &cases {
        let outcome = case.solve();
        solved += usize::from(outcome.is_success());
        assert!(
            outcome.is_success() || outcome.answer.verdict != Verdict::Accept,
            "{}",
            case.name
        );
    }
    assert!(
        solved * 10 >= cases.len() * 9,
        "{solved} of {}",
        cases.len()
    );
}
