//! How the two arms of a cell stand to each other, as configured.

use arthro_geometry::nalgebra::{Quaternion, UnitQuaternion};
use arthro_geometry::{Rigid, Vector3};
use serde::{Deserialize, Serialize};

use crate::cell::Berth;
use crate::clearance::Clearance;
use crate::config::{ArmSetup, QUATERNION_TOLERANCE, ToolMount};

/// Farthest base that is no mistake, mm.
const APART_MAX_MM: f64 = 10_000.0;

/// `motion.layout`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Layout {
    /// Nobody has stated it: no arm moves. There is no safe default.
    #[default]
    Unknown,
    /// Neither arm can reach the other, for example because there is only one: distances are not watched.
    Apart,
    /// forceps_base_from_arthroscope_base, as measured: arms and shafts keep their distance.
    Measured(ToolMount),
}

/// What is wrong with it.
#[derive(Debug, PartialEq, thiserror::Error)]
#[error("motion.layout.measured.{field} {fault}")]
pub struct LayoutError {
    field: &'static str,
    fault: String,
}

impl Layout {
    /// Gives both arms their places in the cell.
    pub fn seat(
        &self,
        forceps: &mut ArmSetup,
        arthroscope: &mut ArmSetup,
    ) -> Result<(), LayoutError> {
        let [first, second] = match self {
            Self::Unknown => [forceps.shape, arthroscope.shape].map(Berth::unstated),
            Self::Apart => [forceps.shape, arthroscope.shape].map(Berth::apart),
            Self::Measured(base) => Berth::beside(Clearance::new(
                (forceps.options.arm, forceps.shape),
                (arthroscope.options.arm, arthroscope.shape),
                rigid(base)?,
            )),
        };
        forceps.options.berth = first;
        arthroscope.options.berth = second;
        Ok(())
    }
}

fn rigid<A, B>(base: &ToolMount) -> Result<Rigid<A, B>, LayoutError>
where
    A: arthro_geometry::frame::Frame,
    B: arthro_geometry::frame::Frame,
{
    let translation = Vector3::from(base.translation_mm);
    let [w, x, y, z] = base.rotation_wxyz;
    let quaternion = Quaternion::new(w, x, y, z);
    // A NaN is in no range.
    if !(..=QUATERNION_TOLERANCE).contains(&(quaternion.norm() - 1.0).abs()) {
        let norm = quaternion.norm();
        return Err(LayoutError {
            field: "rotation_wxyz",
            fault: format!("has norm {norm}; must be 1 within {QUATERNION_TOLERANCE}"),
        });
    }
    if !(..=APART_MAX_MM).contains(&translation.norm()) {
        let away_mm = translation.norm();
        return Err(LayoutError {
            field: "translation_mm",
            fault: format!("is {away_mm} mm away; limit {APART_MAX_MM} mm"),
        });
    }
    Ok(Rigid::new(
        UnitQuaternion::from_quaternion(quaternion),
        translation,
    ))
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_1_SQRT_2;

    use super::*;
    use crate::cell::Other;
    use crate::config::Config;

    fn seated(layout: Layout) -> Result<[ArmSetup; 2], LayoutError> {
        let config = Config::default();
        let mut forceps = config.arms.forceps.check("forceps").unwrap();
        let mut arthroscope = config.arms.arthroscope.check("arthroscope").unwrap();
        layout.seat(&mut forceps, &mut arthroscope)?;
        Ok([forceps, arthroscope])
    }

    fn measured(translation_mm: [f64; 3], rotation_wxyz: [f64; 4]) -> Layout {
        Layout::Measured(ToolMount {
            translation_mm,
            rotation_wxyz,
        })
    }

    #[test]
    fn a_cell_whose_layout_nobody_stated_knows_of_no_other_arm() {
        let [forceps, _] = seated(Config::default().layout).unwrap();
        assert!(matches!(forceps.options.berth.other(), Other::Unstated));
        let [forceps, _] = seated(Layout::Apart).unwrap();
        assert!(matches!(forceps.options.berth.other(), Other::Apart));
    }

    #[test]
    fn arms_at_rest_in_the_cell_keep_their_distance() {
        let layout = measured(
            [350.0, 750.0, 0.0],
            [FRAC_1_SQRT_2, 0.0, 0.0, -FRAC_1_SQRT_2],
        );
        let [forceps, arthroscope] = seated(layout).unwrap();
        let bodies = [&forceps, &arthroscope].map(|setup| {
            let joints = setup.neutral_joints_rad;
            let pose = setup.options.arm.base_from_tool(&joints);
            let berth = &setup.options.berth;
            berth.in_common(&berth.bodies(&joints, &pose))
        });
        let nearest = bodies[0].nearest(&bodies[1]);
        let keep = crate::clearance::Keep::of(&forceps.options.limits);
        assert_eq!(keep.missed(&nearest), None, "{nearest:?}");
    }

    #[test]
    fn a_layout_that_cannot_be_is_refused_with_its_name() {
        let refusal = |layout| seated(layout).unwrap_err().to_string();
        assert_eq!(
            refusal(measured([0.0; 3], [2.0, 0.0, 0.0, 0.0])),
            "motion.layout.measured.rotation_wxyz has norm 2; must be 1 within 0.001"
        );
        let away = refusal(measured([f64::NAN, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]));
        assert!(away.contains("translation_mm is NaN mm away"), "{away}");
    }

    #[test]
    fn a_layout_is_read_as_a_word_or_a_pose() {
        let read = |text: &str| toml::from_str::<Config>(text).unwrap().layout;
        assert_eq!(read("layout = 'apart'"), Layout::Apart);
        assert_eq!(read(""), Layout::Unknown);
        let text = "[layout.measured]\ntranslation_mm = [1.0, 2.0, 3.0]\nrotation_wxyz = [1.0, 0.0, 0.0, 0.0]";
        assert_eq!(read(text), measured([1.0, 2.0, 3.0], [1.0, 0.0, 0.0, 0.0]));
    }
}
