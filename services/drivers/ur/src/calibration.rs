//! The calibration of one very arm, as its controller tells it, and whether it can be that of its make.

use crate::{
    Error,
    primary::{Configuration, Kinematics},
    rtde::ControllerVersion,
};

/// Farthest a calibrated flange may be from the drawing's, m. Calibrations move it by a few millimetres.
const MAX_SHIFT_M: f64 = 0.02;
/// Most a calibrated flange may be turned from the drawing's, rad.
const MAX_TURN_RAD: f64 = 0.05;

/// Denavit-Hartenberg parameters in the standard convention, m and rad: each joint turns by theta about z, moves d along
/// z and a along x, and tilts by alpha about x.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Calibration {
    /// Tells calibrations apart: another arm, or the same one calibrated anew, has others.
    pub checksum: [u32; 6],
    /// Added to the joint positions, rad.
    pub dh_theta: [f64; 6],
    /// m.
    pub dh_a: [f64; 6],
    /// m. Joints 2 to 4 are nearly parallel, so that their d are hardly determined one by one: real arms have values of
    /// many metres here that cancel.
    pub dh_d: [f64; 6],
    /// rad.
    pub dh_alpha: [f64; 6],
    /// As the controller numbers it; the numbers are not documented.
    pub status: u32,
}

/// A make of arm.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Model {
    /// CB3, 3 kg.
    Ur3,
    /// CB3, 5 kg.
    Ur5,
    /// CB3, 10 kg.
    Ur10,
    /// e-Series, 3 kg.
    Ur3e,
    /// e-Series, 5 kg.
    Ur5e,
    /// e-Series, 10 kg.
    Ur10e,
    /// e-Series, 16 kg.
    Ur16e,
    /// 20 kg.
    Ur20,
    /// 30 kg.
    Ur30,
}

/// Where the flange is: rotation by rows, and position in m.
type Pose = ([[f64; 3]; 3], [f64; 3]);

impl Model {
    /// What a configuration says, on a controller of this software; `None` for a make this crate does not know. Type
    /// numbers are those of UR's guide: CB3 and e-Series use the same ones.
    pub fn of(configuration: &Configuration, software: ControllerVersion) -> Option<Self> {
        match (configuration.robot_type, software.is_cb3()) {
            (1, true) => Some(Self::Ur5),
            (2, true) => Some(Self::Ur10),
            (3, true) => Some(Self::Ur3),
            (1, false) => Some(Self::Ur5e),
            (2, false) => Some(Self::Ur10e),
            (3, false) => Some(Self::Ur3e),
            (4, false) => Some(Self::Ur16e),
            (7, false) => Some(Self::Ur20),
            (8, false) => Some(Self::Ur30),
            _ => None,
        }
    }

    /// The drawing: d1, a2, a3, d4, d5, d6 in m (UR's table of DH parameters).
    fn lengths_m(self) -> [f64; 6] {
        match self {
            Self::Ur3 => [0.1519, -0.24365, -0.21325, 0.11235, 0.08535, 0.0819],
            Self::Ur5 => [0.089159, -0.425, -0.39225, 0.10915, 0.09465, 0.0823],
            Self::Ur10 => [0.1273, -0.612, -0.5723, 0.163941, 0.1157, 0.0922],
            Self::Ur3e => [0.15185, -0.24355, -0.2132, 0.13105, 0.08535, 0.0921],
            Self::Ur5e => [0.1625, -0.425, -0.3922, 0.1333, 0.0997, 0.0996],
            Self::Ur10e => [0.1807, -0.6127, -0.57155, 0.17415, 0.11985, 0.11655],
            Self::Ur16e => [0.1807, -0.4784, -0.36, 0.17415, 0.11985, 0.11655],
            Self::Ur20 => [0.2363, -0.8620, -0.7287, 0.2010, 0.1593, 0.1543],
            Self::Ur30 => [0.2363, -0.6370, -0.5037, 0.2010, 0.1593, 0.1543],
        }
    }

    /// The parameters of the drawing, without any calibration.
    pub fn nominal(self) -> Calibration {
        let [d1, a2, a3, d4, d5, d6] = self.lengths_m();
        let quarter = std::f64::consts::FRAC_PI_2;
        Calibration {
            checksum: [0; 6],
            dh_theta: [0.0; 6],
            dh_a: [0.0, a2, a3, 0.0, 0.0, 0.0],
            dh_d: [d1, 0.0, 0.0, d4, d5, d6],
            dh_alpha: [quarter, 0.0, 0.0, quarter, -quarter, 0.0],
            status: 0,
        }
    }
}

impl Calibration {
    /// The calibration that a controller told, if it can be that of this make.
    ///
    /// # Errors
    /// As [`Calibration::check`].
    pub fn import(kinematics: &Kinematics, model: Model) -> Result<Self, Error> {
        let Kinematics {
            checksum,
            dh_theta,
            dh_a,
            dh_d,
            dh_alpha,
            status,
        } = *kinematics;
        let calibration = Self {
            checksum,
            dh_theta,
            dh_a,
            dh_d,
            dh_alpha,
            status,
        };
        calibration.check(model)?;
        Ok(calibration)
    }

