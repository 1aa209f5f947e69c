//! The meniscus seen along its thickness: surface, damage, contour, planned bites in order, and
//! where the jaw was measured when it closed.

use std::fmt::Write as _;

use arthro_geometry::frame::{Camera, Ct, ForcepsBase};
use arthro_geometry::nalgebra::{Matrix3, Quaternion, SymmetricEigen, Vector2};
use arthro_geometry::{Point3, Rotation, Similarity, Vector3};
use arthro_proto::common::v1 as common;
use arthro_proto::gateway::v1::GetReportResponse;
use arthro_simulator::scenario::Scenario;

use crate::demo::Summary;

/// Pixels a millimetre.
const ZOOM: f64 = 16.0;
const MARGIN_MM: f64 = 3.0;

/// The picture with its caption.
pub fn figure(scenario: &Scenario, summary: &Summary, journal: &GetReportResponse) -> String {
    let plane = Plane::of(&scenario.preoperative.model.vertices);
    let mut svg = format!(
        "<figure><svg viewBox=\"0 0 {:.0} {:.0}\" width=\"{:.0}\" role=\"img\" aria-label=\"plan\">",
        plane.size.x * ZOOM,
        plane.size.y * ZOOM,
        plane.size.x * ZOOM
    );
    surface(&mut svg, scenario, &plane);
    damage(&mut svg, scenario, &plane);
    contour(&mut svg, summary, &plane);
    bites(&mut svg, scenario, summary, &plane);
    tips(&mut svg, scenario, summary, journal, &plane);
    svg.push_str(
        "</svg><figcaption>Surface (grey), damaged tissue (red), planned new edge (blue), planned \
         jaw footprints in order (outlined), measured jaw centres (crosses).</figcaption></figure>",
    );
    svg
}

/// The picture plane: spanned by the two long axes of the surface.
struct Plane {
    origin: Point3,
    right: Vector3,
    down: Vector3,
    low: Vector2<f64>,
    size: Vector2<f64>,
}

impl Plane {
    fn of(points: &[Point3]) -> Self {
        let count = points.len().max(1) as f64;
        let origin = Point3::from(points.iter().map(|p| p.coords).sum::<Vector3>() / count);
        let spread: Matrix3<f64> = points
            .iter()
            .map(|p| (p - origin) * (p - origin).transpose())
            .sum();
        let axes = SymmetricEigen::new(spread);
        let mut order = [0, 1, 2];
        order.sort_by(|a, b| axes.eigenvalues[*b].total_cmp(&axes.eigenvalues[*a]));
        let axis = |index: usize| Vector3::from(axes.eigenvectors.column(order[index]));
        let mut plane = Self {
            origin,
            right: axis(0),
            down: axis(1),
            low: Vector2::zeros(),
            size: Vector2::zeros(),
        };
        let (mut low, mut high) = (Vector2::zeros(), Vector2::zeros());
        for point in points {
            let at = plane.along(&(point - origin));
            low = low.inf(&at);
            high = high.sup(&at);
        }
        let margin = Vector2::repeat(MARGIN_MM);
        plane.low = low - margin;
        plane.size = high - low + margin * 2.0;
        plane
    }

    fn along(&self, direction: &Vector3) -> Vector2<f64> {
        Vector2::new(direction.dot(&self.right), direction.dot(&self.down))
    }

    fn pixel(&self, point: &Point3) -> Vector2<f64> {
        (self.along(&(point - self.origin)) - self.low) * ZOOM
    }
}

fn surface(svg: &mut String, scenario: &Scenario, plane: &Plane) {
    let model = &scenario.preoperative.model;
    svg.push_str("<path fill=\"#d7dade\" stroke=\"#d7dade\" stroke-width=\"1\" d=\"");
    for index in 0..model.triangles.len() {
        let [a, b, c] = model.corners(index).map(|corner| plane.pixel(&corner));
        // Faces turned away would cancel those in front of them.
        if (b - a).perp(&(c - a)) < 0.0 {
            continue;
        }
        write!(
            svg,
            "M{:.0} {:.0}L{:.0} {:.0}L{:.0} {:.0}Z",
            a.x, a.y, b.x, b.y, c.x, c.y
        )
        .ok();
    }
    svg.push_str("\"/>");
}

