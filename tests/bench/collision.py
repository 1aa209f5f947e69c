"""A straight shaft against a knee mesh of 32,768 faces: arthro beside python-fcl and coal.

    collision.py FOLDER

FOLDER holds what `cargo bench -p arthro-planning --bench reach` left in this run: knee.json (mesh, shafts, our answers) and
criterion's estimates. The peers are asked the same 2000 shafts from Python, one call a shaft, so that some of their time
is that of the call: it is measured and told. Fails if a peer sees a hit where we see none, or the other way round, unless
the shaft is within 0.02 mm of touching.
"""

import json
import pathlib
import sys
import time

import numpy as np

ROUNDS = 3
# What two libraries may disagree about, mm.
TOUCH_MM = 0.02


def main() -> None:
    folder = pathlib.Path(sys.argv[1])
    knee = json.loads((folder / "knee.json").read_text())
    rows = {"arthro": ours(folder / "criterion")}
    for name, measure in (("python-fcl", fcl_peer), ("coal", coal_peer)):
        try:
            rows[name] = measure(knee)
        except ImportError as error:
            print(f"{name} is not installed: {error}")
    print(f"{'':12}{'intersection us':>18}{'distance us':>14}{'ratios':>18}{'of it call us':>15}")
    base = rows["arthro"]
    for name, row in rows.items():
        ratios = f"{row[0] / base[0]:.1f} x {row[1] / base[1]:.1f} x"
        print(f"{name:12}{row[0]:18.2f}{row[1]:14.2f}{ratios:>18}{row[2]:15.2f}")


def ours(criterion: pathlib.Path) -> tuple[float, float, float]:
    def mean_us(name: str) -> float:
        estimates = json.loads((criterion / "shaft" / name / "new" / "estimates.json").read_text())
        return estimates["mean"]["point_estimate"] / 1000.0

    return mean_us("intersection"), mean_us("distance"), 0.0


def placed(knee: dict) -> list[tuple[np.ndarray, np.ndarray, float]]:
    """Rotation (z along the axis), middle and length of every shaft."""
    poses = []
    for start, end in np.asarray(knee["axes"]):
        length = np.linalg.norm(end - start)
        z = (end - start) / length
        x = np.cross(z, [0.0, 0.0, 1.0])
        x /= np.linalg.norm(x)
        poses.append((np.column_stack([x, np.cross(z, x), z]), 0.5 * (start + end), length))
    return poses


def timed(ask, poses) -> tuple[float, list]:
    """Microseconds a shaft, the best of some rounds, and the answers."""
    best = float("inf")
    for _ in range(ROUNDS):
        began = time.perf_counter()
        answers = [ask(rotation, middle) for rotation, middle, _ in poses]
        best = min(best, time.perf_counter() - began)
    return best * 1e6 / len(poses), answers


def same_hits(name: str, knee: dict, hits: list[bool], distances: list[float]) -> None:
    differing = [
        index
        for index, (theirs, mine) in enumerate(zip(hits, knee["hits"]))
        if theirs != mine and abs(distances[index]) > TOUCH_MM
    ]
    if differing:
        sys.exit(f"{name} and arthro differ on shafts {differing[:5]}, {len(differing)} of {len(hits)}")
    away = [(theirs, mine) for theirs, mine in zip(distances, knee["distances_mm"]) if 0.1 < theirs < 6.0]
    errors = np.abs(np.diff(np.asarray(away))) if away else np.zeros(1)
    print(f"{name}: {sum(hits)} of {len(hits)} hit, as ours; distances differ by {errors.mean():.3f} mm in the mean, {errors.max():.3f} mm at most")


def fcl_peer(knee: dict) -> tuple[float, float, float]:
    import fcl

    mesh = fcl.BVHModel()
    vertices, triangles = np.asarray(knee["vertices"]), np.asarray(knee["triangles"])
    mesh.beginModel(len(vertices), len(triangles))
    mesh.addSubModel(vertices, triangles)
    mesh.endModel()
    bone = fcl.CollisionObject(mesh)
    poses = placed(knee)
    shaft = fcl.CollisionObject(fcl.Capsule(knee["radius_mm"], poses[0][2]))

    def place(rotation, middle):
        shaft.setTransform(fcl.Transform(rotation, middle))

    def hit(rotation, middle):
        place(rotation, middle)
        return fcl.collide(shaft, bone, fcl.CollisionRequest(), fcl.CollisionResult()) > 0

    def distance(rotation, middle):
        place(rotation, middle)
        return fcl.distance(shaft, bone, fcl.DistanceRequest(), fcl.DistanceResult())

    call_us, _ = timed(place, poses)
    hit_us, hits = timed(hit, poses)
    distance_us, distances = timed(distance, poses)
    same_hits("python-fcl", knee, hits, distances)
    return hit_us, distance_us, call_us


def coal_peer(knee: dict) -> tuple[float, float, float]:
    import coal

    mesh = coal.BVHModelOBBRSS()
    vertices, triangles = np.asarray(knee["vertices"]), np.asarray(knee["triangles"])
    points = coal.StdVec_Vec3s()
    for vertex in vertices:
        points.append(vertex)
    faces = coal.StdVec_Triangle()
    for a, b, c in triangles.tolist():
        faces.append(coal.Triangle(a, b, c))
    mesh.beginModel(len(faces), len(points))
    mesh.addSubModel(points, faces)
    mesh.endModel()
    poses = placed(knee)
    capsule = coal.Capsule(knee["radius_mm"], poses[0][2])
    still = coal.Transform3s()
    pose = coal.Transform3s()

    def place(rotation, middle):
        pose.setRotation(rotation)
        pose.setTranslation(middle)

    def hit(rotation, middle):
        place(rotation, middle)
        return coal.collide(capsule, pose, mesh, still, coal.CollisionRequest(), coal.CollisionResult()) > 0

    def distance(rotation, middle):
        place(rotation, middle)
        return coal.distance(capsule, pose, mesh, still, coal.DistanceRequest(), coal.DistanceResult())

    call_us, _ = timed(place, poses)
    hit_us, hits = timed(hit, poses)
    distance_us, distances = timed(distance, poses)
    same_hits("coal", knee, hits, distances)
    return hit_us, distance_us, call_us


if __name__ == "__main__":
    main()
