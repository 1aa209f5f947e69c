//! A drawing as a PNG file.

use tiny_skia::{
    FillRule, LineCap, LineJoin, Paint, Path, PathBuilder, Pixmap, Stroke, StrokeDash, Transform,
};

use super::{At, Color, Drawing, Pen, Shape};

/// What a dot is long, mm: a line without length is not drawn.
const DOT_MM: f64 = 0.01;
/// Most pixels of a picture.
const MAX_PIXELS: f64 = 50e6;

/// Why there is no picture.
#[derive(Debug, PartialEq)]
pub enum Error {
    /// The page has no size, or one that takes too many pixels.
    Size {
        /// Width and height, pixels.
        pixels: [f64; 2],
    },
    /// The encoder failed.
    Encoding(String),
}

impl std::fmt::Display for Error {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Size {
                pixels: [width, height],
            } => write!(
                f,
                "{width} x {height} pixels; must be at least 1 x 1 and at most {MAX_PIXELS} in all"
            ),
            Self::Encoding(problem) => f.write_str(problem),
        }
    }
}

impl std::error::Error for Error {}

/// The page as a PNG file on white.
pub fn png(drawing: &Drawing, px_per_mm: f64) -> Result<Vec<u8>, Error> {
    let pixels = drawing.size_mm.map(|size_mm| (size_mm * px_per_mm).ceil());
    let [width, height] = pixels;
    let fits = width >= 1.0 && height >= 1.0 && width * height <= MAX_PIXELS;
    let pixmap = fits.then(|| Pixmap::new(width as u32, height as u32));
    let Some(Some(mut pixmap)) = pixmap else {
        return Err(Error::Size { pixels });
    };
    pixmap.fill(tiny_skia::Color::WHITE);
    let scale = Transform::from_scale(px_per_mm as f32, px_per_mm as f32);
    for shape in &drawing.shapes {
        match shape {
            Shape::Lines { strokes, pen } => {
                if let Some(path) = path(strokes, End::Open) {
                    pixmap.stroke_path(&path, &paint(&pen.color), &stroke(pen), scale, None);
                }
            }
            Shape::Area { rings, fill } => {
                if let Some(path) = path(rings, End::Closed) {
                    pixmap.fill_path(&path, &paint(fill), FillRule::Winding, scale, None);
                }
            }
            Shape::Disc {
                center: [x, y],
                radius_mm,
                fill,
            } => {
                let disc = PathBuilder::from_circle(*x as f32, *y as f32, *radius_mm as f32);
                if let Some(disc) = disc {
                    pixmap.fill_path(&disc, &paint(fill), FillRule::Winding, scale, None);
                }
            }
        }
    }
    pixmap
        .encode_png()
        .map_err(|error| Error::Encoding(error.to_string()))
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum End {
    Open,
    Closed,
}

/// `None` where there is nothing to draw.
fn path(ways: &[Vec<At>], end: End) -> Option<Path> {
    let mut builder = PathBuilder::new();
    for way in ways {
        let Some(([x, y], rest)) = way.split_first() else {
            continue;
        };
        builder.move_to(*x as f32, *y as f32);
        for [x, y] in rest {
            builder.line_to(*x as f32, *y as f32);
        }
        if rest.is_empty() {
            builder.line_to((x + DOT_MM) as f32, *y as f32);
        }
        if end == End::Closed {
            builder.close();
        }
    }
    builder.finish()
}

fn paint(color: &Color) -> Paint<'static> {
    let [red, green, blue] = color.rgb;
    let alpha = (color.opacity.clamp(0.0, 1.0) * 255.0).round() as u8;
    let mut paint = Paint::default();
    paint.set_color_rgba8(red, green, blue, alpha);
    paint
}

fn stroke(pen: &Pen) -> Stroke {
    let dash = pen
        .dash_mm
        .and_then(|dash_mm| StrokeDash::new(vec![dash_mm as f32; 2], 0.0));
    Stroke {
        width: pen.width_mm as f32,
        line_cap: match dash {
            Some(_) => LineCap::Butt,
            None => LineCap::Round,
        },
        line_join: LineJoin::Round,
        dash,
        ..Stroke::default()
    }
}
