//! Which controller is simulated: its generation and software version, and what follows from them.

use std::{fmt, str::FromStr};

use serde::{Deserialize, Serialize};

use super::kinematics::{Dh, UR5, UR5E};

/// Generation of controller and arm.
#[derive(Clone, Copy, Debug, Default, Deserialize, PartialEq, Eq, Serialize, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum Series {
    /// CB3 with a UR5: software 3.x, 125 cycles a second.
    #[default]
    Cb3,
    /// e-Series with a UR5e: software 5.x, 500 cycles a second.
    E,
}

impl Series {
    /// One cycle of the controller, s.
    pub const fn step_s(self) -> f64 {
        match self {
            Self::Cb3 => 0.008,
            Self::E => 0.002,
        }
    }

    /// Most packages a second that an RTDE client can have.
    pub const fn max_rate_hz(self) -> f64 {
        match self {
            Self::Cb3 => 125.0,
            Self::E => 500.0,
        }
    }

    /// Software that is simulated unless told otherwise.
    pub const fn default_version(self) -> Version {
        match self {
            Self::Cb3 => Version([3, 15, 8, 106_339]),
            Self::E => Version([5, 12, 6, 1_102_099]),
        }
    }

    /// Major number of its software.
    pub const fn major(self) -> u32 {
        match self {
            Self::Cb3 => 3,
            Self::E => 5,
        }
    }

    /// Nominal geometry of the arm.
    pub const fn dh(self) -> Dh {
        match self {
            Self::Cb3 => UR5,
            Self::E => UR5E,
        }
    }
}

impl fmt::Display for Series {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Cb3 => "cb3",
            Self::E => "e",
        })
    }
}

/// Controller software: major, minor, bugfix, build.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Version(pub [u32; 4]);

impl Version {
    /// The software has what came with `cb3` on CB3 and with `e` on e-Series (major, minor, bugfix).
    pub fn has(self, since: Since) -> bool {
        let [major, minor, bugfix, _] = self.0;
        let first = if major < 4 { since.cb3 } else { since.e };
        first.is_some_and(|first| [major, minor, bugfix] >= first)
    }
}

/// First versions with a feature; `None` where it never came.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Since {
    /// On CB3.
    pub cb3: Option<[u32; 3]>,
    /// On e-Series.
    pub e: Option<[u32; 3]>,
}

impl Since {
    /// In every version.
    pub const ALWAYS: Self = Self::new([0, 0, 0], [0, 0, 0]);

    /// Since these.
    pub const fn new(cb3: [u32; 3], e: [u32; 3]) -> Self {
        Self {
            cb3: Some(cb3),
            e: Some(e),
        }
    }

    /// On e-Series only.
    pub const fn e_only(e: [u32; 3]) -> Self {
        Self {
            cb3: None,
            e: Some(e),
        }
    }

    /// On CB3 only.
    pub const fn cb3_only(cb3: [u32; 3]) -> Self {
        Self {
            cb3: Some(cb3),
            e: None,
        }
    }
}

/// Text that names no version.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("version {0:?} is not of the form 3.15.8 or 3.15.8.106339")]
pub struct NotAVersion(String);

impl FromStr for Version {
    type Err = NotAVersion;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let refuse = || NotAVersion(text.to_owned());
        let parts: Vec<u32> = text
            .split('.')
            .map(|part| part.parse().map_err(|_| refuse()))
            .collect::<Result<_, _>>()?;
        match parts[..] {
            [major, minor, bugfix] => Ok(Self([major, minor, bugfix, 0])),
            [major, minor, bugfix, build] => Ok(Self([major, minor, bugfix, build])),
            _ => Err(refuse()),
        }
    }
}

impl fmt::Display for Version {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [major, minor, bugfix, build] = self.0;
        write!(f, "{major}.{minor}.{bugfix}.{build}")
    }
}

impl Serialize for Version {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl<'de> Deserialize<'de> for Version {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        String::deserialize(deserializer)?
            .parse()
            .map_err(serde::de::Error::custom)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_feature_is_there_since_the_version_of_its_own_generation() {
        let since = Since::new([3, 11, 0], [5, 5, 1]);
        let has = |text: &str| text.parse::<Version>().unwrap().has(since);
        assert!(!has("3.10.9") && has("3.11.0") && has("3.15.8.106339"));
        assert!(!has("5.5.0") && has("5.5.1"));
        assert!(
            !"3.15.8"
                .parse::<Version>()
                .unwrap()
                .has(Since::e_only([5, 0, 0]))
        );
    }

    #[test]
    fn text_that_is_no_version_is_refused() {
        for text in ["", "3", "3.15", "3.15.x", "3.15.8.1.2", "-3.1.2"] {
            assert!(text.parse::<Version>().is_err(), "{text}");
        }
    }
}
