//! The analytic inverse loses nothing and reaches what it says, singular poses included.

#[path = "../benches/kinematics/sweep.rs"]
mod sweep;

use arthro_motion::kinematics::model::Make;

/// `ARTHRO_POSES` sets how many are tried of each make.
#[test]
fn no_pose_is_missed_and_no_branch_lost() {
    let cases = std::env::var("ARTHRO_POSES").map_or(100_000, |poses| poses.parse().unwrap());
    for (seed, make) in [(1, Make::Ur5), (2, Make::Ur5e)] {
        let account = sweep::account(&make.into(), seed, cases);
        eprintln!("{make:?}, {cases} poses: {account:?}");
        assert_eq!((account.missing, account.lost), (0, 0));
        // 1e-12 m.
        assert!(account.worst_mm <= 1e-9, "{account:?}");
        assert!(account.worst_rad <= 1e-11, "{account:?}");
    }
}
