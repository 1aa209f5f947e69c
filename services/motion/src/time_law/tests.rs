use proptest::prelude::*;

use super::*;

fn limits() -> impl Strategy<Value = RateLimits> {
    (-3.0..2.0f64, -3.0..4.0f64, -3.0..6.0f64).prop_map(|(speed, acceleration, jerk)| RateLimits {
        speed: 10_f64.powf(speed),
        acceleration: 10_f64.powf(acceleration),
        jerk: 10_f64.powf(jerk),
    })
}

/// Duration of the fastest symmetric law from rest to rest, by formula.
fn shortest_s(limits: &RateLimits) -> f64 {
    let RateLimits {
        speed,
        acceleration,
        jerk,
    } = *limits;
    let rounding_s = acceleration / jerk;
    let with_full_acceleration =
        0.5 * acceleration * ((rounding_s.powi(2) + 4.0 / acceleration).sqrt() - rounding_s);
    let peak = if with_full_acceleration >= acceleration * rounding_s {
        with_full_acceleration
    } else {
        (0.25 * jerk).cbrt()
    };
    let reached = speed.min(peak);
    let jerk_s = (reached / jerk).sqrt().min(acceleration / jerk);
    let ramp_s = jerk_s + reached / (jerk * jerk_s);
    2.0 * ramp_s + (1.0 / reached - ramp_s).max(0.0)
}

/// The state is within the limits at every place, and each number is the integral of the next.
fn check(law: &TimeLaw, limits: &RateLimits) -> Result<(), TestCaseError> {
    let steps = 400;
    let h = law.duration_s() / f64::from(steps);
    let mut before = law.rate(0.0);
    for step in 0..steps {
        let now = law.rate(f64::from(step) * h);
        prop_assert!(
            now.speed.abs() <= limits.speed * (1.0 + 1e-6),
            "{now:?} {limits:?}"
        );
        prop_assert!(now.acceleration.abs() <= limits.acceleration * (1.0 + 1e-6) + 1e-9);
        prop_assert!(now.jerk.abs() <= limits.jerk * (1.0 + 1e-6));
        if step > 0 {
            let mean = 0.5 * (now.speed + before.speed);
            // The trapezium misses by the second derivative, which is at most the acceleration's change.
            let miss = limits.jerk * h.powi(3) / 2.0 + 1e-7;
            prop_assert!(
                (now.s - before.s - mean * h).abs() <= miss,
                "{now:?} {before:?}"
            );
        }
        before = now;
    }
    Ok(())
}

proptest! {
    #[test]
    fn the_law_goes_from_rest_to_rest_within_its_limits(limits in limits()) {
        let law = TimeLaw::new(&limits).unwrap();
        prop_assert_eq!(law.at(0.0), 0.0);
        prop_assert_eq!(law.at(law.duration_s()), 1.0);
        prop_assert!((law.at(law.duration_s() * (1.0 - 1e-12)) - 1.0).abs() < 1e-7);
        check(&law, &limits)?;
    }

    #[test]
    fn the_law_is_the_shortest_there_is_and_symmetric(limits in limits(), t in 0.0..1.0f64) {
        let law = TimeLaw::new(&limits).unwrap();
        let shortest_s = shortest_s(&limits);
        prop_assert!((law.duration_s() / shortest_s - 1.0).abs() < 1e-6, "{} {}", law.duration_s(), shortest_s);
        let (a, b) = (law.at(t * law.duration_s()), law.at((1.0 - t) * law.duration_s()));
        prop_assert!((a + b - 1.0).abs() < 1e-7);
    }

    #[test]
    fn the_same_limits_give_the_same_law(limits in limits()) {
        prop_assert_eq!(TimeLaw::new(&limits).unwrap(), TimeLaw::new(&limits).unwrap());
    }

    #[test]
    fn limits_dilated_are_the_law_run_slower(limits in limits(), by in 1.0..20.0f64, t in 0.0..1.0f64) {
        let law = TimeLaw::new(&limits).unwrap();
        let slower = TimeLaw::new(&limits.dilated(by)).unwrap();
        prop_assert!((slower.duration_s() / (by * law.duration_s()) - 1.0).abs() < 1e-6);
        prop_assert!((slower.at(t * slower.duration_s()) - law.at(t * law.duration_s())).abs() < 1e-6);
    }

    #[test]
    fn a_law_can_begin_under_way(
        limits in limits(), s in 0.0..0.9f64, speed in 0.0..1.0f64,
    ) {
        let start = Rate { s, speed: speed * limits.speed, ..Rate::default() };
        let law = TimeLaw::from(&start, &limits).unwrap();
        prop_assert!((law.at(0.0) - s).abs() < 1e-12);
        prop_assert!((law.rate(0.0).speed - start.speed).abs() <= 1e-9 * limits.speed);
        prop_assert_eq!(law.at(law.duration_s()), 1.0);
    }
}

#[test]
fn a_slow_limit_gives_a_cruise_at_that_speed() {
    let limits = RateLimits {
        speed: 0.5,
        acceleration: 5.0,
        jerk: 50.0,
    };
    let law = TimeLaw::new(&limits).unwrap();
    assert!((law.duration_s() - (2.0 + 0.2)).abs() < 1e-9);
    assert!((law.rate(1.1).speed - 0.5).abs() < 1e-9);
}

#[test]
fn limits_that_are_none_are_refused() {
    for jerk in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let limits = RateLimits {
            speed: 1.0,
            acceleration: 1.0,
            jerk,
        };
        assert_eq!(TimeLaw::new(&limits).unwrap_err().reason(), "NO_TIMING");
    }
}
