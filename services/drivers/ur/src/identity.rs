//! Which controller answers, and whether this crate's program can run there.

use std::fmt;

use crate::rtde::ControllerVersion;
use crate::{Dashboard, Error};

/// The upper registers, which RTDE clients use, came with these versions.
const CB3_NEEDED: [u32; 2] = [3, 9];
const E_SERIES_NEEDED: [u32; 2] = [5, 3];
/// The dashboard tells of remote control and of the model from these versions on.
const CB3_TELLS: [u32; 2] = [3, 12];
const E_SERIES_TELLS: [u32; 2] = [5, 6];

/// Generations of controllers, told apart by their major version.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Series {
    /// Software 3.x, a cycle of 8 ms.
    Cb3,
    /// Software 5.x, a cycle of 2 ms.
    ESeries,
}

impl Series {
    /// Controller cycles per second: the most states that RTDE sends.
    pub fn frequency_hz(self) -> f64 {
        match self {
            Self::Cb3 => 125.0,
            Self::ESeries => 500.0,
        }
    }
}

impl fmt::Display for Series {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Cb3 => "CB3",
            Self::ESeries => "e-Series",
        })
    }
}

/// The robot that a client means to command.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Expected {
    /// Its generation.
    pub series: Series,
    /// Its model as the dashboard names it, such as "UR5": an e-Series arm has the same name.
    pub model: String,
}

/// What a controller says it is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Identity {
    /// From the major version.
    pub series: Series,
    /// Major, minor, bugfix, build.
    pub version: [u32; 4],
    /// As the dashboard names it; none from software that does not tell.
    pub model: Option<String>,
}

impl Identity {
    /// From the version that RTDE reports.
    ///
    /// # Errors
    /// [`Error::TooOld`] for software in which this crate's program cannot run.
    pub fn from_version(version: [u32; 4]) -> Result<Self, Error> {
        let [major, minor, ..] = version;
        let (series, needed) = match major {
            3 => (Series::Cb3, CB3_NEEDED),
            5 => (Series::ESeries, E_SERIES_NEEDED),
            _ => return Err(firmware(version)),
        };
        if [major, minor] < needed {
            return Err(firmware(version));
        }
        Ok(Self {
            series,
            version,
            model: None,
        })
    }

    /// Asks the dashboard for the model, and whether clients may command.
    ///
    /// # Errors
    /// [`Error::LocalControl`], [`Error::WrongRobot`] if it is not the one `expected`, connection failures.
    pub(crate) async fn complete(
        &mut self,
        dashboard: &mut Dashboard,
        expected: Option<&Expected>,
    ) -> Result<(), Error> {
        let tells = match self.series {
            Series::Cb3 => CB3_TELLS,
            Series::ESeries => E_SERIES_TELLS,
        };
        if self.version[..2] >= tells[..] {
            if self.series == Series::ESeries
                && dashboard.ask("is in remote control").await?.trim() == "false"
            {
                return Err(Error::LocalControl);
            }
            let model = dashboard.ask("get robot model").await?;
            // Software that does not know the question answers with a sentence.
            self.model = Some(model.trim().to_owned()).filter(|model| model.starts_with("UR"));
        }
        match expected {
            Some(expected) => self.must_be(expected),
            None => Ok(()),
        }
    }

    fn must_be(&self, expected: &Expected) -> Result<(), Error> {
        let same_model = self
            .model
            .as_ref()
            .is_none_or(|model| model.eq_ignore_ascii_case(&expected.model));
        if same_model && self.series == expected.series {
            return Ok(());
        }
        Err(Error::WrongRobot {
            found: self.to_string(),
            wanted: format!("{} {}", expected.model, expected.series),
        })
    }
}

impl fmt::Display for Identity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [major, minor, bugfix, build] = self.version;
        let model = self.model.as_deref().unwrap_or("UR");
        write!(
            f,
            "{model} {} {major}.{minor}.{bugfix}.{build}",
            self.series
        )
    }
}

fn firmware([major, minor, bugfix, build]: [u32; 4]) -> Error {
    Error::TooOld {
        what: "the program on the controller",
        found: ControllerVersion {
            major,
            minor,
            bugfix,
            build,
        },
        needs: "3.9 or later of 3.x, or 5.3 or later of 5.x",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn old_and_unknown_software_is_refused_by_name() {
        for version in [
            [3, 8, 9, 0],
            [5, 2, 0, 0],
            [1, 8, 0, 0],
            [10, 1, 0, 0],
            [4, 9, 0, 0],
        ] {
            let refusal = Identity::from_version(version).unwrap_err();
            assert!(
                matches!(refusal, Error::TooOld { .. }),
                "{version:?}: {refusal}"
            );
        }
        assert_eq!(
            Identity::from_version([3, 9, 0, 0]).unwrap().series,
            Series::Cb3
        );
        assert_eq!(
            Identity::from_version([5, 12, 0, 0]).unwrap().series,
            Series::ESeries
        );
    }

    #[test]
    fn another_robot_than_the_one_meant_is_refused() {
        let mut identity = Identity::from_version([5, 12, 0, 1]).unwrap();
        let expected = Expected {
            series: Series::Cb3,
            model: "UR5".into(),
        };
        let refusal = identity.must_be(&expected).unwrap_err().to_string();
        assert_eq!(
            refusal,
            "the robot is UR e-Series 5.12.0.1, wanted is UR5 CB3"
        );
        identity.series = Series::Cb3;
        identity.model = Some("UR10".into());
        assert!(identity.must_be(&expected).is_err());
        identity.model = Some("UR5".into());
        identity.must_be(&expected).unwrap();
    }
}
