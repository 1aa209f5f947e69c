"""Registration cases with known truth from closed meniscus meshes: `cases.py FOLDER --mesh FILE [--mesh FILE] --superior +z`.

Writes clouds (PLY) and `cases.json` in the form of `$ARTHRO_DATA/registration`, so that whatever reads that folder reads these.
The source is the whole surface as a segmentation shows it: points snapped to the stairs of a binary marching cubes of a rotated
voxel grid. The target is one view of a depth camera: a pinhole z-buffer, cropped by a straight line across the image, with noise
along the ray and outliers, under an unknown similarity (target = scale R source + t). Lengths are mm of the mesh unless the
target's own unit is named. Every case depends on the seed, its level and its number alone.
"""

import argparse
import dataclasses
import json
import pathlib

import numpy as np

import ply

VOXEL_MM = 0.6
STAIR_NOISE_MM = 0.03
SOURCE_SIZES = (6000, 14000)
PITCH_MM = 0.40
DISTANCE_MM = (90.0, 250.0)
SCALE = (0.3, 3.5)
# Centroids lie anywhere within these balls about the origin.
SOURCE_RADIUS_MM = 150.0
TARGET_RADIUS = 300.0
# Uniform outliers fill the box of the view and this margin; the others form a rod like a tool that starts above the surface.
BOX_MARGIN_MM = 3.0
ROD_GAP_MM, ROD_LENGTH_MM, ROD_SIGMA_MM = 2.0, 12.0, 0.6
OVERLAP_MM = 1.0
SAMPLES_PER_PIXEL = 60


@dataclasses.dataclass(frozen=True)
class Level:
    """Ranges from which a case of this difficulty is drawn."""

    kept: tuple  # share of the view that is left
    sigma_mm: tuple  # depth noise
    outliers: tuple  # share of the target's points
    tilt_deg: float  # largest angle between the line of sight and the superior axis


LEVELS = {
    "easy": Level((0.90, 1.00), (0.10, 0.20), (0.00, 0.02), 35.0),
    "medium": Level((0.65, 0.85), (0.20, 0.35), (0.02, 0.05), 50.0),
    "hard": Level((0.40, 0.60), (0.35, 0.50), (0.05, 0.10), 65.0),
}


class Surface:
    """A triangle mesh from which points are drawn uniformly by area."""

    def __init__(self, vertices, triangles):
        self.corners = vertices[triangles]
        edge, other = self.corners[:, 1] - self.corners[:, 0], self.corners[:, 2] - self.corners[:, 0]
        doubled = np.cross(edge, other)
        length = np.linalg.norm(doubled, axis=1)
        self.corners, doubled, length = self.corners[length > 0], doubled[length > 0], length[length > 0]
        self.normals = doubled / length[:, None]
        self.area = length.sum() / 2
        self.share = length / length.sum()
        self.box_centre = (vertices.min(0) + vertices.max(0)) / 2

    def sample(self, count, rng):
        """Points (count, 3) and the normals of their triangles."""
        picked = rng.choice(len(self.share), count, p=self.share)
        weights = rng.random((count, 2))
        over = weights.sum(1) > 1
        weights[over] = 1 - weights[over]
        first, second, third = np.moveaxis(self.corners[picked], 1, 0)
        points = first + weights[:, :1] * (second - first) + weights[:, 1:] * (third - first)
        return points, self.normals[picked]


def random_rotation(rng):
    """Uniform over SO(3): a unit quaternion of four normal deviates."""
    w, x, y, z = (q := rng.normal(size=4)) / np.linalg.norm(q)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def random_direction(rng):
    """Uniform over the unit sphere."""
    direction = rng.normal(size=3)
    return direction / np.linalg.norm(direction)


def random_in_ball(radius, rng):
    """Uniform over the volume of a ball about the origin."""
    return random_direction(rng) * radius * rng.random() ** (1 / 3)


def across(direction, rng):
    """Two unit vectors that complete a direction to a right-handed frame, at a random angle about it."""
    first = np.cross(random_direction(rng), direction)
    first /= np.linalg.norm(first)
    return first, np.cross(direction, first)


