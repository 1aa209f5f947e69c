//! Partial, noisy views of real menisci with known truth (`registration/cases.json` of the data folder).

use arthro_registration::gate::Verdict;
use arthro_registration::pipeline::Method;
use arthro_registration::scale::ScaleRange;

use crate::world::cases;

/// Solves all cases of a level; of twenty at least `least` must be solved, and no wrong answer accepted.
fn solve_level(level: &str, scale: Option<ScaleRange>, least: usize) {
    let cases = cases(level);
    let (mut solved, mut refused) = (0, 0);
    for mut case in cases.iter().cloned() {
        case.options.scale = scale.unwrap_or(case.options.scale);
        let outcome = case.solve();
        let answer = &outcome.answer;
        let said = format!(
            "{}: {:.2} deg, {:.2} mm, {:.2} %, {:?} {:?}",
            case.name,
            outcome.rotation_deg,
            outcome.centroid_mm,
            outcome.scale_percent,
            answer.verdict,
            answer.reasons
        );
        if outcome.is_success() {
            solved += 1;
            refused += usize::from(answer.verdict == Verdict::Reject);
            assert!(answer.mse_mm2 < answer.coarse_mse_mm2, "{said}");
        } else {
            eprintln!("not solved: {said}");
            assert_ne!(answer.verdict, Verdict::Accept, "{said}");
        }
    }
    assert!(
        solved * 20 >= cases.len() * least,
        "{solved} of {}",
        cases.len()
    );
    assert!(
        refused * 20 <= cases.len(),
        "{refused} solved ones are refused"
    );
}

/// Nothing is known of the scale; the views are metric.
const FREE: Option<ScaleRange> = Some(ScaleRange {
    low: 0.3,
    high: 3.5,
});

#[test]
fn easy_cases_are_solved_at_any_scale() {
    solve_level("easy", None, 20);
    solve_level("easy", FREE, 20);
}

#[test]
fn medium_cases_are_solved_at_any_scale() {
    solve_level("medium", None, 20);
    solve_level("medium", FREE, 19);
}

#[test]
fn most_hard_cases_are_solved_at_any_scale_and_the_others_not_accepted() {
    solve_level("hard", None, 17);
    solve_level("hard", FREE, 15);
}

#[test]
fn what_the_papers_method_gets_wrong_is_not_accepted() {
    for mut case in cases("medium") {
        case.options.method = Method::Paper;
        let outcome = case.solve();
        assert!(
            outcome.is_success() || outcome.answer.verdict != Verdict::Accept,
            "{}: {:.2} deg accepted",
            case.name,
            outcome.rotation_deg
        );
    }
}