fn damage(svg: &mut String, scenario: &Scenario, plane: &Plane) {
    let side = 0.5 * ZOOM;
    svg.push_str("<path fill=\"#d9544d\" d=\"");
    for point in &scenario.preoperative.lesion {
        let at = plane.pixel(point) - Vector2::repeat(side / 2.0);
        write!(svg, "M{:.1} {:.1}h{side}v{side}h-{side}Z", at.x, at.y).ok();
    }
    svg.push_str("\"/>");
}

fn contour(svg: &mut String, summary: &Summary, plane: &Plane) {
    svg.push_str("<polyline fill=\"none\" stroke=\"#2a62c9\" stroke-width=\"3\" points=\"");
    for point in &summary.plan.contour {
        let at = plane.pixel(&bare(point));
        write!(svg, "{:.1},{:.1} ", at.x, at.y).ok();
    }
    svg.push_str("\"/>");
}

fn bites(svg: &mut String, scenario: &Scenario, summary: &Summary, plane: &Plane) {
    let jaw = &scenario.spec.jaw;
    for (index, bite) in summary.plan.bites.iter().enumerate() {
        let (Some(center), Some(approach)) = (&bite.center, &bite.approach) else {
            continue;
        };
        let direction = plane.along(&Vector3::new(approach.x, approach.y, approach.z));
        let Some(along) = direction.try_normalize(1e-6) else {
            continue;
        };
        let across = Vector2::new(-along.y, along.x) * (jaw.width_mm / 2.0 * ZOOM);
        let along = along * (jaw.length_mm / 2.0 * ZOOM);
        let at = plane.pixel(&bare(center));
        let corners = [
            at + along + across,
            at + along - across,
            at - along - across,
            at - along + across,
        ];
        svg.push_str("<polygon fill=\"#2a62c9\" fill-opacity=\".10\" stroke=\"#27364f\" points=\"");
        for corner in corners {
            write!(svg, "{:.1},{:.1} ", corner.x, corner.y).ok();
        }
        write!(
            svg,
            "\"/><text x=\"{:.1}\" y=\"{:.1}\" font-size=\"12\" text-anchor=\"middle\">{}</text>",
            at.x,
            at.y - 6.0,
            index + 1
        )
        .ok();
    }
}

fn tips(
    svg: &mut String,
    scenario: &Scenario,
    summary: &Summary,
    journal: &GetReportResponse,
    plane: &Plane,
) {
    let base_from_camera = scenario.system_view().forceps_base_from_camera;
    let Some(camera_from_ct) = summary.registration.camera_from_ct.as_ref() else {
        return;
    };
    let base_from_ct: Similarity<ForcepsBase, Ct> =
        Similarity::from(base_from_camera) * similarity(camera_from_ct);
    let ct_from_base = base_from_ct.inverse();
    svg.push_str("<path stroke=\"#111\" stroke-width=\"1.5\" d=\"");
    for tip in journal.bites.iter().filter_map(|bite| bite.tip.as_ref()) {
        let at = plane.pixel(&(ct_from_base * bare(tip)));
        write!(
            svg,
            "M{:.1} {:.1}h8M{:.1} {:.1}v8",
            at.x - 4.0,
            at.y,
            at.x,
            at.y - 4.0
        )
        .ok();
    }
    svg.push_str("\"/>");
}

fn similarity(message: &common::Similarity) -> Similarity<Camera, Ct> {
    let rotation = message.rotation.unwrap_or_default();
    Similarity::new(
        message.scale,
        Rotation::from_quaternion(Quaternion::new(
            rotation.w, rotation.x, rotation.y, rotation.z,
        )),
        bare(&message.translation.unwrap_or_default()).coords,
    )
}

fn bare(point: &common::Point) -> Point3 {
    Point3::new(point.x_mm, point.y_mm, point.z_mm)
}
