//! The arthroscope's view as messages: options in, views and refusals out.

use std::ops::RangeInclusive;

use arthro_bootstrap::status;
use arthro_geometry::{Point3, Vector3};
use arthro_proto::common::v1 as common;
use arthro_proto::planning::v1 as proto;
use tonic::Status;

use crate::plan::Arthroscope;
use crate::view::{Blind, FORCEPS_RADIUS_MM, Optics, View};

/// Coordinates of a CT, mm.
const COORDINATE_MM: RangeInclusive<f64> = -10_000.0..=10_000.0;
/// Radius of the cell's forceps, mm.
const DEFAULT_FORCEPS_RADIUS_MM: f64 = 1.75;

/// Reads the message in `field`, and tells everything that is wrong with it at once.
pub(super) fn read(
    field: &str,
    options: &proto::ArthroscopeViewOptions,
) -> Result<Arthroscope, Status> {
    let mut violations = Vec::new();
    let portal = options.portal.unwrap_or_else(|| {
        violations.push((format!("{field}.portal"), "is missing".to_owned()));
        common::Point::default()
    });
    let forceps_radius_mm = options
        .forceps_shaft_radius_mm
        .unwrap_or(DEFAULT_FORCEPS_RADIUS_MM);
    let mut within = |name: &str, value: f64, range: RangeInclusive<f64>| {
        // NaN is in no range.
        if !range.contains(&value) {
            let problem = format!("is {value}; must be {} .. {}", range.start(), range.end());
            violations.push((format!("{field}.{name}"), problem));
        }
    };
    within("portal.x_mm", portal.x_mm, COORDINATE_MM);
    within("portal.y_mm", portal.y_mm, COORDINATE_MM);
    within("portal.z_mm", portal.z_mm, COORDINATE_MM);
    within(
        "forceps_shaft_radius_mm",
        forceps_radius_mm,
        FORCEPS_RADIUS_MM,
    );
    let optics = optics(&options.optics.unwrap_or_default());
    let problems = optics.problems().into_iter();
    violations.extend(problems.map(|(name, problem)| (format!("{field}.optics.{name}"), problem)));
    if !violations.is_empty() {
        return Err(status::invalid_all(violations));
    }
    Ok(Arthroscope {
        portal: Point3::new(portal.x_mm, portal.y_mm, portal.z_mm),
        optics,
        forceps_radius_mm,
    })
}

fn optics(given: &proto::Optics) -> Optics {
    let default = Optics::default();
    let range = |low: Option<f64>, high: Option<f64>, default: &RangeInclusive<f64>| {
        low.unwrap_or(*default.start())..=high.unwrap_or(*default.end())
    };
    Optics {
        tilt_rad: given.tilt_rad.unwrap_or(default.tilt_rad),
        field_of_view_rad: given.field_of_view_rad.unwrap_or(default.field_of_view_rad),
        margin_rad: given.margin_rad.unwrap_or(default.margin_rad),
        distance_mm: range(
            given.distance_min_mm,
            given.distance_max_mm,
            &default.distance_mm,
        ),
        shaft_radius_mm: given.shaft_radius_mm.unwrap_or(default.shaft_radius_mm),
        depth_mm: range(given.depth_min_mm, given.depth_max_mm, &default.depth_mm),
        roll_rad: range(given.roll_min_rad, given.roll_max_rad, &default.roll_rad),
        clearance_min_mm: given.clearance_min_mm.unwrap_or(default.clearance_min_mm),
        bone_clearance_min_mm: given
            .bone_clearance_min_mm
            .unwrap_or(default.bone_clearance_min_mm),
        occluded_max_percent: given
            .occluded_max_percent
            .unwrap_or(default.occluded_max_percent),
        through_tissue_max_mm: given
            .through_tissue_max_mm
            .unwrap_or(default.through_tissue_max_mm),
    }
}

/// A view in ct.
pub(super) fn view(view: &View) -> proto::ArthroscopeView {
    let direction = |direction: &Vector3| common::Direction {
        x: direction.x,
        y: direction.y,
        z: direction.z,
    };
    proto::ArthroscopeView {
        tip: Some(common::Point {
            x_mm: view.tip.x,
            y_mm: view.tip.y,
            z_mm: view.tip.z,
        }),
        approach: Some(direction(&view.approach)),
        optical_axis: Some(direction(&view.optical_axis)),
        roll_rad: view.roll_rad,
        depth_mm: view.depth_mm,
        bite_offset_rad: view.bite_offset_rad,
        distance_mm: view.distance_mm,
        forceps_clearance_mm: view.forceps_clearance_mm,
        occluded_percent: view.occluded_percent,
    }
}

