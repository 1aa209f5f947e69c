//! What each bite does at its time: the order does not change what is removed in the end, but it
//! decides which bite takes it and whether the jaw can close.

use super::Task;
use crate::jaw::Bite;
use crate::tissue::Tissue;

/// What one bite does at its time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BiteAccount {
    /// Tissue of the region that this bite is the first to take, mm3.
    pub region_mm3: f64,
    /// Tissue outside the region that this bite is the first to take, mm3.
    pub outside_mm3: f64,
    /// Share of the jaw's throat that tissue blocks when the bite is made, 0..1.
    pub throat_share: f64,
    /// Predicted time of the whole cycle, s.
    pub seconds: f64,
}

/// A bite whose jaw cannot close at its time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Blocked {
    /// Position in the list of bites, from 0.
    pub bite: usize,
    /// Share of the jaw's throat that tissue blocks.
    pub share: f64,
}

/// The tissue after all bites, and what each of them did.
pub(super) fn carry_out<'a>(
    task: &Task<'a>,
    region: &[bool],
    bites: &[Bite],
) -> (Tissue<'a>, Vec<BiteAccount>) {
    let mut tissue = Tissue::whole(task.voxels);
    let mm3 = |voxels: usize| voxels as f64 * task.voxels.voxel_mm3();
    let accounts = bites.iter().map(|bite| {
        let throat_share = tissue.throat_share(&bite.throat(&task.jaw));
        let removed = tissue.bite(&bite.cut(&task.jaw));
        let inside = removed.iter().filter(|voxel| region[**voxel as usize]);
        let inside = inside.count();
        BiteAccount {
            region_mm3: mm3(inside),
            outside_mm3: mm3(removed.len() - inside),
            throat_share,
            seconds: task.timing.cycle_s(bite, task.portals),
        }
    });
    let accounts = accounts.collect();
    (tissue, accounts)
}

/// The bites whose throat is blocked by more than `limit`.
pub(super) fn blocked(accounts: &[BiteAccount], limit: f64) -> Vec<Blocked> {
    let shares = accounts.iter().map(|account| account.throat_share);
    shares
        .enumerate()
        .filter(|(_, share)| *share > limit)
        .map(|(bite, share)| Blocked { bite, share })
        .collect()
}
