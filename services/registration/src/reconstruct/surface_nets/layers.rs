//! The cells of a scan layer by layer: three layers are held, so that a cell knows its neighbours on all sides.
//!
//! Cells are counted from one voxel before the box around the inside; what lies beyond the box, or beyond the scan, is
//! outside. The cell at (i, j, k) has voxel (i, j, k) of that count at its lowest corner.

use arthro_geometry::scan::Value;

use super::super::body::{Body, Rule};
use super::patches::{CellPatches, Patches, corner_and_axis};

/// Set in a cell's configuration where its bridge is joined.
const JOINED: u16 = 1 << 8;

/// A sweep over the layers of cells along the third axis.
pub(super) struct Layers<'a, T, R> {
    voxels: Voxels<'a, T, R>,
    patches: &'a Patches,
    /// Cells along each axis.
    size: [usize; 3],
    /// How many layers have been entered; the present one is the last of them.
    entered: usize,
    before: Layer,
    now: Layer,
    after: Layer,
    /// Cells of the present layer that the surface passes through.
    active: Vec<usize>,
    /// Which voxels on top of the layer after are inside.
    inside: Vec<u8>,
}

/// What is known of the cells of a layer.
#[derive(Clone)]
struct Layer {
    /// Which corners are inside, and whether the bridge is joined.
    configs: Vec<u16>,
    /// Number of the first vertex in each cell that has vertices.
    first_vertices: Vec<u32>,
}

/// The voxels of the box, counted from one before it.
struct Voxels<'a, T, R> {
    values: &'a [T],
    scan_size: [usize; 3],
    low: [usize; 3],
    /// How many there are along each axis, the ones before and behind the box included.
    size: [usize; 3],
    rule: R,
}

// === impl Layers ===

impl<'a, T: Value, R: Rule<T>> Layers<'a, T, R> {
    pub(super) fn new(
        values: &'a [T],
        scan_size: [usize; 3],
        body: &Body,
        rule: R,
        patches: &'a Patches,
    ) -> Self {
        let voxels = Voxels {
            values,
            scan_size,
            low: body.low,
            size: [0, 1, 2].map(|axis| body.high[axis] - body.low[axis] + 3),
            rule,
        };
        let size = voxels.size.map(|count| count - 1);
        let empty = Layer {
            configs: vec![0; size[0] * size[1]],
            first_vertices: vec![0; size[0] * size[1]],
        };
        let mut layers = Self {
            size,
            patches,
            entered: 0,
            before: empty.clone(),
            now: empty.clone(),
            after: empty,
            active: Vec::new(),
            inside: vec![0; voxels.size[0] * voxels.size[1]],
            voxels,
        };
        layers.fill_after(0);
        layers
    }

    /// Enters the next layer; `false` when there is none.
    pub(super) fn advance(&mut self) -> bool {
        if self.entered == self.size[2] {
            return false;
        }
        std::mem::swap(&mut self.before, &mut self.now);
        std::mem::swap(&mut self.now, &mut self.after);
        self.entered += 1;
        self.fill_after(self.entered);
        let configs = &self.now.configs;
        self.active.clear();
        self.active
            .extend((0..configs.len()).filter(|cell| !matches!(configs[*cell], 0 | 0xff)));
        self.join_bridges();
        true
    }

    /// Cells of the present layer that the surface passes through.
    pub(super) fn active(&self) -> &[usize] {
        &self.active
    }