/// Why there are no views: the bite and every figure with its limit.
pub(crate) fn refusal(field: &str, blind: &Blind) -> Status {
    let message = blind.to_string();
    match blind {
        Blind::Invalid {
            field: name,
            problem,
        } => status::invalid(format!("{field}.{name}"), problem.as_str()),
        Blind::Bite { bite, reason } => {
            let figures = reason.figures().into_iter();
            let mut metadata = vec![("bite", bite.to_string())];
            metadata.extend(figures.map(|(name, value)| (name, format!("{value:.3}"))));
            status::refused(reason.code(), message, &metadata)
        }
        Blind::Cancelled => Status::cancelled(message),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::view::Reason;

    fn options() -> proto::ArthroscopeViewOptions {
        proto::ArthroscopeViewOptions {
            portal: Some(common::Point {
                x_mm: 62.0,
                y_mm: 48.0,
                z_mm: 94.5,
            }),
            ..proto::ArthroscopeViewOptions::default()
        }
    }

    #[test]
    fn a_portal_alone_is_watched_through_by_the_default_arthroscope() {
        let read = read("options.view", &options()).unwrap();
        assert_eq!(read.portal, Point3::new(62.0, 48.0, 94.5));
        assert_eq!(read.optics, Optics::default());
        assert_eq!(read.forceps_radius_mm, DEFAULT_FORCEPS_RADIUS_MM);
    }

    #[test]
    fn a_zero_is_a_value_and_not_the_default() {
        let mut given = options();
        given.optics = Some(proto::Optics {
            tilt_rad: Some(0.0),
            roll_min_rad: Some(0.0),
            ..proto::Optics::default()
        });
        let optics = read("options.view", &given).unwrap().optics;
        assert_eq!(optics.tilt_rad, 0.0);
        assert_eq!(optics.roll_rad, 0.0..=*Optics::default().roll_rad.end());
    }

    #[test]
    fn everything_that_is_wrong_is_named_at_once() {
        let given = proto::ArthroscopeViewOptions {
            portal: None,
            optics: Some(proto::Optics {
                shaft_radius_mm: Some(0.0),
                ..proto::Optics::default()
            }),
            forceps_shaft_radius_mm: Some(f64::NAN),
        };
        let refusal = read("options.view", &given).unwrap_err();
        let violations = status::violations(&refusal);
        let named: Vec<&str> = violations.iter().map(|(field, _)| field.as_str()).collect();
        assert_eq!(
            named,
            [
                "options.view.portal",
                "options.view.forceps_shaft_radius_mm",
                "options.view.optics.shaft_radius_mm"
            ]
        );
    }

    #[test]
    fn a_bite_that_cannot_be_seen_is_refused_by_its_reason() {
        let blind = Blind::Bite {
            bite: 4,
            reason: Reason::Occluded {
                percent: 60.0,
                limit_percent: 25.0,
            },
        };
        let refusal = refusal("options.view", &blind);
        assert_eq!(refusal.code(), tonic::Code::FailedPrecondition);
        assert_eq!(status::reason(&refusal).as_deref(), Some("OCCLUDED"));
        assert!(refusal.message().starts_with("bite 4 cannot be seen: 60 %"));
    }

    #[test]
    fn a_view_keeps_its_figures_in_the_message() {
        let seen = View {
            tip: Point3::new(1.0, 2.0, 3.0),
            approach: Vector3::x(),
            optical_axis: Vector3::y(),
            roll_rad: 0.1,
            depth_mm: 4.0,
            bite_offset_rad: 0.2,
            distance_mm: 20.0,
            forceps_clearance_mm: 5.0,
            occluded_percent: 11.0,
        };
        let message = view(&seen);
        assert_eq!(message.tip.map(|tip| tip.z_mm), Some(3.0));
        assert_eq!(message.optical_axis.map(|axis| axis.y), Some(1.0));
        let figures = [
            message.roll_rad,
            message.depth_mm,
            message.bite_offset_rad,
            message.distance_mm,
            message.forceps_clearance_mm,
            message.occluded_percent,
        ];
        assert_eq!(figures, [0.1, 4.0, 0.2, 20.0, 5.0, 11.0]);
    }
}
