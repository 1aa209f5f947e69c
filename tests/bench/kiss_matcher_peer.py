"""KISS-Matcher: global registration by features of its own; works in mm of the source at the true scale."""

import importlib.metadata

import kiss_matcher
import numpy as np

from similarity import Similarity

VERSION = importlib.metadata.version("kiss-matcher")
VOXEL_MM = 0.7


def estimate(problem):
    """View from model, rigid. Both clouds are centred first: the matcher turns normals towards the origin."""
    model_centre, view_centre = problem.model.mean(0), problem.view.mean(0)
    matcher = kiss_matcher.KISSMatcher(kiss_matcher.KISSMatcherConfig(voxel_size=VOXEL_MM))
    model, view = ((points - centre).astype(np.float32) for points, centre in ((problem.model, model_centre), (problem.view, view_centre)))
    found = matcher.estimate(list(model), list(view))
    rotation = np.asarray(found.rotation, float)
    return Similarity(1.0, rotation, np.asarray(found.translation, float).ravel() + view_centre - rotation @ model_centre)
