"""Registration on cases with known truth, arthro and its peers side by side: `registration.py ARTHRO [FOLDER] [options]`.

Every method sees every case in the same run, one after the other on the same core, so that times can be compared as ratios. The
peers are given the true scale; arthro is given none, a range of +-10 %, or the truth. A peer's time is that of its call on clouds in
memory; arthro's is that of a process, with its start and the reading of both files. Nothing here passes or fails by time.
"""

import argparse
import dataclasses
import json
import math
import os
import pathlib
import platform
import re
import sys
import time

from cores import CORES  # before the peers

import dataset
import kiss_matcher_peer as kiss
import open3d_peers as o3d
import scoring
import small_gicp_peer as gicp
import table
from arthro_cli import Arthro, scale_argument
from scoring import Answer

VERSIONS = {"open3d": o3d.VERSION, "kiss-matcher": kiss.VERSION, "small-gicp": gicp.VERSION, "python": platform.python_version()}
GLOBAL = "global, the true scale given"
FINE = f"fine stage alone, from {dataset.START_DEG:g} deg, {dataset.START_MM:g} mm, {dataset.START_SCALE * 100:g} % off (rigid: true scale)"
OURS = "arthro"
MODES = {"free": f"scale {dataset.FREE_SCALE[0]} to {dataset.FREE_SCALE[1]}", "prior": "scale +-10 %", "known": "scale known"}


@dataclasses.dataclass(frozen=True)
class Method:
    """What is run on each case."""

    key: str
    title: str
    group: str
    run: object  # Case -> Answer


def peer(key, title, group, call):
    """A method whose call takes a problem at the true scale; only the call is timed."""

    def run(case):
        problem = dataset.problem(case)
        began = time.perf_counter()
        view_from_model = call(problem)
        seconds = time.perf_counter() - began
        return Answer(view_from_model.enlarged(case.truth.scale), seconds)

    return Method(key, title, group, run)


def then_scaled_icp(coarse):
    """A coarse call followed by the fine stage of the paper."""
    return lambda problem: o3d.scaled_icp_from_model(problem, coarse(problem))


def ours(arthro, pipeline, mode):
    """One pipeline of arthro with one knowledge of the scale."""
    return Method(
        f"arthro-{pipeline}-{mode}",
        f"{pipeline}, {MODES[mode]}",
        OURS,
        lambda case: arthro.register(case, pipeline, scale_argument(case, mode)),
    )


def methods(arthro):
    """All of them, in the order of the table."""
    return [
        peer("open3d-ransac", "Open3D FPFH + RANSAC", GLOBAL, o3d.ransac),
        peer("open3d-ransac-icp", "  then Open3D scaled ICP", GLOBAL, then_scaled_icp(o3d.ransac)),
        peer("open3d-fgr", "Open3D FPFH + FGR", GLOBAL, o3d.fast_global),
        peer("open3d-fgr-icp", "  then Open3D scaled ICP", GLOBAL, then_scaled_icp(o3d.fast_global)),
        peer("kiss-matcher", "KISS-Matcher", GLOBAL, kiss.estimate),
        peer("kiss-matcher-icp", "  then Open3D scaled ICP", GLOBAL, then_scaled_icp(kiss.estimate)),
        peer("fine-model-to-view", "Open3D scaled ICP, model to view", FINE, lambda p: o3d.scaled_icp_from_model(p, p.scaled_start)),
        peer("fine-view-to-model", "Open3D scaled ICP, view to model", FINE, lambda p: o3d.scaled_icp_from_view(p, p.scaled_start)),
        peer("fine-plane", "Open3D plane ICP, Tukey, rigid", FINE, lambda p: o3d.plane_icp_from_view(p, p.start)),
        peer("fine-gicp", "small_gicp GICP, rigid", FINE, lambda p: gicp.gicp(p, p.start)),
        *(ours(arthro, pipeline, mode) for pipeline in ("robust", "paper") for mode in MODES),
    ]


def run(chosen, cases):
    """The scores of each method, with progress on a terminal."""
    scores = {method.key: [] for method in chosen}
    for number, case in enumerate(cases, 1):
        for method in chosen:
            one = scoring.score(case, method.run(case))
            scores[method.key].append(one)
            if one.note and one.verdict is None:
                print(f"{case.id}: {method.key}: {one.note}", file=sys.stderr)
        if sys.stderr.isatty():
            print(f"\r{number}/{len(cases)} cases", end="" if number < len(cases) else "\n", file=sys.stderr, flush=True)
    return scores


