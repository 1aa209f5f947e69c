"""small_gicp: generalised iterative closest point, rigid; works in mm of the source at the true scale."""

import importlib.metadata

import numpy as np
import small_gicp

from similarity import Similarity

VERSION = importlib.metadata.version("small-gicp")
# The best of a scan: its own default thinning, and a gate that holds the start.
THINNING_MM, GATE_MM, ITERATIONS = 0.25, 3.0, 60


def gicp(problem, start):
    """View from model; the view is moved onto the model."""
    result = small_gicp.align(
        problem.model,
        problem.view,
        np.linalg.inv(start.matrix()),
        registration_type="GICP",
        downsampling_resolution=THINNING_MM,
        max_correspondence_distance=GATE_MM,
        num_threads=1,
        max_iterations=ITERATIONS,
    )
    return Similarity.from_matrix(np.linalg.inv(result.T_target_source))
