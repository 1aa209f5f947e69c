"""The folder of cases: clouds with known truth, as `cases.py` writes them, and the problems that are posed with them."""

import dataclasses
import functools
import json
import zlib

import numpy as np

import ply
from similarity import Similarity, rotation_about

LEVELS = ("easy", "medium", "hard")
# The fine stage alone starts this far from the truth: turned about the centroid, moved, and scaled up or down.
START_DEG, START_MM, START_SCALE = 5.0, 3.0, 0.05
# A scale prior of +-10 %: the truth lies anywhere in the range, not in its middle.
PRIOR = 0.10
FREE_SCALE = (0.3, 3.5)


@dataclasses.dataclass(frozen=True)
class Case:
    """A model, a view of it, and the similarity between them."""

    id: str
    level: str
    source_path: object
    target_path: object
    truth: Similarity
    centroid: np.ndarray  # of the source
    viewpoint: np.ndarray  # of the camera, in the target's frame

    @functools.cached_property
    def source(self):
        """The model: (n, 3) mm."""
        return ply.read_points(self.source_path)

    @functools.cached_property
    def target(self):
        """The view: (m, 3) in the target's unit."""
        return ply.read_points(self.target_path)

    def random(self, purpose):
        """A generator of this case and purpose alone, whatever other cases are run."""
        return np.random.default_rng([zlib.crc32(self.id.encode()), zlib.crc32(purpose.encode())])

    def scale_range(self):
        """A range of +-PRIOR about a centre that is drawn so that the truth is uniform within it."""
        centre = self.truth.scale / self.random("prior").uniform(1 - PRIOR, 1 + PRIOR)
        return centre * (1 - PRIOR), centre * (1 + PRIOR)

    def start(self, scale_error):
        """The truth in mm of the source, turned and moved by START; scaled too if asked, else at the true scale."""
        rng = self.random("start")
        axis, direction = rng.normal(size=(2, 3))
        turn = rotation_about(axis / np.linalg.norm(axis), np.radians(START_DEG))
        sign = rng.choice([-1, 1])
        truth = self.truth.enlarged(1 / self.truth.scale)
        scale, rotation = 1 + sign * scale_error, turn @ truth.rotation
        moved = truth.apply(self.centroid) + START_MM * direction / np.linalg.norm(direction)
        return Similarity(scale, rotation, moved - scale * rotation @ self.centroid)


@dataclasses.dataclass(frozen=True)
class Problem:
    """What a peer is given: both clouds in mm of the source, so that the true scale between them is 1."""

    model: np.ndarray  # (n, 3), the whole surface
    view: np.ndarray  # (m, 3), one side of it
    viewpoint: np.ndarray  # (3,) of the camera that took the view
    start: Similarity  # view from model, near the truth, at the true scale
    scaled_start: Similarity  # the same, START_SCALE off
    seed: int


def problem(case):
    """The case with its true scale given away."""
    return Problem(
        case.source,
        case.target / case.truth.scale,
        case.viewpoint / case.truth.scale,
        case.start(0.0),
        case.start(START_SCALE),
        int(case.random("seed").integers(2**31)),
    )


def read(folder, per_level=None):
    """The name of the set and its cases, at most `per_level` of each level."""
    record = json.loads((folder / "cases.json").read_text())
    cases, taken = [], dict.fromkeys(LEVELS, 0)
    for entry in record["cases"]:
        if per_level is not None and taken[entry["level"]] >= per_level:
            continue
        taken[entry["level"]] += 1
        cases.append(
            Case(
                entry["id"],
                entry["level"],
                folder / entry["source"],
                folder / entry["target"],
                Similarity(entry["scale"], np.array(entry["R"]), np.array(entry["t"])),
                np.array(entry["source_centroid"]),
                np.array(entry["target_viewpoint"]),
            )
        )
    return record["set"], cases
