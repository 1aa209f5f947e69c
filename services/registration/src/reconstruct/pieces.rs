//! The separate pieces of a net: a surface outside, or around a cavity, which has a negative volume. Small ones are
//! specks of a hand-drawn or thresholded segmentation.

use super::surface_nets::{Net, cone};

/// Drops the pieces and fills the cavities that are smaller than a share of the largest piece, and tells how many.
pub(super) fn drop_small(net: &mut Net, min_share: f64) -> usize {
    let piece_of = pieces_of(net);
    let count = piece_of.iter().max().map_or(0, |last| last + 1);
    let mut volumes = vec![0.0; count];
    for quad in &net.quads {
        volumes[piece_of[quad[0] as usize]] += cone(&net.middles, quad);
    }
    // With the vertices in the middle of their cells it is a number of voxels; equal pieces are equal.
    let voxels: Vec<f64> = volumes.into_iter().map(f64::round).collect();
    let largest = voxels.iter().copied().fold(0.0, f64::max);
    let is_kept = |piece: usize| voxels[piece].abs() >= min_share * largest;
    let dropped = (0..count).filter(|piece| !is_kept(*piece)).count();
    if dropped > 0 {
        retain(net, |vertex| is_kept(piece_of[vertex]));
    }
    dropped
}

/// The piece that each vertex belongs to, numbered as they first appear.
fn pieces_of(net: &Net) -> Vec<usize> {
    let mut leader: Vec<u32> = (0..net.positions.len() as u32).collect();
    for quad in &net.quads {
        for corner in &quad[1..] {
            let (one, other) = (lead(&mut leader, quad[0]), lead(&mut leader, *corner));
            leader[one.max(other) as usize] = one.min(other);
        }
    }
    let mut count = 0;
    let mut piece_of = vec![0; leader.len()];
    for vertex in 0..leader.len() {
        let first = lead(&mut leader, vertex as u32) as usize;
        // A leader is the lowest vertex of its piece, so that its number is known by then.
        piece_of[vertex] = if first == vertex {
            count += 1;
            count - 1
        } else {
            piece_of[first]
        };
    }
    piece_of
}

/// The leader of a vertex; halves the way to it in passing.
fn lead(leader: &mut [u32], mut vertex: u32) -> u32 {
    while leader[vertex as usize] != vertex {
        let above = leader[vertex as usize];
        leader[vertex as usize] = leader[above as usize];
        vertex = above;
    }
    vertex
}

fn retain(net: &mut Net, is_kept: impl Fn(usize) -> bool) {
    let number: Vec<u32> = (0..net.positions.len())
        .scan(0, |kept, vertex| {
            let number = *kept;
            *kept += u32::from(is_kept(vertex));
            Some(number)
        })
        .collect();
    net.positions = kept_of(&net.positions, &is_kept);
    net.middles = kept_of(&net.middles, &is_kept);
    net.quads.retain(|quad| is_kept(quad[0] as usize));
    for corner in net.quads.iter_mut().flatten() {
        *corner = number[*corner as usize];
    }
}

fn kept_of(places: &[[f32; 3]], is_kept: impl Fn(usize) -> bool) -> Vec<[f32; 3]> {
    let numbered = places.iter().enumerate();
    let kept = numbered.filter(|(vertex, _)| is_kept(*vertex));
    kept.map(|(_, place)| *place).collect()
}
