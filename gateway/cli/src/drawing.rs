//! Drawings: shapes in millimetres on a page, x to the right and y down, written as SVG or as PNG.
//!
//! Text is drawn with strokes of its own font, so that both writers show the same whatever fonts a machine has.

mod font;
mod png;
mod svg;

pub use font::width_mm;
pub use png::png;
pub use svg::svg;

/// A place on the page, mm.
pub type At = [f64; 2];

/// A page with shapes, later ones over earlier ones.
#[derive(Clone, Debug, PartialEq)]
pub struct Drawing {
    /// What it shows, for those who cannot see it.
    pub title: String,
    /// Width and height, mm.
    pub size_mm: [f64; 2],
    /// The shapes in the order in which they are painted.
    pub shapes: Vec<Shape>,
}

/// What can be painted.
#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    /// Strokes along polylines; a stroke of one point is a dot.
    Lines {
        /// One polyline a stroke.
        strokes: Vec<Vec<At>>,
        /// How they are drawn.
        pen: Pen,
    },
    /// The union of polygons that turn the same way.
    Area {
        /// The corners of each.
        rings: Vec<Vec<At>>,
        /// The colour inside.
        fill: Color,
    },
    /// A disc.
    Disc {
        /// Its middle.
        center: At,
        /// Its radius, mm.
        radius_mm: f64,
        /// The colour inside.
        fill: Color,
    },
}

/// A colour.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Color {
    /// Red, green, blue.
    pub rgb: [u8; 3],
    /// 0 nothing is seen of it, 1 nothing is seen through it.
    pub opacity: f64,
}

impl Color {
    /// An opaque colour.
    pub const fn solid(rgb: [u8; 3]) -> Self {
        Self { rgb, opacity: 1.0 }
    }

    /// The same colour, seen through.
    pub const fn sheer(self, opacity: f64) -> Self {
        Self { opacity, ..self }
    }

    /// A colour on the way through `ramp`; `share` 0 is its first, 1 its last.
    pub fn along(ramp: &[[u8; 3]], share: f64) -> Self {
        let position = share.clamp(0.0, 1.0) * ramp.len().saturating_sub(1) as f64;
        let index = position.floor() as usize;
        let at = |index: usize| ramp.get(index.min(ramp.len().saturating_sub(1))).copied();
        let (Some(before), Some(after)) = (at(index), at(index + 1)) else {
            return Self::solid([0; 3]);
        };
        let mixed = [0, 1, 2].map(|part| {
            let (a, b) = (f64::from(before[part]), f64::from(after[part]));
            (a + position.fract() * (b - a)).round() as u8
        });
        Self::solid(mixed)
    }
}

/// How a line is drawn: round at its ends and corners.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pen {
    /// Its colour.
    pub color: Color,
    /// Its width, mm.
    pub width_mm: f64,
    /// Length of the dashes and of the gaps between them, mm; `None` for an unbroken line.
    pub dash_mm: Option<f64>,
}

impl Pen {
    /// An unbroken line.
    pub const fn new(color: Color, width_mm: f64) -> Self {
        Self {
            color,
            width_mm,
            dash_mm: None,
        }
    }

    /// The same line in dashes.
    pub const fn dashed(self, dash_mm: f64) -> Self {
        Self {
            dash_mm: Some(dash_mm),
            ..self
        }
    }
}

/// Which part of a text lies at its place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Anchor {
    /// The left end.
    Left,
    /// The middle.
    Middle,
    /// The right end.
    Right,
}

impl Drawing {
    /// An empty page.
    pub fn new(title: impl Into<String>, size_mm: [f64; 2]) -> Self {
        Self {
            title: title.into(),
            size_mm,
            shapes: Vec::new(),
        }
    }

    /// Draws a polyline.
    pub fn line(&mut self, points: Vec<At>, pen: Pen) {
        let strokes = vec![points];
        self.shapes.push(Shape::Lines { strokes, pen });
    }

    /// Draws the outline of a polygon.
    pub fn outline(&mut self, mut corners: Vec<At>, pen: Pen) {
        corners.extend(corners.first().copied());
        self.line(corners, pen);
    }

    /// Fills a polygon.
    pub fn area(&mut self, corners: Vec<At>, fill: Color) {
        let rings = vec![corners];
        self.shapes.push(Shape::Area { rings, fill });
    }

    /// Fills a rectangle.
    pub fn rectangle(&mut self, [x, y]: At, [width, height]: [f64; 2], fill: Color) {
        let (right, bottom) = (x + width, y + height);
        self.area(vec![[x, y], [right, y], [right, bottom], [x, bottom]], fill);
    }

    /// Fills a disc.
    pub fn disc(&mut self, center: At, radius_mm: f64, fill: Color) {
        self.shapes.push(Shape::Disc {
            center,
            radius_mm,
            fill,
        });
    }

    /// Writes a line of text with capitals of `height_mm`, the baseline through `at`.
    pub fn text(&mut self, at: At, height_mm: f64, anchor: Anchor, color: Color, text: &str) {
        let before_mm = match anchor {
            Anchor::Left => 0.0,
            Anchor::Middle => 0.5 * width_mm(text, height_mm),
            Anchor::Right => width_mm(text, height_mm),
        };
        let strokes = font::strokes(text, [at[0] - before_mm, at[1]], height_mm);
        let pen = Pen::new(color, font::STROKE * height_mm);
        self.shapes.push(Shape::Lines { strokes, pen });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ramp_begins_with_its_first_and_ends_with_its_last_colour() {
        let ramp = [[0, 0, 0], [100, 0, 0], [200, 50, 0]];
        assert_eq!(Color::along(&ramp, 0.0).rgb, [0, 0, 0]);
        assert_eq!(Color::along(&ramp, 0.25).rgb, [50, 0, 0]);
        assert_eq!(Color::along(&ramp, 1.0).rgb, [200, 50, 0]);
        assert_eq!(Color::along(&ramp, f64::NAN).rgb, [0, 0, 0]);
    }

    #[test]
    fn both_writers_draw_the_same_page() {
        let mut page = Drawing::new("a < b", [10.0, 5.0]);
        page.rectangle([0.0, 0.0], [10.0, 5.0], Color::solid([255; 3]));
        page.disc([2.0, 2.0], 1.0, Color::solid([255, 0, 0]));
        page.line(
            vec![[5.0, 1.0], [9.0, 1.0]],
            Pen::new(Color::solid([0; 3]), 0.5).dashed(0.5),
        );
        page.text([5.0, 4.0], 1.5, Anchor::Left, Color::solid([0; 3]), "39 mm");
        let svg = svg(&page);
        assert!(svg.starts_with("<svg") && svg.ends_with("</svg>"));
        assert!(svg.contains("a &lt; b") && svg.contains("stroke-dasharray"));
        let png = png(&page, 20.0).unwrap();
        let pixmap = tiny_skia::Pixmap::decode_png(&png).unwrap();
        assert_eq!((pixmap.width(), pixmap.height()), (200, 100));
        let middle = pixmap.pixel(40, 40).unwrap();
        assert_eq!((middle.red(), middle.green()), (255, 0));
    }
}
