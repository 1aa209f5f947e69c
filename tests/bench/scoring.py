"""How an answer is judged: against the truth of its case, then over all cases of a method.

Solved is what is within all three limits. TRE is the root mean square distance between where the answer and where the truth put
the points of the whole source, in mm of the source.
"""

import dataclasses

import numpy as np

from dataset import LEVELS
from similarity import Similarity, angle_between_deg

ROTATION_LIMIT_DEG = 5.0
CENTROID_LIMIT_MM = 2.0
SCALE_LIMIT = 0.03


@dataclasses.dataclass(frozen=True)
class Answer:
    """What a method says of one case, in the frames and units of the case's files."""

    similarity: Similarity | None  # none if the method gave none
    seconds: float
    verdict: str | None = None  # of a method that judges itself
    note: str = ""


@dataclasses.dataclass(frozen=True)
class Score:
    """One answer against the truth. Errors are infinite where there is no answer."""

    case: str
    level: str
    solved: bool
    rotation_deg: float
    centroid_mm: float
    scale_error: float
    tre_mm: float
    seconds: float
    verdict: str | None
    note: str


def score(case, answer):
    """The answer to this case against its truth."""
    found, truth = answer.similarity, case.truth
    errors = [np.inf] * 4
    if found is not None and found.is_finite():
        errors = [
            angle_between_deg(found.rotation, truth.rotation),
            np.linalg.norm(found.apply(case.centroid) - truth.apply(case.centroid)) / truth.scale,
            abs(found.scale / truth.scale - 1),
            np.sqrt(((found.apply(case.source) - truth.apply(case.source)) ** 2).sum(1).mean()) / truth.scale,
        ]
    rotation_deg, centroid_mm, scale_error, tre_mm = map(float, errors)
    solved = rotation_deg < ROTATION_LIMIT_DEG and centroid_mm < CENTROID_LIMIT_MM and scale_error < SCALE_LIMIT
    return Score(case.id, case.level, solved, rotation_deg, centroid_mm, scale_error, tre_mm, answer.seconds, answer.verdict, answer.note)


def median(values):
    """None where there is nothing to take it of."""
    return float(np.median(values)) if len(values) else None


def summary(scores):
    """The figures of one method over its cases."""
    levels = {level: [one for one in scores if one.level == level] for level in LEVELS}
    judged = any(one.verdict is not None for one in scores)
    return {
        "cases": {level: len(ones) for level, ones in levels.items()},
        "solved": {level: sum(one.solved for one in ones) for level, ones in levels.items()},
        "tre_solved_median_mm": {level: median([one.tre_mm for one in ones if one.solved]) for level, ones in levels.items()},
        "tre_median_mm": {level: median([one.tre_mm for one in ones]) for level, ones in levels.items()},
        "tre_all_median_mm": median([one.tre_mm for one in scores]),
        "wrong_accepts": sum(one.verdict == "ACCEPT" and not one.solved for one in scores) if judged else None,
        "solved_rejects": sum(one.verdict == "REJECT" and one.solved for one in scores) if judged else None,
        "reviews": sum(one.verdict == "REVIEW" for one in scores) if judged else None,
        "seconds_median": median([one.seconds for one in scores]),
        "seconds_p95": float(np.quantile([one.seconds for one in scores], 0.95)),
    }


def time_ratio(ours, theirs):
    """Median over the cases that both ran of our time over theirs in the same run."""
    seconds = {one.case: one.seconds for one in theirs}
    return median([one.seconds / seconds[one.case] for one in ours if one.case in seconds])