def segmented(surface, count, rng):
    """The surface as a binary segmentation shows it: each point moves along the grid axis closest to its normal, onto the stair."""
    points, normals = surface.sample(count, rng)
    grid_from_mesh, origin = random_rotation(rng), rng.random(3)
    in_grid = points @ grid_from_mesh.T / VOXEL_MM + origin
    axis = np.abs(normals @ grid_from_mesh.T).argmax(1)
    row = np.arange(count)
    in_grid[row, axis] = np.floor(in_grid[row, axis]) + 0.5
    return (in_grid - origin) * VOXEL_MM @ grid_from_mesh + rng.normal(scale=STAIR_NOISE_MM, size=(count, 3))


def view_direction(superior, tilt_deg, rng):
    """From the surface to the camera: uniform over the cap of directions within the tilt of the superior axis."""
    cosine = rng.uniform(np.cos(np.radians(tilt_deg)), 1)
    sideways, _ = across(superior, rng)
    return cosine * superior + np.sqrt(1 - cosine**2) * sideways


def z_buffer(surface, camera, forward, rng):
    """What a pinhole camera sees: for each pixel that any surface covers its nearest point, and the image coordinates.

    One pixel spans PITCH_MM at the median depth of the surface. The point is where the nearest sample lies, not the centre of the pixel.
    """
    samples, _ = surface.sample(int(surface.area / PITCH_MM**2 * SAMPLES_PER_PIXEL), rng)
    right, down = across(forward, rng)
    rays = samples - camera
    depth = rays @ forward
    focal_px = np.median(depth) / PITCH_MM
    image = np.column_stack([rays @ right, rays @ down]) / depth[:, None] * focal_px
    column, row = np.floor(image).astype(int).T
    nearest_first = np.argsort(depth)
    pixel = (row - row.min()) * (column.max() - column.min() + 1) + column - column.min()
    _, first = np.unique(pixel[nearest_first], return_index=True)
    seen = nearest_first[first]
    return samples[seen], image[seen]


def cropped(points, image, kept, rng):
    """The given share of the view, on one side of a straight line across the image."""
    angle = rng.uniform(0, 2 * np.pi)
    along = image @ np.array([np.cos(angle), np.sin(angle)])
    return points[np.argsort(along)[: round(kept * len(points))]]


