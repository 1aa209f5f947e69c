//! Pixels that hang in the air beside an edge: a stereo camera matches a window of pixels, and where that window sees
//! two surfaces it may answer with a depth between them.

use rayon::prelude::*;

use super::{Patch, SIGNIFICANT};

impl Patch<'_> {
    /// Drops what hangs between a nearer and a farther neighbour; says how many.
    pub(super) fn drop_flying(&mut self, steepest: f64) -> usize {
        let flying: Vec<usize> = (0..self.width * self.height)
            .into_par_iter()
            .filter(|place| self.is_flying(*place, steepest))
            .map(|place| place as usize)
            .collect();
        for place in &flying {
            self.depths_mm[*place] = 0.0;
        }
        flying.len()
    }

    fn is_flying(&self, place: i64, steepest: f64) -> bool {
        let (column, row) = (place % self.width, place / self.width);
        let Some(depth_mm) = self.depth_mm(column, row) else {
            return false;
        };
        let pitch_mm = depth_mm / self.lens.intrinsics().fx_px;
        let noise_mm = SIGNIFICANT * 2f64.sqrt() * self.sigmas_mm[place as usize];
        [(1, 0), (0, 1), (1, 1), (1, -1)]
            .into_iter()
            .any(|(dx, dy)| {
                let step_mm = (steepest * pitch_mm * (dx as f64).hypot(dy as f64)).max(noise_mm);
                let before = self.depth_mm(column - dx, row - dy);
                let after = self.depth_mm(column + dx, row + dy);
                before.zip(after).is_some_and(|(before, after)| {
                    let (nearer, farther) = (before.min(after), before.max(after));
                    depth_mm - nearer > step_mm && farther - depth_mm > step_mm
                })
            })
    }
}
