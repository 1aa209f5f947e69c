//! What of a scan is inside, and the box of voxels around it.

use arthro_geometry::scan::{Scan, Value, Visit, labels};

use super::Inside;
use crate::error::{Error, Violation};

/// Most labels that a refusal lists.
const LISTED_LABELS: usize = 32;
/// A crossing is kept at least this share of an edge away from the voxels, so that no triangle is a point.
const MIN_CROSSING: f64 = 0.01;

/// The box around the voxels inside.
#[derive(Clone, Debug)]
pub(super) struct Body {
    /// Lowest voxel of the box along each axis.
    pub(super) low: [usize; 3],
    /// Highest voxel of the box.
    pub(super) high: [usize; 3],
    /// Whether a voxel inside lies at the border of the scan.
    pub(super) touches_border: bool,
}

/// Tells inside from outside by a voxel's value.
pub(super) trait Rule<T>: Copy {
    /// Whether a voxel is inside.
    fn holds(self, value: T) -> bool;
    /// Where the surface crosses the edge from a voxel inside to one outside, as a share of the edge.
    fn crossing(self, inside: T, outside: T) -> f32;
}

/// Inside is the value itself; the surface lies in the middle between the voxels.
#[derive(Clone, Copy)]
pub(super) struct Is<T>(pub(super) T);

impl<T: Value> Rule<T> for Is<T> {
    fn holds(self, value: T) -> bool {
        value == self.0
    }

    fn crossing(self, _: T, _: T) -> f32 {
        0.5
    }
}

/// Inside is this value and above; the surface lies where the values on an edge, interpolated, equal it.
#[derive(Clone, Copy)]
pub(super) struct AtLeast(pub(super) f64);

impl<T: Value> Rule<T> for AtLeast {
    fn holds(self, value: T) -> bool {
        value.into() >= self.0
    }

    fn crossing(self, inside: T, outside: T) -> f32 {
        let (inside, outside): (f64, f64) = (inside.into(), outside.into());
        let share = (inside - self.0) / (inside - outside);
        share.clamp(MIN_CROSSING, 1.0 - MIN_CROSSING) as f32
    }
}

impl Body {
    /// Finds the voxels for which the rule holds.
    pub(super) fn find<T: Value>(
        values: &[T],
        size: [usize; 3],
        rule: impl Rule<T>,
    ) -> Option<Self> {
        let [columns, rows, _] = size;
        let mut found: Option<([usize; 3], [usize; 3])> = None;
        for (line, row) in values.chunks_exact(columns).enumerate() {
            // Most rows hold nothing, and a fold without early exit looks at many values at a time.
            if !row
                .iter()
                .fold(false, |any, value| any | rule.holds(*value))
            {
                continue;
            }
            let holds = |value: &T| rule.holds(*value);
            let first = [row.iter().position(holds)?, line % rows, line / rows];
            let last = [row.iter().rposition(holds)?, line % rows, line / rows];
            let (low, high) = found.get_or_insert((first, last));
            for axis in 0..3 {
                low[axis] = low[axis].min(first[axis]);
                high[axis] = high[axis].max(last[axis]);
            }
        }
        let (low, high) = found?;
        let at_border = |axis: usize| low[axis] == 0 || high[axis] + 1 == size[axis];
        Some(Self {
            low,
            high,
            touches_border: (0..3).any(at_border),
        })
    }
}

/// Refuses a threshold that all voxels are on one side of.
pub(super) fn check_threshold(scan: &Scan, threshold: f64) -> Result<(), Error> {
    let (lowest, highest) = scan.voxels().visit(Range);
    if lowest < threshold && threshold <= highest {
        return Ok(());
    }
    Err(Error::Invalid(vec![Violation::new(
        "threshold",
        format!(
            "is {threshold}, the values are {lowest} to {highest}; must be greater than {lowest} and at most {highest}"
        ),
    )]))
}

/// What is wrong when no voxel is inside.
pub(super) fn nothing_inside(scan: &Scan, inside: Inside) -> Violation {
    let label = match inside {
        Inside::Label(label) => label,
        Inside::Threshold(threshold) => {
            return Violation::new("threshold", format!("is {threshold}, no voxel has as much"));
        }
    };
    let there_are = match labels(scan) {
        Ok(labels) if labels.is_empty() => "there are none but the background 0".to_owned(),
        Ok(labels) => {
            let listed = labels.iter().take(LISTED_LABELS);
            let mut words: Vec<String> = listed.map(|label| label.value.to_string()).collect();
            if labels.len() > LISTED_LABELS {
                words.push(format!("and {} more", labels.len() - LISTED_LABELS));
            }
            format!("there are {}", words.join(", "))
        }
        Err(no_labels) => no_labels.to_string(),
    };
    Violation::new("label", format!("is {label}, {there_are}"))
}

/// Lowest and highest value.
struct Range;

impl Visit for Range {
    type Output = (f64, f64);

    fn visit<T: Value>(self, values: &[T]) -> (f64, f64) {
        let (mut low, mut high) = (values[0], values[0]);
        for &value in values {
            low = if value < low { value } else { low };
            high = if value > high { value } else { high };
        }
        (low.into(), high.into())
    }
}
