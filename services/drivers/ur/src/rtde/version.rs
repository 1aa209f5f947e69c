//! The software a controller runs, and what depends on it.

use std::fmt;

/// Version of the controller software, as `v` answers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ControllerVersion {
    /// 3 on CB3, 5 on e-Series, 10 on PolyScope X.
    pub major: u32,
    /// Second number.
    pub minor: u32,
    /// Third number.
    pub bugfix: u32,
    /// Fourth number.
    pub build: u32,
}

/// The first software that has something, on each series.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Since {
    /// Of CB3 (major 3), as major, minor, bugfix; `None` where it never came.
    pub cb3: Option<[u32; 3]>,
    /// Of e-Series (major 5 and later).
    pub e_series: [u32; 3],
}

/// CB3 controllers before this one answer RTDE wrongly (RTDE guide; the maker's own client refuses them too).
const FIRST_SOUND_CB3: [u32; 3] = [3, 2, 19171];

impl ControllerVersion {
    /// From major, minor, bugfix, build.
    pub const fn new([major, minor, bugfix, build]: [u32; 4]) -> Self {
        Self {
            major,
            minor,
            bugfix,
            build,
        }
    }

    /// A controller of the third generation: 125 cycles a second, no remote control mode.
    pub const fn is_cb3(&self) -> bool {
        self.major < 5
    }

    /// Control cycles, and so RTDE packages, a second: 125 on CB3, 500 since.
    pub const fn max_frequency_hz(&self) -> f64 {
        if self.is_cb3() { 125.0 } else { 500.0 }
    }

    /// Has what came with `since`.
    pub fn has(&self, since: &Since) -> bool {
        let first = if self.is_cb3() {
            since.cb3
        } else {
            Some(since.e_series)
        };
        first.is_some_and(|first| [self.major, self.minor, self.bugfix] >= first)
    }

    /// RTDE of this software can be trusted: CB3 from 3.2.19171 on, and everything of e-Series.
    pub fn has_sound_rtde(&self) -> bool {
        match self.major {
            // Bugfix numbers were build counts until 3.2 and began anew with 3.3.
            0..=2 => false,
            3 => self.minor > 2 || self.bugfix >= FIRST_SOUND_CB3[2],
            _ => true,
        }
    }
}

impl fmt::Display for ControllerVersion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            major,
            minor,
            bugfix,
            build,
        } = self;
        write!(f, "{major}.{minor}.{bugfix}.{build}")
    }
}

impl fmt::Display for Since {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some([major, minor, bugfix]) = self.cb3 {
            write!(f, "{major}.{minor}.{bugfix} on CB3, ")?;
        }
        let [major, minor, bugfix] = self.e_series;
        write!(f, "{major}.{minor}.{bugfix} on e-Series")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_version_has_what_came_before_it_on_its_own_series() {
        let payload = Since {
            cb3: Some([3, 11, 0]),
            e_series: [5, 5, 1],
        };
        let version = |text: [u32; 3]| ControllerVersion::new([text[0], text[1], text[2], 0]);
        assert!(!version([3, 10, 9]).has(&payload));
        assert!(version([3, 11, 0]).has(&payload));
        assert!(!version([5, 5, 0]).has(&payload));
        assert!(version([5, 6, 0]).has(&payload));
        assert!(version([10, 7, 0]).has(&payload));
        let never = Since {
            cb3: None,
            e_series: [5, 9, 0],
        };
        assert!(!version([3, 15, 8]).has(&never));
    }

    #[test]
    fn early_third_generation_software_is_not_trusted() {
        for (parts, sound) in [
            ([3, 2, 19170, 0], false),
            ([3, 2, 19171, 0], true),
            ([3, 3, 0, 0], true),
            ([1, 8, 25000, 0], false),
            ([5, 0, 0, 0], true),
        ] {
            let version = ControllerVersion::new(parts);
            assert_eq!(version.has_sound_rtde(), sound, "{version}");
        }
    }
}
