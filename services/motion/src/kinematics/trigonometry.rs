//! Sines and cosines of several angles at once, without branches, so that the compiler computes them side by side.
//!
//! An angle is `k pi/2 + r`, |r| <= pi/4, with pi/2 in two parts of which the first times k is exact; sine and cosine of
//! r are polynomials through Chebyshev nodes, off by less than 2e-17. Against the standard library the results differ by
//! 2.3e-16 at most.

/// Beyond this `k` times the first part of pi/2 is not exact any more, rad.
const LARGEST_RAD: f64 = 1e5;
/// Adding it leaves an integer in the lowest bits: 1.5 * 2^52.
const ROUND: f64 = 6_755_399_441_055_744.0;
/// The first 33 bits of pi/2, and the rest.
const HALF_PI: (f64, f64) = (1.5707963267341256, 6.077100506506192e-11);
/// `sin r = r + r^3 S(r^2)`.
const S: [f64; 6] = [
    -0.16666666666666666,
    0.008333333333330948,
    -0.00019841269836756774,
    2.7557316101617874e-06,
    -2.505113165023518e-08,
    1.5918115263265974e-10,
];
/// `cos r = 1 - r^2 / 2 + r^4 C(r^2)`.
const C: [f64; 6] = [
    0.041666666666666664,
    -0.0013888888888887398,
    2.480158729876456e-05,
    -2.7557317271145144e-07,
    2.087614614655861e-09,
    -1.1382623647474604e-11,
];

/// Sine and cosine of each angle.
#[inline(always)]
pub fn sin_cos<const N: usize>(angles_rad: &[f64; N]) -> ([f64; N], [f64; N]) {
    // Also false for NaN.
    if !angles_rad
        .iter()
        .all(|angle| (..=LARGEST_RAD).contains(&angle.abs()))
    {
        return (angles_rad.map(f64::sin), angles_rad.map(f64::cos));
    }
    let (mut sines, mut cosines) = ([0.0; N], [0.0; N]);
    for i in 0..N {
        let shifted = angles_rad[i] * std::f64::consts::FRAC_2_PI + ROUND;
        let (k, quarter) = (shifted - ROUND, shifted.to_bits());
        let r = (angles_rad[i] - k * HALF_PI.0) - k * HALF_PI.1;
        let z = r * r;
        let sine = r + r * z * at(&S, z);
        let cosine = 1.0 - (0.5 * z - z * z * at(&C, z));
        let (a, b) = (sine.to_bits(), cosine.to_bits());
        // In odd quarters sine and cosine change places.
        let exchanged = (a ^ b) & (quarter & 1).wrapping_neg();
        // The sine is negative in quarters 2 and 3, the cosine in 1 and 2.
        sines[i] = f64::from_bits(a ^ exchanged ^ ((quarter & 2) << 62));
        cosines[i] = f64::from_bits(b ^ exchanged ^ ((quarter.wrapping_add(1) & 2) << 62));
    }
    (sines, cosines)
}

#[inline(always)]
fn at(polynomial: &[f64; 6], z: f64) -> f64 {
    let [a, b, c, d, e, f] = polynomial;
    let z2 = z * z;
    (a + z * b) + z2 * ((c + z * d) + z2 * (e + z * f))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn agrees(angle: f64) -> bool {
        let ([sine], [cosine]) = sin_cos(&[angle]);
        (sine - angle.sin()).abs() <= 2.3e-16 && (cosine - angle.cos()).abs() <= 2.3e-16
    }

    #[test]
    fn quarter_turns_and_their_neighbours_agree_with_the_standard_library() {
        for k in -100..=100 {
            let angle = f64::from(k) * std::f64::consts::FRAC_PI_4;
            for off in [0.0, 1e-300, 1e-16, -1e-16, 1e-9, -1e-9] {
                assert!(agrees(angle + off), "{k} {off}");
            }
        }
        // Small sines keep their digits.
        let ([sine], _) = sin_cos(&[1e-12]);
        assert_eq!(sine, 1e-12);
    }

    #[test]
    fn what_is_no_number_gives_none() {
        for angle in [f64::NAN, f64::INFINITY] {
            let (sines, cosines) = sin_cos(&[0.5, angle]);
            assert!(sines[1].is_nan() && cosines[1].is_nan());
            assert_eq!(sines[0], 0.5_f64.sin());
        }
    }

    proptest! {
        #[test]
        fn every_angle_agrees_with_the_standard_library(near in -10.0..10.0f64, far in -2e5..2e5f64) {
            prop_assert!(agrees(near), "{near}");
            prop_assert!(agrees(far), "{far}");
        }
    }
}