    /// Refuses numbers that are not finite, and an arm whose flange is nowhere near where that of this make is: the
    /// parameters one by one say little.
    ///
    /// # Errors
    /// [`Error::Value`], with the parameter or the distance that is wrong.
    pub fn check(&self, model: Model) -> Result<(), Error> {
        for (field, values) in [
            ("dh_theta", &self.dh_theta),
            ("dh_a", &self.dh_a),
            ("dh_d", &self.dh_d),
            ("dh_alpha", &self.dh_alpha),
        ] {
            for value in values {
                // So far away that the arithmetic below still has its digits.
                crate::link::in_range(field, *value, -1e4..=1e4, "-10000 to 10000")?;
            }
        }
        let nominal = model.nominal();
        for joints in PROBES {
            let (turn, at) = self.flange(&joints);
            let (nominal_turn, nominal_at) = nominal.flange(&joints);
            let shift_m = distance(&at, &nominal_at);
            crate::link::in_range(
                "shift of the calibrated flange, m",
                shift_m,
                0.0..=MAX_SHIFT_M,
                "0 to 0.02",
            )?;
            crate::link::in_range(
                "turn of the calibrated flange, rad",
                angle_rad(&turn, &nominal_turn),
                0.0..=MAX_TURN_RAD,
                "0 to 0.05",
            )?;
        }
        Ok(())
    }

    /// Base from flange at these joint positions, rad: rotation by rows, and position in m.
    pub fn flange(&self, joints_rad: &[f64; 6]) -> Pose {
        let mut turn = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let mut at = [0.0; 3];
        for (joint, position_rad) in joints_rad.iter().enumerate() {
            let (sin, cos) = (position_rad + self.dh_theta[joint]).sin_cos();
            let (tilt_sin, tilt_cos) = self.dh_alpha[joint].sin_cos();
            let (a, d) = (self.dh_a[joint], self.dh_d[joint]);
            let step = [
                [cos, -sin * tilt_cos, sin * tilt_sin],
                [sin, cos * tilt_cos, -cos * tilt_sin],
                [0.0, tilt_sin, tilt_cos],
            ];
            let way = [a * cos, a * sin, d];
            let row = |row: usize, of: [f64; 3]| {
                turn[row][0] * of[0] + turn[row][1] * of[1] + turn[row][2] * of[2]
            };
            at = [0, 1, 2].map(|of| at[of] + row(of, way));
            turn = [0, 1, 2].map(|of| {
                [0, 1, 2].map(|column| row(of, [step[0][column], step[1][column], step[2][column]]))
            });
        }
        (turn, at)
    }
}

/// Stretched, bent and folded arms, in which wrong lengths show.
const PROBES: [[f64; 6]; 4] = [
    [0.0; 6],
    [0.3, -1.2, 1.6, -0.9, 1.1, 0.4],
    [-2.0, -2.1, -1.3, 0.5, -1.4, 2.6],
    [1.1, -0.4, 2.4, 1.9, 0.2, -1.0],
];

fn distance(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    a.iter()
        .zip(b)
        .map(|(a, b)| (a - b).powi(2))
        .sum::<f64>()
        .sqrt()
}

/// Between two rotations, by the length of their difference: exact where angles are small.
fn angle_rad(a: &[[f64; 3]; 3], b: &[[f64; 3]; 3]) -> f64 {
    let squares: f64 = a
        .iter()
        .flatten()
        .zip(b.iter().flatten())
        .map(|(a, b)| (a - b).powi(2))
        .sum();
    2.0 * (squares / 8.0).sqrt().clamp(0.0, 1.0).asin()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const MODELS: [Model; 9] = [
        Model::Ur3,
        Model::Ur5,
        Model::Ur10,
        Model::Ur3e,
        Model::Ur5e,
        Model::Ur10e,
        Model::Ur16e,
        Model::Ur20,
        Model::Ur30,
    ];

    #[test]
    fn the_drawing_puts_the_flange_where_it_is() {
        let (turn, at) = Model::Ur5.nominal().flange(&[0.0; 6]);
        for (is, should) in at.iter().zip([-0.81725, -0.19145, -0.005491]) {
            assert!((is - should).abs() < 1e-12, "{at:?}");
        }
        assert!((turn[1][2] + 1.0).abs() < 1e-12, "{turn:?}");
    }

    #[test]
    fn no_make_passes_for_another_size() {
        for told in MODELS {
            for asked in MODELS {
                let near = told
                    .lengths_m()
                    .iter()
                    .zip(asked.lengths_m())
                    .all(|(a, b)| (a - b).abs() < 0.001);
                assert_eq!(
                    told.nominal().check(asked).is_ok(),
                    near,
                    "{told:?} {asked:?}"
                );
            }
        }
    }

    /// A tilted joint 2 lets d of 2 and 3 grow without moving the flange, as in real arms.
    #[test]
    fn far_parameters_that_cancel_are_no_fault() {
        let mut calibration = Model::Ur5.nominal();
        (calibration.dh_d[1], calibration.dh_d[2]) = (300.0, -300.0 - 0.001);
        assert!(calibration.check(Model::Ur5).is_ok());
        calibration.dh_d[2] = -299.0;
        let error = calibration.check(Model::Ur5).unwrap_err().to_string();
        assert!(
            error.starts_with("shift of the calibrated flange, m is 1"),
            "{error}"
        );
    }

    #[test]
    fn what_is_no_number_is_refused_by_name() {
        let mut calibration = Model::Ur5e.nominal();
        calibration.dh_alpha[3] = f64::NAN;
        assert!(matches!(
            calibration.check(Model::Ur5e),
            Err(Error::Value {
                field: "dh_alpha",
                ..
            })
        ));
    }

    proptest! {
        #[test]
        fn a_real_calibration_passes(
            lengths in proptest::array::uniform12(-0.001..0.001f64),
            angles in proptest::array::uniform12(-0.001..0.001f64),
            model in proptest::sample::select(MODELS.to_vec()),
        ) {
            let mut calibration = model.nominal();
            for joint in 0..6 {
                calibration.dh_a[joint] += lengths[joint];
                calibration.dh_d[joint] += lengths[6 + joint];
                calibration.dh_theta[joint] += angles[joint];
                calibration.dh_alpha[joint] += angles[6 + joint];
            }
            prop_assert!(calibration.check(model).is_ok());
        }
    }
}
