//! A picture of a registration: the model and the view in its pose, from where the view faces and from two sides, the
//! view's points coloured by their distance to the model.

use std::fmt::Write as _;

use arthro_geometry::nalgebra::{Matrix3, SymmetricEigen};
use arthro_geometry::{Cloud, Point3, Vector3};
use arthro_registration::pipeline::Registration;

use super::{thinned, word};

/// Edge of a panel, and what is left free inside it, px.
const PANEL_PX: f64 = 420.0;
const MARGIN_PX: f64 = 24.0;
const HEADER_PX: f64 = 64.0;
/// Points drawn of each cloud at most.
const MODEL_POINTS: usize = 3000;
const VIEW_POINTS: usize = 2500;
/// Residuals of this and more have the last colour, mm of the model.
const LAST_COLOR_MM: f64 = 1.2;

/// The picture as an SVG document.
pub fn svg(source: &Cloud, target: &Cloud, registration: &Registration) -> String {
    let pose = &registration.camera_from_ct;
    let model: Vec<Point3> = thinned(source, MODEL_POINTS)
        .map(|i| *pose * source.points[i])
        .collect();
    let view: Vec<(Point3, f32)> = thinned(target, VIEW_POINTS)
        .map(|i| (target.points[i], registration.residuals_mm[i]))
        .collect();
    let (middle, axes) = main_axes(&model);
    let widest = model
        .iter()
        .map(|p| (p - middle).norm())
        .fold(0.0, f64::max);
    let px_per_mm = (PANEL_PX / 2.0 - MARGIN_PX) / widest.max(f64::MIN_POSITIVE);

    let (width, height) = (3.0 * PANEL_PX, PANEL_PX + HEADER_PX);
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" viewBox=\"0 0 {width} {height}\" \
         font-family=\"sans-serif\" font-size=\"14\">\n<rect width=\"100%\" height=\"100%\" fill=\"#10161d\"/>\n"
    );
    header(&mut svg, registration);
    let panels = [
        ("along its least extent", [0, 1]),
        ("along its middle extent", [0, 2]),
        ("along its largest extent", [1, 2]),
    ];
    for (index, (title, across)) in panels.into_iter().enumerate() {
        let left = PANEL_PX * index as f64;
        let place = |p: &Point3| {
            let d = p - middle;
            let along = across.map(|axis| axes.column(axis).dot(&d) * px_per_mm);
            [
                left + PANEL_PX / 2.0 + along[0],
                HEADER_PX + PANEL_PX / 2.0 - along[1],
            ]
        };
        let inside = |at: &[f64; 2]| {
            at[0] > left && at[0] < left + PANEL_PX && at[1] > HEADER_PX && at[1] < height
        };
        for at in model.iter().map(place).filter(inside) {
            write!(
                svg,
                "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"1.1\" fill=\"#5b6b7b\"/>",
                at[0], at[1]
            )
            .ok();
        }
        for (at, residual) in view
            .iter()
            .map(|(p, residual)| (place(p), residual))
            .filter(|(at, _)| inside(at))
        {
            let color = color(f64::from(*residual) / LAST_COLOR_MM);
            write!(
                svg,
                "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"1.5\" fill=\"{color}\"/>",
                at[0], at[1]
            )
            .ok();
        }
        writeln!(
            svg,
            "\n<text x=\"{:.0}\" y=\"{:.0}\" fill=\"#9fb0c0\">the model {title}</text>",
            left + 12.0,
            height - 10.0
        )
        .ok();
    }
    svg.push_str("</svg>\n");
    svg
}

fn header(svg: &mut String, registration: &Registration) {
    let evidence = &registration.evidence;
    let verdict = word(registration.verdict);
    let color = match verdict {
        "ACCEPT" => "#69d58c",
        "REVIEW" => "#f2c14e",
        _ => "#ff6b5e",
    };
    writeln!(
        svg,
        "<text x=\"12\" y=\"26\" font-size=\"18\" font-weight=\"bold\" fill=\"{color}\">{verdict}</text>\
         <text x=\"110\" y=\"26\" fill=\"#e6edf3\">scale {:.4}, residual {:.3} mm2, predicted target error {:.2} mm, \
         {:.0} % of the view on the model, {:.0} % of the model seen</text>",
        evidence.scale,
        registration.mse_mm2,
        evidence.tre_predicted_mm,
        100.0 * evidence.inlier_share,
        100.0 * evidence.overlap
    )
    .ok();
    let note = match registration.reasons.is_empty() {
        true => format!(
            "grey: the model; coloured: the view, blue on the model to red {LAST_COLOR_MM} mm and more off it"
        ),
        false => registration.reasons.join("; "),
    };
    writeln!(
        svg,
        "<text x=\"12\" y=\"50\" fill=\"#9fb0c0\">{note}</text>"
    )
    .ok();
}

/// Middle and main directions of the model, largest extent first.
fn main_axes(points: &[Point3]) -> (Point3, Matrix3<f64>) {
    let count = points.len().max(1) as f64;
    let mean = points.iter().map(|p| p.coords).sum::<Vector3>() / count;
    let covariance: Matrix3<f64> = points
        .iter()
        .map(|p| p.coords - mean)
        .map(|d| d * d.transpose())
        .sum();
    let eigen = SymmetricEigen::new(covariance);
    let mut order = [0, 1, 2];
    order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
    let columns = order.map(|axis| eigen.eigenvectors.column(axis).into_owned());
    (mean.into(), Matrix3::from_columns(&columns))
}

/// Blue over green and yellow to red as `share` goes from 0 to 1.
fn color(share: f64) -> String {
    const STOPS: [[f64; 3]; 4] = [
        [74.0, 158.0, 255.0],
        [105.0, 213.0, 140.0],
        [242.0, 193.0, 78.0],
        [255.0, 90.0, 80.0],
    ];
    let at = share.clamp(0.0, 1.0) * 3.0;
    let stop = (at as usize).min(2);
    let between = at - stop as f64;
    let channel =
        |i: usize| (STOPS[stop][i] + (STOPS[stop + 1][i] - STOPS[stop][i]) * between).round() as u8;
    format!("#{:02x}{:02x}{:02x}", channel(0), channel(1), channel(2))
}
