//! How many times the surface passes through a cell of eight voxels, and which edges each passage crosses.
//!
//! On a face of the cell whose voxels are inside and outside crosswise, two passages meet, and the four crossings can
//! be paired in two ways. Everywhere they are paired around the voxels inside, which keeps those apart, except where
//! that would close both passages into one on both sides of the face: then the edge between the two cells would belong
//! to four faces. There they are paired around the voxels outside. Such a cell has no other crosswise face
//! (Wenger, Isosurfaces, 2013, section 3.3), so that the choice never contradicts another one.
//!
//! Corner `c` of a cell lies at `c & 1`, `c >> 1 & 1`, `c >> 2` along the axes; bit `c` of a configuration says that
//! it is inside.

/// Edges of a cell.
pub(super) const EDGES: usize = 12;

/// An edge that the surface does not cross.
const UNCROSSED: u8 = u8::MAX;

/// The passages of the surface through every kind of cell.
#[derive(Debug)]
pub(super) struct Patches {
    apart: Vec<CellPatches>,
    joined: Vec<CellPatches>,
    bridges: Vec<Option<Face>>,
}

/// The passages of the surface through one cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct CellPatches {
    count: u8,
    patch_of_edge: [u8; EDGES],
}

/// A face of a cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Face {
    /// The axis across it.
    pub(super) axis: usize,
    /// 0 below along the axis, 1 above.
    pub(super) side: usize,
}

/// Around which voxels the crossings of a crosswise face are paired.
#[derive(Clone, Copy, PartialEq)]
enum Pairing {
    Inside,
    Outside,
}

/// The edge of a cell along `axis`, `offset` steps from its lowest corner along the two axes that follow.
pub(super) fn edge_along(axis: usize, offset: (usize, usize)) -> usize {
    4 * axis + offset.0 + 2 * offset.1
}

/// Lowest corner of an edge, and the axis along it.
pub(super) fn corner_and_axis(edge: usize) -> (usize, usize) {
    let axis = edge / 4;
    let corner = (edge & 1) << ((axis + 1) % 3) | (edge >> 1 & 1) << ((axis + 2) % 3);
    (corner, axis)
}

impl Patches {
    pub(super) fn new() -> Self {
        let all = |pairing| (0..=255).map(move |config| CellPatches::of(config, pairing));
        Self {
            apart: all(Pairing::Inside).collect(),
            joined: all(Pairing::Outside).collect(),
            bridges: (0..=255).map(bridge).collect(),
        }
    }

    /// The crosswise face of a cell whose two passages become one; both cells at it must have it so to be `joined`.
    pub(super) fn bridge(&self, config: u8) -> Option<Face> {
        self.bridges[config as usize]
    }

    /// The passages through a cell.
    pub(super) fn of(&self, config: u8, is_joined: bool) -> &CellPatches {
        if is_joined {
            &self.joined[config as usize]
        } else {
            &self.apart[config as usize]
        }
    }
}

impl CellPatches {
    /// How many passages.
    pub(super) fn count(&self) -> usize {
        self.count.into()
    }

    /// The passage that crosses an edge, if one does.
    pub(super) fn of_edge(&self, edge: usize) -> Option<usize> {
        let patch = self.patch_of_edge[edge];
        (patch != UNCROSSED).then_some(patch.into())
    }

    /// Joins the crossings that share a face, then numbers what hangs together.
    fn of(config: u8, pairing: Pairing) -> Self {
        let mut leader: [usize; EDGES] = std::array::from_fn(|edge| edge);
        for face in faces() {
            for (one, other) in pairs(config, face, pairing) {
                let (from, to) = (leader[one], leader[other]);
                for entry in &mut leader {
                    if *entry == from {
                        *entry = to;
                    }
                }
            }
        }
        let mut patches = Self {
            count: 0,
            patch_of_edge: [UNCROSSED; EDGES],
        };
        for edge in (0..EDGES).filter(|edge| is_crossed(config, *edge)) {
            let earlier = (0..edge).find(|e| is_crossed(config, *e) && leader[*e] == leader[edge]);
            patches.patch_of_edge[edge] = match earlier {
                Some(earlier) => patches.patch_of_edge[earlier],
                None => {
                    patches.count += 1;
                    patches.count - 1
                }
            };
        }
        patches
    }
}

