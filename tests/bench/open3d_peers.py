"""Open3D: FPFH with RANSAC, FPFH with fast global registration, and its iterative closest point methods.

All work in mm of the source at the true scale and return view from model. The radii are the best of a scan over both anatomies: a
voxel of 0.7 mm, normals over 1.5 mm, FPFH over 4 mm.
"""

import ctypes

import libusb_package
import numpy as np

from similarity import Similarity

# Open3D is linked to libusb by name; loaded first, the packaged one serves.
ctypes.CDLL(str(libusb_package.get_library_path()), mode=ctypes.RTLD_GLOBAL)

import open3d  # noqa: E402

open3d.utility.set_verbosity_level(open3d.utility.VerbosityLevel.Error)
_registration = open3d.pipelines.registration
_within = open3d.geometry.KDTreeSearchParamHybrid

VERSION = open3d.__version__
VOXEL_MM = 0.7
NORMAL_RADIUS_MM, NORMAL_NEIGHBOURS = 1.5, 30
FPFH_RADIUS_MM, FPFH_NEIGHBOURS = 4.0, 100
RANSAC_DISTANCE_MM, RANSAC_EDGE, RANSAC_ITERATIONS, RANSAC_CONFIDENCE = 1.05, 0.9, 100_000, 0.999
FGR_DISTANCE_MM = 1.0
# Correspondence gates of the fine stages and their iterations.
GATES = ((3.0, 30), (1.5, 60))


def _cloud(points):
    cloud = open3d.geometry.PointCloud()
    cloud.points = open3d.utility.Vector3dVector(points)
    return cloud


def _with_normals(cloud):
    cloud.estimate_normals(_within(NORMAL_RADIUS_MM, NORMAL_NEIGHBOURS))
    return cloud


def _features(cloud):
    return _registration.compute_fpfh_feature(cloud, _within(FPFH_RADIUS_MM, FPFH_NEIGHBOURS))


def _model(points):
    """The thinned model with outward normals, and its features."""
    cloud = _with_normals(_cloud(points).voxel_down_sample(VOXEL_MM))
    cloud.orient_normals_consistent_tangent_plane(15)
    at, normals = np.asarray(cloud.points), np.asarray(cloud.normals)
    # By the divergence theorem the flux of the position is positive if the normals of a closed surface point outwards.
    if ((at - at.mean(0)) * normals).sum() < 0:
        cloud.normals = open3d.utility.Vector3dVector(-normals)
    return cloud, _features(cloud)


def _view(points, viewpoint):
    """The thinned view with normals that face the camera, and its features."""
    cloud = _with_normals(_cloud(points).voxel_down_sample(VOXEL_MM))
    cloud.orient_normals_towards_camera_location(viewpoint)
    return cloud, _features(cloud)


def ransac(problem):
    """Rigid RANSAC over FPFH correspondences with edge length and distance checks."""
    open3d.utility.random.seed(problem.seed)
    model, model_features = _model(problem.model)
    view, view_features = _view(problem.view, problem.viewpoint)
    result = _registration.registration_ransac_based_on_feature_matching(
        model,
        view,
        model_features,
        view_features,
        True,
        RANSAC_DISTANCE_MM,
        _registration.TransformationEstimationPointToPoint(False),
        3,
        [
            _registration.CorrespondenceCheckerBasedOnEdgeLength(RANSAC_EDGE),
            _registration.CorrespondenceCheckerBasedOnDistance(RANSAC_DISTANCE_MM),
        ],
        _registration.RANSACConvergenceCriteria(RANSAC_ITERATIONS, RANSAC_CONFIDENCE),
    )
    return Similarity.from_matrix(result.transformation)


def fast_global(problem):
    """Fast global registration over FPFH correspondences."""
    open3d.utility.random.seed(problem.seed)
    model, model_features = _model(problem.model)
    view, view_features = _view(problem.view, problem.viewpoint)
    option = _registration.FastGlobalRegistrationOption(
        use_absolute_scale=True, decrease_mu=True, maximum_correspondence_distance=FGR_DISTANCE_MM
    )
    result = _registration.registration_fgr_based_on_feature_matching(model, view, model_features, view_features, option)
    return Similarity.from_matrix(result.transformation)


def _refined(moving, fixed, start, estimation):
    """Fixed from moving, through the gates."""
    matrix = start
    for distance_mm, iterations in GATES:
        criteria = _registration.ICPConvergenceCriteria(max_iteration=iterations)
        matrix = _registration.registration_icp(moving, fixed, distance_mm, matrix, estimation(distance_mm), criteria).transformation
    return matrix


def _scaled(_distance_mm):
    return _registration.TransformationEstimationPointToPoint(True)


def _tukey_plane(distance_mm):
    return _registration.TransformationEstimationPointToPlane(_registration.TukeyLoss(distance_mm / 2))


def scaled_icp_from_model(problem, start):
    """Scaled point-to-point, each point of the model to the nearest of the view, as in the paper."""
    return Similarity.from_matrix(_refined(_cloud(problem.model), _cloud(problem.view), start.matrix(), _scaled))


def scaled_icp_from_view(problem, start):
    """Scaled point-to-point, each point of the view to the nearest of the model."""
    backwards = _refined(_cloud(problem.view), _cloud(problem.model), np.linalg.inv(start.matrix()), _scaled)
    return Similarity.from_matrix(np.linalg.inv(backwards))


def plane_icp_from_view(problem, start):
    """Rigid point-to-plane under Tukey's loss, each point of the view to the plane of the nearest of the model."""
    model = _with_normals(_cloud(problem.model))
    backwards = _refined(_cloud(problem.view), model, np.linalg.inv(start.matrix()), _tukey_plane)
    return Similarity.from_matrix(np.linalg.inv(backwards))