def outliers(view, count, rng):
    """Half uniform in the padded box of the view, half a rod that stands on it in any direction."""
    uniform = rng.uniform(view.min(0) - BOX_MARGIN_MM, view.max(0) + BOX_MARGIN_MM, (count - count // 2, 3))
    axis, foot = random_direction(rng), view[rng.integers(len(view))]
    along = ROD_GAP_MM + rng.uniform(0, ROD_LENGTH_MM, (count // 2, 1))
    rod = foot + along * axis + rng.normal(scale=ROD_SIGMA_MM, size=(count // 2, 3))
    return np.vstack([uniform, rod])


def share_within(points, others, distance):
    """Share of points that have one of the others within a distance."""
    near = 0
    for block in np.array_split(points, max(1, len(points) // 1000)):
        squared = (block**2).sum(1)[:, None] + (others**2).sum(1) - 2 * block @ others.T
        near += (squared.min(1) <= distance**2).sum()
    return float(near / len(points))


@dataclasses.dataclass(frozen=True)
class Source:
    """A preoperative cloud, shared by many views."""

    file: str
    mesh: str
    surface: Surface
    points: np.ndarray  # in the frame of the source
    rotation: np.ndarray  # source = rotation mesh + translation
    translation: np.ndarray


def make_sources(folder, name, meshes, seed):
    """Every mesh at every size, each in a frame of its own, written to the folder."""
    sources = []
    for mesh in meshes:
        surface = Surface(*ply.read_mesh(mesh))
        for size in SOURCE_SIZES:
            rng = np.random.default_rng([seed, len(LEVELS), len(sources)])
            rotation, translation = random_rotation(rng), random_in_ball(SOURCE_RADIUS_MM, rng)
            points = segmented(surface, size, rng) @ rotation.T + translation
            file = f"{name}_src{len(sources):02}.ply"
            ply.write_points(folder / file, points)
            sources.append(Source(file, mesh.name, surface, points, rotation, translation))
    return sources


def make_case(folder, name, level, number, source, superior, seed):
    """One view of a source, written to the folder, and its record for cases.json."""
    rng = np.random.default_rng([seed, list(LEVELS).index(level), number])
    ranges = LEVELS[level]
    towards_camera = view_direction(superior, ranges.tilt_deg, rng)
    distance_mm = rng.uniform(*DISTANCE_MM)
    camera = source.surface.box_centre + distance_mm * towards_camera
    whole, image = z_buffer(source.surface, camera, -towards_camera, rng)
    clean = cropped(whole, image, rng.uniform(*ranges.kept), rng)

    sigma_mm = rng.uniform(*ranges.sigma_mm)
    rays = clean - camera
    rays /= np.linalg.norm(rays, axis=1)[:, None]
    share = rng.uniform(*ranges.outliers)
    stray = outliers(clean, round(share / (1 - share) * len(clean)), rng)
    noisy = (clean + rng.normal(scale=sigma_mm, size=(len(clean), 1)) * rays) @ source.rotation.T + source.translation
    view = rng.permutation(np.vstack([noisy, stray @ source.rotation.T + source.translation]))

    scale, rotation = float(np.exp(rng.uniform(*np.log(SCALE)))), random_rotation(rng)
    centroid = source.points.mean(0)
    translation = random_in_ball(TARGET_RADIUS, rng) - scale * rotation @ centroid
    viewpoint = scale * rotation @ (source.rotation @ camera + source.translation) + translation
    file = f"{name}_{level}_{number:02}_tgt.ply"
    ply.write_points(folder / file, scale * view @ rotation.T + translation)
    return {
        "id": f"{name}_{level}_{number:02}",
        "level": level,
        "mesh": source.mesh,
        "source": source.file,
        "target": file,
        "scale": scale,
        "R": rotation.tolist(),
        "t": translation.tolist(),
        "mesh_to_source": {"R": source.rotation.tolist(), "t": source.translation.tolist()},
        "source_centroid": centroid.tolist(),
        "n_source": len(source.points),
        "n_target": len(view),
        "noise_sigma_mm": sigma_mm,
        "outlier_fraction": len(stray) / len(view),
        "kept_view_fraction": len(clean) / len(whole),
        "overlap_source_1mm": share_within(source.points, noisy, OVERLAP_MM),
        "target_viewpoint": viewpoint.tolist(),
        "view_tilt_deg": float(np.degrees(np.arccos(towards_camera @ superior))),
        "camera_distance_mm": distance_mm,
    }


def axis(text):
    """`+y` as a unit vector."""
    if len(text) != 2 or text[0] not in "+-" or text[1] not in "xyz":
        raise argparse.ArgumentTypeError(f"{text!r} is not an axis; expected one of +x -x +y -y +z -z")
    return np.eye(3)["xyz".index(text[1])] * (1 if text[0] == "+" else -1)


def main():
    parser = argparse.ArgumentParser(description="Registration cases with known truth from closed meniscus meshes.")
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--mesh", type=pathlib.Path, action="append", required=True, help="triangle mesh in mm; may be given again")
    parser.add_argument("--superior", type=axis, required=True, help="the axis of the meshes that points to the femur, such as +z")
    parser.add_argument("--per-level", type=int, default=20, help="cases of each level")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--name", help="prefix of the cases; the folder's name if left out")
    options = parser.parse_args()

    name = options.name or options.folder.name
    options.folder.mkdir(parents=True, exist_ok=True)
    sources = make_sources(options.folder, name, options.mesh, options.seed)
    cases = [
        make_case(options.folder, name, level, number, sources[number % len(sources)], options.superior, options.seed)
        for level in LEVELS
        for number in range(options.per_level)
    ]
    record = {
        "set": name,
        "voxel_mm": VOXEL_MM,
        "pitch_mm": PITCH_MM,
        "convention": "target = scale*R*source + t",
        "success": "rot<5deg, |T(c)-Tgt(c)|/scale<2mm, |s/sgt-1|<0.03",
        "cases": cases,
    }
    (options.folder / "cases.json").write_text(json.dumps(record, indent=1) + "\n")
    print(f"{len(cases)} cases from {len(sources)} sources in {options.folder}")


if __name__ == "__main__":
    main()