fn bridge(config: u8) -> Option<Face> {
    let patches = CellPatches::of(config, Pairing::Inside);
    faces().find(|face| {
        let [a, b, c, d] = edges_of(*face).map(|edge| patches.of_edge(edge));
        a.is_some() && a == b && b == c && c == d
    })
}

/// The crossings that share a face, in pairs.
fn pairs(config: u8, face: Face, pairing: Pairing) -> Vec<(usize, usize)> {
    let edges = edges_of(face);
    let crossed: Vec<usize> = edges
        .into_iter()
        .filter(|edge| is_crossed(config, *edge))
        .collect();
    match crossed[..] {
        [] => Vec::new(),
        [one, other] => vec![(one, other)],
        // All four: edge i runs from corner i to corner i + 1, so that i - 1 and i meet at corner i.
        _ => {
            let first = corners_of(face)[0];
            let starts_inside = config >> first & 1 == 1;
            if starts_inside == (pairing == Pairing::Inside) {
                vec![(edges[3], edges[0]), (edges[1], edges[2])]
            } else {
                vec![(edges[0], edges[1]), (edges[2], edges[3])]
            }
        }
    }
}

fn faces() -> impl Iterator<Item = Face> {
    (0..3).flat_map(|axis| [0, 1].map(|side| Face { axis, side }))
}

/// Corners of a face, one after the other around it.
fn corners_of(Face { axis, side }: Face) -> [usize; 4] {
    let (b, c) = (1 << ((axis + 1) % 3), 1 << ((axis + 2) % 3));
    [0, b, b | c, c].map(|corner| side << axis | corner)
}

/// Edges of a face, from each of its corners to the next.
fn edges_of(face: Face) -> [usize; 4] {
    let corners = corners_of(face);
    [0, 1, 2, 3].map(|i| edge_between(corners[i], corners[(i + 1) % 4]))
}

fn edge_between(one: usize, other: usize) -> usize {
    let axis = (one ^ other).trailing_zeros() as usize;
    let low = one & other;
    edge_along(
        axis,
        (low >> ((axis + 1) % 3) & 1, low >> ((axis + 2) % 3) & 1),
    )
}

fn is_crossed(config: u8, edge: usize) -> bool {
    let (corner, axis) = corner_and_axis(edge);
    let other = corner | 1 << axis;
    (config >> corner ^ config >> other) & 1 == 1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_crossed_edge_and_no_other_has_a_patch() {
        let patches = Patches::new();
        for config in 0..=255 {
            for is_joined in [false, true] {
                let cell = patches.of(config, is_joined);
                for edge in 0..EDGES {
                    assert_eq!(cell.of_edge(edge).is_some(), is_crossed(config, edge));
                    assert!(cell.of_edge(edge).is_none_or(|patch| patch < cell.count()));
                }
                assert!(cell.count() <= 4);
            }
        }
    }

    #[test]
    fn one_corner_is_one_patch_and_four_lone_corners_are_four() {
        let patches = Patches::new();
        assert_eq!(patches.of(0b0000_0001, false).count(), 1);
        assert_eq!(patches.of(0b0110_1001, false).count(), 4);
        assert_eq!(patches.of(0b0000_0000, false).count(), 0);
        assert_eq!(patches.of(0b1111_1111, false).count(), 0);
    }

    #[test]
    fn a_cell_with_a_bridge_has_one_crosswise_face_and_two_patches_there_when_joined() {
        let patches = Patches::new();
        let mut bridges = 0;
        for config in 0..=255 {
            let Some(face) = patches.bridge(config) else {
                continue;
            };
            bridges += 1;
            let crosswise =
                faces().filter(|face| edges_of(*face).iter().all(|e| is_crossed(config, *e)));
            assert_eq!(crosswise.collect::<Vec<_>>(), [face]);
            let joined = patches.of(config, true);
            let [a, b, c, d] = edges_of(face).map(|edge| joined.of_edge(edge));
            assert!(a != b || b != c, "{config:08b}: {a:?} {b:?} {c:?} {d:?}");
        }
        // Six faces, two ways to be crosswise, one or both of the corners behind inside.
        assert_eq!(bridges, 36);
    }
}