    /// The passages of the surface through a cell of the present layer.
    pub(super) fn patches_of(&self, cell: usize) -> &'a CellPatches {
        self.patches_in(&self.now, cell)
    }

    /// Remembers the number of a cell's first vertex; the others of the cell follow it.
    pub(super) fn set_first_vertex(&mut self, cell: usize, vertex: u32) {
        self.now.first_vertices[cell] = vertex;
    }

    /// Indices of the voxel at a cell's lowest corner; -1 before the scan.
    pub(super) fn lowest_voxel(&self, cell: usize) -> [f32; 3] {
        let corner = self.corner(cell);
        [0, 1, 2].map(|axis| (self.voxels.low[axis] + corner[axis]) as f32 - 1.0)
    }

    /// Where the surface crosses an edge of a cell, from the cell's lowest corner, in voxels.
    pub(super) fn crossing(&self, cell: usize, edge: usize) -> [f32; 3] {
        let (offset, axis) = corner_and_axis(edge);
        let steps = [offset & 1, offset >> 1 & 1, offset >> 2];
        let corner = self.corner(cell);
        let low = [0, 1, 2].map(|axis| corner[axis] + steps[axis]);
        let mut high = low;
        high[axis] += 1;
        let mut place = steps.map(|step| step as f32);
        place[axis] = self.voxels.crossing(low, high);
        place
    }

    /// Whether the lower end of the edge along `axis` from a cell's lowest corner is inside; `None` if both ends are,
    /// or none is.
    pub(super) fn low_inside_of_crossed_edge(&self, cell: usize, axis: usize) -> Option<bool> {
        let config = self.now.configs[cell];
        let (low, high) = (config & 1, config >> (1 << axis) & 1);
        (low != high).then_some(low == 1)
    }

    /// The vertex of the passage across `edge` of the cell that lies `back` steps before `cell` along the two axes that
    /// follow `axis`.
    pub(super) fn vertex_of(
        &self,
        cell: usize,
        axis: usize,
        back: (usize, usize),
        edge: usize,
    ) -> u32 {
        let mut steps = [0; 3];
        steps[(axis + 1) % 3] = back.0;
        steps[(axis + 2) % 3] = back.1;
        let layer = if steps[2] == 1 {
            &self.before
        } else {
            &self.now
        };
        let cell = cell - steps[0] - steps[1] * self.size[0];
        let patch = self.patches_in(layer, cell).of_edge(edge).unwrap_or(0);
        layer.first_vertices[cell] + patch as u32
    }

    fn patches_in(&self, layer: &Layer, cell: usize) -> &'a CellPatches {
        let config = layer.configs[cell];
        self.patches.of(config as u8, config & JOINED != 0)
    }

    fn corner(&self, cell: usize) -> [usize; 3] {
        [cell % self.size[0], cell / self.size[0], self.entered - 1]
    }

    /// Joins the bridges of the present layer whose neighbours have theirs at the same face.
    fn join_bridges(&mut self) {
        for &cell in &self.active {
            let Some(face) = self.patches.bridge(self.now.configs[cell] as u8) else {
                continue;
            };
            let step = [1, self.size[0], 0][face.axis];
            let neighbour = if face.side == 1 {
                cell + step
            } else {
                cell - step
            };
            let layer = match (face.axis, face.side) {
                (2, 0) => &self.before,
                (2, _) => &self.after,
                _ => &self.now,
            };
            let theirs = self.patches.bridge(layer.configs[neighbour] as u8);
            if theirs.is_some_and(|other| other.axis == face.axis && other.side != face.side) {
                self.now.configs[cell] |= JOINED;
            }
        }
    }

    /// Fills the layer after with the cells of a layer; behind the last one nothing is inside.
    fn fill_after(&mut self, layer: usize) {
        let [columns, rows, _] = self.size;
        let top = self.voxels.inside(layer + 1);
        let bottom = std::mem::replace(&mut self.inside, top);
        let width = columns + 1;
        for j in 0..rows {
            let [near, far] = [j * width..(j + 1) * width, (j + 1) * width..(j + 2) * width];
            let [a, b] = [&bottom[near.clone()], &bottom[far.clone()]];
            let [c, d] = [&self.inside[near], &self.inside[far]];
            let configs = &mut self.after.configs[j * columns..(j + 1) * columns];
            for (i, config) in configs.iter_mut().enumerate() {
                let pair = |row: &[u8]| u16::from(row[i] | row[i + 1] << 1);
                *config = pair(a) | pair(b) << 2 | pair(c) << 4 | pair(d) << 6;
            }
        }
    }
}

// === impl Voxels ===

impl<T: Value, R: Rule<T>> Voxels<'_, T, R> {
    /// Which voxels of a layer are inside, as 0 and 1; beyond the box none is.
    fn inside(&self, layer: usize) -> Vec<u8> {
        let [columns, rows, layers] = self.size;
        let mut inside = vec![0; columns * rows];
        if layer == 0 || layer + 1 >= layers {
            return inside;
        }
        for j in 1..rows - 1 {
            let first = self.position([1, j, layer]);
            let row = &self.values[first..first + columns - 2];
            let marks = &mut inside[j * columns + 1..(j + 1) * columns - 1];
            for (mark, value) in marks.iter_mut().zip(row) {
                *mark = u8::from(self.rule.holds(*value));
            }
        }
        inside
    }

    /// Where the surface crosses between two voxels, one of which is inside, as a share of the way from `low`. The
    /// border of the scan lies in the middle between its last voxels and those that would follow.
    fn crossing(&self, low: [usize; 3], high: [usize; 3]) -> f32 {
        let (Some(low), Some(high)) = (self.value(low), self.value(high)) else {
            return 0.5;
        };
        if self.rule.holds(low) {
            self.rule.crossing(low, high)
        } else {
            1.0 - self.rule.crossing(high, low)
        }
    }

    /// The value of a voxel; `None` beyond the scan.
    fn value(&self, voxel: [usize; 3]) -> Option<T> {
        let is_in_scan = (0..3).all(|axis| {
            let counted = self.low[axis] + voxel[axis];
            (1..=self.scan_size[axis]).contains(&counted)
        });
        is_in_scan.then(|| self.values[self.position(voxel)])
    }

    /// Position of a voxel of the scan in its values.
    fn position(&self, voxel: [usize; 3]) -> usize {
        let [i, j, k] = [0, 1, 2].map(|axis| self.low[axis] + voxel[axis] - 1);
        i + self.scan_size[0] * (j + self.scan_size[1] * k)
    }
}
