//! A font of strokes.
//!
//! A glyph is a row of strokes; a stroke is a row of corners, two digits each: x from the left, y down in sixths of a
//! capital's height (capitals from 0 to the baseline at 6, small letters from 2, descenders to 8). A stroke that begins
//! with `~` is drawn round its corners instead of through them.

use super::At;

/// Width of a stroke as a share of the capitals' height.
pub const STROKE: f64 = 0.13;
/// Height of capitals in the glyphs' own unit.
const CAPITAL: f64 = 6.0;
/// Between two glyphs, and for a blank, in the same unit.
const GAP: f64 = 1.7;
const BLANK: f64 = 2.2;
/// Rounds of cutting corners.
const ROUNDS: usize = 3;
/// Stands for what the font does not have.
const UNKNOWN: &str = "0040460600";

/// Width of a line of text, mm.
pub fn width_mm(text: &str, height_mm: f64) -> f64 {
    let units: f64 = text.chars().map(advance).sum();
    (units - GAP).max(0.0) * height_mm / CAPITAL
}

/// The strokes of a line of text whose baseline begins at `at`.
pub fn strokes(text: &str, at: At, height_mm: f64) -> Vec<Vec<At>> {
    let unit_mm = height_mm / CAPITAL;
    let mut left_mm = at[0];
    let mut strokes = Vec::new();
    for letter in text.chars() {
        for stroke in glyph(letter).split_whitespace() {
            let place = |[x, y]: At| [left_mm + x * unit_mm, at[1] + (y - CAPITAL) * unit_mm];
            strokes.push(corners(stroke).into_iter().map(place).collect());
        }
        left_mm += advance(letter) * unit_mm;
    }
    strokes
}

fn advance(letter: char) -> f64 {
    let columns = glyph(letter)
        .split_whitespace()
        .flat_map(|stroke| corners(stroke).into_iter().map(|[x, _]| x));
    match letter {
        ' ' => BLANK + GAP,
        _ => columns.fold(0.0, f64::max) + GAP,
    }
}

fn corners(stroke: &str) -> Vec<At> {
    let (is_round, digits) = match stroke.strip_prefix('~') {
        Some(digits) => (true, digits),
        None => (false, stroke),
    };
    let numbers: Vec<f64> = digits
        .bytes()
        .map(|digit| f64::from(digit.saturating_sub(b'0')))
        .collect();
    let mut points: Vec<At> = numbers
        .chunks_exact(2)
        .map(|pair| [pair[0], pair[1]])
        .collect();
    for _ in 0..if is_round { ROUNDS } else { 0 } {
        points = cut(&points);
    }
    points
}

/// Chaikin's corner cutting, which tends to a quadratic B-spline; an open stroke keeps its ends.
fn cut(points: &[At]) -> Vec<At> {
    let between =
        |a: At, b: At, share: f64| [0, 1].map(|axis| a[axis] + share * (b[axis] - a[axis]));
    let is_closed = points.first() == points.last();
    let mut smooth = Vec::with_capacity(2 * points.len());
    for pair in points.windows(2) {
        smooth.push(between(pair[0], pair[1], 0.25));
        smooth.push(between(pair[0], pair[1], 0.75));
    }
    if is_closed {
        smooth.extend(smooth.first().copied());
        return smooth;
    }
    if let (Some(first), Some(last)) = (smooth.first_mut(), points.first()) {
        *first = *last;
    }
    if let (Some(end), Some(last)) = (smooth.last_mut(), points.last()) {
        *end = *last;
    }
    smooth
}

fn glyph(letter: char) -> &'static str {
    match letter {
        ' ' => "",
        '0' => "~0040460600",
        '1' => "012026",
        '2' => "~0200404306 0646",
        '3' => "~0100404313 ~1343460605",
        '4' => "36300444",
        '5' => "400002 ~02424606",
        '6' => "~400006464202 0204",
        '7' => "004016",
        '8' => "~0040430300 ~0343460603",
        '9' => "~064640000444 4442",
        'A' => "062046 1434",
        'B' => "0006 ~00404303 ~03434606",
        'C' => "~414000064645",
        'D' => "0006 ~00404606",
        'E' => "40000646 0333",
        'F' => "400006 0333",
        'G' => "~414000064643 4323",
        'H' => "0006 4046 0343",
        'I' => "0006",
        'J' => "~30360604",
        'K' => "0006 4004 1346",
        'L' => "000646",
        'M' => "0600244046",
        'N' => "06004640",
        'O' => "~0040460600",
        'P' => "0006 ~00404303",
        'Q' => "~0040460600 2446",
        'R' => "0006 ~00404303 2346",
        'S' => "~4140000343460605",
        'T' => "0040 2026",
        'U' => "~00064640",
        'V' => "002640",
        'W' => "0016213640",
        'X' => "0046 4006",
        'Y' => "002340 2326",
        'Z' => "00400646",
        'a' => "~0232360602 3236",
        'b' => "0006 ~0232360602",
        'c' => "~333202063635",
        'd' => "3036 ~0232360602",
        'e' => "0434 ~343202063635",
        'f' => "~301016 0222",
        'g' => "~0232360602 ~32380807",
        'h' => "0006 ~03023236",
        'i' => "0206 00",
        'j' => "~121808 10",
        'k' => "0006 320436",
        'l' => "0006",
        'm' => "0206 ~03022226 ~23224246",
        'n' => "0206 ~03023236",
        'o' => "~0232360602",
        'p' => "0208 ~0232360602",
        'q' => "3238 ~0232360602",
        'r' => "0206 ~030222",
        's' => "~3332020434360605",
        't' => "~101626 0222",
        'u' => "~02063634 3236",
        'v' => "022642",
        'w' => "0216233642",
        'x' => "0236 3206",
        'y' => "0226 4218",
        'z' => "02320636",
        '.' => "06",
        ',' => "1607",
        ':' => "03 06",
        '-' => "0424",
        '+' => "0444 2226",
        '/' => "0640",
        '%' => "0640 ~0020220200 ~2444462624",
        '(' => "~10000616",
        ')' => "~00101606",
        '<' => "320436",
        '>' => "023406",
        '=' => "0333 0535",
        '_' => "0646",
        '\'' => "0001",
        '#' => "1016 3036 0242 0444",
        _ => UNKNOWN,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_glyph_lies_between_capitals_and_descenders() {
        for letter in ' '..='~' {
            for [x, y] in glyph(letter).split_whitespace().flat_map(corners) {
                assert!(
                    (0.0..=4.0).contains(&x) && (0.0..=8.0).contains(&y),
                    "{letter}"
                );
            }
        }
    }

    #[test]
    fn a_text_is_as_wide_as_its_strokes() {
        let strokes = strokes("Rim 5.3 mm", [2.0, 9.0], 3.0);
        let right = strokes.iter().flatten().map(|at| at[0]).fold(0.0, f64::max);
        assert!((right - 2.0 - width_mm("Rim 5.3 mm", 3.0)).abs() < 1e-9);
    }
}
