//! Takes the steps of the voxels off a net: the net is bent as little as its cells allow.
//!
//! A label map says of every voxel which side it is on and no more, so that a vertex may lie anywhere in its cell
//! (Gibson 1998). Of all such nets the one with the least bending (the sum of squared second differences, a thin
//! plate) is sought, because pulling the net taut instead would shrink every rounded part. Accelerated projected
//! gradient descent (Beck and Teboulle, SIAM J. Imaging Sciences, 2009) comes close in a few dozen passes.

use rayon::prelude::*;

use super::surface_nets::Net;
use crate::budget::Budget;
use crate::error::Error;

/// Length of a step against the gradient. A mean of neighbours minus the vertex is an operator of norm 2 at most, its
/// square of norm 4.
const STEP: f32 = 0.25;
/// How far a vertex may move from the middle of its cell along each axis, in voxels. Less than half, so that it never
/// meets a voxel's middle, where the surface of a lone voxel would shrink to a point.
pub(super) const REACH: f32 = 0.49;
/// Vertices that a thread takes at a time.
const CHUNK: usize = 4096;

/// Relaxes the net; every vertex stays within half a voxel of the middle of its cell, along each axis.
pub(super) fn relax(net: &mut Net, passes: u32, budget: &Budget) -> Result<(), Error> {
    let neighbours = Neighbours::of(net);
    let (mut bend, mut gradient) = (Vec::new(), Vec::new());
    let mut before = net.positions.clone();
    let mut pace = 1.0f32;
    for _ in 0..passes {
        budget.check()?;
        let next_pace = (1.0 + (1.0 + 4.0 * pace * pace).sqrt()) / 2.0;
        let momentum = (pace - 1.0) / next_pace;
        pace = next_pace;
        let ahead = along(&before, &net.positions, momentum);
        neighbours.differences(&ahead, &mut bend);
        neighbours.differences(&bend, &mut gradient);
        before = std::mem::replace(&mut net.positions, ahead);
        let vertices = net.positions.par_iter_mut().zip(&net.middles);
        let vertices = vertices.zip(&gradient).with_min_len(CHUNK);
        vertices.for_each(|((position, middle), gradient)| {
            for axis in 0..3 {
                position[axis] = (position[axis] - STEP * gradient[axis])
                    .clamp(middle[axis] - REACH, middle[axis] + REACH);
            }
        });
    }
    Ok(())
}

/// The places on from `before` by way of `now`, by a share of the way so far.
fn along(before: &[[f32; 3]], now: &[[f32; 3]], share: f32) -> Vec<[f32; 3]> {
    let on = |(before, now): (&[f32; 3], &[f32; 3])| {
        [0, 1, 2].map(|axis| now[axis] + share * (now[axis] - before[axis]))
    };
    before
        .par_iter()
        .zip(now)
        .with_min_len(CHUNK)
        .map(on)
        .collect()
}

/// The neighbours of each vertex, one after the other.
struct Neighbours {
    ends: Vec<u32>,
    of: Vec<u32>,
}

impl Neighbours {
    /// In a closed net each neighbour follows a vertex in exactly one quad.
    fn of(net: &Net) -> Self {
        let mut ends = vec![0; net.positions.len()];
        for corner in net.quads.iter().flatten() {
            ends[*corner as usize] += 1;
        }
        let mut total = 0;
        for end in &mut ends {
            total += *end;
            *end = total;
        }
        let mut places = ends.clone();
        let mut of = vec![0; total as usize];
        for [a, b, c, d] in &net.quads {
            for (from, to) in [(a, b), (b, c), (c, d), (d, a)] {
                let place = &mut places[*from as usize];
                *place -= 1;
                of[*place as usize] = *to;
            }
        }
        Self { ends, of }
    }

    /// The mean over the neighbours of each vertex, minus its own value.
    fn differences(&self, values: &[[f32; 3]], out: &mut Vec<[f32; 3]>) {
        let difference = |vertex: usize| {
            let start = vertex.checked_sub(1).map_or(0, |before| self.ends[before]);
            let neighbours = &self.of[start as usize..self.ends[vertex] as usize];
            let mut sum = [0.0f32; 3];
            for neighbour in neighbours {
                let value = &values[*neighbour as usize];
                for axis in 0..3 {
                    sum[axis] += value[axis];
                }
            }
            let count = neighbours.len() as f32;
            [0, 1, 2].map(|axis| sum[axis] / count - values[vertex][axis])
        };
        let vertices = (0..values.len()).into_par_iter().with_min_len(CHUNK);
        vertices.map(difference).collect_into_vec(out);
    }
}
