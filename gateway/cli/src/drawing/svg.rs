//! A drawing as an SVG document.

use std::fmt::Write as _;

use super::{At, Color, Drawing, Pen, Shape};

/// Pixels that a millimetre takes where nothing else sizes the picture.
const PX_PER_MM: f64 = 12.0;
/// What a dot is long, mm: a line without length is not drawn everywhere.
const DOT_MM: f64 = 0.01;

/// The page as an SVG document.
pub fn svg(drawing: &Drawing) -> String {
    let [width, height] = drawing.size_mm;
    let title = escape(&drawing.title);
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width:.2} {height:.2}\" width=\"{:.0}\" height=\"{:.0}\" \
         role=\"img\" aria-label=\"{title}\" stroke-linecap=\"round\" stroke-linejoin=\"round\"><title>{title}</title>\n",
        width * PX_PER_MM,
        height * PX_PER_MM
    );
    for shape in &drawing.shapes {
        match shape {
            Shape::Lines { strokes, pen } => {
                let path: String = strokes.iter().map(|stroke| way(stroke)).collect();
                // Writing into a String cannot fail.
                writeln!(svg, "<path fill=\"none\"{} d=\"{path}\"/>", line(pen)).ok();
            }
            Shape::Area { rings, fill } => {
                let path: String = rings.iter().map(|ring| way(ring) + "Z").collect();
                writeln!(svg, "<path{} d=\"{path}\"/>", paint("fill", fill)).ok();
            }
            Shape::Disc {
                center: [x, y],
                radius_mm,
                fill,
            } => {
                let fill = paint("fill", fill);
                writeln!(
                    svg,
                    "<circle cx=\"{x:.3}\" cy=\"{y:.3}\" r=\"{radius_mm:.3}\"{fill}/>"
                )
                .ok();
            }
        }
    }
    svg.push_str("</svg>");
    svg
}

fn way(points: &[At]) -> String {
    let mut way = String::new();
    for (index, [x, y]) in points.iter().enumerate() {
        let step = if index == 0 { 'M' } else { 'L' };
        write!(way, "{step}{x:.2} {y:.2}").ok();
    }
    if points.len() == 1 {
        write!(way, "h{DOT_MM}").ok();
    }
    way
}

fn line(pen: &Pen) -> String {
    let dash = pen.dash_mm.map_or_else(String::new, |dash_mm| {
        format!(" stroke-dasharray=\"{dash_mm:.2}\" stroke-linecap=\"butt\"")
    });
    let stroke = paint("stroke", &pen.color);
    format!("{stroke} stroke-width=\"{:.3}\"{dash}", pen.width_mm)
}

fn paint(what: &str, color: &Color) -> String {
    let [red, green, blue] = color.rgb;
    let sheer = if color.opacity < 1.0 {
        format!(" {what}-opacity=\"{:.2}\"", color.opacity)
    } else {
        String::new()
    };
    format!(" {what}=\"#{red:02x}{green:02x}{blue:02x}\"{sheer}")
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
}