def compared(chosen, scores):
    """Time of each of ours over that of each global peer, by case in this run."""
    own_keys = [method.key for method in chosen if method.group == OURS]
    peer_keys = [method.key for method in chosen if method.group == GLOBAL]
    return {theirs: {own: scoring.time_ratio(scores[own], scores[theirs]) for own in own_keys} for theirs in peer_keys}


def report(name, chosen, cases, summaries, ratio):
    """What a person reads."""
    print(f"{name}: {len(cases)} cases; solved if rotation < {scoring.ROTATION_LIMIT_DEG:g} deg, centroid <", end=" ")
    print(f"{scoring.CENTROID_LIMIT_MM:g} mm, scale < {scoring.SCALE_LIMIT * 100:g} %; TRE in mm of the source")
    print(", ".join(f"{program} {version}" for program, version in VERSIONS.items()))
    print()
    print(table.results(chosen, summaries))
    if any(ratio.values()):
        print()
        print(table.ratios(chosen, ratio))


def pattern(text):
    """A regular expression."""
    try:
        return re.compile(text)
    except re.error as error:
        raise argparse.ArgumentTypeError(f"{text!r} is no regular expression: {error}") from error


def arguments():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("arthro", help="the binary")
    default = os.environ.get("ARTHRO_DATA")
    parser.add_argument(
        "folder",
        type=pathlib.Path,
        nargs="?",
        default=pathlib.Path(default) / "registration" if default else None,
        help="clouds and cases.json; $ARTHRO_DATA/registration if left out",
    )
    parser.add_argument("--only", type=pattern, help="run only methods whose key matches: " + ", ".join(m.key for m in methods(None)))
    parser.add_argument("--cases", type=int, help="run only so many cases of each level")
    parser.add_argument("--threads", type=int, default=1, help="cores that arthro may use; the peers have one")
    parser.add_argument("--json", type=pathlib.Path, help="write every score and summary to this file")
    options = parser.parse_args()
    if options.folder is None or not (options.folder / "cases.json").is_file():
        parser.error(f"no cases.json in {options.folder or 'ARTHRO_DATA, which is not set'}; name a folder of cases")
    if options.cases is not None and options.cases < 1:
        parser.error(f"--cases {options.cases} is not at least 1")
    if not 1 <= options.threads <= len(CORES):
        parser.error(f"--threads {options.threads} is not within 1..{len(CORES)}, the cores of this process")
    return options


def main():
    options = arguments()
    arthro = Arthro(options.arthro, frozenset(CORES[: options.threads]))
    chosen = [method for method in methods(arthro) if options.only is None or options.only.search(method.key)]
    lacks = arthro.lacks() if any(method.group == OURS for method in chosen) else None
    if lacks:
        print(f"bench: arthro is NOT MEASURED: {lacks}", file=sys.stderr)
        chosen = [method for method in chosen if method.group != OURS]
    if not chosen:
        print("bench: no method is left to run", file=sys.stderr)
        return 1

    name, cases = dataset.read(options.folder, options.cases)
    scores = run(chosen, cases)
    summaries = {key: scoring.summary(ones) for key, ones in scores.items()}
    ratio = compared(chosen, scores)
    report(name, chosen, cases, summaries, ratio)
    if options.json:
        record = {
            "set": name,
            "versions": VERSIONS,
            "arthro_threads": options.threads,
            "methods": {method.key: {"title": method.title.strip(), "group": method.group, **summaries[method.key]} for method in chosen},
            "time_ratios": ratio,
            "scores": {key: [dataclasses.asdict(one) for one in ones] for key, ones in scores.items()},
        }
        options.json.write_text(json.dumps(finite(record), indent=1) + "\n")
    if lacks:
        print(f"bench: arthro is NOT MEASURED: {lacks}", file=sys.stderr)
    return 1 if lacks else 0


def finite(value):
    """The same with null for what JSON cannot say."""
    if isinstance(value, dict):
        return {key: finite(one) for key, one in value.items()}
    if isinstance(value, list):
        return [finite(one) for one in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


if __name__ == "__main__":
    sys.exit(main())
