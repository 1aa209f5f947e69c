//! Where the bites' numbers go: on the middle of the jaw, or where that is taken, nearby with a line to it.

use crate::drawing::At;

pub const RADIUS_MM: f64 = 0.95;
pub const TEXT_MM: f64 = 0.92;
/// Least distance between two numbers, mm.
const APART_MM: f64 = 2.0;
/// Least distance of a number from a mark, mm.
const FROM_MARK_MM: f64 = 1.5;
/// Distances at which a free place is looked for, mm.
const RINGS_MM: [f64; 6] = [2.2, 3.6, 5.0, 6.5, 8.0, 9.5];
/// Directions that are tried on each ring, nearest to the hole first.
const TURNS: usize = 13;

/// A number's place and what it stands for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Label {
    /// The middle of the jaw.
    pub center: At,
    /// The middle of the number.
    pub at: At,
}

/// Places for numbers at `centers` that cover neither each other nor `marks`, as near as may be and rather towards `hole`.
pub fn spread(centers: &[At], marks: &[At], hole: At) -> Vec<Label> {
    let mut labels: Vec<Label> = Vec::with_capacity(centers.len());
    for &center in centers {
        let is_free = |at: &At| {
            let mut others = labels.iter();
            others.all(|label| distance(label.at, *at) >= APART_MM)
                && marks
                    .iter()
                    .all(|mark| distance(*mark, *at) >= FROM_MARK_MM)
        };
        let inward = (hole[1] - center[1]).atan2(hole[0] - center[0]);
        let around = RINGS_MM.into_iter().flat_map(|radius_mm| {
            (0..TURNS).map(move |turn| {
                // 0, 1, -1, 2, -2, ...
                let step = turn.div_ceil(2) as f64 * if turn % 2 == 0 { -1.0 } else { 1.0 };
                let angle = inward + step * std::f64::consts::TAU / TURNS as f64;
                [
                    center[0] + radius_mm * angle.cos(),
                    center[1] + radius_mm * angle.sin(),
                ]
            })
        });
        let at = std::iter::once(center)
            .chain(around)
            .find(is_free)
            .unwrap_or(center);
        labels.push(Label { center, at });
    }
    labels
}

fn distance(a: At, b: At) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_with_room_stays_on_its_jaw() {
        let labels = spread(&[[0.0, 0.0], [5.0, 0.0]], &[], [0.0, 9.0]);
        assert!(labels.iter().all(|label| label.center == label.at));
    }

    #[test]
    fn crowded_numbers_cover_neither_each_other_nor_marks() {
        let centers: Vec<At> = (0..39).map(|step| [f64::from(step), 0.0]).collect();
        let labels = spread(&centers, &centers[..9], [20.0, 15.0]);
        for (index, label) in labels.iter().enumerate() {
            assert!(
                centers[..9]
                    .iter()
                    .all(|mark| distance(*mark, label.at) >= FROM_MARK_MM)
            );
            for other in &labels[..index] {
                assert!(
                    distance(label.at, other.at) >= APART_MM,
                    "{label:?} {other:?}"
                );
            }
        }
    }
}
